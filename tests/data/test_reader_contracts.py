"""Every registered reader: lost samples are gaps, fillers are gaps, findings follow their channel."""

import hashlib
import json
import os
import struct
import sys
from collections.abc import Callable
from pathlib import Path

import edfio
import ezc3d
import numpy as np
import pytest
import xarray as xr

from emgface.errors import DataError
from emgface.recordings.bids import write_bids
from emgface.recordings.dataset import read_recording, readers, write_recording
from emgface.recordings.findings import findings_in
from emgface.recordings.synchronise import cut
from emgface.view.workspace import Workspace
from tests.data.made_recordings import face, noise, recording
from tests.data.test_poly5 import make_poly5
from tests.data.test_xdf import channel, chunk

RATE, FRAME_RATE = 1000, 100
N, FRAMES = 2000, 200
RNG = np.random.default_rng(2)
EMG = np.round(40.0 * RNG.normal(size=(2, N)), 3)  #: in uV
MARKER = 30.0 + np.cumsum(0.05 * RNG.normal(size=(3, FRAMES)), axis=1)  #: in mm
LOST = (700, 30)  #: first lost sample, number
FILLED = slice(400, 500)
HIDDEN = slice(60, 75)

Kept = np.ndarray
"""Indices of the samples that were recorded."""


def edf(folder: Path, emg: np.ndarray, kept: Kept) -> Path:
    path = folder / "a.edf"
    whole = len(kept) // 10 * 10  # records of 10 samples
    limits = {"physical_range": (-1000, 1000), "digital_range": (-32768, 32767)}
    signals = [
        edfio.EdfSignal(row[:whole], RATE, label=f"E{k}", physical_dimension="uV", **limits)
        for k, row in enumerate(emg, start=1)
    ]
    counts = {"physical_range": (0, 32767), "digital_range": (0, 32767)}
    signals.append(edfio.EdfSignal(kept[:whole].astype(float), RATE, label="COUNT", **counts))
    edfio.Edf(signals, data_record_duration=0.01).write(path)
    return path


def brainvision(folder: Path, emg: np.ndarray, kept: Kept) -> Path:
    (folder / "a.vhdr").write_text(
        "Brain Vision Data Exchange Header File Version 1.0\n[Common Infos]\nDataFile=a.eeg\n"
        "DataFormat=BINARY\nDataOrientation=VECTORIZED\nNumberOfChannels=3\n"
        "SamplingInterval=1000\n[Binary Infos]\nBinaryFormat=IEEE_FLOAT_32\n[Channel Infos]\n"
        "Ch1=E1,,1,uV\nCh2=E2,,1,uV\nCh3=COUNT,,1,n\n"
    )
    (folder / "a.eeg").write_bytes(np.vstack([emg, kept]).astype("<f4").tobytes())
    return folder / "a.vhdr"


def poly5(folder: Path, emg: np.ndarray, kept: Kept) -> Path:
    rows = [("E1", b"uV", emg[0]), ("E2", b"uV", emg[1]), ("COUNTER", b"", kept)]
    described = [(label, unit, row.astype(np.float32)) for label, unit, row in rows]
    return make_poly5(folder / "a.poly5", described, rate=RATE)


def c3d(folder: Path, emg: np.ndarray, kept: Kept) -> Path:
    content = ezc3d.c3d()
    analog = content["parameters"]["ANALOG"]
    analog["LABELS"]["value"], analog["UNITS"]["value"] = ["E1", "E2", "COUNT"], ["uV", "uV", "n"]
    analog["RATE"]["value"] = [float(RATE)]
    content["parameters"]["POINT"]["RATE"]["value"] = [float(FRAME_RATE)]
    content["parameters"]["POINT"]["LABELS"]["value"] = ["M1"]
    content["parameters"]["POINT"]["UNITS"]["value"] = ["mm"]
    frames = len(kept) // 10
    points = np.ones((4, 1, frames))
    points[:3, 0] = MARKER[:, np.arange(frames) % FRAMES]
    content["data"]["points"] = points
    content["data"]["analogs"] = np.vstack([emg, kept])[None, :, : 10 * frames]
    content.write(str(folder / "a.c3d"))
    return folder / "a.c3d"


