"""Baselines, ceilings and individual measures of a study, from stored motions.

There are two stages: the typical motions of each volunteer at each instruction, measured and
simulated with each strategy, and the comparison of every trial with its baselines. Neither
simulates motions.
"""

from bisect import bisect_right
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import netCDF4
import numpy as np
import xarray as xr

from analysis.baselines import BASELINE_VARIABLES, mean_of, with_baselines
from analysis.cube import TRIAL_DIMS
from analysis.errors import AnalysisError
from analysis.individual import instants
from analysis.registration import mean_motion
from emgface.muscles import LIP_MARKERS
from emgface.run.digest import text_digest
from emgface.run.journal import Entry
from emgface.run.store import Result, Stage
from emgface.study.against_baselines import Person, Recorded, compared
from emgface.study.motions import StoredMotion, stored, stored_file
from emgface.study.outcomes import StudyRun
from emgface.study.stage_code import ALIGNED, SCORES
from emgface.study.stages import Laboratory
from emgface.study.table import PlannedTrial

TYPICAL = Stage("typical", (*ALIGNED.modules, *SCORES.modules, __name__))
BASELINES = Stage("baselines", TYPICAL.modules)

MOST_OTHERS: Final = 50
"""Largest number of other volunteers in a template, so that its cost does not grow with the study.

The mean of 50 differs from that of all by a seventh of the deviation between persons.
"""


@dataclass(frozen=True)
class _Volunteer:
    """Trials of one volunteer and their outcomes; digests of the typical motions of all others."""

    trials: Sequence[PlannedTrial]
    entries: Mapping[tuple[str, str, int, str], Entry]
    extent: Result | None
    #: digests of the typical motions of others, by volunteer and `_kind`
    typical: Mapping[str, Mapping[str, str]] = field(default_factory=dict[str, Mapping[str, str]])

    def recorded(self, laboratory: Laboratory) -> dict[Person, dict[int, Recorded]]:
        """List the scored trials by instruction and repetition."""
        persons: dict[Person, dict[int, Recorded]] = defaultdict(dict)
        for trial in self.trials:
            entry = self.entries[*trial.place, trial.strategy]
            if entry.status != "ok" or trial.recording is None:
                continue
            repetitions = persons[trial.place[:2]]
            one = repetitions.setdefault(trial.place[2], Recorded(trial.recording, {}))
            one.motions[trial.strategy] = StoredMotion(laboratory, trial, entry, self.extent)
        return persons


def compute_baselines(
    laboratory: Laboratory,
    planned: Sequence[PlannedTrial],
    entries: Mapping[tuple[str, str, int, str], Entry],
    extents: Mapping[str, Result],
    run: StudyRun,
) -> dict[str, list[str]]:
    """Store the baselines of all trials, computed from stored motions; digests by volunteer.

    `planned` and `entries` are the trials of a variant and their outcomes; `extents` contains the
    range of the features per volunteer, if required. The volunteers are the jobs of the workers of
    `run`.
    """
    by_volunteer: dict[str, list[PlannedTrial]] = defaultdict(list)
    for trial in planned:
        by_volunteer[trial.place[0]].append(trial)
    jobs = [
        _Volunteer(
            trials,
            {p: entries[p] for t in trials for p in [(*t.place, t.strategy)]},
            extents.get(v),
        )
        for v, trials in by_volunteer.items()
    ]
    typical = dict(
        zip(by_volunteer, run.computed(typical_motions, laboratory, jobs, "typical"), strict=True)
    )
    others = others_of(by_volunteer, [name for name, motions in typical.items() if motions])
    jobs = [
        replace(job, typical={name: typical[name] for name in others[own]})
        for own, job in zip(by_volunteer, jobs, strict=True)
    ]
    return dict(
        zip(by_volunteer, run.computed(baselines, laboratory, jobs, "baselines"), strict=True)
    )


