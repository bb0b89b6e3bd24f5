"""TMSi Poly5 files (also .S00) of Porti, Refa and SAGA amplifiers.

A header, one description of 136 bytes for each 16-bit signal, and blocks of 86 bytes and samples.
A channel of 32-bit floats occupies two signals, named ``(Lo) x`` and ``(Hi) x``; a signal without
such a name is a 16-bit integer. Source: TMSi, Poly5/TMS32 file format, versions 2.03 and 2.04.
"""

import struct
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
import xarray as xr

from emgface.errors import DataError
from emgface.recordings.readers._build import assemble_parts, unique_labels, voltages
from emgface.recordings.readers._flags import with_bad_samples
from emgface.recordings.readers._row_flags import with_row_flags
from emgface.recordings.timebase import of_rate

SUFFIXES = (".poly5", ".s00")
FORMAT = "TMSi Poly5"

_MAGIC = b"POLY SAMPLE FILE"
_VERSIONS = {203: 31, 204: 32}  #: length of the initial text of the file, by version
_HEADER = struct.Struct("<H81pHHBHi4x14xiHHH64x")
_SIGNAL = struct.Struct("<41p4x11p4fHH60x")
_BLOCK = struct.Struct("<i4x14x64x")
_FILLED = 1 << 8
"""Bit of the status that marks samples inserted in place of lost ones (TMSi, SAGA user manual)."""


class _Header(NamedTuple):
    version: int
    name: bytes
    sample_rate: int
    storage_rate: int
    storage_type: int
    signals: int
    periods: int
    blocks: int
    periods_per_block: int
    block_size: int
    compression: int


class _Channel(NamedTuple):
    label: str
    unit: str
    low: tuple[float, float]
    high: tuple[float, float]
    words: int


def read(path: Path, units: Mapping[str, str]) -> xr.Dataset:
    """Read the channels that are voltages.

    Samples that the status channel marks as fillers are gaps, as are those that the counter lacks.
    The value is ``unit_low + (x - adc_low) (unit_high - unit_low) / (adc_high - adc_low)``. Raises
    DataError also if the file is compressed.
    """
    data = path.read_bytes()
    header, start = _header(path, data)
    channels, start = _channels(path, data, header, start)
    samples = _samples(path, data, header, channels, start)
    labels, names = unique_labels([channel.label for channel in channels], "channel")
    columns = dict(zip(labels, samples, strict=True))
    base = of_rate(
        path.name,
        header.periods,
        float(_rate(path, header)),
        by="its header",
        witnesses=columns,
    )
    part = voltages(samples, labels, [channel.unit for channel in channels], base, units, names)
    for label, values in zip(labels, samples, strict=True):
        if label.strip().lower() == "status":
            filled = (np.nan_to_num(values).astype(np.int64) & _FILLED) != 0
            part = with_bad_samples(part, "channel", base, filled, f"bit 8 of {label!r} (no data)")
    others = {k: v for k, v in columns.items() if k.strip().lower() != "status"}
    return assemble_parts([with_row_flags(part, "channel", base, others)])


def _text(value: bytes) -> str:
    return value.decode("latin-1").strip("\x00 ")


