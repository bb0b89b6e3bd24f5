"""Faults of a recording, with their channel or marker."""

import re

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from emgface.muscles import CHANNELS, FACE_MARKERS, LIP_MARKERS
from emgface.recordings.check import check_recording, findings_of, problems
from emgface.recordings.finding_codes import CODES


def row(table: pd.DataFrame, name: str) -> pd.Series:
    return table.set_index("name").loc[name]


@pytest.fixture
def clean(trial: xr.Dataset) -> xr.Dataset:
    trial["position"] = trial["position"].interpolate_na("time_marker")
    return trial


def test_a_clean_recording_has_no_finding(clean: xr.Dataset) -> None:
    table = check_recording(clean, study=True)
    assert list(table["name"]) == [*CHANNELS, *FACE_MARKERS, *LIP_MARKERS]
    assert set(table["verdict"]) == {"ok"} and set(table["reason"]) == {""}
    assert problems(table) == [] == problems(table, "warning")
    channel, marker = row(table, "OOS_L"), row(table, "nasion")
    assert (channel["kind"], channel["unit"]) == ("channel", "V")
    assert (marker["kind"], marker["unit"]) == ("marker", "m")
    assert (channel["rate"], channel["duration"]) == (2048.0, 0.25)
    assert marker["rate"] == pytest.approx(100.0, rel=1e-12)
    assert marker["duration"] == pytest.approx(0.25, rel=1e-12)
    assert channel["finite"] == marker["finite"] == 1.0


def test_measures_are_those_of_closed_forms(clean: xr.Dataset) -> None:
    time = clean["time_emg"].values
    clean["emg"].values[0] = 3e-4 * np.sin(2 * np.pi * 64 * time)  # 16 whole periods
    clean["position"].values[0] = 0.0
    clean["position"].values[0, 1] = np.where(np.arange(25) < 24, 0.002, -0.048)
    table = check_recording(clean)
    sine, marker = row(table, "OOS_L"), row(table, "forehead_left")
    assert sine["rms"] == pytest.approx(3e-4 / np.sqrt(2), rel=1e-12)
    assert (sine["smallest"], sine["largest"]) == pytest.approx((-3e-4, 3e-4), rel=1e-12)
    # Mean 0 over 25 frames: 24 at 2 mm and one at -48 mm.
    assert marker["rms"] == pytest.approx(np.sqrt((24 * 0.002**2 + 0.048**2) / 25), rel=1e-12)
    assert (marker["smallest"], marker["largest"]) == (-0.048, 0.002)


def test_a_gap_in_emg_is_an_error(clean: xr.Dataset) -> None:
    clean["emg"].values[3, 100:132] = np.nan
    clean["emg"].values[3, 200] = np.nan
    table = check_recording(clean)
    assert problems(table) == [
        "channel ZYG_L: 33 of 512 samples are NaN, the longest gap 0.01562 s: cut the trial or "
        "omit the channel."
    ]
    assert row(table, "ZYG_L")["finite"] == (512 - 33) / 512
    assert row(table, "ZYG_L")["longest_gap"] == 32 / 2048


@pytest.mark.parametrize("value", [0.0, -1e-3])
def test_a_constant_channel_is_an_error(clean: xr.Dataset, value: float) -> None:
    clean["emg"].values[1] = value
    table = check_recording(clean)
    assert problems(table) == [
        f"channel OOI_L: constant at {value:g} V: check electrode and cable."
    ]
    assert row(table, "OOI_L")["constant"]
    assert not row(table, "OOS_L")["constant"]


def test_a_channel_of_nan_only_is_an_error(clean: xr.Dataset) -> None:
    clean["emg"].values[1] = np.nan
    clean["position"].values[0] = np.nan
    table = check_recording(clean)
    assert problems(table) == [
        "channel OOI_L: is never visible: every sample is NaN.",
        "marker forehead_left: is never visible: every sample is NaN.",
    ]
    assert row(table, "OOI_L")["finite"] == 0.0
    assert np.isnan(row(table, "OOI_L")["rms"])


@pytest.mark.parametrize(("frames", "verdict"), [(1, "warning"), (10, "warning"), (11, "error")])
def test_a_gap_of_a_marker_counts_by_its_length(
    clean: xr.Dataset, frames: int, verdict: str
) -> None:
    clean["position"].values[4, 0, 3 : 3 + frames] = np.nan  # one axis is enough
    table = check_recording(clean, max_gap=0.1)
    assert row(table, "nasion")["verdict"] == verdict
    assert row(table, "nasion")["longest_gap"] == pytest.approx(frames / 100, rel=1e-12)
    assert len(problems(table, verdict)) == 1  # type: ignore[arg-type]


def test_a_marker_that_never_moves_is_an_error(clean: xr.Dataset) -> None:
    clean["position"].values[5] = clean["position"].values[5, :, :1]
    assert problems(check_recording(clean))[0].startswith("marker rhinion: does not move")


def test_an_irregular_clock_is_an_error(clean: xr.Dataset) -> None:
    time = clean["time_marker"].values.copy()
    time[10:] += 0.005
    table = check_recording(clean.assign_coords(time_marker=("time_marker", time)))
    assert len(problems(table)) == 16
    assert "intervals differ by over 10%" in problems(table)[0]