def others_of(volunteers: Iterable[str], names: Iterable[str]) -> dict[str, list[str]]:
    """Choose at most `MOST_OTHERS` other volunteers of `names` for each of the volunteers.

    Names are on a circle at their digests; the next ones are chosen, so that every volunteer is in
    the same number of templates, and a further volunteer changes only `MOST_OTHERS` of them.
    """
    circle = sorted(names, key=text_digest)
    known, others = set(circle), dict[str, list[str]]()
    for own in volunteers:
        first = bisect_right(circle, text_digest(own), key=text_digest)
        count = min(MOST_OTHERS, len(circle) - (own in known))
        others[own] = sorted((circle[first:] + circle[:first])[:count])
    return others


def with_stored_baselines(
    cube: xr.Dataset, laboratory: Laboratory, digests: Sequence[str]
) -> xr.Dataset:
    """Add stored baselines to the cube of their volunteers.

    The result has the variables of `analysis.baselines.VARIABLES`, NaN for trials that were not
    scored. Raises StoreError if one was removed or changed.
    """
    tables = [_tables(stored_file(laboratory, BASELINES, digest)) for digest in digests]
    return with_baselines(cube, _collected(cube, tables))


def typical_motions(laboratory: Laboratory, volunteer: _Volunteer) -> dict[str, str]:
    """Store the typical motions of one volunteer; return their digests by `_kind`."""
    digests: dict[str, str] = {}
    for person, trials in volunteer.recorded(laboratory).items():
        for strategy in ("", *laboratory.study.strategy_names):
            if strategy and not any(strategy in one.motions for one in trials.values()):
                continue
            try:
                result = _typical(laboratory, person, trials, strategy)
            except AnalysisError as error:
                of_what = " ".join((*person, strategy)).strip()
                laboratory.report(f"No typical motion of {of_what}: {error}")
                continue
            digests[_kind(person[1], strategy)] = result.digest
    return digests


def _kind(instruction: str, strategy: str = "") -> str:
    """Name of a typical motion of a volunteer: measured, or simulated with a strategy."""
    return f"{instruction}/{strategy}"


def baselines(laboratory: Laboratory, volunteer: _Volunteer) -> list[str]:
    """Store the baselines of one volunteer; return their digests, one per instruction."""
    persons = volunteer.recorded(laboratory)
    stored_digests: list[str] = []
    for person, trials in persons.items():
        others = {
            strategy: {
                name: digests[kind]
                for name, digests in volunteer.typical.items()
                if kind in digests
            }
            for strategy in ("", *laboratory.study.strategy_names)
            for kind in [_kind(person[1], strategy)]
        }
        elsewhere = {p[1]: r for p, r in persons.items() if p != person}
        stored_digests.append(_baselines(laboratory, person, trials, others, elsewhere).digest)
    return stored_digests


def _parameters(laboratory: Laboratory) -> dict[str, Any]:
    return {
        "alignment": laboratory.study.alignment.model_dump(mode="json"),
        **laboratory.limits,
        "head_frame": laboratory.study.signals.head_frame.model_dump(mode="json"),
    }