def xdf(folder: Path, emg: np.ndarray, kept: Kept) -> Path:
    channels = [channel(label=label, unit="microvolts", type="EMG") for label in ("E1", "E2")]
    head = (
        '<?xml version="1.0"?><info><name>amp</name><type>EMG</type><channel_count>2</channel_count>'
        f"<nominal_srate>{RATE}</nominal_srate><channel_format>double64</channel_format><desc>"
        f"<channels>{''.join(channels)}</channels></desc></info>"
    )
    which = struct.pack("<I", 1)
    samples = which + struct.pack("<BI", 4, len(kept))
    for k, row in zip(kept, emg.T, strict=True):
        samples += struct.pack("<Bd", 8, 50.0 + k / RATE) + row.astype("<f8").tobytes()
    text = f"<info><sample_count>{len(kept)}</sample_count></info>"
    path = folder / "a.xdf"
    first = chunk(1, b'<?xml version="1.0"?><info><version>1.0</version></info>')
    path.write_bytes(
        b"XDF:" + first + chunk(2, which + head.encode()) + chunk(3, samples)
        + chunk(6, which + text.encode())
    )  # fmt: skip
    return path


def csv_toml(folder: Path, emg: np.ndarray, kept: Kept) -> Path:
    table = np.vstack([kept / RATE, emg]).T
    np.savetxt(folder / "a.csv", table, delimiter=",", header="t,E1,E2", comments="", fmt="%.6f")
    path = folder / "a.toml"
    path.write_text('schema = "recording"\n[emg]\nfile = "a.csv"\ntime = "t"\nunit = "uV"\n'
                    '[emg.channels]\nE1 = "E1"\nE2 = "E2"\n')  # fmt: skip
    return path


def csv_counter(folder: Path, emg: np.ndarray, kept: Kept) -> Path:
    table = np.vstack([kept % 256, emg]).T
    np.savetxt(folder / "a.csv", table, delimiter=",", header="n,E1,E2", comments="", fmt="%.6f")
    path = folder / "a.toml"
    path.write_text('schema = "recording"\n[emg]\nfile = "a.csv"\nrate = 1000\nunit = "uV"\n'
                    '[emg.channels]\nE1 = "E1"\nE2 = "E2"\n')  # fmt: skip
    return path


def netcdf(folder: Path, emg: np.ndarray, kept: Kept) -> Path:
    recording = xr.Dataset(
        {"emg": (("channel", "time_emg"), emg / 1e6, {"units": "V"})},
        {"channel": ["E1", "E2"], "time_emg": ("time_emg", kept / RATE, {"units": "s"})},
        {"origin": "measured"},
    )
    return write_recording(recording, folder / "a.nc")


def trc(folder: Path, position: np.ndarray, kept: Kept) -> Path:
    lines = ["PathFileType\t4\t(X/Y/Z)\ta.trc",
             "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits",
             f"100.00\t100.00\t{len(kept)}\t1\tmm",
             "Frame#\tTime\tM1\t\t", "\t\tX1\tY1\tZ1"]  # fmt: skip
    for k, row in zip(kept, position.T, strict=True):
        lines.append("\t".join([str(k + 1), f"{k / 100:.3f}", *(f"{v:.5f}" for v in row)]))
    (folder / "a.trc").write_text("\n".join(lines) + "\n")
    return folder / "a.trc"


def bids_motion(folder: Path, position: np.ndarray, kept: Kept) -> Path:
    place = folder / "sub-01" / "motion"
    place.mkdir(parents=True)
    stem = "sub-01_task-A_run-1_tracksys-m"
    rows = [f"M1_{a}\t{a}\tPOS\tM1\tmm" for a in "xyz"] + ["latency\tn/a\tLATENCY\tn/a\ts"]
    table = "\n".join(["name\tcomponent\ttype\ttracked_point\tunits", *rows])
    (place / f"{stem}_channels.tsv").write_text(table + "\n")
    (place / f"{stem}_motion.json").write_text(json.dumps({"SamplingFrequency": 100}))
    values = np.vstack([position, kept / FRAME_RATE]).T
    np.savetxt(place / f"{stem}_motion.tsv", values, delimiter="\t", fmt="%.6f")
    return place / f"{stem}_motion.tsv"


Write = Callable[[Path, np.ndarray, Kept], Path]
OF_EMG: dict[str, Write] = {
    "edf": edf, "brainvision": brainvision, "poly5": poly5, "c3d": c3d, "xdf": xdf,
    "csv_toml": csv_toml, "csv_toml, counter": csv_counter, "netcdf": netcdf,
}  # fmt: skip
OF_MARKERS: dict[str, Write] = {"trc": trc, "bids_motion": bids_motion}


ELSEWHERE = {"text_exports"}
"""Readers whose files of many layouts are made, and examined in the same ways, in their own tests."""