def test_a_single_sample_is_an_error(clean: xr.Dataset) -> None:
    table = check_recording(clean.isel(time_emg=[0]))
    assert len(problems(table)) == 14 and "has 1 samples" in problems(table)[0]


@pytest.mark.parametrize(("factor", "text"), [(1e3, "far above EMG"), (1e-4, "only: check electr")])
def test_an_amplitude_unlike_surface_emg_is_a_warning(
    clean: xr.Dataset, factor: float, text: str
) -> None:
    clean["emg"].values[2] *= factor
    table = check_recording(clean)
    assert problems(table) == []
    (sentence,) = problems(table, "warning")
    assert sentence.startswith("channel RIS_L: varies by") and text in sentence


def test_an_offset_is_accepted(clean: xr.Dataset) -> None:
    clean["emg"].values[2] += 0.05
    assert set(check_recording(clean)["verdict"]) == {"ok"}


def test_clocks_with_little_in_common_are_a_warning(clean: xr.Dataset) -> None:
    """As with half of the true sampling rate, or markers whose clock starts later."""
    wrong_rate = clean.assign_coords(time_emg=2.0 * clean["time_emg"])
    late = clean.assign_coords(time_marker=clean["time_marker"] + 0.15)
    for recording, common in ((wrong_rate, "0.24 s"), (late, "0.0995")):
        table = check_recording(recording)
        said = [text for text in table["reason"] if "in common" in text]
        assert len(said) == 1 and common in said[0]


def test_a_clipped_channel_is_a_warning(clean: xr.Dataset) -> None:
    clean["emg"].values[6] = np.clip(clean["emg"].values[6], -1e-4, 1e-4)
    (sentence,) = problems(check_recording(clean), "warning")
    assert sentence.startswith("channel MEN_L:") and sentence.endswith("extreme: clipped.")


def test_a_study_lists_what_is_missing(clean: xr.Dataset) -> None:
    labels = [str(c) for c in clean["channel"].values]
    labels[0] = "OOS_left"
    short = clean.assign_coords(channel=labels).isel(channel=slice(0, 13), marker=slice(0, 15))
    assert problems(check_recording(short)) == []
    table = check_recording(short, study=True)
    assert problems(table) == [
        "channel OOS_L: missing from the recording: it may be 'OOS_left'.",
        "channel MEN_R: missing from the recording: map a label of the file to it.",
        "marker lower_lateral_right: missing from the recording: map a label of the file to it.",
    ]


def test_either_part_may_be_absent(clean: xr.Dataset) -> None:
    emg = clean[["emg"]]
    assert set(check_recording(emg)["kind"]) == {"channel"}
    assert len(problems(check_recording(emg, study=True))) == 16
    assert check_recording(xr.Dataset()).empty


def test_findings_are_values_not_sentences() -> None:
    """Every clause says something itself; a value that is a sentence could not be compared.

    A channel that was left out states its unit and type as values, too, whatever the words.
    """
    for code, meaning in CODES.items() - {("left_out", CODES["left_out"])}:
        words = re.sub(r"\{[^}]*\}", "", meaning.clause)
        assert len(re.findall(r"[a-z]{3,}", words)) >= 2, code


def test_a_rate_without_the_pass_band_is_an_error_with_its_values(clean: xr.Dataset) -> None:
    slow = clean.assign_coords(time_emg=clean["time_emg"] * 100.0)
    findings = [f for f in findings_of(slow) if f.code == "no_band"]
    rate = 1.0 / float(slow["time_emg"].diff("time_emg").mean())
    assert findings and findings[0].values["rate"] == pytest.approx(rate)
    assert findings[0].values["half"] == pytest.approx(rate / 2)
    assert "at least an octave of the pass-band from 15 to 500 Hz" in findings[0].clause


@pytest.mark.parametrize("frames", [2, 5, None])
def test_two_markers_at_one_place_are_a_warning(clean: xr.Dataset, frames: int | None) -> None:
    """A copied trajectory, or two that the tracking joined; neither score nor check noticed it."""
    names = [str(m) for m in clean["marker"].values]
    clean["position"].values[4, :, :frames] = clean["position"].values[2, :, :frames]
    said = [text for text in problems(check_recording(clean), "warning") if "exactly" in text]
    assert len(said) == 1 and f"marker {names[2]}" in said[0] and names[4] in said[0]
    count = clean.sizes["time_marker"] if frames is None else frames
    assert f"in {count} frames, the first at t = {clean['time_marker'].values[0]:g} s" in said[0]


def test_markers_that_are_equal_in_one_coordinate_or_frame_are_not(clean: xr.Dataset) -> None:
    clean["position"].values[4, :2] = clean["position"].values[2, :2]
    clean["position"].values[5, :, :1] = clean["position"].values[3, :, :1]
    clean["position"].values[6:8, :, 10:20] = np.nan
    assert not [text for text in problems(check_recording(clean), "warning") if "exactly" in text]