def _typical(
    laboratory: Laboratory, person: Person, trials: Mapping[int, Recorded], strategy: str = ""
) -> Result:
    """Mean motion of a volunteer over repetitions, and the mean instants of a measured one.

    It is the measured motion if `strategy` is empty, otherwise the motion simulated with it.
    """
    inputs = {"face": laboratory.for_volunteer(person[0]).face_digest}
    for repetition, one in trials.items():
        inputs |= one.digests(str(repetition))

    def driven() -> xr.Dataset:
        motions = [
            one.motions[strategy].dataset for one in trials.values() if strategy in one.motions
        ]
        lips = [motion["position"].sel(marker=list(LIP_MARKERS)) for motion in motions]
        mean = mean_motion(lips, laboratory.alignment)
        return xr.Dataset({"position": mean}, attrs={"repetitions": mean.attrs["contributors"]})

    def measured() -> xr.Dataset:
        least = laboratory.study.score.smallest_motion
        mean = mean_motion([one.measured for one in trials.values()], laboratory.alignment)
        clock = np.array(
            [
                np.multiply(instants(one.measured, smallest_motion=least), one.pace)
                for one in trials.values()
            ]
        )
        onset, peak = (mean_of([column], 1)[0] for column in clock.T[:, :, None])
        return xr.Dataset(
            {
                "position": mean,
                "onset": ((), onset, {"units": "s"}),
                "peak": ((), peak, {"units": "s"}),
            },
            attrs={"repetitions": mean.attrs["contributors"]},
        )

    return laboratory.store.get_or_compute(
        TYPICAL,
        inputs,
        {**_parameters(laboratory), "strategy": strategy},
        driven if strategy else measured,
        label=" ".join((*person, strategy)).strip(),
    )


def _baselines(
    laboratory: Laboratory,
    person: Person,
    own: Mapping[int, Recorded],
    others: Mapping[str, Mapping[str, str]],
    elsewhere: Mapping[str, Mapping[int, Recorded]],
) -> Result:
    """Baselines of the trials of one volunteer and instruction.

    `others` contains the digests of the typical motions of other volunteers, by strategy ("" for
    the measured motions) and volunteer.
    """
    inputs = {"face": laboratory.for_volunteer(person[0]).face_digest}
    for strategy, digests in others.items():
        kind = _kind(person[1], strategy)
        inputs |= {f"typical {other} {kind}": digest for other, digest in digests.items()}
    for instruction, trials in {person[1]: own, **elsewhere}.items():
        for repetition, one in trials.items():
            inputs |= one.digests(f"{instruction} {repetition}")

    def compute() -> xr.Dataset:
        typical = {
            strategy: [stored(laboratory, TYPICAL, digest) for digest in digests.values()]
            for strategy, digests in others.items()
        }
        measured = typical.pop("")
        return compared(laboratory, person, own, measured, typical, elsewhere)

    return laboratory.store.get_or_compute(
        BASELINES,
        inputs,
        {
            **_parameters(laboratory),
            "form": laboratory.study.score.form,
            "instruction": person[1],  # baselines of an instruction depend on all instructions
        },
        compute,
        label=" ".join(person),
    )


_Tables = Mapping[str, tuple[tuple[str, ...], np.ndarray]]


def _tables(path: Path) -> _Tables:
    """Dims and values of all variables of a file; xarray takes several times as long to open it."""
    with netCDF4.Dataset(path) as opened:
        opened.set_auto_mask(False)
        return {name: (v.dimensions, v[...]) for name, v in opened.variables.items()}


def _collected(cube: xr.Dataset, tables: Sequence[_Tables]) -> dict[str, xr.DataArray]:
    """Combine the values of all volunteers and instructions in one array per variable."""
    place = {
        str(dim): {label: k for k, label in enumerate(cube[dim].values.tolist())}
        for dim in cube.dims
    }
    made = {
        name: np.full(tuple(cube.sizes[dim] for dim in dims), np.nan)
        for name, (dims, _, _) in BASELINE_VARIABLES.items()
        if name != "skill"
    }
    for one in tables:
        at = {
            dim: [place[dim][label] for label in one[dim][1].tolist()]
            for dim in (*TRIAL_DIMS, "marker")
        }
        for name, values in made.items():
            dims = BASELINE_VARIABLES[name][0]
            own, data = one[name]
            values[np.ix_(*(at[dim] for dim in dims))] = data.transpose(
                [own.index(dim) for dim in dims]
            )
    return {
        name: xr.DataArray(values, dims=dims, coords={dim: cube[dim] for dim in dims})
        for name, values in made.items()
        for dims in [BASELINE_VARIABLES[name][0]]
    }
