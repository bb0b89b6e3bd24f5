"""Timing, asymmetry and variation within an instruction, for constructed motions."""

from itertools import permutations

import numpy as np
import pytest
import xarray as xr
from synthetic_trajectories import trajectory

from analysis.individual import ONSET, asymmetry, instants, together, within_instruction
from analysis.trajectory import motion

NAMES = ("corner_left", "upper_left", "corner_right", "upper_right")


def moving(course: np.ndarray, time: np.ndarray, sizes=(1.0, 1.0, 1.0, 1.0)) -> xr.DataArray:
    """Four markers that move in one direction by `sizes` [mm] times the time course."""
    direction = np.array([0.6, 0.0, -0.8])
    rest = np.random.default_rng(0).normal(0, 0.03, (4, 3))
    values = rest[:, :, None] + 1e-3 * np.multiply.outer(
        np.multiply.outer(np.asarray(sizes), direction), course
    )
    return xr.DataArray(
        values, dims=("marker", "axis", "time"), attrs={"units": "m"},
        coords={"marker": list(NAMES), "axis": list("xyz"), "time": time},
    )  # fmt: skip


def bump(t: np.ndarray, start: float, length: float = 0.8) -> np.ndarray:
    """sin^2 from 0 at `start` over `length` seconds."""
    return np.sin(np.pi * np.clip((t - start) / length, 0, 1)) ** 2


@pytest.mark.parametrize("begin", [0.0, 3.0])
def test_instants_of_a_bump(begin: float) -> None:
    """sin^2 passes 0.2 at asin(sqrt 0.2)/pi of its length and peaks at half of it."""
    t = begin + np.linspace(0, 1.6, 161)
    onset, peak = instants(moving(bump(t, begin + 0.3), t))
    expected = begin + 0.3 + 0.8 * np.arcsin(np.sqrt(ONSET)) / np.pi
    assert onset == pytest.approx(expected, abs=2e-3)
    assert peak == pytest.approx(begin + 0.7, abs=1e-4)


@pytest.mark.parametrize("delay", [-0.05, 0.013, 0.1])
def test_a_delay_is_found_between_other_rates_and_sizes(delay: float) -> None:
    fine, coarse = np.linspace(0, 1.6, 321), np.linspace(0, 1.6, 161)
    early = instants(moving(bump(coarse, 0.3), coarse))
    late = instants(moving(bump(fine, 0.3 + delay), fine, (3, 3, 3, 3)))
    np.testing.assert_allclose(np.subtract(late, early), delay, atol=2e-3)


def test_noise_of_markers_moves_the_onset_little() -> None:
    t = np.linspace(0, 1.6, 161)
    clean = moving(bump(t, 0.3), t, (5, 5, 5, 5))
    errors = []
    for seed in range(20):
        noise = np.random.default_rng(seed).normal(0, 1e-4, clean.shape)
        errors.append(np.subtract(instants(clean + noise), instants(clean)))
    assert np.abs(errors).max() < 0.03


def test_instants_are_undefined_without_movement() -> None:
    t = np.linspace(0, 1.6, 161)
    assert np.isnan(instants(moving(np.zeros(161), t))).all()
    gap = moving(bump(t, 0.3), t)
    gap[0, 0, 5] = np.nan
    assert np.isnan(instants(gap)).all()


@pytest.mark.parametrize(
    ("sizes", "expected"),
    [((1, 1, 1, 1), 0.0), ((3, 3, 1, 1), 0.5), ((1, 1, 3, 3), -0.5), ((1, 1, 0, 0), 1.0),
     ((0, 0, 2, 2), -1.0)],
)  # fmt: skip
def test_asymmetry_of_known_sides(sizes, expected: float) -> None:
    t = np.linspace(0, 1.6, 161)
    data = moving(bump(t, 0.3), t, sizes)
    assert asymmetry(data) == pytest.approx(expected, abs=1e-12)
    mirrored = data.assign_coords(marker=[NAMES[k] for k in (2, 3, 0, 1)])
    assert asymmetry(mirrored) == pytest.approx(-expected, abs=1e-12)


