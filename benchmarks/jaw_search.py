"""Published jaw model: set of parameters within the prior with the smallest excess of its outcomes.

A part of ``python -m benchmarks jaw --part posterior``. The largest excess over the published ranges
is minimised by sequential linear programming with a trust region: outcomes are linearised by
differences, a linear programme finds the best set within reach, and the reach shrinks where the set
is not better, also after a second step with the same slopes. Source: Madsen 1975, J. Inst. Math. Appl.
16, 321, for minimax problems.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linprog

from benchmarks.jaw_sets import PRIOR, WANTED, Values, excess

NAMES = [name for name in PRIOR if name != "curved path"]
LOW, WIDE = (np.array([PRIOR[n][0] for n in NAMES]), np.array([np.ptp(PRIOR[n]) for n in NAMES]))
APART, REACH, LEAST = 0.04, 0.25, 0.01
"""Step of differences, first and smallest reach, as shares of the width of the prior."""
GAIN = 0.01
"""Smallest predicted decrease of the excess that is followed."""


@dataclass(frozen=True)
class Found:
    """Result of one search.

    Attributes
    ----------
    own : parameters
    outcomes : with them [mm, s]
    far : largest excess of the wanted outcomes
    binding : outcomes whose excess is within 5 % of the largest
    """

    own: Values
    outcomes: Values
    far: float
    binding: tuple[str, ...]


def largest(outcomes: Values, wanted: Sequence[str]) -> float:
    """Largest excess of some outcomes; infinite where the motion could not be computed."""
    far = excess(outcomes)
    return max(far[n] if np.isfinite(far[n]) else np.inf for n in wanted)


def nearest(
    outcomes: Callable[[Values], Values], start: Values, wanted: Sequence[str] = tuple(WANTED)
) -> Found:
    """Search from a set for the smallest largest excess of some outcomes, on its condylar path."""

    def own_of(u: np.ndarray) -> Values:
        return {"curved path": start["curved path"]} | dict(
            zip(NAMES, (LOW + WIDE * u).tolist(), strict=True)
        )

    u, reach = (np.array([start[n] for n in NAMES]) - LOW) / WIDE, REACH
    found = outcomes(own_of(u))
    far = largest(found, wanted)
    while far > 0.0 and reach >= LEAST:
        slopes = _slopes(lambda x: outcomes(own_of(x)), u, found, wanted)
        better = False
        while reach >= LEAST and not better:
            step, predicted = _step(u, found, slopes, wanted, reach)
            if far - predicted < GAIN:
                reach = 0.0
                break
            enough = far - 0.1 * (far - predicted)
            new = outcomes(own_of(u + step))
            if np.isfinite(largest(new, wanted)) and largest(new, wanted) >= enough:
                # with the same slopes from where curvature led
                step = step + _step(u + step, new, slopes, wanted, 0.5 * reach)[0]
                new = outcomes(own_of(u + step))
            better = largest(new, wanted) < enough
            if better:
                u, found, far = u + step, new, largest(new, wanted)
            reach *= 1.5 if better else 0.5
    excesses = excess(found)
    binding = tuple(n for n in wanted if excesses[n] >= 0.95 * far > 0.0)
    return Found(own_of(u), found, far, binding)


def _slopes(
    outcomes: Callable[[np.ndarray], Values], u: np.ndarray, here: Values, wanted: Sequence[str]
) -> np.ndarray:
    """Slopes (wanted, parameters) of outcomes by one-sided differences within the prior."""
    slopes = np.zeros((len(wanted), len(u)))
    for k in range(len(u)):
        moved = u.copy()
        moved[k] += APART if u[k] + APART <= 1.0 else -APART
        there = outcomes(moved)
        change = np.array([there[n] - here[n] for n in wanted])
        slopes[:, k] = np.nan_to_num(change / (moved[k] - u[k]))
    return slopes


def _step(
    u: np.ndarray, here: Values, slopes: np.ndarray, wanted: Sequence[str], reach: float
) -> tuple[np.ndarray, float]:
    """Best step within reach and prior for linear outcomes, and the largest excess after it."""
    low, high = np.array([WANTED[n] for n in wanted]).T
    values, unit = np.array([here[n] for n in wanted]), 0.05 * (low + high)
    rows = np.block([[slopes, -unit[:, None]], [-slopes, -unit[:, None]]])
    bounds = [(max(-reach, -x), min(reach, 1.0 - x)) for x in u] + [(0.0, None)]
    solved = linprog(
        np.append(np.zeros(len(u)), 1.0),
        A_ub=rows,
        b_ub=np.concatenate([high - values, values - low]),
        bounds=bounds,
        method="highs",
    )
    best = np.asarray(solved.x, dtype=np.float64)
    return best[:-1], float(best[-1])
