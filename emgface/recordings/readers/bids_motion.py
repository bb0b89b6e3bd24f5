"""Marker positions of a BIDS dataset: ``*_motion.tsv`` with its tables."""

from collections.abc import Mapping
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from emgface.errors import DataError
from emgface.muscles import AXES
from emgface.recordings.bids.names import (
    TRIAL_ENTITIES,
    entities,
    labels_in_name,
    name_findings,
    require_bids_name,
    trial_of,
)
from emgface.recordings.bids.sidecars import (
    describing,
    device,
    lag_between,
    positive_number,
    read_json,
    read_tsv,
    sidecar_path,
    start_times,
    table_of_scans,
    world,
)
from emgface.recordings.ends import doubtful_lines
from emgface.recordings.findings import Finding, with_findings
from emgface.recordings.readers._build import (
    Part,
    assemble_parts,
    one_unit,
    position_array,
    unique_labels,
)
from emgface.recordings.readers._flags import bad_rows, without_bad
from emgface.recordings.readers._row_flags import with_row_flags
from emgface.recordings.timebase import TimeBase, of_rate, of_stamps, with_counter
from emgface.schema.units import to_si
from emgface.texts import read_text

SUFFIXES = (".tsv",)
FORMAT = "Motion-BIDS"

_ENDING = "_motion.tsv"


def is_recording(path: Path) -> bool:
    """Return True for ``*_motion.tsv`` without an EMG file of the same trial, with which it is read."""
    return path.name.endswith(_ENDING) and not _partners(path, "emg", ("emg.edf", "emg.bdf"))


def read(path: Path, units: Mapping[str, str]) -> xr.Dataset:
    """Read the positions of one tracking system under the names of its points; ``n/a`` is NaN."""
    if not path.name.endswith(_ENDING):
        raise DataError(
            f"{path.name} is a table that does not specify its contents; expected a file "
            "called *_motion.tsv of a BIDS dataset: write a TOML sidecar for it and specify "
            "that instead."
        )
    part, description = _load(path, units)
    origin = "simulated" if description.get("Origin") == "simulated" else "measured"
    united = assemble_parts([part], origin=origin, device=device(description))
    united = with_findings(united, name_findings(path, description.get("TaskName")))
    return united.assign_attrs(world(description) | trial_of(path))


def companions(path: Path) -> list[Path]:
    """Return the files that describe the positions."""
    return describing(path, "channels.tsv", "motion.json")


def files_of_motion(emg: Path) -> list[Path]:
    """Return the files from which `motion_of_trial` reads the markers of the trial of an EMG file."""
    files = _partners(emg, "motion", ("motion.tsv",))[:1]
    scans = table_of_scans(emg) if files else None
    return [
        *files,
        *(one for file in files for one in companions(file)),
        *([scans] if scans else []),
    ]


def motion_of_trial(emg: Path, units: Mapping[str, str]) -> list[Part]:
    """Read the markers of the same trial as an EMG file of a BIDS dataset, none or one part.

    Further tracking systems have separate clocks and are listed in ``dropped``. If ``*_scans.tsv``
    contains both start times, the lag of the markers is preserved; those that cannot be compared are a
    finding.
    """
    files = _partners(emg, "motion", ("motion.tsv",))
    if not files:
        return []
    part, _ = _load(files[0], units)
    started = start_times(emg)
    if part.data is not None and {emg.name, files[0].name} & started.keys():
        stated = (started.get(path.name, "n/a") for path in (emg, files[0]))
        lag, doubt = lag_between(*stated)
        time = part.data["time_marker"]
        shifted = time.values + lag
        part = part._replace(
            data=part.data.assign_coords(time_marker=("time_marker", shifted, time.attrs)),
            findings=(*part.findings, *([doubt] if doubt else [])),
        )
    others = {path.name: "another tracking system, read it separately" for path in files[1:]}
    return [part._replace(dropped={**part.dropped, **others})]


def _partners(path: Path, folder: str, endings: tuple[str, ...]) -> list[Path]:
    """Files of the same trial in the folder of another kind of signal."""
    labels = entities(path)
    own = {key: labels[key] for key in TRIAL_ENTITIES if key in labels}
    other = path.parent.parent / folder
    if not own or not other.is_dir():
        return []
    partners = sorted(
        candidate
        for ending in endings
        for candidate in other.glob(f"*_{ending}")
        if _same_trial(labels_in_name(candidate), own)
    )
    for partner in partners:
        require_bids_name(partner)
    return partners


def _same_trial(labels: dict[str, list[str]], own: dict[str, str]) -> bool:
    """Return True if a name has the entities of a trial, also if it has others of them as well."""
    named = {key: values for key, values in labels.items() if key in TRIAL_ENTITIES}
    return named.keys() == own.keys() and all(own[key] in named[key] for key in own)


