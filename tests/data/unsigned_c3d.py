"""Writer of C3D files with unsigned 16-bit analog counts, by the specification of the format."""

import struct
from pathlib import Path

import numpy as np


def _parameter(group: int, name: str, kind: int, dims: tuple[int, ...], data: bytes) -> bytes:
    body = struct.pack("bB", kind, len(dims)) + bytes(dims) + data + b"\0"
    return (
        struct.pack("bb", len(name), group)
        + name.encode()
        + struct.pack("<h", 2 + len(body))
        + body
    )


def _group(number: int, name: str) -> bytes:
    return struct.pack("bb", len(name), -number) + name.encode() + struct.pack("<hB", 3, 0)


def _text(group: int, name: str, text: str) -> bytes:
    return _parameter(group, name, -1, (len(text), 1), text.encode())


def write_integers(path: Path, counts: np.ndarray, *, offset: int, scale: float) -> None:
    """Write one point and analog counts (channels, samples), ten samples in a frame."""
    channels, samples = counts.shape
    frames = samples // 10

    def words(*values: int) -> bytes:
        return struct.pack(f"<{len(values)}H", *values)

    def real(*values: float) -> bytes:
        return struct.pack(f"<{len(values)}f", *values)

    parameters = b"".join([
        _group(1, "POINT"), _parameter(1, "USED", 2, (), words(1)),
        _parameter(1, "SCALE", 4, (), real(0.1)), _parameter(1, "RATE", 4, (), real(100.0)),
        _parameter(1, "DATA_START", 2, (), words(4)), _parameter(1, "FRAMES", 2, (), words(frames)),
        _text(1, "LABELS", "M1"), _text(1, "UNITS", "mm"), _text(1, "DESCRIPTIONS", "M1"),
        _group(2, "ANALOG"), _parameter(2, "USED", 2, (), words(channels)),
        _parameter(2, "GEN_SCALE", 4, (), real(1.0)), _parameter(2, "RATE", 4, (), real(1000.0)),
        _parameter(2, "SCALE", 4, (channels,), real(*[scale] * channels)),
        _parameter(2, "OFFSET", 2, (channels,), words(*[offset] * channels)),
        _text(2, "LABELS", "E1"), _text(2, "UNITS", "V "), _text(2, "DESCRIPTIONS", "E1"),
        _text(2, "FORMAT", "UNSIGNED"), _parameter(2, "BITS", 2, (), words(16)),
    ])  # fmt: skip
    section = (b"\x01\x50\x02\x54" + parameters + b"\0\0").ljust(1024, b"\0")
    header = bytearray(512)
    struct.pack_into("<BB5H", header, 0, 2, 0x50, 1, 10 * channels, 1, frames, 0)
    struct.pack_into("<fHHf", header, 12, 0.1, 4, 10, 100.0)
    data = b""
    for frame in range(frames):
        data += struct.pack("<4h", 10 + frame, 20, 30, 0)
        data += counts[:, 10 * frame : 10 * (frame + 1)].T.astype("<u2").tobytes()
    path.write_bytes(
        (bytes(header) + section + data).ljust(-(-len(data) // 512) * 512 + 1536, b"\0")
    )
