"""BrainVision recordings, written here by the specification of the format."""

from pathlib import Path

import numpy as np
import pytest

from emgface.errors import DataError, UnitsError
from emgface.recordings.dataset import find_recordings, read_recording
from emgface.recordings.findings import findings_in
from emgface.recordings.inventory import inventory_table
from emgface.recordings.labels import note

COUNTS = np.random.default_rng(5).integers(-3000, 3000, size=(3, 200))
CODES = {"INT_16": "<i2", "INT_32": "<i4", "IEEE_FLOAT_32": "<f4", "UINT_16": "<u2"}
CHANNELS = "Ch1=ZYG\\1 left,,0.5,µV\nCh2=DAO,,0.001,mV\nCh3=Temp,,1,C"


def make(
    folder: Path,
    *,
    kind: str = "INT_16",
    order: str = "MULTIPLEXED",
    channels: str = CHANNELS,
    common: str = "",
    markers: str = "Mk1=New Segment,,1,1,0\nMk2=Stimulus,S 1,50,1,0",
    encoding: str = "utf-8",
    interval: str = "500",
) -> Path:
    """Write header, markers and counts."""
    header = (
        "Brain Vision Data Exchange Header File Version 1.0\n; a comment = no entry\n"
        f"[Common Infos]\n{'Codepage=UTF-8' if encoding == 'utf-8' else ''}\n"
        f"DataFile=$b.eeg\nMarkerFile=a.vmrk\nDataFormat=BINARY\nDataOrientation={order}\n"
        f"NumberOfChannels=3\nSamplingInterval={interval}\n{common}\n"
        f"[Binary Infos]\nBinaryFormat={kind}\n[Channel Infos]\n{channels}\n"
        "[Comment]\nNumberOfChannels=99\n"
    )
    path = folder / "a.vhdr"
    path.write_bytes(header.encode(encoding))
    (folder / "a.vmrk").write_text(
        f"Brain Vision Data Exchange Marker File, Version 1.0\n[Marker Infos]\n{markers}\n"
    )
    stored = np.abs(COUNTS) if kind == "UINT_16" else COUNTS
    laid = stored.T if order == "MULTIPLEXED" else stored
    (folder / "a.eeg").write_bytes(np.ascontiguousarray(laid).astype(CODES[kind]).tobytes())
    return path


@pytest.mark.parametrize("order", ["MULTIPLEXED", "VECTORIZED"])
@pytest.mark.parametrize("kind", CODES)
def test_counts_become_volts(tmp_path: Path, kind: str, order: str) -> None:
    trial = read_recording(make(tmp_path, kind=kind, order=order))
    stored = np.abs(COUNTS) if kind == "UINT_16" else COUNTS
    assert list(trial["channel"].values) == ["ZYG, left", "DAO"]
    np.testing.assert_allclose(trial["emg"].values[0], stored[0] * 0.5 / 1e6, rtol=1e-15)
    np.testing.assert_allclose(trial["emg"].values[1], stored[1] * 0.001 / 1e3, rtol=1e-15)
    np.testing.assert_allclose(trial["time_emg"], np.arange(200) / 2000.0, rtol=1e-15)
    assert note(trial, "dropped") == {"Temp": "in 'C', not a voltage"}


@pytest.mark.parametrize(
    "marker", ["Comment,LostSamples: 30,101,1,0", "LostSamples,Lost samples 30,101"]
)
def test_samples_that_markers_call_lost_are_gaps(tmp_path: Path, marker: str) -> None:
    trial = read_recording(make(tmp_path, markers=f"Mk1=New Segment,,1,1,0\nMk2={marker}"))
    lost = np.isnan(trial["emg"].values[0])
    np.testing.assert_array_equal(np.flatnonzero(lost), np.arange(100, 130))
    assert [f.code for f in findings_in(trial) if f.code != "left_out"] == ["gap"]
    with pytest.raises(DataError, match="30 samples are lost before sample 901 of 200"):
        read_recording(make(tmp_path, markers=f"Mk1={marker.replace('101', '901')}"))


def test_an_old_header_is_in_the_code_page_of_windows(tmp_path: Path) -> None:
    trial = read_recording(make(tmp_path, encoding="cp1252"))
    np.testing.assert_allclose(trial["emg"].values[0], COUNTS[0] * 0.5 / 1e6, rtol=1e-15)


def test_a_channel_without_unit_is_in_microvolts(tmp_path: Path) -> None:
    path = make(tmp_path, channels="Ch1=A,,0.5\nCh2=B,,\nCh3=C,,0.001,V")
    recording = read_recording(path)["emg"].values
    np.testing.assert_allclose(recording[0], COUNTS[0] * 0.5 / 1e6, rtol=1e-15)
    np.testing.assert_allclose(recording[1], COUNTS[1] / 1e6, rtol=1e-15)
    np.testing.assert_allclose(recording[2], COUNTS[2] / 1e3, rtol=1e-15)


def test_it_is_one_recording_of_a_folder_whose_digest_covers_the_samples(tmp_path: Path) -> None:
    path = make(tmp_path)
    assert find_recordings(tmp_path) == [path]
    assert list(inventory_table(tmp_path)["file"]) == ["a.vhdr"]
    before = read_recording(path).attrs["source_digest"]
    stored = bytearray((tmp_path / "a.eeg").read_bytes())
    stored[17] ^= 1
    (tmp_path / "a.eeg").write_bytes(bytes(stored))
    assert read_recording(path).attrs["source_digest"] != before


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"markers": "Mk1=New Segment,,1,1,0\nMk2=New Segment,,80,1,0"}, "paused.*sample 80"),
        ({"common": "SegmentationType=MARKERBASED"}, "contains MARKERBASED data"),
        ({"common": "DataType=FREQUENCYDOMAIN"}, "contains FREQUENCYDOMAIN data"),
        ({"common": "DataPoints=300"}, "declares 300"),
        ({"interval": "0"}, "SamplingInterval = '0'"),
        ({"channels": "Ch1=A,,1,V\nCh3=C,,1,V"}, "does not describe channel 2"),
        ({"channels": CHANNELS.replace("0.5", "half")}, "resolution is 'half'"),
        ({"order": "SIDEWAYS"}, "SIDEWAYS; expected BINARY"),
    ],
)
def test_recordings_that_are_not_continuous_are_refused(
    tmp_path: Path, changes: dict[str, str], match: str
) -> None:
    with pytest.raises(DataError, match=match):
        read_recording(make(tmp_path, **changes))


def test_truncated_and_missing_files(tmp_path: Path) -> None:
    path = make(tmp_path)
    stored = (tmp_path / "a.eeg").read_bytes()
    (tmp_path / "a.eeg").write_bytes(stored[:-1])
    with pytest.raises(DataError, match="truncated or damaged"):
        read_recording(path)
    (tmp_path / "a.eeg").unlink()
    with pytest.raises(DataError, match="not in its folder"):
        read_recording(path)
    with pytest.raises(UnitsError, match="not a unit of voltage"):
        read_recording(make(tmp_path), mapping={"units": {"emg": "kg"}})
