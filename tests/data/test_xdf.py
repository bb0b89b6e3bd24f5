"""XDF recordings of the Lab Streaming Layer, written here by the specification of the format."""

import struct
from pathlib import Path

import numpy as np
import pytest

from emgface.errors import DataError, UnitsError
from emgface.recordings.dataset import read_recording
from emgface.recordings.labels import note

RATE, FRAMES = 1000.0, 100.0
EMG = np.random.default_rng(3).normal(size=(500, 2))
POSITION = np.random.default_rng(4).normal(size=(50, 6))


def chunk(tag: int, content: bytes) -> bytes:
    return struct.pack("<BIH", 4, len(content) + 2, tag) + content


def channel(**entries: str) -> str:
    return "<channel>" + "".join(f"<{k}>{v}</{k}>" for k, v in entries.items()) + "</channel>"


def stream(
    number: int, kind: str, rate: float, start: float, values: np.ndarray, channels: list[str],
    *, footer: int | None = None, gap: float = 0.0, name: str = "",
) -> bytes:  # fmt: skip
    """Header, samples in two chunks, and footer of a stream."""
    head = (
        f'<?xml version="1.0"?><info><name>{name or kind}</name><type>{kind}</type>'
        f"<channel_count>{values.shape[1]}</channel_count><nominal_srate>{rate}</nominal_srate>"
        "<channel_format>double64</channel_format><desc><channels>"
        + "".join(channels)
        + "</channels></desc></info>"
    )
    which = struct.pack("<I", number)
    chunks = chunk(2, which + head.encode())
    half = len(values) // 2
    for first, rows in ((0, values[:half]), (half, values[half:])):
        content = which + struct.pack("<BI", 4, len(rows))
        for k, row in enumerate(rows):
            at = start + (first + k) / rate + (gap if first else 0.0)
            content += struct.pack("<Bd", 8, at) + row.astype("<f8").tobytes()
        chunks += chunk(3, content)
    count = len(values) if footer is None else footer
    chunks += chunk(6, which + f"<info><sample_count>{count}</sample_count></info>".encode())
    return chunks


def emg_stream(**options) -> bytes:
    channels = [channel(label="ZYG_L", unit="microvolts", type="EMG"),
                channel(label="ZYG_R", unit="mV", type="EMG")]  # fmt: skip
    return stream(1, "EMG", RATE, 100.0, EMG, channels, **options)


def mocap_stream(unit: str = "millimeters") -> bytes:
    channels = [
        channel(label=f"{marker}_{axis}", marker=marker, type=f"Position{axis}", unit=unit)
        for marker in ("nasion", "chin")
        for axis in "XYZ"
    ]
    return stream(2, "MoCap", FRAMES, 100.02, POSITION, channels)


def make(folder: Path, *streams: bytes) -> Path:
    path = folder / "a.xdf"
    header = chunk(1, b'<?xml version="1.0"?><info><version>1.0</version></info>')
    path.write_bytes(b"XDF:" + header + b"".join(streams))
    return path


def test_emg_and_markers_share_a_clock(tmp_path: Path) -> None:
    other = stream(3, "Audio", 10.0, 90.0, np.zeros((20, 1)), [])
    trial = read_recording(make(tmp_path, emg_stream(), mocap_stream(), other))
    assert list(trial["channel"].values) == ["ZYG_L", "ZYG_R"]
    np.testing.assert_allclose(trial["emg"].values[0], EMG[:, 0] / 1e6, rtol=1e-15)
    np.testing.assert_allclose(trial["emg"].values[1], EMG[:, 1] / 1e3, rtol=1e-15)
    np.testing.assert_allclose(trial["time_emg"], np.arange(500) / RATE, atol=1e-9)
    np.testing.assert_allclose(trial["time_marker"], 0.02 + np.arange(50) / FRAMES, atol=1e-9)
    expected = POSITION.reshape(50, 2, 3).transpose(1, 2, 0) / 1e3
    np.testing.assert_allclose(trial["position"].values, expected, rtol=1e-15)
    assert "stream Audio" in note(trial, "dropped")


def test_a_stream_of_another_type_with_channels_of_emg(tmp_path: Path) -> None:
    channels = [channel(label="Fz", unit="uV", type="EEG"),
                channel(label="DAO", unit="uV", type="EMG")]  # fmt: skip
    trial = read_recording(make(tmp_path, stream(1, "EEG", RATE, 5.0, EMG, channels)))
    assert list(trial["channel"].values) == ["DAO"]
    np.testing.assert_allclose(trial["emg"].values[0], EMG[:, 1] / 1e6, rtol=1e-15)


@pytest.mark.parametrize(
    ("make_streams", "match"),
    [
        (lambda: [emg_stream(footer=501)], "declares 501 samples but contains 500"),
        (lambda: [emg_stream(gap=3.0)], "lacks 3000 samples between the 500 that it contains"),
        (lambda: [emg_stream(), emg_stream().replace(b"\x01\x00\x00\x00", b"\x05\x00\x00\x00")],
         "contains 2 streams of EMG"),
        (lambda: [stream(1, "Audio", 10.0, 0.0, np.zeros((20, 1)), [])], "neither EMG nor markers"),
        (lambda: [mocap_stream().replace(b"PositionZ", b"PositionQ")],
            "does not describe a marker with three"),
        (lambda: [], "complete chunks"),
    ],
)  # fmt: skip
def test_incomplete_recordings_are_refused(tmp_path: Path, make_streams, match: str) -> None:
    with pytest.raises(DataError, match=match):
        read_recording(make(tmp_path, *make_streams()))


def test_a_file_cut_anywhere_is_refused(tmp_path: Path) -> None:
    """pyxdf would return the data before the end."""
    path = make(tmp_path, emg_stream(), mocap_stream())
    whole = path.read_bytes()
    for part in (0.05, 0.3, 0.7, 0.95):
        path.write_bytes(whole[: int(part * len(whole))])
        with pytest.raises(DataError, match="truncated or damaged"):
            read_recording(path)


def test_a_chunk_that_pyxdf_skips_is_refused(tmp_path: Path) -> None:
    """A damaged number of samples, without a footer for comparison."""
    path = make(tmp_path, emg_stream())
    data = bytearray(path.read_bytes())
    at = data.index(struct.pack("<BI", 4, 250))
    data[at + 1 : at + 5] = struct.pack("<I", 260)
    path.write_bytes(bytes(data))
    with pytest.raises(DataError, match="a\\.xdf"):
        read_recording(path)


def test_an_unknown_unit_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UnitsError, match="furlong"):
        read_recording(make(tmp_path, mocap_stream(unit="furlong")))
