"""EDF, EDF+ and BDF files, read by edfio, with the tables of a BIDS dataset.

A file called ``*_emg.edf`` or ``*_emg.bdf`` with a ``*_channels.tsv`` is a trial of a BIDS dataset:
the types and names of its channels, its duration and its markers (`bids_motion.py`) are read
with it.
"""

import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import edfio
import numpy as np
import xarray as xr

from emgface.errors import DataError
from emgface.recordings.bids.electrodes import read_electrodes
from emgface.recordings.bids.names import name_findings
from emgface.recordings.bids.sidecars import (
    EmgSidecars,
    describing,
    emg_sidecars,
    sidecar_path,
)
from emgface.recordings.events import EVENT_COLUMNS, read_events
from emgface.recordings.findings import Finding, with_findings
from emgface.recordings.readers._build import (
    Part,
    assemble_parts,
    left_out,
    left_out_by_rate,
    unique_labels,
    voltages,
)
from emgface.recordings.readers._edf_records import Records, out_of_range, records_of
from emgface.recordings.readers._filters import (
    bands_of_table,
    filters_of_description,
    stated_filters,
)
from emgface.recordings.readers._flags import (
    Mark,
    bad_rows,
    odd_status,
    with_bad_samples,
    with_marks,
    without_bad,
)
from emgface.recordings.readers._row_flags import with_row_flags
from emgface.recordings.readers.bids_motion import files_of_motion, motion_of_trial
from emgface.recordings.timebase import TimeBase, of_blocks, of_rate, with_counter
from emgface.schema.rules import one_line
from emgface.schema.units import quantity_of

SUFFIXES = (".edf", ".bdf")
FORMAT = "EDF or BDF"

_DESCRIBING = ("channels.tsv", "emg.json", "events.tsv", "electrodes.tsv", "coordsystem.json")
_HEADER = 256  #: bytes of the general header, and of the header of each signal


class _Content(NamedTuple):
    values: list[np.ndarray]
    labels: list[str]
    units: list[str]
    rates: list[float]
    device: str
    records: Records | None
    filters: list[str]
    record: float  #: duration of a record [s]


def is_recording(path: Path) -> bool:
    """Return False for an EDF file of another type of a BIDS dataset, such as EEG or iEEG."""
    return not path.stem.endswith(("_eeg", "_ieeg", "_meg", "_nirs", "_physio"))


def companions(path: Path) -> list[Path]:
    """Return the tables, descriptions and markers of a trial of a BIDS dataset."""
    if emg_sidecars(path) is None:
        return []
    return [*describing(path, *_DESCRIBING), *files_of_motion(path)]


def read(path: Path, units: Mapping[str, str]) -> xr.Dataset:
    """Read the voltage channels with the most frequent sampling rate.

    Pauses between records are gaps. Intervals that annotations or the events of a BIDS dataset call
    bad (``BAD`` and names that begin so), or in which the status of BioSemi is out of range, are NaN.
    Raises DataError also if the recording contradicts its tables.
    """
    content = _load(path)
    sidecars = emg_sidecars(path)
    given = content.labels if sidecars is None else sidecars.names(content.labels)
    labels, names = unique_labels(given, "channel")
    stated = content.units
    if sidecars is not None and "emg" not in units:
        stated = sidecars.units(given, content.units)
    names |= {label: own for label, own in zip(labels, content.labels, strict=True) if label != own}
    keep, dropped, left = _of_one_rate(content, labels, stated, sidecars, "emg" in units)
    emg = Part()
    if keep:
        base = _time_base(path, content, keep, sidecars, given)
        n = base.stored
        emg = voltages(
            [content.values[i][:n] for i in keep],
            [labels[i] for i in keep],
            [stated[i] for i in keep],
            base,
            units,
            {label: names[label] for label in labels if label in names},
        )
        emg = _without_flagged(emg, content, base, labels)
        if sidecars is not None:
            emg = with_marks(emg, base, _events(path), "event", labels)
    used = [i for i in keep if labels[i] not in emg.dropped]
    bands = stated_filters({labels[i]: content.filters[i] for i in used})
    if sidecars is not None:
        bands += bands_of_table(sidecars.channels, [labels[i] for i in used])
    emg = emg._replace(dropped={**dropped, **emg.dropped}, findings=[*left, *bands, *emg.findings])
    if sidecars is not None:
        emg = without_bad(emg, "channel", bad_rows(sidecars.channels, labels), "channels.tsv")
        odd = odd_status(sidecars.channels, [labels[i] for i in used], "channel", "channels.tsv")
        texts = filters_of_description(sidecars.description, [labels[i] for i in used])
        emg = emg._replace(findings=[*emg.findings, *odd, *texts])
    if sidecars is None:
        return assemble_parts([emg], device=content.device)
    motion = motion_of_trial(path, units)
    united = assemble_parts(
        [emg, *motion], origin=sidecars.origin, device=sidecars.device or content.device
    )
    united = with_findings(united, name_findings(path, sidecars.description.get("TaskName")))
    electrodes = read_electrodes(path, sidecars.channels)
    attrs = {} if electrodes is None else {"electrodes": electrodes}
    return united.assign_attrs({**sidecars.world, **sidecars.trial, **attrs})


