"""Quadratic programme of the activations: weighted least squares within a box."""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from sim.pattern import Flags
from sim.state import Array

EXACT = (
    1e-14  #: multiplier of a bound that counts as 0, over the terms of its entry of the gradient
)
REFINED = 3  #: largest number of corrections of the solution on the final free set


@dataclass(frozen=True)
class Minimum:
    """Minimiser of a quadratic within a box."""

    x: Array  #: (n,)
    #: (n,) bool, active bounds
    at_low: Flags
    at_high: Flags
    violation: float  #: of the optimality conditions, as of the function of this name


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
    no active set recurs. A multiplier counts as 0 if it is below the rounding error of its own terms,
    because those of other variables may be larger by many orders. The solution on the final set is
    corrected by solutions of its residual while this decreases (iterative refinement). A quadratic that
    is singular on the free variables has the solution of smallest norm of its change (pseudo-inverse).
    Source: Nocedal and Wright 2006, Numerical Optimization, section 16.5.
    """
    n = len(c)
    x = np.clip(np.zeros(n) if start is None else start, low, high)
    fixed = low >= high
    at_low, at_high = (x <= low) | fixed, (x >= high) & ~fixed
    size = np.abs(Q)
    for _ in range(20 * n + 20):
        free = ~(at_low | at_high)
        move = np.zeros(n)
        if free.any():
            move[free] = _solved(Q[np.ix_(free, free)], (c - Q @ x)[free])
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
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
        wrong = np.where(wrong > EXACT * (size @ np.abs(x) + np.abs(c)), wrong, 0.0)
        worst = int(np.argmax(wrong)) if n else 0
        if not n or wrong[worst] == 0.0:
            break
        at_low[worst] = at_high[worst] = False
    x = _refined(Q, c, low, high, x, ~(at_low | at_high))
    return Minimum(x, at_low, at_high, violation(Q, c, low, high, x))


def _refined(Q: Array, c: Array, low: Array, high: Array, x: Array, free: Flags) -> Array:
    """Solution x with a smaller residual on the free variables, if corrections decrease it."""
    if not free.any():
        return x
    left, inner = (c - Q @ x)[free], Q[np.ix_(free, free)]
    for _ in range(REFINED):
        other = x.copy()
        other[free] += _solved(inner, left)
        other = np.clip(other, low, high)
        remaining = (c - Q @ other)[free]
        if not np.abs(remaining).max() < np.abs(left).max():
            break
        x, left = other, remaining
    return x


def _solved(Q: Array, c: Array) -> Array:
    try:
        return np.asarray(cho_solve(cho_factor(Q), c), dtype=np.float64)
    except np.linalg.LinAlgError:
        return np.asarray(np.linalg.lstsq(Q, c, rcond=None)[0], dtype=np.float64)


def violation(Q: Array, c: Array, low: Array, high: Array, x: Array) -> float:
    """Largest change of a variable that alone, within its bounds, still lowers x'Qx/2 - c'x.

    Variable i alone is optimal at x_i - g_i/Q_ii, with the gradient g = Qx - c, or at the bound before
    it. The change is 0 if and only if the Karush-Kuhn-Tucker conditions hold; its unit is that of x,
    and it does not depend on the scale of the quadratic or of other variables, as ratios of gradients
    do. Violated bounds count with their distance.
    """
    gradient, own = Q @ x - c, np.diag(Q)
    with np.errstate(divide="ignore"):
        alone = np.where(gradient == 0.0, 0.0, gradient / np.where(own > 0.0, own, 0.0))
    return float(np.abs(x - np.clip(x - alone, low, high)).max(initial=0.0))
