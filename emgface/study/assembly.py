"""Cube of a study, described, assembled from journal and store, some volunteers at a time."""

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import xarray as xr

from analysis.axes import combine_cubes
from analysis.cube import build_cube
from analysis.tables import origin_of, recordings
from analysis.trial import Origin
from emgface import __version__
from emgface.errors import DataError
from emgface.muscles import LIP_MARKERS
from emgface.run.journal import read_trial
from emgface.schema.parts import write_netcdf_parts
from emgface.signals.montage import MontageParameters, montage_of
from emgface.study.baselines import with_stored_baselines
from emgface.study.configuration import Label, StudyConfiguration
from emgface.study.formants import with_stored_formants
from emgface.study.intake import Intake
from emgface.study.outcomes import Entries
from emgface.study.stages import Laboratory
from emgface.study.table import PlannedTrial, Recording

REFERENCES: Final = (
    "Eskes et al. 2017, Simulation of facial expressions using person-specific sEMG signals "
    "controlling a biomechanical face model, doi:10.17605/OSF.IO/DUX3W (data)"
)


class Origins:
    """Environments of the trials of a cube, and the dates of their results."""

    def __init__(self) -> None:
        self.environments: dict[str, Any] = {}
        self.last = ""  #: date of the last result
        self._dates: dict[str, tuple[int, str, str]] = {}

    def add(self, part: xr.Dataset, environments: Iterable[str]) -> None:
        """Add a part of the cube, with the attribute ``environments`` of each of its variants."""
        for text in environments:
            self.environments |= json.loads(text)
        pairs = zip(part["computed"].values.flat, part["computed_with"].values.flat, strict=True)
        for date, which in ((str(date), str(which)) for date, which in pairs if date):
            self.last = max(self.last, date)
            for digest in set(which.split()):
                count, first, last = self._dates.get(digest, (0, date, date))
                self._dates[digest] = count + 1, min(first, date), max(last, date)

    def history(self) -> list[str]:
        """One line per environment, ordered by the date of its last result."""
        return sorted(
            f"{last}: emgface {self.environments[digest]['emgface']} (environment {digest}) computed "
            f"results of {count} trial{'s' if count > 1 else ''}, the first at {first}"
            for digest, (count, first, last) in self._dates.items()
        )


def with_recordings(cube: xr.Dataset, recordings: Sequence[Recording]) -> xr.Dataset:
    """Add the file and the digest of every recording to a cube.

    The text variables ``recording`` and ``recording_digest`` (volunteer, instruction, repetition)
    are empty for trials without a recording.
    """
    dims = ("volunteer", "instruction", "repetition")
    place = [{label: k for k, label in enumerate(cube[dim].values.tolist())} for dim in dims]
    shape = tuple(cube.sizes[dim] for dim in dims)
    files, digests = np.full(shape, "", dtype=object), np.full(shape, "", dtype=object)
    for recording in recordings:
        index = tuple(known[label] for known, label in zip(place, recording.place, strict=True))
        files[index], digests[index] = recording.path.name, recording.digest
    return cube.assign(
        recording=(dims, files.astype(str), {"long_name": "file of the recording"}),
        recording_digest=(dims, digests.astype(str), {"long_name": "digest of its content"}),
    )


def montages(recordings: Sequence[Recording], parameters: MontageParameters) -> str:
    """Describe the recorded channels and the treatment of the others.

    There is one sentence for each montage; several montages state the trials to which they apply.
    """
    trials: dict[str, list[str]] = {}
    for recording in recordings:
        if recording.channels:
            sentence = montage_of(recording.channels, parameters).sentence
            trials.setdefault(sentence, []).append(recording.label)
    if len(trials) == 1:
        return next(iter(trials))
    return ". ".join(
        f"In {len(labels)} recording{'s' if len(labels) > 1 else ''} ({', '.join(labels[:3])}"
        f"{', ...' if len(labels) > 3 else ''}) {sentence}"
        for sentence, labels in trials.items()
    )


def described_cube(
    attrs: Mapping[str, Any],
    *,
    name: str,
    face: Mapping[str, str],
    configuration: str,
    origins: Origins,
    montage: str,
) -> dict[str, Any]:
    """Add title, sources, history and environments to the attributes of a cube.

    `face` contains ``name``, ``origin`` and ``digest``; `configuration` is JSON; `montage` is the
    result of `montages`. The attributes ``title``, ``source``, ``history``, ``references`` and
    ``Conventions`` follow the CF conventions (1.11, section 2.6); ``date_created`` is the date of
    the last result, so that a cube assembled again is identical.
    """
    which = recordings(origin_of(xr.Dataset(attrs=attrs)))
    environments = dict(sorted(origins.environments.items()))
    versions = sorted({str(one["emgface"]) for one in environments.values()}) or [__version__]
    return {
        **attrs,
        "Conventions": "CF-1.11",
        "title": f"{name}: scores of the simulated face against {which}",
        "source": f"emgface {' and '.join(versions)}; {which}; face {face['name']}",
        "history": "\n".join(origins.history()),
        "references": REFERENCES,
        "date_created": origins.last,
        "name": name,
        "face": face["name"],
        "face_origin": face["origin"],
        "face_digest": face["digest"],
        "configuration": configuration,
        "environments": json.dumps(environments),
        "montage": montage,
    }


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
            formants = {place: one.formants[place] for place in labels if place in one.formants}
            cube = with_stored_formants(cube, one.laboratory, formants)
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
        return described_cube(
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
