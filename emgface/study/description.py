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


def described(
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
