"""Draft of the sidecar of a table or array, from the contents of the file.

Information that the file does not contain is guessed, and every guess is listed under
``unconfirmed``, which the reader refuses until a person has checked the guesses and deleted the
list.
"""

import os
import re
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd

from emgface.errors import DataError, EmgfaceError, UnitsError, listed
from emgface.files import existing_file
from emgface.recordings.counters import LEAST_COUNTER_SAMPLES, counter_of
from emgface.recordings.dataset import read_recording
from emgface.recordings.draft import Draft, toml_value
from emgface.recordings.exports import layout_of
from emgface.recordings.kinds import kind_of_name, signal_of
from emgface.recordings.layout import text_layout, unit_in
from emgface.recordings.readers._arrays import ARRAY_SUFFIXES
from emgface.recordings.readers._build import unique_labels
from emgface.recordings.readers._table_models import EmgTable
from emgface.recordings.readers._tables import FLAGS_OF_SAMPLES, load_table
from emgface.recordings.readers.text_exports import export_of, left_out, part_of
from emgface.recordings.stamps import TIME_LABELS
from emgface.recordings.timebase import of_stamps
from emgface.recordings.verdicts import MOST_EMG_RATE
from emgface.schema.units import DIVISORS, spelling

TABLE_SUFFIXES: Final = (".csv", ".txt", ".tsv", ".dat", ".asc", ".gz")  #: suffixes of text tables
PLAUSIBLE: Final = (1e-6, 1e-3)
"""Range of the fast part of surface EMG [V], by which its unit is guessed: three decades apart."""
#: plausible sampling rates [Hz], by which the unit of time is guessed
PLAUSIBLE_RATES: Final = (20.0, MOST_EMG_RATE)
AXIS_ENDINGS: Final = (
    ("_x", "_y", "_z"),
    (".x", ".y", ".z"),
    (" x", " y", " z"),
    (":x", ":y", ":z"),
)
_COORDINATE: Final = re.compile(r"[_.: ][xyzXYZ]$")
_INDEX: Final = re.compile(r"(sample|samples|index|frame|nr|no|#|n)\b.*", re.IGNORECASE)


def describe(
    path: str | Path,
    *,
    sidecar_folder: str | Path | None = None,
    rate: float | None = None,
    unit: str | None = None,
    columns: Sequence[str] | None = None,
    variable: str | None = None,
    confirmed: bool = False,
) -> str:
    """Draft the sidecar of a text table, a MATLAB or an HDF5 file, as TOML.

    `sidecar_folder` is the folder of the sidecar, which contains the file or its folder; the default
    is that of the file. Known properties are the sampling `rate` [Hz], the `unit` of the EMG, the
    labels of the `columns`, if the file contains none, and the `variable` of a MATLAB or HDF5 file
    that contains the recording; `confirmed` accepts all guesses. Raises DataError if the file is
    absent, of a format that requires no sidecar, or contains no rows of numbers, and UnitsError if
    `unit` is no voltage.
    """
    from emgface.recordings.arrays import array_table  # importing parsers of arrays is slow

    path = existing_file(path, "a table or array")
    unit = None if unit is None else spelling(unit)
    if unit not in (None, *DIVISORS["V"]):
        raise UnitsError(f"the unit of EMG is {unit!r}, expected one of {', '.join(DIVISORS['V'])}")
    suffix = path.suffix.lower()
    if suffix not in (*TABLE_SUFFIXES, *ARRAY_SUFFIXES):
        raise DataError(
            f"{path.name} ends in {suffix!r}; expected one of "
            f"{', '.join((*TABLE_SUFFIXES, *ARRAY_SUFFIXES))}: other formats state their rates and "
            "units themselves, open them with 'emgface check'."
        )
    draft = Draft()
    folder = path.parent if sidecar_folder is None else Path(sidecar_folder)
    draft.lines.append("[emg]")
    relative = Path(os.path.relpath(path, folder)).as_posix()
    if relative.startswith("../") or Path(relative).is_absolute():
        raise DataError(
            f"the sidecar would be in {folder}, and {path.name} is not; expected a sidecar in the "
            "folder of the file or above it, because it may name no other file: write it there."
        )
    draft.put("file", relative)
    layout = None if suffix in ARRAY_SUFFIXES or columns is not None else layout_of(path)
    if layout is not None:
        try:
            _export(path, draft, layout.NAME, unit)
            return _checked(path, draft, folder, confirmed)
        except _NoUnit:
            del draft.lines[2:]  # counts without a transfer function: a table of the user
    if suffix in ARRAY_SUFFIXES:
        frame, own_rate, own_unit = array_table(path, draft, variable, columns)
        unit = unit or own_unit
        units, rate = dict.fromkeys(frame.columns, ""), rate or own_rate
    else:
        frame, units = _text_table(path, draft, columns)
    clock, rate = _clock(draft, frame, units, rate)
    frame = frame.drop(columns=clock)
    _emg(draft, frame, units, rate, unit)
    _positions(draft, frame)
    return _checked(path, draft, folder, confirmed)