def test_every_reader_is_examined() -> None:
    examined = {name.partition(",")[0] for name in (*OF_EMG, *OF_MARKERS)} | ELSEWHERE
    registered = {reader.__name__.rpartition(".")[2] for reader in readers().values()}  # type: ignore[attr-defined]
    assert registered - examined == set(), "add a writer of this format to OF_EMG or OF_MARKERS"


_opened: list[str] | None = None


def _hook(event: str, arguments: tuple) -> None:
    if event == "open" and _opened is not None and isinstance(arguments[0], str | os.PathLike):
        _opened.append(os.path.abspath(os.fspath(arguments[0])))


sys.addaudithook(_hook)


def opened_by_reading(path: Path, folder: Path) -> set[Path]:
    """Files in a folder that are opened while a recording is read."""
    global _opened
    _opened = []
    try:
        read_recording(path)
        return {Path(one) for one in _opened if one.startswith(f"{folder}{os.sep}")}
    finally:
        _opened = None


def bids(folder: Path, emg: np.ndarray, kept: Kept) -> Path:
    """Trial with markers, events and the times of scans."""
    trial = recording(noise(seconds=4.0), face())
    place = write_bids(trial.assign_attrs(volunteer="V1", instruction="A", repetition=1), folder)[0]
    events = place.with_name(place.name.rpartition("_")[0] + "_events.tsv")
    events.write_text("onset\tduration\ttrial_type\n0.5\t0.25\tBAD\n")
    return place


@pytest.mark.parametrize("name", [*OF_EMG, *OF_MARKERS, "bids"])
def test_the_digest_covers_each_file_that_is_opened(name: str, tmp_path: Path) -> None:
    """Tables and markers of a BIDS dataset could change without another digest of the source."""
    write = {**OF_EMG, "bids": bids}.get(name)
    if write is None:
        path = OF_MARKERS[name](tmp_path, MARKER, np.arange(FRAMES))
    else:
        path = write(tmp_path, EMG, np.arange(N))
    files = opened_by_reading(path, tmp_path)
    assert path in files and (name != "bids" or len(files) > 6), files
    companions = getattr(readers()[path.suffix], "companions", lambda _: [])
    covered = [path, *companions(path)]
    assert files <= set(covered), files - set(covered)
    whole = hashlib.sha256(b"".join(one.read_bytes() for one in covered)).hexdigest()
    assert read_recording(path).attrs["source_digest"] == whole
    # A workspace of the page is bound to the same files.
    opened = Workspace.open(tmp_path / "work", {"recording": path}, ("ZYG_L",))
    assert opened.digests["recording"] == whole


def remaining(samples: int, first: int, number: int) -> Kept:
    return np.delete(np.arange(samples), np.arange(first, first + number))


@pytest.mark.parametrize("name", OF_EMG)
def test_a_whole_recording_has_no_finding(name: str, tmp_path: Path) -> None:
    recording = read_recording(OF_EMG[name](tmp_path, EMG, np.arange(N)))
    np.testing.assert_allclose(recording["time_emg"], np.arange(N) / RATE, atol=1e-9)
    np.testing.assert_allclose(recording["emg"].sel(channel="E1"), EMG[0] / 1e6, atol=4e-8)
    assert [f.sentence for f in findings_in(recording) if f.code != "left_out"] == []


@pytest.mark.parametrize("name", OF_EMG)
def test_lost_samples_are_gaps(name: str, tmp_path: Path) -> None:
    kept = remaining(N, *LOST)
    recording = read_recording(OF_EMG[name](tmp_path, EMG[:, kept], kept))
    whole = np.full(N, np.nan)
    whole[kept] = EMG[0, kept] / 1e6
    size = recording.sizes["time_emg"]
    assert size >= N - 10  # whole records and frames alone are written
    np.testing.assert_allclose(recording["time_emg"], np.arange(size) / RATE, atol=1e-9)
    np.testing.assert_allclose(recording["emg"].sel(channel="E1"), whole[:size], atol=4e-8)
    (gap,) = [f for f in findings_in(recording) if f.code == "gap"]
    assert (gap.values["samples"], gap.values["at"]) == (30, pytest.approx(0.7))


@pytest.mark.parametrize("name", [n for n in OF_EMG if n != "netcdf"])
def test_the_unit_of_a_channel_in_a_mapping_replaces_that_of_the_file(
    name: str, tmp_path: Path
) -> None:
    path = OF_EMG[name](tmp_path, EMG, np.arange(N))
    own, single, every = (
        read_recording(path, mapping={"units": units})["emg"].sel(channel=["E1", "E2"])
        for units in ({}, {"E2": "mV"}, {"E2": "mV", "emg": "nV"})
    )
    np.testing.assert_allclose(single, own * [[1.0], [1e3]], rtol=1e-9)
    np.testing.assert_allclose(every, own * [[1e-3], [1e3]], rtol=1e-9)


