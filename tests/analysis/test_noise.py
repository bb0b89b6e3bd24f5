"""Noise of markers, estimated from the trial, and its effect on a correlation."""

import numpy as np
import pytest
import xarray as xr
from synthetic_trajectories import once, there_and_back, trajectory

from analysis.align import _check_signal, align
from analysis.errors import AlignmentError
from analysis.noise import attenuation, marker_noise, noise_level, sampled_share, unit_noise
from analysis.scores import DROWNED, correlation_3d, score


@pytest.mark.parametrize("sigma", [1e-5, 1e-4, 1e-3])
@pytest.mark.parametrize("course", [once, there_and_back])
def test_known_noise_of_a_moving_marker(sigma: float, course) -> None:
    """Twenty trials of ten markers that move by 5 mm: bias below 2 %, standard deviation 7 %."""
    estimates = [
        marker_noise(trajectory(course, noise=sigma, seed=seed)["position"]).values
        for seed in range(20)
    ]
    assert np.mean(estimates) == pytest.approx(np.sqrt(3) * sigma, rel=0.02)
    assert np.std(estimates) == pytest.approx(0.07 * np.sqrt(3) * sigma, rel=0.25)


def test_motion_and_jumps_hardly_affect_the_noise_estimate() -> None:
    still = marker_noise(trajectory()["position"])
    assert float(still.max()) < 5e-6
    rng = np.random.default_rng(0)
    values = 1e-4 * rng.normal(size=(3, 200))
    before = noise_level(values)
    values[:, 60:] += 0.01
    values[:, 120:140] = np.nan
    assert noise_level(values) == pytest.approx(before, rel=0.1)
    assert np.isnan(noise_level(values[:, :10]))


def test_noise_after_interpolation_between_frames() -> None:
    """Half-way, it is the mean squared frequency response of the cardinal cubic spline.

    The cubic B-spline is 23/48 and 1/48 at half-way points, 4/6 and 1/6 at frames.
    """
    time = np.arange(160) / 100.0
    w = np.linspace(0, 2 * np.pi, 4096, endpoint=False)
    response = (46 * np.cos(w / 2) + 2 * np.cos(1.5 * w)) / 48 / ((4 + 2 * np.cos(w)) / 6)
    for offset, share in ((0.0, 1.0), (0.005, float((response**2).mean()))):
        sampled = sampled_share(None, time, time[20:-20] + offset)
        assert sampled == pytest.approx(share, rel=0.04)
    # a sample that is the mean of four frames keeps a quarter
    four = unit_noise(640).reshape(64, 160, 4).mean(axis=2)
    assert sampled_share(four, time, time) == pytest.approx(0.25, rel=0.04)
    assert (unit_noise(100) == unit_noise(100)).all()


def test_uneven_instants_have_no_noise_estimate() -> None:
    uneven = trajectory().isel(time=np.r_[0:60, 61:100:2, 100:160])
    assert np.isnan(marker_noise(uneven["position"])).all()
    scores = score(align(uneven, trajectory()), trajectory())
    assert np.isfinite(scores["rho"]).all() and np.isnan(scores["attenuation"]).all()


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
    rho = correlation_3d(noisy, xr.DataArray(w, dims=dims))
    expected = 1.0 / np.sqrt(1.0 + 3 * ratio**2)
    error = 4 * float(rho.std()) / 10
    assert float(rho.mean()) == pytest.approx(clean * expected, abs=error)
    size = ((noisy - noisy.mean("time")) ** 2).sum(dims) ** 0.5 / 200**0.5
    predicted = attenuation(size, xr.full_like(size, np.sqrt(3) * sigma))
    # The estimate of the reliability is unbiased; that of its root is not if it may be zero.
    assert float((predicted**2).mean()) == pytest.approx(expected**2, abs=0.02)