def test_asymmetry_is_undefined_without_movement_or_side() -> None:
    t = np.linspace(0, 1.6, 161)
    assert np.isnan(asymmetry(moving(np.zeros(161), t)))
    assert np.isnan(asymmetry(moving(bump(t, 0.3), t).isel(marker=[0, 1])))


def varied(coefficients, seed: int, size: float = 1e-3) -> list[xr.Dataset]:
    """Repetitions of a movement with deviations c_r times one pattern."""
    base = trajectory()
    shape = base["position"] - base["position"].mean("time")
    pattern = (
        np.random.default_rng(seed).normal(size=(10, 3, 1))
        * np.sin(2 * np.pi * base["time"].values / 0.8)
        * np.abs(shape).max("axis").values[:, None, :]
        / np.abs(shape.values).max()
    )
    return [base.assign(position=base["position"] + size * c * pattern) for c in coefficients]


def test_deviations_that_agree_correlate_and_mirrored_ones_anticorrelate() -> None:
    c = np.array([1.0, -0.4, 0.3, -0.9])
    same = within_instruction(varied(c, 3), varied(c, 3), {"scaling": "none"})
    opposite = within_instruction(varied(c, 3), varied(-c, 3), {"scaling": "none"})
    assert same.sizes == {"marker": 10}
    assert (same.values > 0.99).all() and (opposite.values < -0.9).all()


def test_measured_repetitions_that_are_registered_once_give_the_same_score() -> None:
    c, options = np.array([1.0, -0.4, 0.3, -0.9]), {"scaling": "none"}
    measured, simulated = varied(c, 3), varied(-c, 3)
    once = within_instruction(measured, simulated, options, known=together(measured, options))
    xr.testing.assert_identical(once, within_instruction(measured, simulated, options))


def test_motion_omits_gaps() -> None:
    time = np.linspace(0.0, 1.0, 50)
    data = moving(bump(time, 0.1), time)
    data[0, :, 10:20], data[1] = np.nan, np.nan
    centred = data - data.mean("time")
    squares = (centred**2).sum(["axis", "time"]).mean()
    assert motion(data) == pytest.approx(float(np.sqrt(squares / 50)), rel=1e-12)


def test_size_of_deviations_does_not_matter() -> None:
    c = np.array([1.0, -0.4, 0.3])
    centred = within_instruction(varied(c, 3), varied(c, 3, size=0.2e-3), {"scaling": "none"})
    assert (centred.values > 0.95).all()


def test_mean_over_all_orders_is_zero() -> None:
    """The contribution common to all trials cancels, for any motion."""
    measured = [
        trajectory(amplitude=a, noise=3e-4, seed=k) for k, a in enumerate((4e-3, 5e-3, 7e-3))
    ]
    simulated = [
        trajectory(amplitude=a, noise=3e-4, seed=k, shift=0.05)
        for k, a in enumerate((2e-3, 3e-3, 5e-3), start=9)
    ]
    scores = [
        within_instruction(measured, [simulated[k] for k in order], {"scaling": "none"}).values
        for order in permutations(range(3))
    ]
    assert np.abs(scores[0]).max() > 0.5  # Both sequences of trials increase.
    np.testing.assert_allclose(np.mean(scores, axis=0), 0.0, atol=1e-9)


def test_a_template_has_no_score_within_an_instruction() -> None:
    measured = varied([1.0, -0.5, 0.2], 3)
    assert np.isnan(within_instruction(measured, [trajectory()] * 3)).all()
    assert np.isnan(within_instruction(measured[:1], measured[:1])).all()
    still = trajectory(amplitude=0.0)
    assert np.isnan(within_instruction(measured, [still] * 3)).all()
