"""Noise of markers: estimated from the trial itself, and what it does to a correlation."""

import numpy as np
import pytest
import xarray as xr
from scipy.interpolate import CubicSpline
from synthetic_trajectories import once, there_and_back, trajectory

from analysis.align import align
from analysis.errors import AlignmentError
from analysis.noise import attenuation, marker_noise, noise_level, sampled_share
from analysis.scores import DROWNED, correlation_3d, score


@pytest.mark.parametrize("sigma", [1e-5, 1e-4, 1e-3])
@pytest.mark.parametrize("course", [once, there_and_back])
def test_known_noise_of_a_moving_marker(sigma: float, course) -> None:
    """Twenty trials of ten markers that move by 5 mm: no bias beyond 2 %, a scatter of 7 %."""
    found = [
        marker_noise(trajectory(course, noise=sigma, seed=seed)["position"]).values
        for seed in range(20)
    ]
    assert np.mean(found) == pytest.approx(np.sqrt(3) * sigma, rel=0.02)
    assert np.std(found) == pytest.approx(0.07 * np.sqrt(3) * sigma, rel=0.25)


def test_motion_leaves_nothing_and_leaps_count_little() -> None:
    still = marker_noise(trajectory()["position"])
    assert float(still.max()) < 5e-6
    rng = np.random.default_rng(0)
    values = 1e-4 * rng.normal(size=(3, 200))
    before = noise_level(values)
    values[:, 60:] += 0.01
    values[:, 120:140] = np.nan
    assert noise_level(values) == pytest.approx(before, rel=0.1)
    assert np.isnan(noise_level(values[:, :10]))


def test_noise_that_is_left_between_frames() -> None:
    """Against the variance of interpolated noise, on frames and half-way between them."""
    time = np.arange(120) / 100.0
    rng = np.random.default_rng(1)
    for offset, expected in ((0.0, 1.0), (0.005, None)):
        source = time[20:-20] + offset
        share = sampled_share(None, time, source)
        if expected is not None:
            assert share == pytest.approx(expected, rel=1e-12)
        drawn = CubicSpline(time, rng.normal(size=(400, 120)), axis=1)(source)
        assert share == pytest.approx(float(drawn.var()), rel=0.03)
    # a sample that is the mean of four frames keeps a quarter
    weight = np.kron(np.eye(30), np.full((4, 1), 0.25))
    assert sampled_share(weight, time[:30], time[:30]) == pytest.approx(0.25)


@pytest.mark.parametrize("ratio", [0.1, 0.5, 1.0, 2.0])
def test_correlation_is_attenuated_as_predicted(ratio: float) -> None:
    """Mean rho of noisy trajectories over that without noise, in closed form.

    `ratio` is the noise of one axis over the motion; a hundred trials, four standard errors.
    """
    t = np.linspace(0, 2 * np.pi, 200)
    v = np.stack([np.sin(t), np.sin(2 * t), 0 * t])
    w = np.stack([np.sin(t), 0.5 * np.cos(t), 0 * t])
    motion = np.sqrt((v**2).sum() / 200)
    dims = ("axis", "time")
    clean = float(correlation_3d(xr.DataArray(v, dims=dims), xr.DataArray(w, dims=dims)))
    rng = np.random.default_rng(2)
    sigma = ratio * motion
    noisy = xr.DataArray(v + sigma * rng.normal(size=(100, 3, 200)), dims=("trial", *dims))
    found = correlation_3d(noisy, xr.DataArray(w, dims=dims))
    expected = 1.0 / np.sqrt(1.0 + 3 * ratio**2)
    error = 4 * float(found.std()) / 10
    assert float(found.mean()) == pytest.approx(clean * expected, abs=error)
    size = ((noisy - noisy.mean("time")) ** 2).sum(dims) ** 0.5 / 200**0.5
    predicted = attenuation(size, xr.full_like(size, np.sqrt(3) * sigma))
    # The reliability is estimated without bias; its root is not where it may be zero.
    assert float((predicted**2).mean()) == pytest.approx(expected**2, abs=0.02)


