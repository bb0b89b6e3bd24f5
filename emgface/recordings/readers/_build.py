"""Assembly of a recording from the parts that a reader returns."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
import xarray as xr

from emgface.errors import DataError, UnitsError, listed
from emgface.muscles import AXES
from emgface.recordings.findings import Finding, findings_in, with_findings
from emgface.recordings.kinds import kind_of_unit
from emgface.recordings.readers._filters import stated_processing
from emgface.recordings.timebase import TimeBase
from emgface.schema.units import quantity_of, spelling, to_si

MOST_COLUMNS: Final = 2048
"""Most channels or markers of a recording, and columns of a table; the largest grids have 512."""


class Part(NamedTuple):
    """EMG or markers of a file, with the record of its labels.

    `data` is the result of `emg_array` or `position_array`, or None. The mappings contain the
    `units` of variables in the file, the `dropped` labels with the reason, and by new name the
    `names` in the file; `findings` are those besides the findings of the time base.
    """

    data: xr.Dataset | None = None
    units: Mapping[str, str] = {}
    dropped: Mapping[str, str] = {}
    names: Mapping[str, str] = {}
    findings: Sequence[Finding] = ()


def emg_array(values: np.ndarray, labels: Sequence[str], time: TimeBase, unit: str) -> xr.Dataset:
    """Return ``emg(channel, time_emg)`` [V] from stored values (channels, samples) in a unit.

    Gaps of the time base are NaN, and its findings are stored with the dataset. Raises UnitsError if
    the unit is absent or not a voltage.
    """
    coords = {"channel": list(labels), "time_emg": ("time_emg", time.times, {"units": "s"})}
    laid = time.laid(values)
    array = xr.DataArray(laid, coords, ("channel", "time_emg"), "emg", {"units": unit})
    return with_findings(to_si(array, "voltage").to_dataset(), time.findings("channel"))


def position_array(
    values: np.ndarray, labels: Sequence[str], time: TimeBase, unit: str
) -> xr.Dataset:
    """Return ``position(marker, axis, time_marker)`` [m] from stored values (markers, 3, frames).

    Values are NaN where a marker is not visible and in the gaps of the time base, whose findings are
    stored with the dataset. Raises UnitsError if the unit is absent or not a length.
    """
    coords = {
        "marker": list(labels),
        "axis": list(AXES),
        "time_marker": ("time_marker", time.times, {"units": "s"}),
    }
    dims = ("marker", "axis", "time_marker")
    array = xr.DataArray(time.laid(values), coords, dims, "position", {"units": unit})
    return with_findings(to_si(array, "length").to_dataset(), time.findings("marker"))


def one_unit(stated: Sequence[str], given: str | None, place: str) -> str:
    """Return the unit of coordinates, of which a file states one each; UnitsError for several.

    With a `given` unit that replaces them, several are accepted.
    """
    different = list(dict.fromkeys(spelling(unit) for unit in stated))
    if len(different) > 1 and given is None:
        raise UnitsError(
            f"{place} states the units {', '.join(map(repr, different))} for positions; expected one: "
            "repair it, or specify the unit of all as position in the table 'units' of the mapping."
        )
    return next(iter(stated), "")


def voltages(
    values: Sequence[np.ndarray] | np.ndarray,
    labels: Sequence[str],
    stated: Sequence[str],
    time: TimeBase,
    units: Mapping[str, str],
    names: Mapping[str, str],
) -> Part:
    """Return the channels that are voltages, each converted from its own unit.

    `stated` is the unit of each channel in the file (possibly empty). In `units`, ``emg`` replaces
    all of them, and the label of a channel that of this channel. `names` are the labels that were
    changed (`unique_labels`). Channels of another quantity are listed in ``dropped``. Raises
    UnitsError if no channel has a unit and none is specified.
    """
    dropped: dict[str, str] = {}
    left: list[Finding] = []
    keep: list[int] = []
    used: list[str] = []
    for i, (label, own) in enumerate(zip(labels, stated, strict=True)):
        own = units.get(label, units.get("emg", own))
        used.append(own)
        if quantity_of(own) == "voltage" or label in units or "emg" in units:
            keep.append(i)
            continue
        left.append(left_out(label, unit=own.strip()))
        dropped[label] = left[-1].clause
    if not keep:
        if not any(own.strip() for own in stated):
            raise UnitsError(
                f"None of the {len(labels)} analog channels has a unit; expected V, mV or uV: "
                "specify it as emg in the table 'units' of the mapping."
            )
        unknown = [i for i, own in enumerate(stated) if _unknown(own)]
        if unknown:
            raise UnitsError(
                f"{listed([labels[i] for i in unknown])} {'is' if len(unknown) == 1 else 'are'} in "
                f"{listed(dict.fromkeys(repr(stated[i]) for i in unknown))}, an unknown unit; expected "
                "V, mV, uV or nV: specify the unit of the values as emg in the table 'units' of the "
                "mapping, and if they are a root mean square or rectified, export the raw signal."
            )
        return Part(None, {}, dropped, names, left)
    by_unit: dict[str, list[int]] = {}
    for i in keep:
        by_unit.setdefault(spelling(used[i]), []).append(i)
    parts = [
        emg_array(np.stack([values[i] for i in rows]), [labels[i] for i in rows], time, one)
        for one, rows in by_unit.items()
    ]
    data = xr.concat(parts, "channel", combine_attrs="override").sel(
        channel=[labels[i] for i in keep]
    )
    original = ", ".join(dict.fromkeys(stated[i] for i in keep))
    processed = [one for i in keep for one in stated_processing(labels[i], labels[i])]
    return Part(data, {"emg": original}, dropped, names, [*left, *processed])


def left_out(label: str, *, unit: str = "", kind: str = "") -> Finding:
    """Return the finding on an analog channel that is left out by its unit or its type in the file."""
    if kind:
        why = f"of type {kind}, not EMG"
    elif not unit:
        why = "has no unit"
    elif _unknown(unit):
        why = f"in {unit!r}, an unknown unit"
    else:
        why = f"in {unit!r}, not a voltage"
    return Finding("left_out", "channel", label, {"unit": unit, "type": kind, "why": why})


def left_out_by_rate(label: str, rate: float, used: float) -> Finding:
    """Return the finding on a channel whose rate [Hz] is not that of the channels that are used."""
    return Finding("other_rate", "channel", label, {"rate": rate, "used": used})


def _unknown(unit: str) -> bool:
    """Return True for a unit that looks like one of voltage (.V, muV, uVrms) and is not known."""
    known = quantity_of(unit) is not None or kind_of_unit(unit) is not None
    return "v" in unit.lower() and not known


def assemble_parts(
    parts: Sequence[Part], *, origin: str = "measured", device: str = ""
) -> xr.Dataset:
    """Combine EMG and positions of one trial, with the record of the contents of the file.

    `device` is the recording device, if stated in the file. Raises DataError if no part contains
    data.
    """
    notes: dict[str, dict[str, str]] = {"original_names": {}, "original_units": {}, "dropped": {}}
    for part in parts:
        notes["original_names"] |= part.names
        notes["original_units"] |= part.units
        notes["dropped"] |= part.dropped
    arrays = [part.data for part in parts if part.data is not None]
    if not arrays:
        reasons = "; ".join(f"{name}: {why}" for name, why in list(notes["dropped"].items())[:3])
        raise DataError(
            f"The file contains neither EMG nor markers{f' ({reasons})' if reasons else ''}; "
            "expected at least one of them: check whether it is the right file"
            + (
                ", or specify the unit of these channels as emg, or by their labels, in the table "
                "'units' of the mapping."
                if any("not a voltage" in why for why in notes["dropped"].values())
                else "."
            )
        )
    findings = [finding for data in arrays for finding in findings_in(data)]
    findings += [finding for part in parts for finding in part.findings]
    findings += [finding for part in parts for finding in _repeated(part)]
    united = xr.merge([data.drop_attrs(deep=False) for data in arrays])
    united.attrs = {"origin": origin}
    united = with_findings(united, findings)
    for name, value in notes.items():
        united.attrs[name] = json.dumps(value, ensure_ascii=False)
    return united.assign_attrs(device=device) if device else united


def _repeated(part: Part) -> list[Finding]:
    """Findings on channels and markers under a label that occurs several times in the file."""
    if part.data is None:
        return []
    kind = "channel" if "emg" in part.data else "marker"
    labels = part.data[kind].values.tolist()
    others = dict[str, list[str]]()
    for name, given in part.names.items():
        if name != given.strip() and given.strip() in labels:
            others.setdefault(given.strip(), []).append(name)
    return [
        Finding("repeated_label", kind, label, {"count": 1 + len(names), "other": names[0]})
        for label, names in others.items()
    ]


def require_few(count: int, place: str, what: str) -> None:
    """Raise DataError for more channels, markers or columns than a recording has (`MOST_COLUMNS`)."""
    if count > MOST_COLUMNS:
        raise DataError(
            f"{place} {count} {what}; expected at most {MOST_COLUMNS}: it is not a table of "
            "signals over time, or transposed."
        )


def positive(path: Path, name: str, text: str, kind: type[int] | type[float] = float) -> float:
    """Convert the text of an entry of a header to a number above 0; DataError for another text."""
    try:
        value = kind(text)
        if not 0 < value < 1e9:
            raise ValueError
    except ValueError:
        raise DataError(
            f"{path.name} has {name} = {text!r}; expected a number above 0: the header is damaged, "
            "export the recording again."
        ) from None
    return value


def unique_labels(labels: Sequence[str], stem: str) -> tuple[list[str], dict[str, str]]:
    """Return stripped, unique labels, and by new label those of the file that were changed.

    Empty labels are replaced by `stem`, and repeated ones are numbered.
    """
    require_few(len(labels), "The file has", f"{stem}s")
    result: list[str] = []
    changed: dict[str, str] = {}
    for number, label in enumerate(labels, start=1):
        plain = label.strip() or f"{stem} {number}"
        name, again = plain, 2
        while name in result:
            name, again = f"{plain} ({again})", again + 1
        result.append(name)
        if name != label:
            changed[name] = label
    return result, changed
