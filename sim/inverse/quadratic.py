"""Quadratic programme of the activations: weighted least squares within a box."""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import lsq_linear

from sim.dense import least, reported
from sim.pattern import Flags, Index
from sim.state import Array

BVLS_TOLERANCE = (
    1e-14  #: relative change of the objective and of its gradient at which the iteration ends
)


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
    """Minimiser of x'Qx/2 - c'x for low <= x <= high, by bounded-variable least squares.

    Parameters
    ----------
    Q : (n, n) symmetric, positive semi-definite.
    c, low, high : (n,)
    start : (n,) or None
        First guess. The change from it is the smallest one if the minimiser is not unique.

    Returns
    -------
    Minimum

    Notes
    -----
    With Q = A'A and A'b = c the quadratic is |A x - b|^2/2, in units in which the diagonal of Q is 1.
    Source: Stark and Parker 1995, Bounded-variable least-squares: an algorithm and applications,
    Computational Statistics 10, 129-141, in `scipy.optimize.lsq_linear`.
    """
    x = np.clip(np.zeros(len(c)) if start is None else start, low, high)
    free: Index = np.flatnonzero(low < high)
    at_low, at_high = low >= high, np.zeros(len(c), dtype=np.bool_)
    if len(free):
        size = np.sqrt(np.diag(Q)[free])
        unit = 1.0 / np.where(size > 0.0, size, 1.0)
        A = _root(unit[:, None] * Q[np.ix_(free, free)] * unit)
        b = least(A.T, unit * (c - Q @ x)[free], "the quadratic of the activations")
        bounds = (low - x)[free] / unit, (high - x)[free] / unit
        most = 20 * len(c) + 20
        result = lsq_linear(A, b, bounds, method="bvls", tol=BVLS_TOLERANCE, max_iter=most)
        at_low[free], at_high[free] = result.active_mask < 0, result.active_mask > 0
        x[free] = np.clip(x[free] + unit * result.x, low[free], high[free])
        x = np.where(at_low, low, np.where(at_high, high, x))
    return Minimum(x, at_low, at_high, violation(Q, c, low, high, x))


def _root(Q: Array) -> Array:
    """A with Q = A'A, also of a singular matrix."""
    try:
        return np.asarray(np.linalg.cholesky(Q).T, dtype=np.float64)
    except np.linalg.LinAlgError:
        with reported("the quadratic of the activations"):
            values, vectors = np.linalg.eigh(Q)
        return np.sqrt(values.clip(0.0))[:, None] * vectors.T


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
