"""Flags of alignments at a bound, and refusal of trajectories that cannot be aligned."""

import numpy as np
import pytest
import xarray as xr
from synthetic_trajectories import DURATION, once, there_and_back, trajectory

from analysis.align import _length_ratio, align
from analysis.errors import AlignmentError, TrajectoryError
from analysis.flags import flags_of
from analysis.lag import overlap_correlation
from analysis.scores import score

COURSES = pytest.mark.parametrize("course", [once, there_and_back])


def test_bound_on_the_shift() -> None:
    """The true shift is outside; the nearest allowed one is selected and flagged."""
    aligned = align(trajectory(shift=0.2), trajectory(), max_shift=0.1)
    assert abs(float(aligned["shift"])) <= 0.1
    assert int(aligned["shift_at_bound"]) == 1
    assert float(align(trajectory(shift=0.2), trajectory(), max_shift=0.0)["shift"]) == 0.0


@pytest.mark.parametrize("sign", ["direction", "correlation"])
@pytest.mark.parametrize("shift", [0.45, 0.6, 0.8])
def test_a_shift_beyond_the_overlap_is_flagged(sign: str, shift: float) -> None:
    """The allowed shifts contain smaller peaks, of which that of the mirror image is -0.75."""
    for one in (shift, -shift):
        aligned = align(
            trajectory(there_and_back, shift=one), trajectory(there_and_back), sign=sign
        )
        assert int(aligned["shift_at_bound"]) == 1
        inside = np.sign(one) * (shift - 0.41)
        near = align(
            trajectory(there_and_back, shift=inside), trajectory(there_and_back), sign=sign
        )
        assert int(near["shift_at_bound"]) == 0


def test_burst_shifted_out_of_the_overlap_is_a_weak_match() -> None:
    """With less than half of the motion, shifts cannot be distinguished."""
    aligned = align(trajectory(shift=0.8), trajectory())
    assert float(aligned["b_correlation"]) < 0.7
    assert int(aligned["weak_match"]) == 1
    assert int(align(trajectory(shift=0.3), trajectory())["weak_match"]) == 0


@COURSES
def test_noise_raises_no_flags(course) -> None:
    model = trajectory(course)
    for seed in range(10):
        aligned = align(trajectory(course, shift=0.1, noise=5e-4, seed=seed), model)
        assert flags_of(aligned) == []


def test_a_stretch_outside_the_range_is_flagged() -> None:
    """A quarter of a second is stretched by 6.4; a search ends at its bound."""
    short = trajectory(duration=0.25, count=26, scale=6.4)
    aligned = align(short, trajectory())
    assert float(aligned["scale"]) == pytest.approx(6.4)
    assert int(aligned["scale_at_bound"]) == 1
    searched = align(trajectory(scale=1.5), trajectory(), scaling="search")
    assert int(searched["scale_at_bound"]) == 1
    for scale in (0.9, 1.0, 1.15):
        inside = align(trajectory(scale=scale), trajectory(), scaling="search")
        assert int(inside["scale_at_bound"]) == 0


@pytest.mark.parametrize("lost", [slice(0, 20), slice(-20, None)])
@pytest.mark.parametrize("shift", [0.0, 0.083, -0.06])
def test_invisible_ends_are_omitted_and_do_not_change_the_stretch(
    lost: slice, shift: float
) -> None:
    """One marker is not visible for an eighth of the trial; shift and scale are unaffected."""
    model, data = trajectory(), trajectory(shift=shift, dim="time_marker")
    data["position"].values[4, :, lost] = np.nan
    aligned = align(data, model)
    assert float(aligned["scale"]) == 1.0
    assert float(aligned["shift"]) == pytest.approx(shift, abs=1e-4)
    period = DURATION / 159
    assert float(aligned["unseen_ends"]) == pytest.approx(20 * period, rel=1e-9)
    covered = np.isfinite(aligned["position"]).all(["marker", "axis"])
    assert float(aligned["overlap"]) == float(covered.mean()) < 0.9
    np.testing.assert_allclose(score(aligned, model)["rho"], 1.0, atol=1e-5)
    whole = align(trajectory(shift=shift), model)
    both = covered & np.isfinite(whole["position"]).all(["marker", "axis"])
    gap = (aligned["position"] - whole["position"]).where(both)
    assert float(abs(gap).max()) < 1e-5
    assert flags_of(aligned) == []


