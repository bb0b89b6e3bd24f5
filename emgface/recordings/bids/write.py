"""Write recordings to a BIDS dataset: EMG as BDF, markers as motion.tsv, and their tables."""

import math
from collections.abc import Mapping, Sequence
from datetime import datetime, timedelta
from fractions import Fraction
from pathlib import Path
from typing import Any, Final

import edfio
import numpy as np
import xarray as xr

from analysis.tables import origin_of
from emgface.errors import DataError
from emgface.files import replace_file, write_text
from emgface.muscles import AXES, MUSCLE_NAMES
from emgface.recordings.bids.electrodes import LINKS, electrode_tables
from emgface.recordings.bids.names import file_name
from emgface.recordings.bids.rules import (
    BIDS_VERSION,
    ELECTRODE_COLUMNS,
    EMG_COLUMNS,
    MOTION_COLUMNS,
    PARTICIPANT_COLUMNS,
    SCAN_COLUMNS,
)
from emgface.recordings.bids.tables import complete_table, write_json, write_table
from emgface.recordings.labels import note
from emgface.schema.validation import validate
from emgface.signals.filters import check_gaps, sampling_rate

LARGEST_COUNT: Final = 2**23 - 1
"""Largest count of BDF, used for both signs, so that zero volts are zero counts."""
TRACKING: Final = "markers"  #: label of the tracking system
_START: Final = datetime(1970, 1, 1)
_LONGEST_RECORD: Final = 60
_DEFAULTS: Final[dict[str, Any]] = {
    "EMGPlacementScheme": "Other",
    "EMGPlacementSchemeDescription": "Bipolar surface electrodes over the named muscles.",
    "EMGReference": "bipolar",
    "PowerLineFrequency": "n/a",
    "SoftwareFilters": "n/a",
}


def write_bids(
    recording: xr.Dataset,
    root: str | Path,
    *,
    name: str = "Surface EMG and lip markers",
    emg: Mapping[str, Any] | None = None,
    motion: Mapping[str, Any] | None = None,
) -> list[Path]:
    """Write one trial into a BIDS dataset, which is created if it does not exist.

    `recording` has volunteer, instruction and repetition, which become the entities sub, task and
    run. `root` is the folder of the dataset, whose tables of participants and scans are completed,
    and `name` the name of a new one. `emg` and `motion` are further entries of ``*_emg.json`` and
    ``*_motion.json``, for example ``{"PowerLineFrequency": 50, "Manufacturer": "TMSi"}``; they
    replace the defaults. Returns the files of the trial with signals, EMG first.

    Markers are written with all their digits. EMG is quantised to 24 bits of a range that is a
    power of two of microvolts and at least 1 uV: an error of at most 6e-8 of that range, and none
    for values read from such a file. Time is 0 at the first EMG sample; ``*_scans.tsv`` contains
    the lag of the markers to the microsecond. BIDS cannot represent the true activation of
    simulated trials, which is written as netCDF.

    Raises SchemaError or UnitsError if the recording does not fulfil its declaration, SignalError
    if EMG has a gap, which BDF cannot represent, or a clock is not uniform, and DataError if a name
    is not a BIDS label, or the rate is not possible in BDF.
    """
    recording = validate(recording, "recording")
    root = Path(root)
    given = bids_entities(recording)
    folder = root / f"sub-{given['sub']}"
    named = {**given, "tracksys": TRACKING}
    paths = {
        "emg": folder / "emg" / file_name(given, "emg.bdf"),
        "position": folder / "motion" / file_name(named, "motion.tsv"),
    }
    starts = {
        paths[signal]: float(recording[signal][clock][0])
        for signal, clock in (("emg", "time_emg"), ("position", "time_marker"))
        if signal in recording
    }
    if "emg" in recording:
        check_gaps(recording["emg"])
        _record(_rate(recording["time_emg"].values))
    if "position" in recording:
        _rate(recording["time_marker"].values)
    # Signals are removed first and written last: without the lag of the markers, which the table of
    # scans states, or without its markers, a trial that was interrupted would be read as complete.
    for path in paths.values():
        path.unlink(missing_ok=True)
    _begin(root, name, recording)
    first = next(iter(starts.values()))
    scans = [
        (path.relative_to(folder).as_posix(), _instant(start - first))
        for path, start in starts.items()
    ]
    complete_table(folder / f"sub-{given['sub']}_scans.tsv", SCAN_COLUMNS, scans)
    complete_table(root / "participants.tsv", PARTICIPANT_COLUMNS, [(f"sub-{given['sub']}",)])
    if "position" in recording:
        _write_motion(recording["position"], paths["position"], named, recording, motion or {})
    if "emg" in recording:
        _write_emg(recording["emg"], paths["emg"], given, recording, emg or {})
    return list(starts)


