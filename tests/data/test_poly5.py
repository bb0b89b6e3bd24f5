"""TMSi Poly5: files packed byte by byte, and a real one compared with its unpacked bytes."""

import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from emgface.errors import DataError, UnitsError
from emgface.recordings.check import check_recording
from emgface.recordings.dataset import read_recording
from emgface.recordings.findings import findings_in
from emgface.recordings.labels import note

PER_BLOCK = 16


def pascal(text: bytes, size: int) -> bytes:
    return (bytes([len(text)]) + text).ljust(size, b"\0")


def make_poly5(
    path: Path,
    channels: Sequence[tuple[str, bytes, np.ndarray]],
    *,
    rate: int = 2048,
    version: int = 203,
    ranges: tuple[float, float, float, float] = (0.0, 1.0, 0.0, 1.0),
    number_blocks: bool = False,
    **header: int,
) -> Path:
    """Write channels (label, unit, float32 or int16 samples) as the format describes."""
    samples = len(channels[0][2])
    blocks = -(-samples // PER_BLOCK)
    described, columns = [], []
    for label, unit, values in channels:
        wide = values.dtype == np.float32
        for stem in ("(Lo) ", "(Hi) ") if wide else ("",):
            name = pascal((stem + label).encode("latin-1"), 41) + bytes(4) + pascal(unit, 11)
            described.append((name + struct.pack("<4f", *ranges) + bytes(2 + 2)).ljust(136, b"\0"))
        columns.append(np.ascontiguousarray(values).view("<u2").reshape(samples, -1))
    words = np.concatenate(columns, axis=1)
    words = np.concatenate([words, np.zeros((blocks * PER_BLOCK - samples, words.shape[1]), "<u2")])
    size = 2 * len(described) * PER_BLOCK
    given = {"periods": samples, "blocks": blocks, "size": size, "compression": 0} | header
    start = b"POLY SAMPLE FILEversion %d.%02d\r\n\x1a" % divmod(version, 100)
    content = start.ljust({203: 31, 204: 32}[version], b"\0")
    content += struct.pack("<H", version) + pascal(b"a trial", 81)
    content += struct.pack("<HHBHi", rate, rate, 0, len(described), given["periods"]) + bytes(4)
    content += struct.pack("<7H", 2017, 4, 20, 4, 10, 30, 0)
    content += struct.pack("<iHHH", given["blocks"], PER_BLOCK, given["size"], given["compression"])
    content += bytes(64) + b"".join(described)
    for k in range(blocks):
        first = k if number_blocks else k * PER_BLOCK
        content += struct.pack("<i", first) + bytes(4 + 14 + 64)
        content += words[k * PER_BLOCK : (k + 1) * PER_BLOCK].astype("<u2").tobytes()
    path.write_bytes(content)
    return path


def signals(samples: int = 40, count: int = 3) -> list[tuple[str, bytes, np.ndarray]]:
    rng = np.random.default_rng(3)
    return [
        (f"E{i}", b"\xb5Volt", rng.normal(scale=50, size=samples).astype(np.float32))
        for i in range(1, count + 1)
    ]


@pytest.mark.parametrize("version", [203, 204])
@pytest.mark.parametrize("samples", [PER_BLOCK - 1, PER_BLOCK, 2 * PER_BLOCK + 8])
def test_floats_are_those_that_were_written(tmp_path: Path, version: int, samples: int) -> None:
    given = signals(samples)
    path = make_poly5(tmp_path / "trial.Poly5", given, version=version)
    trial = read_recording(path)
    assert list(trial["channel"].values) == ["E1", "E2", "E3"]
    expected = np.stack([v for _, _, v in given]).astype(float) / 1e6
    np.testing.assert_array_equal(trial["emg"], expected)
    np.testing.assert_array_equal(trial["time_emg"], np.arange(samples) / 2048)
    assert note(trial, "original_units") == {"emg": "\u00b5Volt"}
    assert trial.attrs["source"] == "trial.Poly5"


def test_integers_are_scaled_by_their_range(tmp_path: Path) -> None:
    counts = np.array([-32768, -1, 0, 1, 32767], np.int16)
    channel = [("E1", b"mV", counts)]
    path = make_poly5(tmp_path / "a.poly5", channel, ranges=(-5.0, 5.0, -32768.0, 32767.0))
    emg = read_recording(path)["emg"].values[0]
    expected = (-5.0 + (counts + 32768.0) * 10.0 / 65535.0) / 1e3
    np.testing.assert_allclose(emg, expected, rtol=1e-12, atol=1e-18)


def test_wide_and_narrow_channels_may_be_mixed(tmp_path: Path) -> None:
    given = signals(20, 2)
    given.insert(1, ("Dig", b"Bit", np.arange(20, dtype=np.int16)))
    trial = read_recording(make_poly5(tmp_path / "a.poly5", given))
    assert list(trial["channel"].values) == ["E1", "E2"]
    np.testing.assert_array_equal(trial["emg"].values[1], given[2][2].astype(float) / 1e6)
    assert note(trial, "dropped") == {"Dig": "in 'Bit', not a voltage"}


def test_a_mapping_names_muscles_and_unit(tmp_path: Path) -> None:
    given = [(label, b"", values) for label, _, values in signals()]
    path = make_poly5(tmp_path / "a.poly5", given)
    with pytest.raises(UnitsError, match="^a.poly5: None of the 3 analog channels has a unit"):
        read_recording(path)
    mapping: dict[str, Any] = {"units": {"emg": "uV"}, "channels": {"E2": "ZYG_L"}}
    trial = read_recording(path, mapping=mapping)
    assert list(trial["channel"].values) == ["ZYG_L"]
    assert note(trial, "original_names") == {"ZYG_L": "E2"}


def test_blocks_may_be_numbered_by_sample_or_by_one(tmp_path: Path) -> None:
    given = signals(50)
    one = read_recording(make_poly5(tmp_path / "a.poly5", given))
    other = read_recording(make_poly5(tmp_path / "b.poly5", given, number_blocks=True))
    np.testing.assert_array_equal(one["emg"], other["emg"])


def test_every_truncation_is_refused(tmp_path: Path) -> None:
    path = make_poly5(tmp_path / "a.poly5", signals(40, 1))
    whole = path.read_bytes()
    spare = (3 * PER_BLOCK - 40) * 4  # bytes after the last sample that carry none
    for length in range(0, len(whole) - spare, 7):
        path.write_bytes(whole[:length])
        with pytest.raises(DataError, match="^a.poly5 (begins with|is a Poly5|has .* truncated)"):
            read_recording(path)
    path.write_bytes(whole[: len(whole) - spare])
    assert read_recording(path).sizes["time_emg"] == 40


@pytest.mark.parametrize(
    ("header", "text"),
    [
        ({"periods": 2**31 - 1}, "do not agree"),
        ({"periods": 0}, "do not agree"),
        ({"periods": -5}, "do not agree"),
        ({"blocks": 2**27, "periods": 2**27 * PER_BLOCK - 1}, "truncated"),
        ({"blocks": 4}, "do not agree"),
        ({"size": 10}, "do not agree"),
        ({"compression": 1}, "delta-compressed"),
    ],
)
def test_a_header_that_contradicts_the_file_is_refused(
    tmp_path: Path, header: dict[str, int], text: str
) -> None:
    path = make_poly5(tmp_path / "a.poly5", signals(), **header)
    with pytest.raises(DataError, match=text):
        read_recording(path)


def test_missing_blocks_lost_halves_and_empty_ranges_are_refused(tmp_path: Path) -> None:
    path = make_poly5(tmp_path / "a.poly5", signals(40, 1))
    whole = bytearray(path.read_bytes())
    first = 217 + 2 * 136 + 86 + 4 * PER_BLOCK
    whole[first : first + 4] = struct.pack("<i", 3 * PER_BLOCK)
    path.write_bytes(whole)
    with pytest.raises(DataError, match="block 1 begins at sample 48, expected 16"):
        read_recording(path)
    path = make_poly5(tmp_path / "a.poly5", signals(40, 1))
    path.write_bytes(path.read_bytes().replace(b"(Hi)", b"(Ho)"))
    with pytest.raises(
        DataError, match="'.Lo. E1' followed by '.Ho. E1'; expected its second half"
    ):
        read_recording(path)
    path = make_poly5(tmp_path / "a.poly5", signals(40, 1), ranges=(0, 1, 5, 5))
    with pytest.raises(DataError, match="channel 'E1': the range 5 to 5 corresponds to 0 to 1"):
        read_recording(path)


def test_the_real_file_holds_ventilator_signals(shared: Path) -> None:
    path = shared / "recordings" / "resurfemg-poly5" / "vent_data_synth_pocc.Poly5"
    if not path.is_file():
        pytest.skip("the Poly5 file is not there")
    with pytest.raises(DataError, match="neither EMG nor markers .P: in 'cmH2O', not a voltage"):
        read_recording(path)
    trial = read_recording(path, mapping={"units": {"emg": "mV"}})
    assert dict(trial.sizes) == {"channel": 3, "time_emg": 42000}
    assert list(trial["channel"].values) == ["P", "F", "V"]
    np.testing.assert_array_equal(trial["time_emg"], np.arange(42000) / 100)
    # Block by block with the numbers of the header, as published with the file.
    data, pieces = path.read_bytes(), []
    for k in range(16):
        pieces.append(np.frombuffer(data, "<f4", 2730 * 3, 217 + 6 * 136 + k * (86 + 32760) + 86))
    expected = np.concatenate(pieces).reshape(-1, 3)[:42000].T
    np.testing.assert_array_equal(trial["emg"], expected.astype(float) / 1e3)


@pytest.mark.parametrize(("marked", "all_of_them"), [(slice(None), True), (slice(1, None), False)])
def test_a_status_that_marks_all_samples_is_the_reason_that_is_stated(
    tmp_path: Path, marked: slice, all_of_them: bool
) -> None:
    status = np.zeros(400, np.int16)
    status[marked] = -1
    path = make_poly5(tmp_path / "a.poly5", [*signals(400, 2), ("STATUS", b"Bit", status)])
    trial = read_recording(path)
    table = check_recording(trial).set_index("name")
    said = "all of the 400 samples are marked as bad by bit 8 of 'STATUS'"
    assert table.loc[["E1", "E2"], "reason"].str.contains(said).eq(all_of_them).all()
    assert not table.loc[["E1", "E2"], "reason"].str.contains("never visible").any()
    assert (table.loc[["E1", "E2"], "verdict"] == "error").all() or not all_of_them
    codes = [f.code for f in findings_in(trial)]
    assert codes[1:] == (["all_bad", "all_bad"] if all_of_them else ["bad_interval"])


def test_a_rate_of_zero_is_refused(tmp_path: Path) -> None:
    path = make_poly5(tmp_path / "a.poly5", signals(), rate=0)
    with pytest.raises(DataError, match="sampling rate of 0 Hz"):
        read_recording(path)