@pytest.mark.parametrize("noise", [2e-4, 5e-4, 1e-3])
def test_attenuation_of_a_whole_trial_is_that_of_its_scores(noise: float) -> None:
    """Noise estimated, resampled and aligned; markers whose motion is twice as strong."""
    model = trajectory(there_and_back)
    trials = [trajectory(there_and_back, shift=0.055, noise=noise, seed=s) for s in range(10)]
    found = [score(align(data, model), model, smallest_snr=0.0) for data in trials]
    rho = np.array([one["rho"].values for one in found])
    predicted = np.array([one["attenuation"].values for one in found])
    kept = predicted.mean(axis=0) > np.sqrt(2 / 3)
    assert kept.sum() >= 3
    np.testing.assert_allclose(
        rho[:, kept].mean(axis=0), predicted[:, kept].mean(axis=0), atol=0.03
    )


def moving_but_one(scale: float, seed: int) -> xr.Dataset:
    """Camera noise of 0.1 mm a coordinate; one marker moves `scale` times as far as it did."""
    data = trajectory(shift=0.05)
    own = data["position"].values[4]
    own[:] = own.mean(axis=1, keepdims=True) + scale * (own - own.mean(axis=1, keepdims=True))
    rng = np.random.default_rng(seed)
    data["position"].values[:] += 1e-4 * rng.normal(size=data["position"].shape)
    return data


def test_still_marker_under_camera_noise_has_a_reason() -> None:
    model = trajectory()
    for seed in range(8):
        found = score(align(moving_but_one(0.0, seed), model), model)
        one = found.sel(marker="marker_4")
        assert str(one["reason"].values) == DROWNED
        assert np.isnan(one["rho"]) and np.isnan(one["amplitude_ratio"])
        assert float(one["attenuation"]) < 0.71
        assert int(np.isfinite(found["rho"]).sum()) == 9


def test_tiny_motion_above_the_noise_is_kept() -> None:
    """0.3 mm of motion under 0.17 mm of noise, three axes together."""
    model = trajectory()
    size = float(
        ((model["position"][4] - model["position"][4].mean("time")) ** 2).sum("axis").mean()
    )
    scale = 3e-4 / np.sqrt(size)
    for seed in range(5):
        one = score(align(moving_but_one(scale, seed), model), model).sel(marker="marker_4")
        assert str(one["reason"].values) == ""
        assert float(one["attenuation"]) == pytest.approx(0.87, abs=0.06)
        assert float(one["rho"]) == pytest.approx(float(one["attenuation"]), abs=0.08)


def test_trial_of_nothing_but_noise_is_refused() -> None:
    for seed in range(10):
        with pytest.raises(AlignmentError, match="does not move beyond its noise"):
            align(trajectory(amplitude=0.0, noise=1e-4, seed=seed), trajectory())


def test_small_motion_shared_by_all_markers_is_aligned() -> None:
    """Ten markers together show what none shows alone; each is then judged by itself."""
    data = trajectory(amplitude=1.5e-4, shift=0.05, noise=1e-4)
    found = align(data, trajectory())
    assert float(found["shift"]) == pytest.approx(0.05, abs=0.02)


def test_noise_that_a_dataset_carries_is_taken() -> None:
    data = trajectory(shift=0.05)
    data["noise"] = ("marker", np.linspace(1e-4, 1e-3, 10), {"units": "m"})
    shuffled = data.isel(marker=[3, 1, 2, 0, 4, 5, 9, 8, 7, 6])
    found = align(shuffled, trajectory())
    share = np.unique((found["noise"] / data["noise"]).values.round(12))
    assert share.size == 1 and 0.7 < share[0] < 1.0
    scored = score(found, trajectory())
    assert list(scored["noise"].values) == list(found["noise"].values)
    assert (np.diff(scored["attenuation"].values) != 0).all()