def _time_base(
    path: Path,
    content: _Content,
    keep: Sequence[int],
    sidecars: EmgSidecars | None,
    given: Sequence[str],
) -> TimeBase:
    """Instants of the samples: by the begins of the records, and compared with the tables."""
    rate, stored = content.rates[keep[0]], len(content.values[keep[0]])
    others = {} if sidecars is None else sidecars.rates([given[i] for i in keep])
    base = of_rate(path.name, stored, rate, by="its header", others=others)
    records = content.records
    if records is not None:
        size = round(rate * records.duration)
        if size * records.starts.size == stored:
            blocks = of_blocks(path.name, records.starts, size, rate, "the begins of its records")
            base = blocks.noting(base.notes) if blocks.gaps else base
    n = stored if sidecars is None else round(min(sidecars.duration or 1e9, 1e9) * rate)
    if not base.gaps and 0 <= stored - n < content.record * rate:  # the last record is padded
        base = of_rate(path.name, n, rate, by="its header", others=others)
    base = base if sidecars is None else base.noting(sidecars.pauses(bool(base.gaps)))
    n = base.stored
    same = {
        label: values[:n]
        for label, values in zip(content.labels, content.values, strict=True)
        if len(values) == stored
    }
    return with_counter(base, same, duration=None if sidecars is None else sidecars.duration)


def _without_flagged(part: Part, content: _Content, base: TimeBase, labels: Sequence[str]) -> Part:
    """Replace samples that annotations or the status of the amplifier mark as bad."""
    if content.records is not None:
        part = with_marks(part, base, content.records.marks, "annotation", labels)
    same = {
        label: values[: base.stored]
        for label, values in zip(content.labels, content.values, strict=True)
        if len(values) >= base.stored
    }
    part = with_row_flags(part, "channel", base, same)
    outside = out_of_range(same)
    if outside is not None:
        part = with_bad_samples(part, "channel", base, outside, "the status (out of range)")
    return part


def _events(path: Path) -> list[Mark]:
    """Events of a trial of a BIDS dataset, as marks."""
    table = sidecar_path(path, "events.tsv")
    events = None if table is None else read_events(table).fillna(0.0)
    return [] if events is None else [Mark(*row) for row in events[[*EVENT_COLUMNS]].to_numpy()]


def _of_one_rate(
    content: _Content,
    labels: Sequence[str],
    units: Sequence[str],
    sidecars: EmgSidecars | None,
    forced: bool,
) -> tuple[list[int], dict[str, str], list[Finding]]:
    """Choose the voltage channels with the most frequent rate; state reasons for omissions."""
    dropped: dict[str, str] = {}
    left: list[Finding] = []

    def leave(finding: Finding) -> None:
        left.append(finding)
        dropped[finding.name] = finding.clause

    kept: list[int] = []
    for i, label in enumerate(labels):
        kind = "EMG" if sidecars is None else sidecars.type_of(label)
        if kind != "EMG":
            leave(left_out(label, kind=kind))
        else:
            kept.append(i)
    # Only voltages determine the rate, unless one unit is specified for all channels.
    voters = [i for i in kept if forced or quantity_of(units[i]) == "voltage"] or kept
    rates = [content.rates[i] for i in voters]
    if not rates:
        return [], dropped, left
    common = max(dict.fromkeys(rates), key=lambda rate: (rates.count(rate), rate))
    for i in kept:
        if content.rates[i] != common and i in voters:
            leave(left_out_by_rate(labels[i], content.rates[i], common))
        elif content.rates[i] != common:
            leave(left_out(labels[i], unit=units[i].strip()))
    return [i for i in kept if content.rates[i] == common], dropped, left


