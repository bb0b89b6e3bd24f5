"""Text files of PLUX OpenSignals (biosignalsplux, BITalino): a JSON header, then columns.

The header states rate, columns, sensors and resolution of every device; the columns are a sequence
number ``nSeq``, digital inputs, and the counts of the converter. For an EMG sensor the transfer
function is

    V = (count / 2^n - 1/2) * VCC / gain,

with VCC = 3 V and gain 1000 for biosignalsplux, VCC = 3.3 V and gain 1009 for BITalino. Source:
PLUX, OpenSignals sensor file specification (txt format); data sheets of the EMG sensors of
biosignalsplux and BITalino (r)evolution.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from emgface.errors import DataError
from emgface.recordings.exports.contract import Block, Column, Export, header_rate
from emgface.recordings.readers._build import require_few
from emgface.texts import json_in

NAME: str = "OpenSignals"

_END: Final = "# endofheader"
_SUPPLY: Final = {"bitalino": (3.3, 1009.0), "biosignalsplux": (3.0, 1000.0),
                  "channeller": (3.0, 1000.0)}  # fmt: skip
"""Supply [V] and gain [1] of the EMG sensor of a device, by a part of its name in the header."""


class _Device(NamedTuple):
    name: str
    rate: float
    columns: list[str]
    channels: list[str]  #: columns of sensors, the last ones
    sensors: list[str]
    bits: list[float]
    converted: bool


def matches(head: Sequence[str]) -> bool:
    """Return True if the first line declares the format, or a line ends its header."""
    return bool(head) and (
        head[0].lower().startswith("# opensignals text file format")
        or (head[0].startswith("# {") and any(x.lower().startswith(_END) for x in head[:6]))
    )


def read(path: Path, text: str, head: Sequence[str]) -> Export:
    """Return the sensors of all devices, in volts where the transfer function is known."""
    end = next((k for k, line in enumerate(head) if line.lower().startswith(_END)), None)
    header = next((line[1:].strip() for line in head if line.startswith("# {")), None)
    try:
        content = json_in(header or "")
        devices = [_device(path, one) for one in content.values()]
    except (ValueError, AttributeError, RecursionError) as error:
        if isinstance(error, DataError):
            raise
        devices = []
    if end is None or not devices:
        raise DataError(
            f"{path.name} has no header of OpenSignals that can be read; expected a line of JSON and "
            "'# EndOfHeader': it is damaged, export the recording again."
        )
    names = [name for device in devices for name in device.columns]
    require_few(len(names), f"{path.name} declares", "columns")
    block = Block(path, text, end + 1, "\t", names)
    columns: list[Column] = []
    first = 0
    for device in devices:
        columns += _signals(path, block, device, first, len(devices) > 1)
        first += len(device.columns)
    return Export(columns, ", ".join(device.name for device in devices))


def _device(path: Path, header: Mapping[str, Any]) -> _Device:
    columns, labels = _texts(header, "column"), _texts(header, "label")
    count = len(labels) or len(header.get("channels", []))
    if not columns or not 0 < count <= len(columns) or "sampling rate" not in header:
        raise DataError(
            f"{path.name} declares {len(columns)} columns and {count} channels; expected both, and a "
            "sampling rate: its header is damaged, export the recording again."
        )
    sensors = _texts(header, "sensor")
    bits = header.get("resolution", [])
    bits = bits if isinstance(bits, list) else [bits]
    return _Device(
        str(header.get("device", "") or header.get("device name", "")),
        header_rate(path, "sampling rate", str(header["sampling rate"])),
        columns,
        columns[-count:],
        (sensors + [""] * count)[:count],
        # Resolutions are listed for the channels, or for all columns but the sequence number.
        [float(b or 0) for b in bits[-count:]] + [float("nan")] * (count - len(bits[-count:])),
        bool(header.get("convertedValues", 0)),
    )


def _texts(header: Mapping[str, Any], key: str) -> list[str]:
    value = header.get(key, [])
    return [str(one) for one in value] if isinstance(value, list) else []


def _signals(path: Path, block: Block, device: _Device, first: int, several: bool) -> list[Column]:
    columns: list[Column] = []
    if device.columns[0].lower() == "nseq":
        why, numbers = "sequence number of the samples", block.numbers(first)
        if block.n_rows > 1 and numbers.min() == numbers.max():
            raise DataError(
                f"{path.name} has the sequence number {numbers[0]:g} in every row; expected counts, by "
                "which lost samples are found: it is damaged, export it again."
            )
        columns.append(Column(device.columns[0], "", numbers, device.rate, None, why))
    start = first + len(device.columns) - len(device.channels)
    for k, label in enumerate(device.channels):
        values = np.array(block.numbers(start + k))
        sensor = device.sensors[k].strip()
        named = f"{device.name}: {label}" if several else label
        named = f"{named} {sensor}" if sensor.upper() not in ("", "RAW") else named
        unit, apart = "", ""
        if sensor.upper() in ("EMG", "FEMG", "SEMG") and not device.converted:
            supply = next((v for key, v in _SUPPLY.items() if key in device.name.lower()), None)
            if supply is None or not 0 < device.bits[k] <= 32:
                apart = (
                    f"counts of an EMG sensor of {device.name or 'an unnamed device'}, whose transfer "
                    "function is not known: specify step and zero in a sidecar"
                )
            else:
                values = (values / 2.0 ** device.bits[k] - 0.5) * supply[0] / supply[1]
                unit = "V"
        elif sensor.upper() in ("EMG", "FEMG", "SEMG", "", "RAW", "CUSTOM"):
            apart = "" if device.converted else (
                "counts of a sensor that the file does not name: specify step and zero in a sidecar"
            )  # fmt: skip
        else:
            apart = f"of type {sensor}, not EMG"
        columns.append(Column(named, unit, values, device.rate, None, apart))
    return columns