class _NoUnit(Exception):
    """An export has no signal that may be EMG in a unit."""


def _export(path: Path, draft: Draft, name: str, unit: str | None) -> None:
    """Describe the export of a recording program, which states its rate, labels and units."""
    columns = list(export_of(path).columns)
    labels = unique_labels([column.label for column in columns], "channel")[0]
    reasons = [left_out(column, "V") for column in columns]
    used = [column for column, reason in zip(columns, reasons, strict=True) if not reason]
    if not used:
        raise _NoUnit
    draft.put("layout", name, "states rate, labels and units itself")
    lacking = [column for column in used if not column.unit.strip()]
    if lacking and unit is None:
        spread = float(np.median([_fast(column.values) for column in lacking]))
        unit, why = _plausible(spread)
        draft.put("unit", unit, f"of signals without a unit: {why}", table="emg", sure=False)
    else:
        draft.put("unit", unit or "V", "of signals without a unit" if lacking else "after reading")
    part = part_of(path, export_of(path), {}, unit or "V")
    assert part.data is not None  # signals are used
    time = part.data["time_emg"].values
    rate = (time.size - 1) / float(time[-1] - time[0]) if time.size > 1 else float("nan")
    draft.put("rate", float(f"{rate:.7g}"), f"Hz; {time.size / rate:.6g} s")
    draft.lines += ["", "[emg.channels]  # signal to channel; others are left out"]
    for label, reason in zip(labels, reasons, strict=True):
        reason = reason or part.dropped.get(label, "")
        mark, note = ("# ", f"  # {reason}") if reason else ("", "")
        draft.lines.append(f"{mark}{toml_value(label)} = {toml_value(label)}{note}")


def _plausible(spread: float) -> tuple[str, str]:
    """Unit in which a signal with this standard deviation from sample to sample would be EMG."""
    fits = [u for u, d in DIVISORS["V"].items() if PLAUSIBLE[0] <= spread / d < PLAUSIBLE[1]]
    unit = fits[0] if fits else "uV"
    volts = 1e6 * spread / DIVISORS["V"][unit]
    return unit, f"from sample to sample values differ by {spread:.3g}, {volts:.3g} uV in this unit"


def _checked(path: Path, draft: Draft, folder: Path, confirmed: bool) -> str:
    """Return the text of a sidecar, which can be read once its guesses are confirmed.

    Raises DataError if it cannot, for example because the rate is not known.
    """
    text = draft.text(path.name, confirmed)
    if draft.guesses and not confirmed:
        return text
    with tempfile.TemporaryDirectory() as place:
        sidecar = Path(place) / "draft.toml"
        sidecar.write_text(text, encoding="utf-8")
        try:
            read_recording(sidecar, folder=folder)
        except EmgfaceError as error:
            raise DataError(
                f"{path.name} cannot be described completely, because {str(error).rstrip('.')}: specify "
                "--rate, --unit or --columns, or draft the sidecar without --confirm and complete it."
            ) from error
    return text


