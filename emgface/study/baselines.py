"""Baselines, ceilings and individual measures of a study, from stored motions.

There are two stages: the typical motion of each volunteer at each instruction, and the comparison
of every trial with its baselines. Neither simulates motions.
"""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np
import xarray as xr

from analysis.baselines import VARIABLES, mean_of, with_baselines
from analysis.errors import AnalysisError
from analysis.individual import instants
from analysis.registration import mean_motion
from emgface.errors import StoreError
from emgface.study.against_baselines import Person, Recorded, compared
from emgface.study.digest import text_digest
from emgface.study.journal import Entry
from emgface.study.motions import StoredMotion
from emgface.study.outcomes import Run
from emgface.study.stages import ALIGNED, SCORES, Laboratory
from emgface.study.store import Result, Stage
from emgface.study.table import PlannedTrial

_CODE = (
    *ALIGNED.modules,
    "analysis.registration",
    "analysis.individual",
    "emgface.study.against_baselines",
)

TYPICAL = Stage("typical", (*_CODE, __name__))
BASELINES = Stage("baselines", (*_CODE, *SCORES.modules, "analysis.baselines", __name__))

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
    typical: Mapping[Person, str] = field(default_factory=dict[Person, str])

    def recorded(self, laboratory: Laboratory) -> dict[Person, dict[int, Recorded]]:
        """List the scored trials by instruction and repetition."""
        persons: dict[Person, dict[int, Recorded]] = defaultdict(dict)
        for trial in self.trials:
            entry = self.entries[*trial.place, trial.strategy]
            if entry.status != "ok" or trial.recording is None:
                continue
            of = persons[trial.place[:2]]
            one = of.setdefault(trial.place[2], Recorded(trial.recording, {}))
            one.motions[trial.strategy] = StoredMotion(laboratory, trial, entry, self.extent)
        return persons


def add_baselines(
    laboratory: Laboratory,
    cube: xr.Dataset,
    planned: Sequence[PlannedTrial],
    entries: Mapping[tuple[str, str, int, str], Entry],
    extents: Mapping[str, Result],
    run: Run,
) -> xr.Dataset:
    """Add the baselines of its scores, computed from stored motions, to the cube of a study.

    `planned` and `entries` are the trials of the cube and their outcomes; `extents` contains the
    range of the features per volunteer, if required. The volunteers are the jobs of the workers of
    `run`. The result has the variables of `analysis.baselines.VARIABLES`, NaN for trials that were
    not scored.
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
    of = dict(
        zip(by_volunteer, run.computed(typical_motions, laboratory, jobs, "typical"), strict=True)
    )
    typical = {
        (volunteer, i): digest for volunteer, found in of.items() for i, digest in found.items()
    }
    jobs = [
        replace(job, typical=_others(volunteer, typical))
        for volunteer, job in zip(by_volunteer, jobs, strict=True)
    ]
    found = run.computed(baselines, laboratory, jobs, "baselines")
    return with_baselines(cube, _collected(cube, [one for each in found for one in each]))


def _others(volunteer: str, typical: Mapping[Person, str]) -> dict[Person, str]:
    """Typical motions of at most `MOST_OTHERS` other volunteers, the same in every run."""
    names = {name for name, _ in typical} - {volunteer}
    chosen = set(sorted(names, key=lambda name: text_digest(f"{volunteer} {name}"))[:MOST_OTHERS])
    return {person: digest for person, digest in typical.items() if person[0] in chosen}


def typical_motions(laboratory: Laboratory, of: _Volunteer) -> dict[str, str]:
    """Store the typical motions of one volunteer; return their digests by instruction."""
    found: dict[str, str] = {}
    for person, trials in of.recorded(laboratory).items():
        try:
            found[person[1]] = _typical(laboratory, person, trials).digest
        except AnalysisError as error:
            laboratory.report(f"No typical motion of {' '.join(person)}: {error}")
    return found


def baselines(laboratory: Laboratory, of: _Volunteer) -> list[xr.Dataset]:
    """Store and return the baselines of one volunteer, a dataset per instruction."""
    persons = of.recorded(laboratory)
    found: list[xr.Dataset] = []
    for person, trials in persons.items():
        others = {p: digest for p, digest in of.typical.items() if p[1] == person[1]}
        elsewhere = {p[1]: r for p, r in persons.items() if p != person}
        found.append(_baselines(laboratory, person, trials, others, elsewhere).dataset)
    return found


def _stored(laboratory: Laboratory, digest: str) -> xr.Dataset:
    """Read a typical motion, which another worker may have computed."""
    found = laboratory.store.read(TYPICAL.name, digest)
    if found is None:
        raise StoreError(
            f"the typical motion {digest} was changed or removed while the study ran: run the same "
            "command again, which computes it again"
        )
    return found


def _parameters(laboratory: Laboratory) -> dict[str, Any]:
    return {
        "alignment": laboratory.study.alignment.model_dump(mode="json"),
        **laboratory.limits,
        "head_frame": laboratory.study.signals.head_frame.model_dump(mode="json"),
    }


def _typical(laboratory: Laboratory, person: Person, of: Mapping[int, Recorded]) -> Result:
    """Mean measured motion of a volunteer over repetitions, and its mean instants."""
    inputs = {"face": laboratory.face_digest}
    for repetition, one in of.items():
        inputs |= one.digests(str(repetition))

    def compute() -> xr.Dataset:
        least = laboratory.study.score.smallest_motion
        mean = mean_motion([one.measured for one in of.values()], laboratory.alignment)
        clock = np.array(
            [
                np.multiply(instants(one.measured, smallest_motion=least), one.pace)
                for one in of.values()
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
        TYPICAL, inputs, _parameters(laboratory), compute, label=" ".join(person)
    )


def _baselines(
    laboratory: Laboratory,
    person: Person,
    of: Mapping[int, Recorded],
    others: Mapping[Person, str],
    elsewhere: Mapping[str, Mapping[int, Recorded]],
) -> Result:
    """Baselines of the trials of one volunteer and instruction."""
    inputs = {"face": laboratory.face_digest}
    inputs |= {f"typical {' '.join(other)}": digest for other, digest in others.items()}
    for instruction, trials in {person[1]: of, **elsewhere}.items():
        for repetition, one in trials.items():
            inputs |= one.digests(f"{instruction} {repetition}")
    return laboratory.store.get_or_compute(
        BASELINES,
        inputs,
        {
            **_parameters(laboratory),
            "form": laboratory.study.score.form,
            "instruction": person[1],  # baselines of an instruction depend on all instructions
        },
        lambda: compared(
            laboratory, person, of, [_stored(laboratory, d) for d in others.values()], elsewhere
        ),
        label=" ".join(person),
    )


def _collected(cube: xr.Dataset, found: Sequence[xr.Dataset]) -> dict[str, xr.DataArray]:
    """Combine the values of all volunteers and instructions in one array per variable."""
    collected: dict[str, xr.DataArray] = {}
    for name, (dims, _, _) in VARIABLES.items():
        if name == "skill":
            continue
        shape = tuple(cube.sizes[dim] for dim in dims)
        data = xr.DataArray(np.full(shape, np.nan), dims=dims, coords={d: cube[d] for d in dims})
        for one in found:
            data.loc[{dim: one[dim] for dim in dims}] = one[name].transpose(*dims)
        collected[name] = data
    return collected
