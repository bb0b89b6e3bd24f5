"""Recovery of known shifts and scales by alignment."""

import numpy as np
import pytest
import xarray as xr
from synthetic_trajectories import DURATION, once, there_and_back, trajectory

from analysis.align import align
from analysis.errors import TrajectoryError
from analysis.lag import overlap_correlation

COURSES = pytest.mark.parametrize("course", [once, there_and_back])


def timing_bound(course, scale: float, shift: float, noise: float) -> tuple[float, float]:
    """Cramer-Rao bound [1, s] of scale and shift under white noise.

    Amplitude and offset of the coefficient vector are unknown as well.
    """
    t = np.linspace(0, DURATION, 160)
    size, step = 5e-3 * np.sqrt(10), 1e-5

    def b(k: float, s: float) -> np.ndarray:
        return size * course(k * t + s)

    jacobian = np.column_stack(
        [
            (b(scale + step, shift) - b(scale - step, shift)) / (2 * step),
            (b(scale, shift + step) - b(scale, shift - step)) / (2 * step),
            b(scale, shift),
            np.ones_like(t),
        ]
    )
    bound = noise * np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian)))
    return float(bound[0]), float(bound[1])


def test_overlap_correlation_against_a_loop() -> None:
    """Every lag against np.corrcoef of the overlapping samples."""
    rng = np.random.default_rng(1)
    x, y = rng.normal(size=23) + 100.0, rng.normal(size=17) - 40.0
    lags, r, overlap, motion, variance = overlap_correlation(x, y)
    assert list(lags) == list(range(-16, 23))
    for lag, correlation, count, part, var in zip(lags, r, overlap, motion, variance, strict=True):
        pairs = [(x[i], y[i - lag], i) for i in range(23) if 0 <= i - lag < 17]
        a, b = np.array([p[0] for p in pairs]), np.array([p[1] for p in pairs])
        assert count == len(pairs)
        if len(pairs) > 2:
            assert correlation == pytest.approx(np.corrcoef(a, b)[0, 1], abs=1e-10)
            fractions = a.var() * len(a) / (x.var() * 23), b.var() * len(b) / (y.var() * 17)
            assert part == pytest.approx(min(fractions), rel=1e-9)
            assert var == pytest.approx(b.var(), rel=1e-9)


def test_a_marker_that_is_never_visible_is_named() -> None:
    model = trajectory()
    measured = model.copy(deep=True)
    measured["position"][3] = np.nan
    name = str(model["marker"].values[3])
    with pytest.raises(TrajectoryError, match=f"measured marker {name} is visible at no instant"):
        align(measured, model)


@COURSES
@pytest.mark.parametrize("scaling", ["length", "search", "none"])
def test_equal_trajectories_stay_as_they_are(course, scaling: str) -> None:
    data = trajectory(course, noise=5e-4)
    aligned = align(data, data, scaling=scaling)
    assert (float(aligned["shift"]), float(aligned["scale"]), int(aligned["sign"])) == (0.0, 1.0, 1)
    assert float(aligned["overlap"]) == 1.0
    assert int(aligned["shift_at_bound"]) == 0
    np.testing.assert_allclose(aligned["position"], data["position"], atol=1e-15)
    np.testing.assert_allclose(aligned["b_aligned"], aligned["b_simulated"], atol=1e-15)


@COURSES
@pytest.mark.parametrize("shift", [-0.2, -0.0437, 0.0, 0.0083, 0.15])
def test_shift_without_noise(course, shift: float) -> None:
    """Recovered to a thousandth of a sampling period; the positions then agree.

    The remaining error is that of cubic interpolation at 100 Hz.
    """
    model = trajectory(course)
    aligned = align(trajectory(course, shift=shift, dim="time_marker"), model)
    assert float(aligned["shift"]) == pytest.approx(shift, abs=1e-5)
    assert float(aligned["scale"]) == 1.0
    gap = np.abs(aligned["position"] - model["position"]).max()
    assert float(gap) < 1e-5
    covered = np.isfinite(aligned["position"]).all(["marker", "axis"])
    assert float(aligned["overlap"]) == float(covered.mean())
    assert float(aligned["overlap"]) == pytest.approx(1 - abs(shift) / DURATION, abs=1 / 80)


@COURSES
@pytest.mark.parametrize(("shift", "scale"), [(-0.05, 1.1), (0.05, 0.9), (0.0, 1.2), (-0.1, 0.85)])
def test_scale_without_noise(course, shift: float, scale: float) -> None:
    """Recovered to a thousandth; the error is due to the common low-pass at different speeds."""
    aligned = align(trajectory(course, shift=shift, scale=scale), trajectory(course),
                  scaling="search")  # fmt: skip
    assert float(aligned["scale"]) == pytest.approx(scale, abs=1e-3)
    assert float(aligned["shift"]) == pytest.approx(shift, abs=1e-3)


@pytest.mark.slow
@COURSES
def test_shift_and_scale_under_noise_reach_the_cramer_rao_bound(course) -> None:
    """Forty noisy trials scatter no more than 1.4 times the least possible, without bias.

    1.4 is beyond the 99.9 % point of a standard deviation estimated from forty values.
    """
    shift, scale, noise, count = -0.05, 1.1, 5e-4, 40
    model = trajectory(course)
    errors = []
    for seed in range(count):
        data = trajectory(course, shift=shift, scale=scale, noise=noise, seed=seed)
        aligned = align(data, model, scaling="search")
        errors.append((float(aligned["scale"]) - scale, float(aligned["shift"]) - shift))
    for error, bound in zip(np.array(errors).T, timing_bound(course, scale, shift, noise),
                            strict=True):  # fmt: skip
        assert error.std(ddof=1) < 1.4 * bound
        assert abs(error.mean()) < 4 * bound / np.sqrt(count)


