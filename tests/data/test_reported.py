"""Situations that people reported publicly, as small files: read, reported or refused as required."""

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

import emgface as ef
from emgface.errors import DataError, UnitsError
from emgface.recordings.check import check_recording
from emgface.recordings.dataset import read_recording
from emgface.recordings.findings import findings_in

RATES = [("01-xdf-packet-loss/trial.xdf", 1000.0, 8.0), ("04-edf-tal-gap/d_nogap.edf", 2000.0, 8.0),
         ("05-counter-jumps/board.toml", 1000.0, 8.0)]  # fmt: skip


@pytest.fixture
def reported(shared: Path) -> Path:
    folder = shared / "reported"
    if not folder.is_dir():
        pytest.skip("the folder of reported situations is not there")
    return folder


def codes(recording: xr.Dataset) -> dict[str, Any]:
    return {finding.code: finding.values for finding in findings_in(recording)}


def onset(emg: xr.DataArray) -> float:
    """Instant at which the burst begins [s], by its power in 20 samples."""
    power = np.convolve(np.nan_to_num(emg.values) ** 2, np.ones(20) / 20, mode="same")
    return float(emg["time_emg"][np.argmax(power > 0.2 * power.max())])


@pytest.mark.parametrize(("file", "rate", "seconds"), RATES)
def test_lost_samples_keep_the_time(reported: Path, file: str, rate: float, seconds: float) -> None:
    recording = read_recording(reported / file)
    time = recording["time_emg"].values
    assert 1.0 / np.diff(time).mean() == pytest.approx(rate, rel=1e-6)
    assert time.size / rate == pytest.approx(seconds)
    if "04" not in file:
        assert onset(recording["emg"][0]) == pytest.approx(5.0, abs=0.03)


def test_counter_jumps_are_reported_with_place_and_number(reported: Path) -> None:
    recording = read_recording(reported / "05-counter-jumps/board.toml")
    assert codes(recording)["gaps"]["samples"] == 702
    table = check_recording(recording)
    assert "by the counter 'Sample Index'" in str(table["reason"][0])


@pytest.mark.parametrize("file", ["c_gap.edf", "d_gap.edf"])
def test_pauses_of_edf_are_gaps(reported: Path, file: str) -> None:
    recording = read_recording(reported / "04-edf-tal-gap" / file)
    assert codes(recording)["gap"]["at"] == pytest.approx(4.0)
    with pytest.raises(DataError, match="has a gap of 9 s"):
        ef.activate(recording, strategy="act_all", missing_side="mirror", missing_muscle="zero")


def test_other_streams_of_xdf(reported: Path) -> None:
    folder = reported / "15-xdf-others"
    assert codes(read_recording(folder / "nominal.xdf"))["rate"]["other"] == 2000.0
    for file in ("overlap.xdf", "reset.xdf"):
        time = read_recording(folder / file)["time_emg"].values
        np.testing.assert_allclose(time, np.arange(6000) / 1000, atol=1.5e-3)
    with pytest.raises(DataError, match="away from uniform samples"):
        read_recording(folder / "irregular.xdf")


def test_latencies_are_the_times_of_markers(reported: Path) -> None:
    (path,) = reported.glob("02-bids-latency/bids/**/*_emg.edf")
    recording = read_recording(path)
    moved = recording["position"].sel(marker="corner_left", axis="y")
    first = float(
        moved["time_marker"][np.argmax(np.nan_to_num(moved.values) > 0.5 * np.nanmax(moved))]
    )
    assert first == pytest.approx(5.0, abs=0.02)
    assert codes(recording)["gap_of_markers"]["seconds"] == pytest.approx(1.5)


def test_bad_channels_are_missing(reported: Path) -> None:
    (path,) = reported.glob("03-bids-status-bad/bids/**/*_emg.edf")
    recording = read_recording(path)
    assert "ZYG_R" not in recording["channel"].values
    row = check_recording(recording).set_index("name").loc["ZYG_R"]
    assert (row["verdict"], "electrode came off" in row["reason"]) == ("error", True)
    with pytest.warns(match="channel ZYG_R: marked as bad in channels.tsv"):
        activation = ef.activate(
            path, strategy="act_all", missing_side="mirror", missing_muscle="zero"
        )
    assert "copied from the other side: OOS_R, ZYG_R" in activation.attrs["montage"]
    assert "bad" in codes(activation)
    mapped = read_recording(path, mapping={"channels": {"ZYG_L": "ZYG_L", "ZYG_R": "ZYG_R"}})
    assert list(mapped["channel"].values) == ["ZYG_L"]


