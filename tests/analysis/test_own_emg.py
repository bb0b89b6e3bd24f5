"""Gain by the EMG of the trial, in worlds in which it helps by a known amount or not at all."""

import numpy as np
import pytest

from analysis.statistics.skill import ratio_interval

INSTRUCTIONS, REPETITIONS, SAMPLES = 6, 4, 60
VARIATION = 0.15  #: variance of a repetition about the person's mean, over that of the mean [1]
ERROR = 0.5  #: variance of the error of the model [1]


def correlation(a, b):
    return (a * b).sum(-1) / np.sqrt((a * a).sum(-1) * (b * b).sum(-1))


def gains(rng, volunteers: int, own: float) -> tuple[np.ndarray, np.ndarray]:
    """Gain by own EMG and 1 - rho of other repetitions, (volunteers, instructions, repetitions, 1).

    A repetition is mu + e; the model predicts mu + n + `own` e, where n is its error, which is the
    same in all repetitions. Driven by the EMG of another repetition, it predicts mu + n + own e'.
    """
    shape = (volunteers, INSTRUCTIONS, REPETITIONS, SAMPLES)
    mu, n = rng.normal(size=(2, volunteers, INSTRUCTIONS, 1, SAMPLES))
    size = np.exp(0.4 * rng.normal(size=(volunteers, 1, 1, 1)))  # persons vary differently
    e = np.sqrt(VARIATION) * size * rng.normal(size=shape)
    measured, model = mu + e, mu + np.sqrt(ERROR) * n + own * e
    others = [np.roll(np.arange(REPETITIONS), k) for k in range(1, REPETITIONS)]
    shuffled = np.mean([correlation(measured, model[:, :, o]) for o in others], axis=0)
    repeat = np.mean([correlation(measured, measured[:, :, o]) for o in others], axis=0)
    return (correlation(measured, model) - shuffled)[..., None], (1.0 - repeat)[..., None]


@pytest.mark.parametrize("own", [0.0, 0.5, 1.0])
def test_the_gain_is_the_known_one_and_below_the_largest(own: float) -> None:
    """Closed form f q / sqrt((1 + q)(1 + f^2 q + s)), averaged over the sizes of the variation."""
    rng = np.random.default_rng(1)
    found, room = zip(*(gains(rng, 12, own) for _ in range(100)), strict=True)
    q = VARIATION * np.exp(0.8 * rng.normal(size=200_000))
    expected = np.mean(own * q / np.sqrt((1 + q) * (1 + own**2 * q + ERROR)))
    assert np.mean(found) == pytest.approx(expected, abs=0.004)
    assert np.mean(room) == pytest.approx(np.mean(q / (1 + q)), abs=0.004)
    assert np.mean(found) < np.mean(room)


@pytest.mark.parametrize("volunteers", [6, 12])
def test_positive_and_negative_control(volunteers: int) -> None:
    """Power 0.9 or more for a model that follows half of the variation, in 200 studies.

    Without EMG of the trial, the interval excludes 0 in at most 8 % of the studies (nominal 5 %;
    1.9 standard errors), and on the side of a gain in at most 4.5 %.
    """
    rng = np.random.default_rng(volunteers)

    def intervals(own: float) -> np.ndarray:
        return np.array(
            [ratio_interval(gains(rng, volunteers, own)[0], None, 0.95, 200, 0) for _ in range(200)]
        )

    helped, useless = intervals(0.5), intervals(0.01)
    assert (helped[:, 1] > 0.0).mean() >= 0.9
    shuffled = np.array(
        [
            ratio_interval(gains(rng, volunteers, 0.5)[0] * sign, None, 0.95, 200, 0)
            for sign in _signs(rng, volunteers, 200)
        ]
    )
    assert ((shuffled[:, 1] > 0) | (shuffled[:, 2] < 0)).mean() <= 0.08
    assert (shuffled[:, 1] > 0).mean() <= 0.045
    assert np.abs(useless[:, 0]).mean() < 0.1 * np.abs(helped[:, 0]).mean()


def _signs(rng, volunteers: int, studies: int) -> np.ndarray:
    """Random exchange of own EMG and that of another repetition, per volunteer."""
    return rng.choice([-1.0, 1.0], size=(studies, volunteers, 1, 1, 1))