def bids_entities(recording: xr.Dataset) -> dict[str, str]:
    """Return the labels of subject (``sub``), ``task`` and ``run`` of a recording.

    Raises DataError if one is absent or is not a BIDS label.
    """
    absent = [n for n in ("volunteer", "instruction", "repetition") if n not in recording.attrs]
    if absent:
        raise DataError(
            f"The recording specifies no {absent[0]}; expected volunteer, instruction and repetition, "
            "which form the file names: specify --subject, --task and --run, or set them as attributes."
        )
    given = {
        "sub": str(recording.attrs["volunteer"]),
        "task": str(recording.attrs["instruction"]),
        "run": f"{int(recording.attrs['repetition']):02d}",
    }
    file_name(given, "emg.bdf")
    return given


def _instant(lag: float) -> str:
    return (_START + timedelta(seconds=lag)).isoformat(timespec="microseconds")


def _common(recording: xr.Dataset, rate: float, samples: int) -> dict[str, Any]:
    """Entries of both JSON files."""
    attrs = recording.attrs
    return {
        "TaskName": attrs["instruction"],
        "SamplingFrequency": rate,
        "RecordingDuration": samples / rate,
        **({"ManufacturersModelName": attrs["device"]} if attrs.get("device") else {}),
        "Origin": attrs["origin"],
        **({"World": attrs["world"]} if attrs.get("world") else {}),
    }


def _write_emg(
    emg: xr.DataArray,
    path: Path,
    given: dict[str, str],
    recording: xr.Dataset,
    further: Mapping[str, Any],
) -> None:
    time, n = emg["time_emg"].values, emg.sizes["time_emg"]
    rate = _rate(time)
    record, seconds = _record(rate)
    # Numbers in the header have 8 characters: -8388608 uV is the lowest possible.
    unit, factor = ("uV", 1e6) if np.abs(emg.values).max() <= 8.0 else ("mV", 1e3)
    padded = np.pad(emg.values * factor, ((0, 0), (0, -n % record)), mode="edge")
    labels = [str(c) for c in emg["channel"].values]
    short = _short_labels(labels)
    signals = []
    for label, values in zip(short, padded, strict=True):
        top = float(2.0 ** math.ceil(math.log2(max(np.abs(values).max(), 1.0))))
        signals.append(
            edfio.BdfSignal(
                values, record / seconds, label=label, physical_dimension=unit,
                physical_range=(-top, top), digital_range=(-LARGEST_COUNT, LARGEST_COUNT),
            )
        )  # fmt: skip
    content = edfio.Bdf(signals, data_record_duration=seconds)
    rows = [
        (label, "EMG", unit, MUSCLE_NAMES.get(label.partition("_")[0], "n/a")) for label in labels
    ]
    columns = (*EMG_COLUMNS, "target_muscle")
    if "electrodes" in recording.attrs:
        links = _write_electrodes(recording, labels, path.parent, given)
        # The muscle of the name of the study, if it is one, otherwise that of the source.
        rows = [
            (*row[:3], link[2] if row[3] == "n/a" else row[3], *link[:2])
            for row, link in zip(rows, links, strict=True)
        ]
        columns = (*columns, *LINKS[:2])
    write_table(path.with_name(file_name(given, "channels.tsv")), columns, rows)
    description = {**_DEFAULTS, **_common(recording, rate, n)}
    description |= {"RecordingType": "continuous", "EMGChannelCount": len(labels), **further}
    write_json(path.with_suffix(".json"), description)
    replace_file(path, lambda target: content.write(target))


