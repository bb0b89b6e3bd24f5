"""Agreement of estimated activations with true ones, beyond what all persons share in an instruction.

All arrays are (trial, muscle, sample) on a common grid of time, with the volunteer and the instruction
of every trial. The *deviation* of a trial is its value minus the mean of the other volunteers in the
same instruction, for the estimate and for the truth alike. An estimate that is the same for all persons
has no deviations, and one that depends on other things than the person has deviations whose correlation
with the true ones is 0 on average.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]

REACH: Final = 0.05  #: share of the largest activation below which a random burst counts as over


@dataclass(frozen=True)
class Trials:
    """Volunteer and instruction of every trial."""

    volunteer: tuple[str, ...]
    instruction: tuple[str, ...]

    def others(self, k: int) -> list[int]:
        """Trials of the other volunteers with the instruction of trial k."""
        return [
            j
            for j, (v, i) in enumerate(zip(self.volunteer, self.instruction, strict=True))
            if i == self.instruction[k] and v != self.volunteer[k]
        ]

    def of_volunteer(self, volunteer: str) -> list[int]:
        """Trials of one volunteer."""
        return [k for k, v in enumerate(self.volunteer) if v == volunteer]

    @property
    def persons(self) -> list[str]:
        """Volunteers in the order of their first trial."""
        return list(dict.fromkeys(self.volunteer))


def mean_of_others(values: Floats, trials: Trials) -> Floats:
    """Mean over the other volunteers in the same instruction, for every trial."""
    return np.array([values[trials.others(k)].mean(axis=0) for k in range(len(values))])


def deviations(values: Floats, trials: Trials) -> Floats:
    """Values minus the mean of the other volunteers in the same instruction."""
    return values - mean_of_others(values, trials)


def spread_of_deviations(persons: int) -> float:
    """Spread of independent persons over that of their correlations of deviations [1].

    Deviations from the mean of the others contain parts of all persons. With independent parts of
    equal size, the correlation measured in a person is (n - 2) / (n - 1) of the own one plus
    1 / (n - 1) of the mean of all, so that the spread is too small by the former and the mean is not
    changed.
    """
    return (persons - 1.0) / (persons - 2.0)


def correlation(a: Floats, b: Floats) -> float:
    """Pearson correlation over all elements; 0 if the first, the estimate, does not vary."""
    a, b = a.ravel() - a.mean(), b.ravel() - b.mean()
    size = float(np.linalg.norm(a) * np.linalg.norm(b))
    scale = 1e-12 * max(1.0, float(np.abs(b).max(initial=0.0)))
    return float(a @ b) / size if np.abs(a).max(initial=0.0) > scale and size > 0.0 else 0.0


def agreement(
    estimate: Floats, truth: Floats, trials: Trials, muscles: Sequence[int] | None = None
) -> Floats:
    """Correlation with the truth per volunteer, over instructions, muscles and time."""
    at = slice(None) if muscles is None else list(muscles)
    return np.array(
        [
            correlation(estimate[own][:, at], truth[own][:, at])
            for own in map(trials.of_volunteer, trials.persons)
        ]
    )


def deviation_agreement(
    estimate: Floats, truth: Floats, trials: Trials, muscles: Sequence[int] | None = None
) -> Floats:
    """Correlation of deviations per volunteer."""
    return agreement(deviations(estimate, trials), deviations(truth, trials), trials, muscles)


def explained(
    estimates: Mapping[str, Floats],
    truth: Floats,
    trials: Trials,
    muscles: Sequence[int] | None = None,
) -> Floats:
    """Share of the true deviations that a linear combination of estimated ones predicts, per volunteer.

    1 - |d - sum_j c_j e_j|^2 / |d|^2, with the coefficients c_j by least squares in the other
    volunteers. Negative if the combination is worse than no deviation at all.
    """
    at = slice(None) if muscles is None else list(muscles)
    d = deviations(truth, trials)[:, at]
    e = [deviations(one, trials)[:, at] for one in estimates.values()]
    shares: list[float] = []
    for person in trials.persons:
        own = trials.of_volunteer(person)
        rest = [k for k in range(len(d)) if k not in own]
        x = np.stack([one[rest].ravel() for one in e], axis=1)
        c = np.linalg.lstsq(x, d[rest].ravel(), rcond=None)[0]
        left = d[own] - sum(w * one[own] for w, one in zip(c, e, strict=True))
        shares.append(1.0 - float((left**2).sum() / (d[own] ** 2).sum()))
    return np.array(shares)


def random_activations(shape: tuple[int, int, int], rng: np.random.Generator) -> Floats:
    """Activations that no table made: bursts of every muscle and trial drawn independently.

    A muscle is active with probability U(0, 1) per trial; its burst is a raised cosine of level U(0, 1)
    with its centre anywhere in the trial and a width of 0.2 to 1 of it.
    """
    trials, muscles, samples = shape
    at = np.linspace(0.0, 1.0, samples)
    centre, width = rng.uniform(0.0, 1.0, (2, trials, muscles, 1))
    width = 0.2 + 0.8 * width
    phase = np.clip((at - centre) / width, -0.5, 0.5)
    level = rng.uniform(0.0, 1.0, (trials, muscles, 1))
    active = rng.uniform(size=(trials, muscles, 1)) < rng.uniform(size=(trials, 1, 1))
    return np.asarray(active * level * 0.5 * (1.0 + np.cos(2.0 * np.pi * phase)))


def of_other_volunteers(values: Floats, trials: Trials, shift: int) -> Floats:
    """Values of another volunteer in the same instruction, `shift` places further in their order."""
    return np.array(
        [values[(own := trials.others(k))[(k + shift) % len(own)]] for k in range(len(values))]
    )


def with_known_agreement(
    truth: Floats, trials: Trials, rho: float | Sequence[float] | Floats, rng: np.random.Generator
) -> Floats:
    """Estimate whose deviations have the correlation `rho` with the true ones (positive control).

    `rho` is one value, or one of every person, each from -1 to 1.

    The mean of the other volunteers, plus ``rho d + sqrt(1 - rho^2) |d| e``: d is the true deviation,
    and e is smooth noise of unit size without its part along d.
    """
    base, d = truth.mean(axis=0, keepdims=True), deviations(truth, trials)
    noise = deviations(random_activations(truth.shape, rng), trials)
    made = np.empty_like(d)
    each = np.broadcast_to(np.asarray(rho, dtype=np.float64), len(trials.persons))
    for person, known in zip(trials.persons, each, strict=True):
        own = trials.of_volunteer(person)
        e = noise[own] - noise[own].mean()
        f = d[own] - d[own].mean()
        e = e - f * (e * f).sum() / (f**2).sum()
        made[own] = known * f + np.sqrt((1.0 - known**2) * (f**2).sum() / (e**2).sum()) * e
    return base + made