def test_a_small_overlap_is_flagged() -> None:
    data = trajectory()
    data["position"].values[:, :, 110:] = np.nan
    aligned = align(data, trajectory())
    assert float(aligned["overlap"]) == pytest.approx(110 / 160, abs=1 / 160)
    assert flags_of(aligned) == ["little_overlap"]


def test_small_overlap_cannot_win() -> None:
    """Two trajectories that agree only at their ends are not shifted to these ends."""
    rng = np.random.default_rng(3)
    t = np.linspace(0, DURATION, 160)
    tail = np.interp(t, np.linspace(0, DURATION, 12), rng.normal(size=12))
    head = np.interp(t, np.linspace(0, DURATION, 12), rng.normal(size=12))
    head[:30] = tail[-30:]
    model = trajectory(lambda own: np.interp(own, t, head))
    data = trajectory(lambda own: np.interp(own, t, tail))
    lags, r, *_ = overlap_correlation(head, tail)
    assert r[lags == -130] == pytest.approx(1.0, abs=1e-9)  # correlation of the short overlap
    aligned = align(data, model)
    assert float(aligned["overlap"]) >= 0.74
    assert abs(float(aligned["shift"])) <= 0.26 * DURATION


def still(data: xr.Dataset) -> xr.Dataset:
    data["position"].values[:] = data["position"].values[:, :, :1]
    return data


def gap(data: xr.Dataset) -> xr.Dataset:
    data["position"].values[3, :, 20:25] = np.nan
    return data


@pytest.mark.parametrize(
    ("spoil", "error", "words"),
    [
        (still, AlignmentError, "measured trajectory does not move"),
        (gap, TrajectoryError, r"gaps at 5 of 160 instants \(marker_3\)"),
        (lambda d: d.isel(marker=slice(1, None)), TrajectoryError, "not measured: marker_0"),
        (lambda d: d.isel(time=slice(0, 7)), TrajectoryError, "7 samples, expected at least 8"),
    ],
)
def test_degenerate_trajectories(spoil, error: type, words: str) -> None:
    with pytest.raises(error, match=words):
        align(spoil(trajectory()), trajectory())


def test_extra_markers_are_refused() -> None:
    with pytest.raises(TrajectoryError, match="not simulated: marker_9"):
        align(trajectory(), trajectory().isel(marker=slice(0, 9)))


def test_model_that_does_not_move() -> None:
    with pytest.raises(AlignmentError, match="simulated trajectory does not move"):
        align(trajectory(), trajectory(amplitude=1e-11))


@pytest.mark.parametrize(
    ("option", "words"),
    [
        ({"scaling": "linear"}, "'linear', expected 'length'"),
        ({"sign": "up"}, "'up', expected 'direction'"),
        ({"clear_cosine": 1.5}, "clear_cosine is 1.5"),
        ({"scale_range": (1.1, 1.2)}, "expected 0 < least <= 1"),
        ({"scale_step": 0.0}, "scale_step is 0.0"),
        ({"max_shift": -1.0}, "max_shift is -1.0 s"),
        ({"least_overlap": 0.0}, "least_overlap is 0.0"),
        ({"cutoff": 0.0}, "cutoff is 0.0 Hz"),
        ({"least_gain": 1.0}, "least_gain is 1.0"),
    ],
)
def test_options_out_of_range(option: dict, words: str) -> None:
    with pytest.raises(AlignmentError, match=words):
        align(trajectory(), trajectory(), **option)


def test_no_allowed_shift() -> None:
    """All the measured motion lies outside the overlap."""

    def early(t: np.ndarray) -> np.ndarray:
        return np.exp(-(((t - 0.05) / 0.01) ** 2))

    def late(t: np.ndarray) -> np.ndarray:
        return np.exp(-(((t - 2.95) / 0.01) ** 2))

    data = trajectory(late, duration=3.0, count=300)
    with pytest.raises(AlignmentError, match="no shift leaves an overlap"):
        align(data, trajectory(early), scaling="none", max_shift=0.1)


def test_durations_that_differ_by_more_than_a_period_are_scaled() -> None:
    def over(end: float) -> np.ndarray:
        return np.arange(0.0, end + 1e-12, 0.01)

    assert _length_ratio(over(1.0), over(1.0)) == 1.0
    assert _length_ratio(over(1.0), over(1.01)) == 1.0  # one period, which the sampling explains
    assert _length_ratio(over(1.0), over(1.02)) == pytest.approx(1.02)
    assert _length_ratio(over(1.02), over(1.0)) == pytest.approx(1 / 1.02)
