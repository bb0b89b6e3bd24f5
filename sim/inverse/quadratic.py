"""Quadratic programme of the activations: weighted least squares within a box."""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from sim.pattern import Flags
from sim.state import Array

EXACT = 1e-12  #: relative tolerance of the multipliers


@dataclass(frozen=True)
class Minimum:
    """Minimiser of a quadratic within a box."""

    x: Array  #: (n,)
    #: (n,) bool, active bounds
    at_low: Flags
    at_high: Flags
    #: largest violation of the Karush-Kuhn-Tucker conditions, relative to the largest entry of the
    #: gradient at x = 0
    violation: float


def minimise_in_box(
    Q: Array, c: Array, low: Array, high: Array, start: Array | None = None
) -> Minimum:
    """Minimiser of x'Qx/2 - c'x for low <= x <= high, by a primal active-set method.

    Parameters
    ----------
    Q : (n, n) symmetric, positive definite on the free variables; made so by any positive weight on
        the size or on the change.
    c, low, high : (n,)
    start : (n,) or None
        First guess, which determines the first active set.

    Returns
    -------
    Minimum

    Notes
    -----
    Each iteration solves for the free variables exactly and moves to the first bound on the way, or
    releases the bound with the largest multiplier of the wrong sign. The objective decreases, so that
    no active set recurs. A quadratic that is singular on the free variables has the solution of
    smallest norm of its change (pseudo-inverse). Source: Nocedal and Wright 2006, Numerical
    Optimization, section 16.5.
    """
    n = len(c)
    x = np.clip(np.zeros(n) if start is None else start, low, high)
    fixed = low >= high
    at_low, at_high = (x <= low) | fixed, (x >= high) & ~fixed
    scale = float(np.abs(c).max(initial=0.0)) + float(np.abs(Q @ x).max(initial=0.0)) + 1e-300
    for _ in range(20 * n + 20):
        free = ~(at_low | at_high)
        move = np.zeros(n)
        if free.any():
            move[free] = _solved(Q[np.ix_(free, free)], (c - Q @ x)[free])
        with np.errstate(divide="ignore", invalid="ignore"):
            room = np.where(move > 0.0, (high - x) / move, (low - x) / move)
        room = np.where(move == 0.0, np.inf, room)
        first = int(np.argmin(room)) if n else 0
        if n and room[first] < 1.0:
            x = np.clip(x + max(float(room[first]), 0.0) * move, low, high)
            (at_high if move[first] > 0.0 else at_low)[first] = True
            x[first] = high[first] if move[first] > 0.0 else low[first]
            continue
        x = np.clip(x + move, low, high)
        gradient = Q @ x - c
        wrong = np.where(at_low & ~fixed, -gradient, np.where(at_high, gradient, 0.0))
        worst = int(np.argmax(wrong)) if n else 0
        if not n or wrong[worst] <= EXACT * scale:
            break
        at_low[worst] = at_high[worst] = False
    return Minimum(x, at_low, at_high, violation(Q, c, low, high, x))


def _solved(Q: Array, c: Array) -> Array:
    try:
        return np.asarray(cho_solve(cho_factor(Q), c), dtype=np.float64)
    except np.linalg.LinAlgError:
        return np.asarray(np.linalg.lstsq(Q, c, rcond=None)[0], dtype=np.float64)


def violation(Q: Array, c: Array, low: Array, high: Array, x: Array) -> float:
    """Largest violation of the optimality conditions at x, relative to the gradient at zero.

    The projected gradient x - clip(x - (Qx - c)) would mix units; the gradient itself is measured:
    zero if free, of one sign at a bound.
    """
    gradient = Q @ x - c
    inside = np.where(x <= low, np.maximum(-gradient, 0.0), np.abs(gradient))
    inside = np.where(x >= high, np.maximum(gradient, 0.0), inside)
    inside = np.where(low >= high, 0.0, inside)
    outside = np.maximum(np.maximum(low - x, x - high), 0.0)
    scale = float(np.abs(c).max(initial=0.0)) + 1e-300
    return max(float(inside.max(initial=0.0)) / scale, float(outside.max(initial=0.0)))
