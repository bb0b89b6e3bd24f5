"""Fillers in markers and EMG become gaps; measured values do not."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import emgface as ef
from emgface.recordings.dataset import read_recording, write_recording
from emgface.recordings.fillers import emg_fillers, marker_fillers, without_fillers
from emgface.recordings.findings import findings_in

RNG = np.random.default_rng(11)
T = np.arange(4000) / 2000.0
RAW = 5e-6 * RNG.normal(size=T.size) * (1 + 20 * np.exp(-(((T - 1.0) / 0.2) ** 2)))
FRAMES = np.arange(300)
MARKER = np.stack([0.02 + 0.004 * np.sin(0.05 * FRAMES), 0.1 + 0 * FRAMES, 0.9 + 0 * FRAMES])
MARKER = MARKER + 3e-5 * RNG.normal(size=MARKER.shape)
SPAN = slice(900, 1100)

EMG_FILLERS = {
    "zeros": lambda x: 0.0,
    "held": lambda x: x[SPAN.start - 1],
    "9999 V": lambda x: 9999.0,
    "-32768 counts": lambda x: -32768 * 1e-6,
    "1e38": lambda x: 1e38,
    "infinity": lambda x: np.inf,
}
MARKER_FILLERS = {
    "zeros": lambda p: 0.0,
    "held": lambda p: p[:, 99:100],
    "9.999 m": lambda p: 9.999,
    "-1000 m": lambda p: -1e3,
    "one far frame": lambda p: -9.999,
    "far point": lambda p: np.array([[5.0], [-3.0], [8.0]]),
    "infinity": lambda p: np.inf,
}


@pytest.mark.parametrize("filler", EMG_FILLERS)
def test_fillers_of_emg_are_found_and_nothing_else(filler: str) -> None:
    values = RAW.copy()
    values[SPAN] = EMG_FILLERS[filler](values)
    (fillers,) = emg_fillers(values, 5e-4)
    expected = np.zeros(T.size, dtype=bool)
    expected[SPAN] = True
    np.testing.assert_array_equal(fillers.mask, expected)


@pytest.mark.parametrize("filler", MARKER_FILLERS)
def test_fillers_of_markers_are_found_and_nothing_else(filler: str) -> None:
    span = slice(100, 101) if "one" in filler else slice(100, 112)
    values = MARKER.copy()
    values[:, span] = MARKER_FILLERS[filler](values)
    (fillers,) = marker_fillers(values, 0.9)
    np.testing.assert_array_equal(np.flatnonzero(fillers.mask), np.arange(span.start, span.stop))


@pytest.mark.parametrize("codes", [(-9999.0, 9999.0), (0.0, -9999.0), (1e6,)])
def test_several_codes_and_codes_in_most_samples_are_fillers(codes: tuple[float, ...]) -> None:
    values, expected = RAW.copy(), np.zeros(T.size, dtype=bool)
    spans = [slice(100, 300), slice(1200, 1500)] if len(codes) > 1 else [slice(0, 2300)]
    for span, code in zip(spans, codes, strict=True):
        values[span], expected[span] = code * 1e-6, True
    masks = [filler.mask for filler in emg_fillers(values, 5e-4)]
    np.testing.assert_array_equal(np.any(masks, axis=0), expected)
    positions, frames = MARKER.copy(), np.zeros(FRAMES.size, dtype=bool)
    spans = [slice(20, 60), slice(100, 120)] if len(codes) > 1 else [slice(0, 170)]
    for span, code in zip(spans, codes, strict=True):
        positions[:, span], frames[span] = code * 1e-3, True
    masks = []
    for filler in marker_fillers(positions, 0.9):
        masks.append(filler.mask)
        positions[:, filler.mask] = np.nan
    np.testing.assert_array_equal(np.any(masks, axis=0), frames)


def clipped(x: np.ndarray) -> np.ndarray:
    return np.clip(x, -3e-5, 3e-5)


@pytest.mark.parametrize(
    "values",
    [
        RAW,
        clipped(RAW),
        np.abs(clipped(RAW)),
        np.round(RAW / 1e-6) * 1e-6,
        np.round(RAW / 2e-5) * 2e-5,
        np.where(T < 0.5, 0.0, np.round(np.abs(RAW) / 1e-5) * 1e-5),
        np.zeros(T.size),
        np.where(T > 1.5, np.nan, RAW),
        np.r_[RAW[:-1], 1.0],
        1e-3 * np.clip(np.sin(9.0 * T), -0.5, 0.3) + np.where(T > 0.3, 1e-4 * T**2, 0.0),
    ],
    ids="raw clipped rectified 1uV 20uV quiet constant ended spike resting".split(),
)
def test_measured_emg_has_no_filler(values: np.ndarray) -> None:
    assert list(emg_fillers(values, 5e-4)) == []


@pytest.mark.parametrize(
    "values",
    [
        MARKER,
        np.round(MARKER, 3),
        np.round(MARKER, 4),
        np.tile(MARKER[:, :1], 300),
        np.zeros((3, 300)),
        np.where(FRAMES > 150, np.array([[0.0], [0.01], [0.0]]), 0.0),
        np.where(FRAMES > 250, np.nan, MARKER),
        1e-3 * np.maximum(np.sin(0.05 * FRAMES), 0.0) * np.array([[1.0], [0.3], [-2.0]]),
        np.round(np.where(FRAMES < 200, MARKER[:, :1], MARKER), 4),
    ],
    ids="noise 1mm 0.1mm still origin step lost displacement resting".split(),
)
def test_measured_markers_have_no_filler(values: np.ndarray) -> None:
    assert list(marker_fillers(values, 0.2)) == []


def test_a_marker_at_the_origin_throughout_is_missing_if_the_others_are_elsewhere() -> None:
    (fillers,) = marker_fillers(np.zeros((3, 300)), 1.2)
    assert fillers.mask.all()


def test_random_recordings_of_any_resolution_have_no_filler() -> None:
    rng = np.random.default_rng(3)
    for _ in range(300):
        step = 10 ** rng.uniform(-8, -4.5)
        signal = 10 ** rng.uniform(-6, -4) * rng.normal(size=2000)
        assert list(emg_fillers(np.round(signal / step) * step, 1e-3)) == []
        grid = 10 ** rng.uniform(-5, -2)
        walk = np.cumsum(10 ** rng.uniform(-6, -3) * rng.normal(size=(3, 400)), axis=1)
        assert list(marker_fillers(np.round(walk / grid) * grid + 0.3, 0.5)) == []


def test_fillers_are_gaps_with_findings_in_every_way_of_opening(
    trial: xr.Dataset, tmp_path: Path
) -> None:
    rng = np.random.default_rng(1)
    n = 2000
    trial = trial.isel(time_emg=0, time_marker=0, drop=True).drop_vars(["emg", "position"])
    emg = rng.normal(scale=1e-5, size=(trial.sizes["channel"], n))
    emg[3, 700:800] = 0.0
    position = 0.5 + rng.normal(scale=1e-4, size=(trial.sizes["marker"], 3, 200))
    position[2, :, 50:60] = 0.0
    position[5, :, 90:95] = position[5, :, 89:90]
    trial = trial.assign(
        emg=(("channel", "time_emg"), emg, {"units": "V"}),
        position=(("marker", "axis", "time_marker"), position, {"units": "m"}),
    ).assign_coords(
        time_emg=("time_emg", np.arange(n) / 1000, {"units": "s"}),
        time_marker=("time_marker", np.arange(200) / 100, {"units": "s"}),
    )
    path = write_recording(trial, tmp_path / "a.nc")
    for opened in (read_recording(path), ef.read(path), without_fillers(trial)):
        assert int(np.isnan(opened["emg"]).sum()) == 100
        assert int(np.isnan(opened["position"]).sum()) == 3 * 15
        findings = {(f.kind, f.name): f.values["samples"] for f in findings_in(opened)}
        names = [str(name) for name in trial["marker"].values]
        channel = str(trial["channel"].values[3])
        assert findings == {
            ("channel", channel): 100,
            ("marker", names[2]): 10,
            ("marker", names[5]): 5,
        }
    again = read_recording(write_recording(read_recording(path), tmp_path / "b.nc"))
    xr.testing.assert_identical(again["position"], read_recording(path)["position"])
    assert findings_in(again) == findings_in(read_recording(path))