def _write_electrodes(
    recording: xr.Dataset, labels: Sequence[str], folder: Path, given: dict[str, str]
) -> list[tuple[str, ...]]:
    """Write the positions of the electrodes; return the electrodes and the muscle of each channel."""
    electrodes, original = str(recording.attrs["electrodes"]), note(recording, "original_names")
    links, places, system = electrode_tables(electrodes, labels, original)
    if places:
        subject = {"sub": given["sub"]}
        columns = (*ELECTRODE_COLUMNS, "z", "coordinate_system")
        write_table(folder / file_name(subject, "electrodes.tsv"), columns, places)
        write_json(
            folder / file_name(subject, "coordsystem.json"),
            {"EMGCoordinateSystem": "Other", "EMGCoordinateUnits": "n/a", **system},
        )
    return links


def _write_motion(
    position: xr.DataArray,
    path: Path,
    given: dict[str, str],
    recording: xr.Dataset,
    further: Mapping[str, Any],
) -> None:
    rate = _rate(position["time_marker"].values)
    markers = [str(m) for m in position["marker"].values]
    values = position.values.reshape(-1, position.sizes["time_marker"]).T
    lines = ("\t".join("n/a" if math.isnan(v) else repr(v) for v in row) for row in values.tolist())
    rows = [(f"{m}_{axis}", axis, "POS", m, "m") for m in markers for axis in AXES]
    write_table(path.with_name(file_name(given, "channels.tsv")), MOTION_COLUMNS, rows)
    description = _common(recording, rate, position.sizes["time_marker"])
    description |= {
        "TrackingSystemName": TRACKING,
        "MotionChannelCount": len(rows),
        "POSChannelCount": len(rows),
        "TrackedPointsCount": len(markers),
        "MissingValues": "n/a",
        **further,
    }
    write_json(path.with_suffix(".json"), description)
    write_text(path, "\n".join(lines) + "\n")


def _rate(time: np.ndarray) -> float:
    """Rate of a clock, without the rounding of its instants [Hz]."""
    measured = sampling_rate(time)
    plain = Fraction(measured).limit_denominator(_LONGEST_RECORD)
    away = np.abs(time - time[0] - np.arange(time.size) / float(plain or 1)).max()
    return float(plain) if plain and away * measured < 1e-6 else measured


def _record(rate: float) -> tuple[int, int]:
    """Samples and seconds of a BDF record, both integers."""
    ratio = Fraction(rate).limit_denominator(_LONGEST_RECORD)
    if abs(float(ratio) - rate) > 1e-9 * rate:
        raise DataError(
            f"EMG is sampled at {rate!r} Hz, for which no record of up to {_LONGEST_RECORD} "
            "s has a whole number of samples; expected a rational rate: resample, or write "
            "netCDF."
        )
    return ratio.numerator, ratio.denominator


def _short_labels(labels: Sequence[str]) -> list[str]:
    """Labels of at most 16 ASCII characters; the table contains the complete ones."""
    plain = [label.encode("ascii", "replace").decode()[:16] for label in labels]
    return plain if len(set(plain)) == len(plain) else [f"EMG{i + 1}" for i in range(len(labels))]


def _begin(root: Path, name: str, recording: xr.Dataset) -> None:
    """Write the files common to a dataset, if they do not exist."""
    simulated = recording.attrs["origin"] == "simulated"
    description = root / "dataset_description.json"
    if not description.is_file():
        content = {
            "Name": f"{name} ({origin_of(recording)})" if simulated else name,
            "BIDSVersion": BIDS_VERSION,
            "DatasetType": "raw",
            "GeneratedBy": [{"Name": "emgface"}],
        }
        write_json(description, content)
    readme = root / "README.md"
    if not readme.is_file():
        kind = "Simulated" if simulated else "Measured"
        world = str(recording.attrs.get("world", ""))
        write_text(
            readme,
            f"# {name}\n\n{kind} surface EMG and marker positions, one run per trial"
            f"{', ' + world if world else ''}.\n",
        )
