"""Study of the paper on a folder with its recordings: files joined to trials, and the configuration.

EMG and markers of a trial may be files of different programs. Files that state the same volunteer,
instruction and repetition are joined to one recording, if one has EMG and the other markers.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import xarray as xr

from emgface.choices import configure
from emgface.errors import DataError, EmgfaceError
from emgface.files import named_file
from emgface.recordings.dataset import read_recordings, write_recording
from emgface.recordings.synchronise import synchronise
from emgface.study.configuration import StudyConfiguration
from emgface.study.table import Place, place_of


@dataclass
class Joined:
    """Recordings of all trials, and files that could not be used with the reasons."""

    paths: list[Path] = field(default_factory=list[Path])
    omitted: list[str] = field(default_factory=list[str])


def join_recordings(
    folder: Path, out: Path, *, mapping: Path | None = None, offset: float = 0.0
) -> Joined:
    """Join the files of a folder to one recording per trial, written to the folder `out`.

    `mapping` is a mapping file or a pattern of file names (`read_recording`). Markers of another file
    than the EMG have times of their own: t_emg = `offset` + t_marker [s]; both start at 0 by default.
    A trial that lacks EMG or markers, or has one of them twice, is omitted with the reason. Raises
    DataError if the folder has no recording, or none is complete.
    """
    recordings: dict[Place, dict[str, tuple[Path, xr.Dataset]]] = {}
    result, twice = Joined(), set[Place]()
    for path, read in read_recordings(folder, mapping=mapping):
        try:
            if isinstance(read, EmgfaceError):
                raise read
            place = place_of(read, path.name)
        except EmgfaceError as error:
            result.omitted.append(f"{path.name}: {error}")
            continue
        parts = recordings.setdefault(place, {})
        for name in ("emg", "position"):
            if name not in read:
                continue
            if name in parts:
                twice.add(place)
                result.omitted.append(
                    f"{path.name}: {name} of {' '.join(map(str, place))} is also in "
                    f"{parts[name][0].name}, expected one file: remove or move the other"
                )
            else:
                parts[name] = path, read
    for place, parts in sorted(recordings.items()):
        if place in twice:
            continue
        try:
            recording = _joined(place, parts, offset)
            result.paths.append(write_recording(recording, named_file(out, *place, suffix=".nc")))
        except EmgfaceError as error:
            result.omitted.append(f"{' '.join(map(str, place))}: {error}")
    if not result.paths:
        raise DataError(
            f"no trial in {folder} has EMG and markers, expected both for each volunteer, instruction "
            f"and repetition: {'; '.join(result.omitted[:3])}"
        )
    return result


def _joined(
    place: Place, parts: Mapping[str, tuple[Path, xr.Dataset]], offset: float
) -> xr.Dataset:
    """One recording of a trial."""
    if lacking := [name for name in ("emg", "position") if name not in parts]:
        there = ", ".join(sorted({path.name for path, _ in parts.values()}))
        raise DataError(
            f"{' and '.join(lacking)} not found next to {there}, expected a further file of the same "
            "volunteer, instruction and repetition: check the names of the files, or the mapping"
        )
    (first, emg), (second, position) = parts["emg"], parts["position"]
    if first == second:
        return emg
    own = position[["position"]]
    united = xr.merge([emg.drop_attrs(deep=False), own.drop_attrs(deep=False)])
    origins = {str(each.attrs.get("origin", "measured")) for each in (emg, position)}
    attrs: dict[str, Any] = {**position.attrs, **emg.attrs}
    attrs["source"] = f"{first.name}, {second.name}"
    attrs["origin"] = "simulated" if "simulated" in origins else "measured"
    volunteer, instruction, repetition = place
    attrs |= {"volunteer": volunteer, "instruction": instruction, "repetition": repetition}
    return synchronise(united.assign_attrs(attrs), offset)


def published_study(recordings: Path, **changes: Any) -> StudyConfiguration:
    """Configure the published study: its strategies, and sigma_max from 300 kPa, one per volunteer.

    All other parameters are the defaults, in which the ambiguities of the paper are settled; `changes`
    replace tables, such as ``face``.
    """
    values: dict[str, Any] = {
        "name": "published study",
        "strategies": ["act_all", "act_3", "act_rel"],
        "recordings": {"folder": recordings.resolve()},
        "simulation": {"sigma_max": "published", "sigma_max_policy": {"scope": "volunteer"}},
    }
    for name, change in changes.items():
        values[name] = {**values.get(name, {}), **change}
    return configure(StudyConfiguration, values, where="published study")