def _load(path: Path, units: Mapping[str, str]) -> tuple[Part, dict[str, Any]]:
    """Return positions and the content of ``*_motion.json``."""
    require_bids_name(path)
    table, sidecar = sidecar_path(path, "channels.tsv"), sidecar_path(path, "motion.json")
    if table is None or sidecar is None:
        raise DataError(
            f"{path.name} has no channels.tsv and motion.json in its folder; expected both: "
            "a motion file contains neither names nor a rate."
        )
    channels, description = read_tsv(table), read_json(sidecar)
    missing = [c for c in ("component", "type", "tracked_point", "units") if c not in channels]
    if missing:
        raise DataError(
            f"{table.name} lacks the column {missing[0]!r}; expected name, component, type, "
            "tracked_point and units: repair it."
        )
    stated = [
        positive_number(description.get(key), sidecar.name, key)
        for key in ("SamplingFrequencyEffective", "SamplingFrequency", "RecordingDuration")
    ]
    rate, announced = stated[0] or stated[1], stated[2]
    latencies = channels.index[channels["type"] == "LATENCY"]
    if rate is None and not len(latencies):
        raise DataError(
            f"{sidecar.name} has SamplingFrequency {description.get('SamplingFrequency')!r}; expected a "
            "rate above 0 Hz: set it."
        )
    values, cut = _values(path, len(channels))
    base = _time_base(path, values, channels, rate, announced).noting(cut)
    positions = channels[(channels["type"] == "POS") & channels["component"].isin(AXES)]
    dropped = {
        str(row["name"]): (
            "read as the times of the samples"
            if row["type"] == "LATENCY"
            else f"of type {row['type']}, component {row['component']}"
        )
        for _, row in channels.drop(positions.index).iterrows()
    }
    points: list[str] = []
    columns: list[list[int]] = []
    for point, rows in positions.groupby("tracked_point", sort=False):
        by_axis = dict(zip(rows["component"], rows.index, strict=True))
        if len(rows) == 3 and len(by_axis) == 3:
            points.append(str(point))
            columns.append([int(by_axis[axis]) for axis in AXES])
        else:
            dropped |= {str(n): "not one column for each axis" for n in rows["name"]}
    if not points:
        return Part(None, {}, dropped), description
    used = positions.loc[[i for triple in columns for i in triple], "units"]
    stated_unit = one_unit(list(used), units.get("position"), table.name)
    labels, names = unique_labels(points, "marker")
    array = np.stack([values[:, triple].T for triple in columns])
    data = position_array(array, labels, base, units.get("position", stated_unit))
    part = Part(data, {"position": stated_unit}, dropped, names)
    others = channels.index.difference(positions.index)
    part = with_row_flags(
        part, "marker", base, {str(channels["name"][k]): values[:, k] for k in others}
    )
    bad = bad_rows(channels, [str(name) for name in positions["name"]])
    point = {str(row["name"]): str(row["tracked_point"]) for _, row in positions.iterrows()}
    of_points = {point[name]: why for name, why in bad.items() if point[name] in labels}
    return without_bad(part, "marker", of_points, table.name), description


def _time_base(
    path: Path,
    values: np.ndarray,
    channels: pd.DataFrame,
    rate: float | None,
    announced: float | None,
) -> TimeBase:
    """Instants of the frames: of the column of latencies, or otherwise of the rate."""
    if len(values) < 1:
        raise DataError(f"{path.name} has no frames; expected at least one: copy it again.")
    latency = next((k for k, kind in enumerate(channels["type"]) if kind == "LATENCY"), None)
    if latency is not None:
        unit = str(channels["units"].iloc[latency])
        unit = "s" if unit in ("n/a", "") else unit
        named = xr.DataArray(values[:, latency], dims="time", name=f"{path.name}, its latencies")
        base = of_stamps(
            path.name,
            to_si(named.assign_attrs(units=unit), "time").values,
            nominal=None if rate is None else float(rate),
            by="the column of latencies",
            nominal_by="motion.json",
            jittered=True,
        )
        return with_counter(base, {}, duration=announced)
    columns = {str(name): values[:, k] for k, name in enumerate(channels["name"])}
    stated = [
        positive_number(cell, "channels.tsv", "sampling_frequency")
        for cell in channels.get("sampling_frequency", ())
    ]
    others = {"channels.tsv": next((rate for rate in stated if rate), None)}
    return of_rate(
        path.name,
        len(values),
        float(rate or 0.0),
        by="motion.json",
        others=others,
        witnesses=columns,
        duration=announced,
    )


def _values(path: Path, count: int) -> tuple[np.ndarray, list[Finding]]:
    """Return the numbers of a motion file, shape (frames, channels), and a finding if it was cut."""
    try:
        text = read_text(path)
        frame = pd.read_csv(StringIO(text), sep="\t", header=None, na_values=["n/a"])
        values = frame.to_numpy(dtype=np.float64)
    except (OSError, ValueError, pd.errors.ParserError) as error:
        raise DataError(
            f"{path.name} cannot be read as numbers ({' '.join(str(error).split())}); expected "
            "columns of numbers or n/a separated by tabs, without a row of names: repair it."
        ) from error
    if values.shape[1] != count:
        raise DataError(
            f"{path.name} has {values.shape[1]} columns and its channels.tsv {count} rows; "
            "expected one row for each column: it is truncated, or the table belongs to another file."
        )
    last = text.rpartition("\n")[2]
    if last and last.count("\t") != count - 1:
        raise DataError(f"{path.name} ends within a row; expected complete rows: copy it again.")
    return values, doubtful_lines(text, "\t")