@pytest.mark.slow
@COURSES
def test_noise_creates_no_stretch(course) -> None:
    """With marker noise of 0.5 mm, a search does not stretch at least 90 % of the trials.

    The maximum of the correlation (`least_gain=0`) stretches nearly all of them.
    """
    model = trajectory(course)
    trials = [trajectory(course, shift=0.083, noise=5e-4, seed=seed) for seed in range(40)]
    kept = [float(align(data, model, scaling="search")["scale"]) == 1.0 for data in trials]
    assert np.mean(kept) >= 0.9
    plain = [align(data, model, scaling="search", least_gain=0.0)["scale"] for data in trials[:10]]
    assert np.mean([float(scale) == 1.0 for scale in plain]) < 0.5


@COURSES
def test_noise_creates_no_bias_of_the_shift(course) -> None:
    """Interpolation averages noise and, without the low-pass, biases shifts to between samples."""
    model, noise, count = trajectory(course), 5e-4, 40
    t = np.linspace(0, DURATION, 160)
    rate = 5e-3 * np.sqrt(10) * np.gradient(course(t), t)
    bound = noise / np.sqrt((rate**2).sum())
    errors = np.array(
        [
            float(align(trajectory(course, noise=noise, seed=s), model)["shift"])
            for s in range(count)
        ]
    )
    assert abs(errors.mean()) < 4 * bound / np.sqrt(count)
    assert errors.std(ddof=1) < 1.4 * bound


def test_periodic_movement_takes_the_nearest_peak() -> None:
    """An oscillation matches equally well at every period; the smallest shift is correct."""

    def wave(t: np.ndarray) -> np.ndarray:
        return np.sin(2 * np.pi * t / 0.2)

    for shift in (0.0, 0.03, -0.03):
        for seed in range(5):
            data = trajectory(wave, shift=shift, noise=5e-4, seed=seed)
            aligned = align(data, trajectory(wave))
            assert float(aligned["shift"]) == pytest.approx(shift, abs=0.01)


def test_length_is_normalised() -> None:
    """A movement twice as slow, recorded twice as long, with another rate and marker order."""
    model = trajectory()
    slow = trajectory(scale=0.5, shift=0.04, duration=2 * DURATION, count=401, dim="time_marker")
    slow = slow.isel(marker=slice(None, None, -1))
    aligned = align(slow, model)
    assert float(aligned["scale"]) == pytest.approx(0.5, rel=1e-12)
    assert float(aligned["shift"]) == pytest.approx(0.04, abs=1e-4)
    assert list(aligned["marker"].values) == list(model["marker"].values)
    assert float(np.abs(aligned["position"] - model["position"]).max()) < 2e-5


def test_durations_within_a_period_are_not_stretched() -> None:
    """159 and 160 samples are regarded as the same duration."""
    model = trajectory()
    assert float(align(model.isel(time=slice(None, -1)), model)["scale"]) == 1.0


def test_start_times_do_not_matter() -> None:
    model = trajectory()
    late = trajectory(shift=0.06).assign_coords(time=model["time"] + 12.0)
    assert float(align(late, model)["shift"]) == pytest.approx(0.06, abs=1e-4)


def test_uneven_simulated_time() -> None:
    """A simulation with halved steps keeps its instants."""
    keep = np.r_[0:60, 61:100:2, 100:160]
    model = trajectory().isel(time=keep)
    aligned = align(trajectory(shift=0.06), model)
    assert float(aligned["shift"]) == pytest.approx(0.06, abs=1e-4)
    np.testing.assert_array_equal(aligned["time"], model["time"])


def test_whole_samples_on_request() -> None:
    model = trajectory()
    aligned = align(trajectory(shift=0.083), model, subsample=False)
    period = DURATION / 159
    assert float(aligned["shift"]) == pytest.approx(round(0.083 / period) * period, abs=1e-12)


def test_uncentred_on_request() -> None:
    aligned = align(trajectory(shift=0.08), trajectory(), centred=False)
    assert aligned.attrs["centred"] == 0
    assert float(aligned["explained_variance_measured"]) > 0.97
    assert float(aligned["shift"]) == pytest.approx(0.08, abs=0.02)


def test_choices_and_identity_are_recorded() -> None:
    data = trajectory(origin="simulated", volunteer="v1", instruction="A", repetition=2)
    model = trajectory(strategy="act_3", origin="simulated")
    aligned = align(data, model, scaling="search", max_shift=0.3)
    assert aligned.attrs["origin"] == "simulated"
    assert (aligned.attrs["volunteer"], aligned.attrs["repetition"]) == ("v1", 2)
    assert aligned.attrs["strategy"] == "act_3"
    assert (aligned.attrs["scaling"], aligned.attrs["max_shift"]) == ("search", 0.3)
    assert all("units" in aligned[name].attrs for name in aligned.data_vars)


def test_result_survives_netcdf(tmp_path) -> None:
    aligned = align(trajectory(shift=0.05), trajectory())
    aligned.to_netcdf(tmp_path / "aligned.nc")
    with xr.open_dataset(tmp_path / "aligned.nc") as again:
        xr.testing.assert_equal(again.load(), aligned)
