"""Sign of an aligned component, by direction if it is clear, otherwise by correlation."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import beta
from synthetic_trajectories import there_and_back, trajectory

from analysis.align import align
from analysis.matching import CLEAR_COSINE
from analysis.scores import score


def test_mirrored_movement_under_both_rules() -> None:
    """A model that moves in the opposite direction is aligned by correlation, but not by direction.

    In both cases the disagreement is flagged, and the cosine is returned.
    """
    model = trajectory(amplitude=-5e-3)
    aligned = align(trajectory(shift=0.08), model, sign="correlation")
    assert float(aligned["shift"]) == pytest.approx(0.08, abs=1e-3)
    assert float(aligned["b_correlation"]) > 0.999
    assert float(aligned["direction_cosine"]) < -0.9
    kept = align(trajectory(shift=0.08), model)
    assert float(kept["direction_cosine"]) > 0.9
    assert float(kept["b_correlation"]) < 0.9
    assert int(aligned["sign_disagrees"]) == int(kept["sign_disagrees"]) == 1
    same = align(trajectory(shift=0.08), trajectory())
    assert float(same["direction_cosine"]) > 0.9
    assert (int(same["sign_disagrees"]), int(same["sign_by_direction"])) == (0, 1)


def lobes(*sizes: float):
    """Left, right, left: half waves of these amplitudes with alternating sign."""

    def course(t: np.ndarray) -> np.ndarray:
        phase = np.clip((t - 0.2) / 1.2, 0, 1 - 1e-12) * len(sizes)
        return np.asarray(sizes)[phase.astype(int)] * np.sin(np.pi * phase)

    return course


@pytest.mark.parametrize("noise", [0.0, 3e-4])
def test_left_right_left_matches_itself_and_not_its_mirror(noise: float) -> None:
    """One side is stronger in the volunteer, the other in the model, so that a shift fits the mirror.

    The larger maximum of the correlation, 0.92 at 0.4 s, matches left with right.
    """
    model = trajectory(lobes(0.5, 1.0, 1.0))
    data = trajectory(lobes(1.0, 1.0, 0.5), noise=noise)
    aligned = align(data, model)
    assert abs(float(aligned["shift"])) < 0.05
    assert float(score(aligned, model)["rho"].median()) > 0.7
    assert (int(aligned["sign_disagrees"]), int(aligned["sign_by_direction"])) == (1, 1)
    mirrored = align(data, model, sign="correlation")
    assert abs(float(mirrored["shift"])) == pytest.approx(0.4, abs=0.02)
    assert float(mirrored["b_correlation"]) > float(aligned["b_correlation"])
    assert float(score(mirrored, model)["rho"].median()) < -0.7
    assert (int(mirrored["sign_disagrees"]), int(mirrored["sign_by_direction"])) == (1, 0)
    assert mirrored.attrs["sign_by"] == "correlation"


def test_time_reversed_movement_keeps_its_direction() -> None:
    """The direction of a reversed movement is the same, so that the signs agree."""
    data, model = trajectory(), trajectory()
    backwards = data.isel(time=slice(None, None, -1)).assign_coords(time=data["time"])
    aligned = align(backwards, model)
    assert float(aligned["direction_cosine"]) > 0.9
    assert (int(aligned["sign_disagrees"]), int(aligned["sign_by_direction"])) == (0, 1)


def test_unrelated_directions_leave_the_sign_to_the_correlation() -> None:
    """Every marker moves along an axis perpendicular to that of the model."""
    data, model = trajectory(shift=0.08), trajectory()
    rng = np.random.default_rng(5)
    turned = data.copy(deep=True)
    centred = data["position"] - data["position"].mean("time")
    turned["position"] = data["position"] + 0.0
    for k in range(10):
        axis = np.cross(centred.values[k, :, 60], rng.normal(size=3))
        axis /= np.linalg.norm(axis)
        size = np.linalg.norm(centred.values[k], axis=0) * np.sign(centred.values[k, 0])
        turned["position"].values[k] = axis[:, None] * size
    turned["position"].attrs["units"] = "m"
    by_rule = [align(turned, model, sign=rule) for rule in ("direction", "correlation")]
    assert abs(float(by_rule[0]["direction_cosine"])) < CLEAR_COSINE
    assert int(by_rule[0]["sign_by_direction"]) == 0
    for name in ("shift", "sign", "b_correlation", "position"):
        np.testing.assert_array_equal(by_rule[0][name], by_rule[1][name])


def test_clear_cosine_is_the_point_of_five_per_cent_in_six_dimensions() -> None:
    """cos^2 of a random direction follows Beta(1/2, (d - 1)/2)."""
    assert CLEAR_COSINE == pytest.approx(np.sqrt(beta.ppf(0.95, 0.5, 2.5)), abs=0.005)
    drawn = np.random.default_rng(0).normal(size=(20000, 6))
    cosine = np.abs(drawn[:, 0]) / np.linalg.norm(drawn, axis=1)
    assert np.mean(cosine > CLEAR_COSINE) == pytest.approx(0.05, abs=4 * np.sqrt(0.05 / 20000))


def test_sign_resolves_half_a_period() -> None:
    """Left-right-left shifted by little must not match right-left at half a period."""
    aligned = align(trajectory(there_and_back, shift=0.05, noise=1e-3), trajectory(there_and_back))
    assert float(aligned["shift"]) == pytest.approx(0.05, abs=0.02)
    assert float(aligned["direction_cosine"]) > 0.9


@pytest.mark.parametrize("seed", range(4))
def test_a_match_of_negative_correlation_does_not_depend_on_rounding(seed: int) -> None:
    """Opposite courses along one clear direction correlate negatively at every small shift.

    The largest correlation is chosen, not one of many shifts that leave the whole variance
    unexplained: turning the camera frame, which rounds every coordinate, changes nothing.
    """

    def rising(t: np.ndarray) -> np.ndarray:
        return np.tanh(3.0 * (t - 0.8)) + 0.3 * np.sin(7.0 * t)

    def falling(t: np.ndarray) -> np.ndarray:
        return -np.tanh(3.0 * (t - 0.7)) + 0.3 * np.cos(9.0 * t)

    data, model = trajectory(rising), trajectory(falling)
    aligned = align(data, model, max_shift=0.2)
    assert int(aligned["sign_by_direction"]) == 1 and float(aligned["b_correlation"]) < 0.0
    turn = Rotation.random(random_state=seed).as_matrix()
    turned = [
        each.assign(
            position=each["position"].copy(
                data=np.einsum("ij,mjt->mit", turn, each["position"].values)
            )
        )
        for each in (data, model)
    ]
    again = align(*turned, max_shift=0.2)
    assert float(again["shift"]) == pytest.approx(float(aligned["shift"]), abs=1e-6)
    tried = [
        float(align(data, model, max_shift=bound)["b_correlation"]) for bound in (0.0, 0.05, 0.1)
    ]
    assert float(aligned["b_correlation"]) >= max(tried) - 1e-9