def _text_table(
    path: Path, draft: Draft, columns: Sequence[str] | None
) -> tuple[pd.DataFrame, dict[str, str]]:
    """Numbers of a text table, and the unit of each column; adds the layout to the draft."""
    layout = text_layout(path)
    given: dict[str, Any] = {"delimiter": layout.delimiter}
    draft.put("delimiter", layout.delimiter, table="emg", sure=layout.sure,
              why="" if layout.sure else "other delimiters fit as well")  # fmt: skip
    if layout.decimal != ".":
        given["decimal"] = layout.decimal
        draft.put("decimal", layout.decimal)
    if layout.encoding:
        given["encoding"] = layout.encoding
        draft.put("encoding", layout.encoding, "the file is not UTF-8", table="emg", sure=False)
    if layout.skip_rows:
        given["skip_rows"] = layout.skip_rows
        why = "lines before the table"
        if layout.skipped:
            why += (
                f", {layout.skipped} of which are rows of numbers: check that they are no samples"
            )
        draft.put("skip_rows", layout.skip_rows, why, table="emg", sure=not layout.skipped)
    if columns is not None and len(columns) != len(layout.labels):
        raise DataError(
            f"{path.name} has {len(layout.labels)} columns and {len(columns)} labels were given; "
            f"expected one for each of {listed(layout.labels, 12)}."
        )
    if columns is not None or not layout.labelled:
        if columns is not None and layout.labelled:
            if layout.skip_rows:
                draft.lines.pop()
            given["skip_rows"] = layout.skip_rows + 1
            draft.put("skip_rows", layout.skip_rows + 1, "lines before the numbers", table="emg",
                      sure=not layout.skipped)  # fmt: skip
        named = columns is not None or any(not x.startswith("column ") for x in layout.labels)
        given["columns"] = tuple(unique_labels(list(columns or layout.labels), "column")[0])
        draft.put("columns", list(given["columns"]), "" if named else "the file contains none",
                  table="emg", sure=named)  # fmt: skip
    table = EmgTable(file=path.name, unit="V", rate=1.0, **given)
    frame, _, dropped, *_ = load_table(path.parent / "the draft", table, wanted={})
    names = [str(name) for name in frame.columns]
    frame.columns = names
    for name, reason in dropped.items():
        why = "contains text and is left out"
        why = (
            f"{reason}: the table 'flags' states its meaning" if reason == FLAGS_OF_SAMPLES else why
        )
        draft.lines.append(f"# The column {toml_value(name)} {why}.")
    units = dict(zip(given.get("columns", layout.labels), layout.units, strict=False))
    return frame, {name: units.get(name) or unit_in(name) for name in names}


def _clock(
    draft: Draft, frame: pd.DataFrame, units: dict[str, str], rate: float | None
) -> tuple[list[str], float | None]:
    """Write the rate or the column of instants; return columns of counters, and the rate."""
    counting: list[str] = []
    for name in frame.columns:
        values = frame[name].to_numpy()
        counter = None if TIME_LABELS.fullmatch(name) else counter_of(values, LEAST_COUNTER_SAMPLES)
        if counter is not None and counter.modulus > 0:
            counting.append(name)
            draft.lines.append(f"# The column {toml_value(name)} is a counter and is left out.")
            continue
        step = np.diff(values)
        mean = float(step.mean()) if step.size else 0.0
        if len(values) < 3 or not (step > 0).all() or np.ptp(step) > 0.2 * mean:
            if not TIME_LABELS.fullmatch(name):
                continue
            counting.append(name)
            try:
                mean = 1.0 / of_stamps(f"The column {toml_value(name)}", values).rate
                draft.lines.append(
                    f"# The steps of the column {toml_value(name)} are uneven ({step.min():.4g} to "
                    f"{step.max():.4g}): samples that are lost become gaps."
                )
            except DataError as error:
                draft.lines.append(f"# {error}".replace("\n", " "))
                continue
            counting.pop()
        if _INDEX.fullmatch(name) or (mean == 1.0 and not TIME_LABELS.fullmatch(name)):
            counting.append(name)
            continue
        if not (
            TIME_LABELS.fullmatch(name) or (name == frame.columns[0] and name.startswith("column "))
        ):
            continue
        stated = units[name] if units[name] in DIVISORS["s"] else ""
        divisors = (
            {stated: DIVISORS["s"][stated]} if stated else DIVISORS["s"] | {"min": 1.0 / 60.0}
        )
        fits = {
            u: d / mean
            for u, d in divisors.items()
            if stated or PLAUSIBLE_RATES[0] <= d / mean <= PLAUSIBLE_RATES[1]
        }
        if not fits or rate is not None:
            counting.append(name)
            continue
        unit, hertz = next(iter(fits.items()))
        if unit == "min":  # not a unit of sidecars
            draft.put("rate", float(f"{hertz:.6g}"), f"Hz; {name} seems to be in minutes",
                      table="emg", sure=False)  # fmt: skip
            return [*counting, name], hertz
        known = TIME_LABELS.fullmatch(name) is not None
        why = "" if known else "the first column ascends evenly"
        draft.put("time", name, why, table="emg", sure=known)
        draft.put("time_unit", unit, f"{hertz:.6g} Hz" + ("" if stated else " in this unit"),
                  table="emg", sure=bool(stated) or len(fits) == 1 and unit == "s")  # fmt: skip
        return [*counting, name], hertz
    if rate is not None:
        draft.put("rate", float(rate), "Hz")
    else:
        draft.lines.append("# rate = ...  # UNCONFIRMED Hz: no column of instants was found")
        draft.guesses.append("emg.rate")
    return counting, rate


