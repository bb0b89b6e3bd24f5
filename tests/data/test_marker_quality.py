"""Noise, jumps and exchanged names of markers."""

import warnings

import numpy as np
import pytest
import xarray as xr

from emgface.muscles import CHANNELS
from emgface.recordings.check import check_recording, problems
from emgface.recordings.quality import marker_quality, swapped_markers, swapped_sides
from emgface.volunteers.emg import band_limited_noise
from tests.data.made_recordings import MARKERS, RATE, face, noise, positions, recording


def test_noise_and_leaps_of_markers_are_measured() -> None:
    values = face(400)
    rng = np.random.default_rng(1)
    for scale in (5e-5, 1e-3):
        quality = marker_quality(positions(values + scale * rng.normal(size=values.shape)))
        np.testing.assert_allclose(quality["noise"], np.sqrt(3) * scale, rtol=0.2)
    values[9, :, 100] += 0.02
    table = check_recording(recording(noise(seconds=4.0), values))
    (sentence,) = problems(table, "warning")
    assert (
        sentence.startswith("marker upper_paramedian_right: moves at up to") and "jumps" in sentence
    )


def test_names_exchanged_in_a_trial_are_found() -> None:
    values = face(200)
    i, j = MARKERS.index("upper_lateral_left"), MARKERS.index("upper_paramedian_left")
    exchanged = values.copy()
    exchanged[[i, j], :, 120:] = values[[j, i], :, 120:]
    (row,) = swapped_markers(positions(exchanged)).to_dict("records")
    assert (row["first"], row["second"], row["time"]) == (MARKERS[i], MARKERS[j], 1.2)
    assert row["ratio"] < 0.1


@pytest.mark.parametrize(
    ("first", "second"),
    [("corner_left", "corner_right"), ("upper_paramedian_left", "lower_lateral_right"),
     ("nasion", "rhinion"), ("forehead_left", "temple_left"),
     ("upper_paramedian_left", "upper_paramedian_right"),
     ("upper_lateral_left", "upper_paramedian_left")],
)  # fmt: skip
def test_names_exchanged_throughout_are_found(first: str, second: str) -> None:
    i, j = MARKERS.index(first), MARKERS.index(second)
    values = face(20, seed=3, deform=0.05)
    values[[i, j]] = values[[j, i]]
    swaps = swapped_markers(positions(values))
    assert {(r.first, r.second) for r in swaps.itertuples()} == {(first, second)}
    assert swaps["time"].isna().all()


def test_a_mirrored_face_is_reported() -> None:
    values = face(20)
    values[:, 0] *= -1
    (row,) = swapped_markers(positions(values)).to_dict("records")
    assert (row["first"], row["second"]) == ("left", "right")
    text = problems(check_recording(recording(noise(), values)), "warning")
    assert any("axes are mirrored" in sentence for sentence in text)


def test_faces_of_many_shapes_are_not_suspected() -> None:
    suspected = sum(
        len(swapped_markers(positions(face(5, seed=s, deform=0.15)))) for s in range(40)
    )
    assert suspected == 0


def sided(sign: float) -> xr.Dataset:
    """Return a mouth drawn left, right, left by the muscles of the same or of the other side."""
    seconds = 8.0
    rng = np.random.default_rng(7)
    time = np.arange(int(seconds * RATE)) / RATE
    frames = np.arange(int(seconds * 100)) / 100
    draw = np.sin(2 * np.pi * time / 4)
    drive = np.where([[c.endswith("_L")] for c in CHANNELS], sign * draw, -sign * draw)
    values = 50e-6 * np.clip(drive, 0.05, None) * band_limited_noise(14, time.size, RATE, rng)
    places = face(frames.size)
    left, right = MARKERS.index("corner_left"), MARKERS.index("corner_right")
    way = np.sin(2 * np.pi * frames / 4)
    places[left, 0] += 0.012 * np.clip(way, 0, None)
    places[right, 0] -= 0.012 * np.clip(-way, 0, None)
    return recording(values, places)


def test_exchanged_sides_are_found_in_movements_to_one_side() -> None:
    right = swapped_sides(sided(1.0))
    assert len(right) == 4 and not right["swapped"].any() and (right["correlation"] > 0.5).all()
    wrong = swapped_sides(sided(-1.0))
    assert wrong["swapped"].all()
    text = problems(check_recording(sided(-1.0)), "warning")
    assert sum("check whether left and right are exchanged" in sentence for sentence in text) == 4


LOST = {
    "first frames": (slice(None), slice(5)),
    "last frames": (slice(None), slice(-20, None)),
    "one frame of all": (slice(None), slice(70, 71)),
    "a corner": (MARKERS.index("corner_left"), slice(50, 60)),
    "a skull marker": (0, slice(300, 500)),
    "all skull markers": (slice(0, 6), slice(300, 310)),
}


@pytest.mark.parametrize("lost", LOST)
def test_lost_frames_do_not_hide_exchanged_sides(lost: str) -> None:
    for sign in (1.0, -1.0):
        given = sided(sign)
        markers, frames = LOST[lost]
        given["position"].values[markers, :, frames] = np.nan
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            swaps = swapped_sides(given)
        assert len(swaps) == 4 and (swaps["swapped"] == (sign < 0)).all()


def test_equal_sides_raise_no_suspicion() -> None:
    assert not swapped_sides(recording(noise(), face(800)))["swapped"].any()
    assert swapped_sides(recording(noise())).empty


def test_the_markers_of_a_generated_face_are_not_suspected(coarse: xr.Dataset) -> None:
    model = coarse
    lips = model["position"].values[model["marker_node"].values]
    places = np.concatenate([model["face_marker_position"].values, lips])
    named = positions(np.repeat(places[:, :, None], 5, axis=2))
    assert [*model["face_marker"].values, *model["marker"].values] == list(named["marker"].values)
    assert swapped_markers(named).empty


@pytest.mark.parametrize("shift", [-6.5, -5.0, -4.5, 4.5, 5.5, 6.5])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_sides_are_not_judged_where_there_is_no_emg(sign: float, shift: float) -> None:
    """The first or last value of the EMG was held, and compared with a motion of another time."""
    given = sided(sign)
    given = given.assign_coords(time_emg=given["time_emg"] + shift)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert swapped_sides(given).empty


def test_sides_are_judged_during_the_emg() -> None:
    for sign in (1.0, -1.0):
        given = sided(sign)
        for part in (
            given.isel(time_emg=slice(int(6 * RATE))),
            given.isel(time_emg=slice(int(2 * RATE), None)),
        ):
            swaps = swapped_sides(part)
            assert len(swaps) == 4 and (swaps["swapped"] == (sign < 0)).all()
