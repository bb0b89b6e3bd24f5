"""Cube of a study, assembled from its journal and its store, some volunteers at a time."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import xarray as xr

from analysis.axes import combine_cubes
from analysis.cube import build_cube
from analysis.trial import Origin
from emgface.errors import DataError
from emgface.muscles import LIP_MARKERS
from emgface.run.journal import read_trial
from emgface.schema.parts import write_netcdf_parts
from emgface.study.axes import Label
from emgface.study.baselines import with_stored_baselines
from emgface.study.configuration import StudyConfiguration
from emgface.study.description import Origins, described, montages, with_recordings
from emgface.study.formants import with_stored_formants
from emgface.study.intake import Intake
from emgface.study.outcomes import Entries
from emgface.study.stages import Laboratory
from emgface.study.table import PlannedTrial, Recording

AT_A_TIME: Final = 16  #: volunteers of a part of the cube, which is in memory


@dataclass(frozen=True)
class Computed:
    """Outcomes of the trials of one variant, and the digests of what is derived from them."""

    labels: tuple[Label, ...]
    laboratory: Laboratory
    entries: Entries
    baselines: Mapping[str, Sequence[str]]  #: digests of stored baselines, by volunteer
    #: digests of stored formants by trial; None if the study has none
    formants: Mapping[tuple[str, str, int, str], str] | None


def write_cube(
    path: Path,
    study: StudyConfiguration,
    computed: Sequence[Computed],
    intake: Intake,
    trials: Sequence[PlannedTrial],
    checkpoint: Callable[[], None],
) -> Path:
    """Write the cube of all variants of a study, of which `AT_A_TIME` volunteers are in memory.

    `checkpoint` is called before each part and may raise an exception, which leaves an existing
    file as it was. Raises StoreError if the journal or the store was changed meanwhile.
    """
    recordings: dict[str, list[Recording]] = {}
    for recording in intake.recordings:
        recordings.setdefault(recording.place[0], []).append(recording)
    places: dict[str, dict[tuple[str, str, int, str], None]] = {}
    for trial in trials:
        places.setdefault(trial.place[0], {})[*trial.place, trial.strategy] = None
    fixed = {
        "instructions": list(dict.fromkeys(t.place[1] for t in trials)),
        "repetitions": sorted({t.place[2] for t in trials}),
        "strategies": list(computed[0].laboratory.study.strategy_names),
        "markers": list(LIP_MARKERS),
        "origin": _origin(intake),
        "incisor": study.face.head is not None,
    }
    origins, common = Origins(), dict[str, Any]()

    def of_variant(one: Computed, chosen: Sequence[str]) -> xr.Dataset:
        labels = [place for volunteer in chosen for place in places[volunteer]]
        results = (read_trial(one.entries[place]) for place in labels)
        cube = build_cube(results, volunteers=chosen, **fixed)
        cube = with_recordings(cube, [r for v in chosen for r in recordings.get(v, [])])
        cube = with_stored_baselines(
            cube, one.laboratory, [d for v in chosen for d in one.baselines.get(v, [])]
        )
        if one.formants is not None:
            found = {place: one.formants[place] for place in labels if place in one.formants}
            cube = with_stored_formants(cube, one.laboratory, found)
        return cube

    def parts() -> Iterator[xr.Dataset]:
        names = list(places)
        for start in range(0, len(names), AT_A_TIME):
            checkpoint()
            chosen = names[start : start + AT_A_TIME]
            cubes = {one.labels: of_variant(one, chosen) for one in computed}
            cube = _combined(study, cubes) if study.axis else cubes[computed[0].labels]
            environments = [str(one.attrs["environments"]) for one in cubes.values()]
            origins.add(cube, environments)
            for name, value in cube.attrs.items():
                known = common.setdefault(str(name), value)
                if name != "environments" and not np.array_equal(known, value):
                    raise DataError(
                        f"trials of {chosen[0]} have {name} = {value!r}, others {known!r}: "
                        "run all trials of a study with the same parameters"
                    )
            yield cube

    def attrs() -> dict[str, Any]:
        face = computed[0].laboratory
        return described(
            common | ({"world": intake.world} if intake.world else {}),
            name=study.name,
            face={
                "name": str(face.face.attrs["name"]),
                "origin": str(face.face.attrs["origin"]),
                "digest": face.face_digest,
            },
            configuration=study.model_dump_json(),
            origins=origins,
            montage=montages(intake.recordings, study.signals.montage),
        )

    return write_netcdf_parts(parts(), path, "cube", "volunteer", attrs)


def _combined(study: StudyConfiguration, cubes: dict[tuple[Label, ...], xr.Dataset]) -> xr.Dataset:
    """Combine the cubes of all variants along the axes of a study."""
    cube = combine_cubes(cubes, {axis.dim: axis.labels() for axis in study.axis})
    for axis in study.axis:
        numeric = cube[axis.dim].dtype.kind == "f"
        cube[axis.dim].attrs = {"units": "1"} if numeric else {}
        cube[axis.dim].attrs["parameters"] = ", ".join(axis.parameters)
    return cube


def _origin(intake: Intake) -> Origin:
    return "simulated" if intake.origin == "simulated" else "measured"