def _emg(
    draft: Draft, frame: pd.DataFrame, units: dict[str, str], rate: float | None, unit: str | None
) -> None:
    """Write the unit of the EMG and its columns."""
    names = [
        name for name in frame.columns if _axis(name, frame) is None and kind_of_name(name) is None
    ]
    stated = {units[name] for name in names if units.get(name) in DIVISORS["V"]}
    spread = [_fast(frame[name].to_numpy()) for name in names]
    spread = [value for value in spread if value > 0]
    typical = float(np.median(spread)) if spread else float("nan")
    lacking = [name for name in names if units.get(name) not in DIVISORS["V"]]
    if unit is not None:
        draft.put("unit", unit)
    elif stated and (len(stated) == 1 or not lacking):
        unit = next(units[name] for name in names if units.get(name) in stated)
        why = "as the labels say" if not lacking else f"the label {lacking[0]!r} states none"
        draft.put("unit", unit, why, table="emg", sure=not lacking)
        others = [name for name in names if units.get(name) in stated - {unit}]
        if others:
            listing = ", ".join(f"{toml_value(n)} = {toml_value(units[n])}" for n in others)
            draft.lines.append(f"units = {{ {listing} }}  # of other columns, as their labels say")
    else:
        unit, why = _plausible(typical)
        why = why if spread else "no column varies"
        whole = all(np.array_equal(v, np.round(v)) for v in frame[names].to_numpy().T)
        if names and whole:
            why += "; whole numbers may be counts, then set step and zero"
        draft.put("unit", unit, why, table="emg", sure=False)
    scale = DIVISORS["V"].get(unit, 1.0)
    draft.lines += [
        "",
        "[emg.channels]  # column to channel; columns that are not listed are left out",
    ]
    for name in frame.columns:
        if _axis(name, frame) is not None:
            continue
        if _COORDINATE.search(name):
            draft.lines.append(
                f"# {toml_value(name)} = {toml_value(name)}  # a coordinate, no three axes"
            )
            continue
        signal = signal_of(name, frame[name].to_numpy() / scale, rate or float("nan"))
        mark, note = (
            ("", "") if signal.kind == "EMG" else ("# ", f"  # {signal.kind}: {signal.reason}")
        )
        draft.lines.append(f"{mark}{toml_value(name)} = {toml_value(name)}{note}")


def _positions(draft: Draft, frame: pd.DataFrame) -> None:
    """Write the table of markers, if there are columns of three axes."""
    directions = {_axis(name, frame) for name in frame.columns} - {None}
    if not directions:
        return
    axes = next(iter(sorted(a for a in directions if a is not None)))
    values = np.abs(frame[[n for n in frame.columns if _axis(n, frame)]].to_numpy())
    middle = float(np.nanmedian(values))
    unit = "mm" if middle > 5.0 else "m"
    first = draft.lines.index("")
    layout = [line for line in draft.lines[1:first] if not line.startswith("unit")]
    if all(line.startswith("#") for line in draft.lines[first + 2 :]):  # no column contains EMG
        draft.lines.clear()
        draft.guesses = [
            name.replace("emg.", "position.") for name in draft.guesses if name != "emg.unit"
        ]
    draft.lines += ["", "[position]", *layout]
    draft.put("axes", list(axes))
    draft.put(
        "unit", unit, f"the median distance from zero is {middle:.3g}", table="position", sure=False
    )


def _axis(name: str, frame: pd.DataFrame) -> tuple[str, str, str] | None:
    """Suffixes of the three columns of the marker to which a column may belong."""
    if kind_of_name(name) is not None:
        return None  # accelerometers also have axes
    for endings in AXIS_ENDINGS:
        for known in (endings, tuple(e.upper() for e in endings)):
            stem = name[: len(name) - len(known[0])]
            if name.endswith(known) and stem and all(stem + e in frame.columns for e in known):
                return known[0], known[1], known[2]
    return None


def _fast(values: np.ndarray) -> float:
    """Standard deviation of the differences of a signal, independent of offset and drift."""
    step = np.diff(values[np.isfinite(values)])
    return float(np.std(step) / np.sqrt(2.0)) if step.size else 0.0