@pytest.mark.parametrize("file", ["dotv.edf", "muV.edf", "uVrms.edf", "uV2.edf"])
def test_unknown_units_are_named(reported: Path, file: str) -> None:
    path = reported / "08-edf-wrong-unit" / file
    with pytest.raises(UnitsError, match="ZYG_L, ZYG_R are in '.*', an unknown unit"):
        read_recording(path)
    assert read_recording(path, mapping={"units": {"emg": "uV"}}).sizes["channel"] == 2


@pytest.mark.parametrize("file", "first negative real_offset signed start0 unsigned12".split())
def test_scales_of_c3d(reported: Path, file: str) -> None:
    folder = reported / "09-c3d-scaling"
    scaled, usual = (read_recording(folder / f"{name}.c3d") for name in (file, "real_offset"))
    np.testing.assert_allclose(scaled["emg"], usual["emg"], atol=0.6e-6)


def test_other_byte_orders_of_c3d_are_named(reported: Path) -> None:
    with pytest.raises(DataError, match="byte order of SGI and MIPS"):
        read_recording(reported / "09-c3d-scaling/mips.c3d")


@pytest.mark.parametrize(
    ("file", "marker"),
    [("zeros_head.c3d", "forehead_left"), ("zeros_lip.c3d", "corner_left"),
     ("zeros.trc", "corner_left")],
)  # fmt: skip
def test_zeros_for_missing_markers_are_gaps(reported: Path, file: str, marker: str) -> None:
    folder = reported / "10-zero-for-missing"
    recording = read_recording(folder / file)
    marked = read_recording(folder / ("marked_head.c3d" if "head" in file else "marked_lip.c3d"))
    np.testing.assert_allclose(recording["position"], marked["position"], atol=1e-7)
    (filler,) = [f for f in findings_in(recording) if f.code == "filler_of_marker"]
    assert (filler.name, filler.values["samples"]) == (marker, 12)


def test_the_column_of_times_determines_the_rate(reported: Path) -> None:
    for file, rate, other in (("exact", 29.97, None), ("v2997", 29.97, 30.0), ("v2997long", 29.97, 30.0),
                             ("v60", 59.94, 60.0)):  # fmt: skip
        recording = read_recording(reported / "11-trc-rate" / f"{file}.trc")
        assert 1.0 / np.diff(recording["time_marker"]).mean() == pytest.approx(rate, rel=1e-6)
        assert codes(recording).get("rate", {}).get("other") == other


def test_contradicting_rates_of_bids_are_reported(reported: Path) -> None:
    (path,) = reported.glob("12-bids-rate/**/*_emg.edf")
    rates = [f.values["other_by"] for f in findings_in(read_recording(path)) if f.code == "rate"]
    assert rates == ["emg.json", "channels.tsv"]


@pytest.mark.parametrize(
    ("file", "code"), [("rect", "rectified"), ("env", "envelope"), ("rms", "envelope"), ("raw", "")]
)
def test_processed_emg_is_reported_after_mapping(reported: Path, file: str, code: str) -> None:
    folder = reported / "16-rectified"
    for path, mapping in ((f"{file}_named.c3d", None), (f"{file}_other.c3d", folder / "map.toml")):
        reasons = check_recording(read_recording(folder / path, mapping=mapping))["reason"]
        assert not reasons.str.contains("median frequency|artefact").any()
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            done = ef.activate(
                folder / path, mapping=mapping, strategy="act_all", missing_side="mirror",
                missing_muscle="zero", feature="rms",
            )  # fmt: skip
        assert (code in codes(done)) == bool(code)
        text = " ".join(str(one.message) for one in caught)
        assert ("is never negative" in text) == bool(code)


def test_check_states_a_size_that_score_refuses(reported: Path) -> None:
    folder = reported / "18-c3d-units"
    table = check_recording(read_recording(folder / "m_in_mm.c3d"))
    assert table["reason"].str.contains("check the unit of the positions").any()
    for file in ("MM.c3d", "cm.c3d"):
        assert (
            not check_recording(read_recording(folder / file))["reason"].str.contains("unit").any()
        )


@pytest.mark.parametrize("file", ["hold", "zero"])
def test_samples_that_the_status_marks_are_gaps(reported: Path, file: str) -> None:
    folder = reported / "19-poly5-dummy"
    marked, clean = (read_recording(folder / f"{name}.poly5") for name in (file, "clean"))
    gaps = np.isnan(marked["emg"].values)
    assert gaps.sum() == 2 * 1200
    np.testing.assert_array_equal(marked["emg"].values[~gaps], clean["emg"].values[~gaps])
    with pytest.warns(match="marked as bad by bit 8"), pytest.raises(DataError, match="has a gap"):
        ef.activate(marked, strategy="act_all", missing_side="mirror", missing_muscle="zero")
