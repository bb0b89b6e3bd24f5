"""Motions drawn at random in which the parts of persons, repetitions and EMG are known."""

from typing import Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from analysis.baselines import ceiling_of, template_limit
from analysis.statistics.skill import ratio_interval

Floats = NDArray[np.float64]
Interval = tuple[float, float, float]

MARKERS, INSTRUCTIONS, REPETITIONS, SAMPLES = 3, 6, 2, 24  #: of `world`
DIMS: Final = ("volunteer", "instruction", "repetition", "marker")
VARIATION: Final = (
    0.15  #: variance of a repetition about the person's mean, over that of the mean [1]
)
ERROR: Final = 0.5  #: variance of the error of the model [1]
TRIALS: Final = (6, 4, 60)  #: instructions, repetitions and samples of `gains`
DRAWS: Final = 200  #: bootstrap samples of an interval


def correlation(a: Floats, b: Floats) -> Floats:
    """Uncentred correlation over the last axis."""
    return np.asarray((a * b).sum(-1) / np.sqrt((a * a).sum(-1) * (b * b).sum(-1)))


def world(
    rng: np.random.Generator,
    volunteers: int,
    specific: float,
    spread: float = 0.4,
    own: float = 0.7,
) -> tuple[Floats, Floats, Floats]:
    """Scores in a world in which motion = common + individual + deviation of the repetition.

    The size of the individual part varies between persons (standard deviation `spread` of its
    logarithm). Returns rho of the prediction common + `specific` x individual, template_rho and
    repeat_rho, each of shape (volunteers, instructions, repetitions, markers).
    """
    shape = (volunteers, INSTRUCTIONS, REPETITIONS, MARKERS, SAMPLES)
    common = rng.normal(size=(1, INSTRUCTIONS, 1, MARKERS, SAMPLES))
    common = common * np.exp(0.3 * rng.normal(size=(1, INSTRUCTIONS, 1, MARKERS, 1)))
    size = own * np.exp(spread * rng.normal(size=(volunteers, 1, 1, 1, 1)))
    individual = size * rng.normal(size=(volunteers, INSTRUCTIONS, 1, MARKERS, SAMPLES))
    measured = common + individual + 0.1 * rng.normal(size=shape)
    person = measured.mean(2, keepdims=True)
    template = (person.sum(0, keepdims=True) - person) / (volunteers - 1)
    again = correlation(measured, measured[:, :, ::-1])
    return (
        correlation(measured, common + specific * individual),
        correlation(measured, template),
        again,
    )


def limit_of(template: Floats) -> Floats:
    """Scores of a template of infinitely many persons, as the package extrapolates them."""
    others = xr.DataArray(np.full(template.shape[:2], len(template) - 1.0), dims=DIMS[:2])
    return np.asarray(template_limit(xr.DataArray(template, dims=DIMS), others).values)


def skill_interval(
    rho: Floats, template: Floats, again: Floats, *, finite: bool = False
) -> Interval:
    """Skill and its interval, as `analysis.statistics.skill.against_baselines` computes them.

    With `finite`, the reference is the template of the other volunteers itself.
    """
    limit = template if finite else limit_of(template)
    ceiling = np.asarray(ceiling_of(again))
    top, room = ((one - limit).mean(3, keepdims=True) for one in (rho, ceiling))
    return ratio_interval(top, room, 0.95, DRAWS, 0)


def gains(
    rng: np.random.Generator, volunteers: int, own: float, noise: float = 0.0
) -> tuple[Floats, Floats]:
    """Gain by own EMG and 1 - rho of other repetitions, (volunteers, instructions, repetitions, 1).

    A repetition is mu + e; the model predicts mu + n + `own` e + m. Its error n is the same in all
    repetitions; m, with the variance `noise` [1], is that of the EMG of the repetition. Driven by the
    EMG of another repetition, it predicts mu + n + own e' + m'.
    """
    instructions, repetitions, samples = TRIALS
    shape = (volunteers, instructions, repetitions, samples)
    mu, n = rng.normal(size=(2, volunteers, instructions, 1, samples))
    size = np.exp(0.4 * rng.normal(size=(volunteers, 1, 1, 1)))  # persons vary differently
    e = np.sqrt(VARIATION) * size * rng.normal(size=shape)
    measured, model = mu + e, mu + np.sqrt(ERROR) * n + own * e
    if noise:
        model = model + np.sqrt(noise) * rng.normal(size=shape)
    others = [np.roll(np.arange(repetitions), k) for k in range(1, repetitions)]
    shuffled = np.mean([correlation(measured, model[:, :, o]) for o in others], axis=0)
    repeat = np.mean([correlation(measured, measured[:, :, o]) for o in others], axis=0)
    return (correlation(measured, model) - shuffled)[..., None], (1.0 - repeat)[..., None]


def exchanged(rng: np.random.Generator, gain: Floats) -> Floats:
    """Gains after a random exchange, in every volunteer, of the own EMG and that of a repetition."""
    return gain * rng.choice([-1.0, 1.0], size=(len(gain), 1, 1, 1))


def gain_interval(gain: Floats) -> Interval:
    """Gain by own EMG and its interval, as `against_baselines` computes them."""
    return ratio_interval(gain, None, 0.95, DRAWS, 0)