@pytest.mark.parametrize("name", OF_MARKERS)
def test_the_unit_of_positions_in_a_mapping_replaces_that_of_the_file(
    name: str, tmp_path: Path
) -> None:
    path = OF_MARKERS[name](tmp_path, MARKER, np.arange(FRAMES))
    own, given = (
        read_recording(path, mapping={"units": units})["position"]
        for units in ({}, {"position": "cm"})
    )
    np.testing.assert_allclose(given, 10.0 * own, rtol=1e-9)


@pytest.mark.parametrize("units", [{"E2": "mV"}, {"emg": "mV"}])
def test_a_recording_in_si_units_takes_no_unit(units: dict[str, str], tmp_path: Path) -> None:
    with pytest.raises(DataError, match="states its units"):
        read_recording(netcdf(tmp_path, EMG, np.arange(N)), mapping={"units": units})


@pytest.mark.parametrize("name", [n for n in OF_EMG if n not in ("netcdf", "csv_toml", "xdf")])
def test_a_packet_stored_twice_is_reported(name: str, tmp_path: Path) -> None:
    kept = np.r_[0:700, 680:1980]
    recording = read_recording(OF_EMG[name](tmp_path, EMG[:, kept], kept))
    (finding,) = [f for f in findings_in(recording) if f.code != "left_out"]
    assert (finding.code, finding.values["at"]) == ("counter", pytest.approx(0.7))


@pytest.mark.parametrize("name", OF_EMG)
def test_fillers_are_gaps_and_findings_follow_their_channel(name: str, tmp_path: Path) -> None:
    filled = EMG.copy()
    filled[0, FILLED] = 0.0 if name != "edf" else filled[0, FILLED.start]  # 0 is between two counts
    path = OF_EMG[name](tmp_path, filled, np.arange(N))
    channels = {"E2": "ZYG_R", "E1": "ZYG_L"}
    recording = read_recording(path, mapping={"channels": channels})
    gaps = np.isnan(recording["emg"])
    assert 99 <= int(gaps.sel(channel="ZYG_L").sum()) <= 100
    assert not gaps.sel(channel="ZYG_R").any()
    (filler,) = [f for f in findings_in(recording) if f.code == "filler"]
    assert (filler.kind, filler.name) == ("channel", "ZYG_L")
    again = read_recording(write_recording(recording, tmp_path / "kept.nc"))
    assert findings_in(again) == findings_in(recording)
    early, late = cut(again, 0.2, 1.0), cut(again, 1.0, 1.9)
    (moved,) = [f for f in findings_in(early) if f.code == "filler"]
    assert moved.values["at"] == pytest.approx(float(filler.values["at"]) - 0.2)
    assert not [f for f in findings_in(late) if f.code == "filler"]
    other = read_recording(path, mapping={"channels": {"E2": "ZYG_R"}})
    assert not [f for f in findings_in(other) if f.code == "filler"]


@pytest.mark.parametrize("name", OF_MARKERS)
def test_lost_frames_and_fillers_of_markers_are_gaps(name: str, tmp_path: Path) -> None:
    filled = MARKER.copy()
    filled[:, HIDDEN] = 0.0
    kept = remaining(FRAMES, 120, 7)
    recording = read_recording(OF_MARKERS[name](tmp_path, filled[:, kept], kept))
    expected = np.full((3, FRAMES), np.nan)
    expected[:, kept] = filled[:, kept] / 1e3
    expected[:, HIDDEN] = np.nan
    np.testing.assert_allclose(recording["position"].sel(marker="M1"), expected, atol=1e-8)
    np.testing.assert_allclose(recording["time_marker"], np.arange(FRAMES) / 100, atol=1e-9)
    codes = {f.code: f.values for f in findings_in(recording)}
    assert codes["gap_of_markers"]["samples"] == 7
    assert codes["filler_of_marker"]["samples"] == 15


def test_fillers_of_markers_with_emg_are_gaps(tmp_path: Path) -> None:
    filled = MARKER.copy()
    filled[:, HIDDEN] = filled[:, HIDDEN.start - 1 : HIDDEN.start]
    MARKER_BEFORE = MARKER.copy()
    try:
        MARKER[:] = filled
        recording = read_recording(c3d(tmp_path, EMG, np.arange(N)))
    finally:
        MARKER[:] = MARKER_BEFORE
    np.testing.assert_array_equal(
        np.flatnonzero(np.isnan(recording["position"].values[0, 0])), np.arange(60, 75)
    )