def _load(path: Path) -> _Content:
    """Read the file, and refuse one whose header and length are inconsistent."""
    data = _whole(path)
    bdf = data[:1] == b"\xff"
    try:
        with warnings.catch_warnings():
            # edfio truncates data, or returns it unscaled, with a warning only.
            warnings.simplefilter("error")
            if bdf:
                opened = edfio.read_bdf(data, header_encoding="latin-1")
            else:
                opened = edfio.read_edf(data, lazy_load_data=False, header_encoding="latin-1")
            records = records_of(data)
            broken = opened.reserved[:5] in ("EDF+D", "BDF+D") and records is None
            signals = opened.signals
            content = _Content(
                [np.asarray(signal.data, dtype=np.float64) for signal in signals],
                [signal.label.strip() for signal in signals],
                [signal.physical_dimension.strip() for signal in signals],
                [float(signal.sampling_frequency) for signal in signals],
                _device(opened),
                records,
                [signal.prefiltering for signal in signals],
                float(opened.data_record_duration),
            )
            ranges = [(*signal.physical_range, *signal.digital_range) for signal in signals]
    except (ValueError, KeyError, IndexError, TypeError, ArithmeticError, Warning) as error:
        raise DataError(
            f"{path.name} cannot be read as {'BDF' if bdf else 'EDF'} ({one_line(error)}); expected the "
            "fields of that format: it is damaged, export it again."
        ) from error
    if broken:
        raise DataError(
            f"{path.name} has pauses between its records, but does not state when they begin; "
            "expected a continuous recording: export each part as a separate file."
        )
    for label, limits in zip(content.labels, ranges, strict=True):
        low, high, least, most = limits
        if not np.isfinite(limits).all() or low == high or least >= most:
            raise DataError(
                f"{path.name}, channel {label!r}: counts {least:g} to {most:g} correspond to "
                f"{low:g} to {high:g}; expected two ranges: the header is damaged, export it "
                "again."
            )
    return content


def _whole(path: Path) -> bytes:
    """Return the content of a file whose length agrees with its header."""
    data = path.read_bytes()
    bdf = data[:8] == b"\xffBIOSEMI"
    if not bdf and data[:8].strip() != b"0":
        raise DataError(
            f"{path.name} begins with {data[:8]!r}; expected '0' (EDF) or 'BIOSEMI' (BDF): it is "
            "another format, or damaged."
        )
    fields = {"length of the header": (184, 8), "number of records": (236, 8)}
    fields["number of signals"] = (252, 4)
    header, records, signals = (_integer(path, data, what, *at) for what, at in fields.items())
    if signals < 1 or header != _HEADER * (signals + 1) or len(data) < header:
        raise DataError(
            f"{path.name} has {len(data)} bytes and declares {signals} signals and a header of "
            f"{header} bytes; expected {_HEADER} for each signal and {_HEADER} more: it is "
            "truncated or damaged, copy or export it again."
        )
    try:
        seconds = float(data[244:252])
    except ValueError:
        seconds = float("nan")
    if not 0.0 < seconds < 1e6:
        raise DataError(
            f"{path.name}: a record lasts {data[244:252].decode('latin-1')!r} s; expected a number "
            "above 0: the header is damaged, export the file again."
        )
    # The samples per record follow after 216 bytes of other fields for each signal.
    start = _HEADER + 216 * signals
    counts = [
        _integer(path, data, f"number of samples of signal {i + 1}", start + 8 * i, 8)
        for i in range(signals)
    ]
    record = (3 if bdf else 2) * sum(counts)
    if min(counts) < 0 or record == 0 or records < -1 or records == 0:
        raise DataError(
            f"{path.name} declares {records} records of {sum(counts)} samples; expected at least "
            "one of each: the recording is empty or damaged."
        )
    count = (len(data) - header) / record
    # After an interruption the number is -1; a whole number of records is then required.
    if count != (int(count) if records == -1 else records) or count < 1:
        raise DataError(
            f"{path.name} declares {'whole' if records == -1 else records} records but contains "
            f"{count:.6g}; expected all of them: it is truncated or damaged, copy it again."
        )
    return data[:236] + b"%-8d" % int(count) + data[244:]


def _integer(path: Path, data: bytes, what: str, start: int, length: int) -> int:
    text = data[start : start + length]
    try:
        # int() would also accept '1_0' and digits of other scripts.
        if not text.strip().lstrip(b"+-").isdigit():
            raise ValueError
        return int(text)
    except ValueError:
        raise DataError(
            f"{path.name}: the {what} is {text.decode('latin-1')!r}; expected an integer: the "
            "header is damaged, export the file again."
        ) from None


def _device(opened: "edfio.Edf | edfio.Bdf") -> str:
    """Return the equipment code of an EDF+ header; in EDF this field is free text."""
    try:
        code = opened.recording.equipment_code
    except (ValueError, IndexError, KeyError):
        return ""
    return "" if code in ("X", "") else code.replace("_", " ")
