"""Description of a cube in its attributes: title, source, history, recordings, environments."""

import json
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final

import numpy as np
import xarray as xr

from analysis.tables import origin_of, recordings
from emgface import __version__
from emgface.signals.montage import MontageParameters, montage_of
from emgface.study.table import Recording

REFERENCES: Final = (
    "Eskes et al. 2017, Simulation of facial expressions using person-specific sEMG signals "
    "controlling a biomechanical face model, doi:10.17605/OSF.IO/DUX3W (data)"
)


def merged_environments(cubes: Iterable[xr.Dataset]) -> dict[str, Any]:
    """Combine the attribute ``environments`` of cubes, in the order of their digests."""
    found: dict[str, Any] = {}
    for cube in cubes:
        found |= json.loads(str(cube.attrs.get("environments", "{}")))
    return dict(sorted(found.items()))


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


def described(
    cube: xr.Dataset,
    *,
    name: str,
    face: Mapping[str, str],
    configuration: str,
    environments: Mapping[str, Any],
    montage: str,
) -> xr.Dataset:
    """Add title, sources, history and environments to a cube.

    `face` contains ``name``, ``origin`` and ``digest``; `configuration` is JSON; `environments` and
    `montage` are results of `merged_environments` and `montages`. The attributes ``title``,
    ``source``, ``history``, ``references`` and ``Conventions`` follow the CF conventions (1.11,
    section 2.6); ``date_created`` is the date of the last result, so that a cube assembled again is
    identical.
    """
    which = recordings(origin_of(cube))
    versions = sorted({str(one["emgface"]) for one in environments.values()}) or [__version__]
    return cube.assign_attrs(
        Conventions="CF-1.11",
        title=f"{name}: scores of the simulated face against {which}",
        source=f"emgface {' and '.join(versions)}; {which}; face {face['name']}",
        history="\n".join(_history(cube, environments)),
        references=REFERENCES,
        date_created=max((text for text in cube["computed"].values.flat if text), default=""),
        name=name,
        face=face["name"],
        face_origin=face["origin"],
        face_digest=face["digest"],
        configuration=configuration,
        environments=json.dumps(environments),
        montage=montage,
    )


def _history(cube: xr.Dataset, environments: Mapping[str, Any]) -> list[str]:
    """One line per environment, ordered by the date of its last result."""
    rows = [
        (str(date), set(str(which).split()))
        for date, which in zip(
            cube["computed"].values.flat, cube["computed_with"].values.flat, strict=True
        )
        if date
    ]
    lines: list[str] = []
    for digest, one in environments.items():
        dates = sorted(date for date, which in rows if digest in which)
        if dates:
            count = "1 trial" if len(dates) == 1 else f"{len(dates)} trials"
            lines.append(
                f"{dates[-1]}: emgface {one['emgface']} (environment {digest}) computed results of "
                f"{count}, the first at {dates[0]}"
            )
    return sorted(lines)