@pytest.mark.parametrize("noise", [2e-4, 5e-4, 1e-3])
def test_attenuation_of_a_whole_trial_is_that_of_its_scores(noise: float) -> None:
    """Noise is estimated, resampled and aligned; the motion of some markers is twice as large."""
    model = trajectory(there_and_back)
    trials = [trajectory(there_and_back, shift=0.055, noise=noise, seed=s) for s in range(10)]
    scored = [score(align(data, model), model, smallest_snr=0.0) for data in trials]
    rho = np.array([one["rho"].values for one in scored])
    predicted = np.array([one["attenuation"].values for one in scored])
    kept = predicted.mean(axis=0) > np.sqrt(2 / 3)
    assert kept.sum() >= 3
    np.testing.assert_allclose(
        rho[:, kept].mean(axis=0), predicted[:, kept].mean(axis=0), atol=0.03
    )


def moving_but_one(scale: float, seed: int) -> xr.Dataset:
    """Camera noise of 0.1 mm per coordinate; the motion of one marker is multiplied by `scale`."""
    data = trajectory(shift=0.05)
    own = data["position"].values[4]
    own[:] = own.mean(axis=1, keepdims=True) + scale * (own - own.mean(axis=1, keepdims=True))
    rng = np.random.default_rng(seed)
    data["position"].values[:] += 1e-4 * rng.normal(size=data["position"].shape)
    return data


def test_still_marker_under_camera_noise_has_a_reason() -> None:
    model = trajectory()
    for seed in range(8):
        scores = score(align(moving_but_one(0.0, seed), model), model)
        one = scores.sel(marker="marker_4")
        assert str(one["reason"].values) == DROWNED
        assert np.isnan(one["rho"]) and np.isnan(one["amplitude_ratio"])
        assert float(one["attenuation"]) < 0.71
        assert int(np.isfinite(scores["rho"]).sum()) == 9


def test_tiny_motion_above_the_noise_is_kept() -> None:
    """0.3 mm of motion with 0.17 mm of noise, three axes together."""
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


@pytest.mark.parametrize("count", [20, 160])
def test_a_trial_of_noise_only_is_refused(count: int) -> None:
    """Also of few frames, in which the first component of noise is many times larger."""
    for seed in range(10):
        with pytest.raises(AlignmentError, match="does not move beyond its noise"):
            align(trajectory(amplitude=0.0, noise=1e-4, count=count, seed=seed), trajectory())


def test_small_motion_shared_by_all_markers_is_aligned() -> None:
    """Ten markers together have a detectable motion, although none of them alone has."""
    data = trajectory(amplitude=1.5e-4, shift=0.05, noise=1e-4)
    aligned = align(data, trajectory())
    assert float(aligned["shift"]) == pytest.approx(0.05, abs=0.02)


def test_the_noise_stated_in_a_dataset_is_used() -> None:
    data = trajectory(shift=0.05)
    data["noise"] = ("marker", np.linspace(1e-4, 1e-3, 10), {"units": "m"})
    shuffled = data.isel(marker=[3, 1, 2, 0, 4, 5, 9, 8, 7, 6])
    aligned = align(shuffled, trajectory())
    share = (aligned["noise"] / data["noise"]).values
    np.testing.assert_allclose(share, share[0], rtol=1e-12)
    assert 0.7 < share[0] < 1.05
    scored = score(aligned, trajectory())
    assert list(scored["noise"].values) == list(aligned["noise"].values)
    assert (np.diff(scored["attenuation"].values) != 0).all()


@pytest.mark.parametrize(("share", "moves"), [(0.95, False), (1.05, True)])
def test_a_component_must_exceed_the_variance_of_that_of_noise(share: float, moves: bool) -> None:
    """That of ten markers with 30 coordinates, one of which is unknown, and 120 samples."""
    noise = np.sqrt(3.0) * 1e-4 * np.array([1.0] * 9 + [np.nan])  # 0.1 mm in each coordinate
    wanted = 1e-8 * (1.0 + np.sqrt(30 / 120)) ** 2
    course = np.sqrt(2.0 * share * 1.5 * wanted) * np.sin(2.0 * np.pi * np.arange(120) / 120)
    if moves:
        _check_signal(course, noise, 0.5)
    else:
        with pytest.raises(AlignmentError, match="does not move beyond its noise"):
            _check_signal(course, noise, 0.5)