def _header(path: Path, data: bytes) -> tuple[_Header, int]:
    """Read the header; return it and its end."""
    if not data.startswith(_MAGIC):
        raise DataError(
            f"{path.name} begins with {data[:16]!r}; expected {_MAGIC.decode()!r}: it is not "
            "a Poly5 file, or damaged."
        )
    for version, start in _VERSIONS.items():
        end = start + _HEADER.size
        if len(data) >= end and struct.unpack_from("<H", data, start)[0] == version:
            header = _Header(*_HEADER.unpack_from(data, start))
            break
    else:
        raise DataError(
            f"{path.name} is a Poly5 file of {len(data)} bytes without a version 2.03 or 2.04; "
            "expected one of these: it is damaged, export it again."
        )
    if header.compression:
        raise DataError(
            f"{path.name} is delta-compressed; expected uncompressed samples: export it without "
            "compression."
        )
    counts = (header.signals, header.periods, header.blocks, header.periods_per_block)
    needed = -(-header.periods // max(header.periods_per_block, 1))
    if (
        min(counts) < 1
        or header.block_size != 2 * header.signals * header.periods_per_block
        or header.blocks != needed
    ):
        raise DataError(
            f"{path.name} declares {header.signals} signals, {header.periods} samples, "
            f"{header.blocks} blocks of {header.periods_per_block} samples and "
            f"{header.block_size} bytes, which do not agree; expected a closed recording: it was "
            "interrupted or damaged, export it again."
        )
    return header, end


def _channels(path: Path, data: bytes, header: _Header, start: int) -> tuple[list[_Channel], int]:
    """Read the signal descriptions; return the channels and the start of the blocks."""
    end = start + header.signals * _SIGNAL.size
    expected = end + header.blocks * (_BLOCK.size + header.block_size)
    # A last block that is not full may end after its last sample.
    spare = (header.blocks * header.periods_per_block - header.periods) * 2 * header.signals
    if not expected - spare <= len(data) <= expected:
        state = "truncated" if len(data) < expected else "damaged"
        raise DataError(
            f"{path.name} has {len(data)} bytes; expected {expected} for the {header.periods} "
            f"samples of {header.signals} signals it declares: it is {state}, copy it again."
        )
    channels: list[_Channel] = []
    position, halves = start, 0
    while position < end:
        name, unit, *limits = _SIGNAL.unpack_from(data, position)[:6]
        label = _text(name)
        words = 2 if label.startswith("(Lo)") else 1
        position += words * _SIGNAL.size
        if words == 2:
            halves += 1
            other = (
                _text(_SIGNAL.unpack_from(data, position - _SIGNAL.size)[0])
                if position <= end
                else "nothing"
            )
            if not other.startswith("(Hi)"):
                raise DataError(
                    f"{path.name} has the signal {label!r} followed by {other!r}; expected "
                    "its second half, '(Hi) ...': the file is damaged."
                )
            label = label.removeprefix("(Lo)").strip()
        unit_low, unit_high, adc_low, adc_high = (float(limit) for limit in limits)
        if not np.isfinite(limits).all() or adc_low == adc_high or unit_low == unit_high:
            raise DataError(
                f"{path.name}, channel {label!r}: the range {adc_low:g} to {adc_high:g} corresponds to "
                f"{unit_low:g} to {unit_high:g} {_text(unit)}; expected two ranges: the file is "
                "damaged."
            )
        low, high = (adc_low, unit_low), (adc_high, unit_high)
        channels.append(_Channel(label, _text(unit), low, high, words))
    return channels, end


def _samples(
    path: Path, data: bytes, header: _Header, channels: list[_Channel], start: int
) -> list[np.ndarray]:
    """Return the samples of each channel in its unit."""
    stride = _BLOCK.size + header.block_size
    whole = np.zeros(header.blocks * stride, np.uint8)
    whole[: len(data) - start] = np.frombuffer(data, np.uint8, offset=start)
    blocks = whole.reshape(header.blocks, stride)
    index = np.ascontiguousarray(blocks[:, :4]).view("<i4")[:, 0].astype(np.int64)
    steps = set(np.diff(index).tolist())
    # The index of a block is its first sample, or, by some programs, its number.
    if len(steps) > 1 or not steps <= {header.periods_per_block, 1}:
        wrong = np.diff(index) != header.periods_per_block
        at = int(np.argmax(wrong)) + 1
        raise DataError(
            f"{path.name}: block {at} begins at sample {index[at]}, expected "
            f"{index[at - 1] + header.periods_per_block}: blocks are missing or damaged, export "
            "the file again."
        )
    words = np.ascontiguousarray(blocks[:, _BLOCK.size :]).view("<u2")
    words = words.reshape(-1, header.signals)[: header.periods]
    result: list[np.ndarray] = []
    column = 0
    for channel in channels:
        raw = np.ascontiguousarray(words[:, column : column + channel.words])
        column += channel.words
        kind = "<f4" if channel.words == 2 else "<i2"
        values = raw.view(kind)[:, 0].astype(np.float64)
        (adc_low, unit_low), (adc_high, unit_high) = channel.low, channel.high
        if (adc_low, adc_high) != (unit_low, unit_high):
            scale = (unit_high - unit_low) / (adc_high - adc_low)
            values = unit_low + (values - adc_low) * scale
        result.append(values)
    return result


def _rate(path: Path, header: _Header) -> int:
    """Rate of the stored samples [Hz]."""
    rate = header.storage_rate if header.storage_type == 0 else header.sample_rate
    if rate < 1 or header.storage_type not in (0, 1):
        raise DataError(
            f"{path.name} specifies a sampling rate of {header.sample_rate} Hz, stored at "
            f"{header.storage_rate}; expected rates above 0 Hz: the file is damaged."
        )
    return rate
