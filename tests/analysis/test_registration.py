"""Means of motions: registration in time, equal weights, and amplitude."""

import numpy as np
import pytest
from synthetic_trajectories import once, trajectory

from analysis.align import align
from analysis.errors import AlignmentError
from analysis.registration import displacement, mean_motion, registered, retimed

OPTIONS = {"scaling": "none"}


def size(motion) -> float:
    """Root-mean-square displacement of all markers [m]."""
    return float(np.sqrt((displacement(motion).values ** 2).sum(axis=1).mean()))


def test_mean_of_shifted_motions_is_the_motion() -> None:
    """Without registration the peak of the mean would be lower by a tenth."""
    motions = [trajectory(shift=shift) for shift in (0.0, 0.1, -0.1, 0.06)]
    mean, whole = mean_motion(motions, OPTIONS), displacement(motions[0])
    fitted = align(whole, mean, **OPTIONS)["position"].isel(time=slice(30, 130)).values
    error = mean.values[:, :, 30:130] - fitted
    error -= error.mean(axis=2, keepdims=True)
    assert np.abs(error).max() < 1e-3 * np.ptp(whole.values)
    plain = np.mean([displacement(motion).values for motion in motions], axis=0)
    assert np.ptp(plain) < 0.97 * np.ptp(whole.values) < 0.971 * np.ptp(mean.values)
    assert mean.attrs == {"units": "m", "contributors": 4}


def test_mean_is_of_displacements_in_metres() -> None:
    """Equal movements of 4 and 8 mm about different postures have a mean of 6 mm."""
    small, large = trajectory(amplitude=4e-3), trajectory(amplitude=8e-3)
    large["position"] = large["position"] + 0.01
    mean = mean_motion([small, large], OPTIONS)
    np.testing.assert_allclose(size(mean), 1.5 * size(small), rtol=1e-9)


def test_order_does_not_matter() -> None:
    motions = [
        trajectory(shift=k / 50, amplitude=(4 + k) * 1e-3, noise=1e-4, seed=k) for k in range(3)
    ]
    first, second = mean_motion(motions, OPTIONS), mean_motion(motions[::-1], OPTIONS)
    np.testing.assert_allclose(first.values, second.values, rtol=0, atol=1e-12)


def test_mean_of_one_motion_is_its_displacement() -> None:
    motion = trajectory()
    mean = mean_motion([motion], OPTIONS)
    np.testing.assert_allclose(mean.values, displacement(motion).values, atol=1e-15)


def test_motions_without_movement_are_omitted_and_counted() -> None:
    still = trajectory(amplitude=0.0)
    mean = mean_motion([still, trajectory(), trajectory(shift=0.05)], OPTIONS)
    assert mean.attrs["contributors"] == 2
    assert registered([still], trajectory(), OPTIONS) == [None]
    for motions in ([], [still]):
        with pytest.raises(AlignmentError, match="0 motions moves|1 motions moves"):
            mean_motion(motions, OPTIONS)


def test_a_registered_motion_keeps_its_duration() -> None:
    """It is held at its ends; a shorter motion would be stretched in a comparison."""
    (transform,) = registered([trajectory(shift=0.2)], trajectory(), OPTIONS)
    assert (
        transform is not None
        and transform.sizes["time"] == 160
        and np.isfinite(transform.values).all()
    )
    np.testing.assert_array_equal(transform.values[:, :, 0], transform.values[:, :, 1])


def test_retiming_repeats_an_alignment() -> None:
    measured, model = trajectory(shift=0.1, scale=1.1), trajectory()
    fit = align(measured, model, scaling="search")
    again = retimed(
        measured["position"], model["time"], shift=float(fit["shift"]), scale=float(fit["scale"])
    )
    inside = np.isfinite(fit["position"].values).all(axis=(0, 1))
    assert 100 < inside.sum() < 160 or inside.all()
    np.testing.assert_array_equal(again.values[:, :, inside], fit["position"].values[:, :, inside])


def test_registration_finds_a_time_course_at_any_start() -> None:
    course = [displacement(one) for one in (trajectory(once), trajectory(once, shift=0.15))]
    (transform,) = registered(course[1:], course[0], OPTIONS)
    assert transform is not None
    error = transform.values - course[0].values
    error -= error.mean(axis=2, keepdims=True)
    assert np.sqrt((error**2).mean()) < 0.02 * np.sqrt((course[0].values ** 2).mean())
