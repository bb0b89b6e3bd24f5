"""Few weighted points that replace all points of a solid, by non-negative least squares.

Energy-conserving sampling and weighting (Farhat et al., International Journal for Numerical Methods
in Engineering 98, 2014) chooses positive weights with which the forces of few elements reproduce
those of all in the training states. The same is done here with quadrature points, as in An, Kim and
James (ACM Transactions on Graphics 27, 2008): the weighted forces still have an energy.
"""

from dataclasses import dataclass

import numpy as np

from sim._kernels.lanes import LANES
from sim._kernels.reduced import ROWS, PointTable, point_stresses
from sim.scene import Index
from sim.state import Array

SKETCH = 600  #: number of random combinations of the equations of all training states


@dataclass(frozen=True)
class Sample:
    """Chosen points."""

    points: Index  #: (k,) indices, ascending
    weights: Array  #: (k,) factors on their volumes
    #: root mean square over the training states of the displacement [m] that the errors of the forces
    #: cause with the stiffness at rest
    error: float


def sampled(
    table: PointTable,
    states: Array,
    activations: Array,
    stiffness: Array,
    total_mass: float,
    *,
    tolerance: float,
    most: int,
    among: int | None = None,
    seed: int = 0,
) -> Sample:
    """Choose points whose weighted forces cause the same displacements as those of all points.

    Parameters
    ----------
    table : PointTable
        All points, with weight one.
    states : (k, r) coordinates.
    activations : (k, n_muscles).
    stiffness : (n, n) at rest, positive definite.
    total_mass : float
        Of the tissue [kg], for displacements in metres.
    tolerance : float
        Of `Sample.error` [m].
    most : int
        Largest number of points.
    among : int, optional
        Number of points, drawn at random, among which they are chosen; default: all.
    seed : int
        Of the random combinations of equations, whose norm replaces that of all equations.
    """
    rng = np.random.default_rng(seed)
    p, n, r = len(table.volume), len(stiffness), states.shape[1]
    equations = np.zeros((SKETCH, p))
    stress, w = np.zeros((p, 9)), np.zeros((ROWS, 9))
    G, x = table.G.reshape(p, 9, -1)[..., :n], np.zeros((-(-r // LANES), LANES))
    for y, a in zip(states, activations, strict=True):
        x.reshape(-1)[:r] = y
        point_stresses(table, x, a, w, stress)
        forces = np.einsum("pcn,pc->np", G, stress, optimize=True)
        mixed = rng.standard_normal((SKETCH, n)) @ np.linalg.inv(stiffness)
        equations += mixed @ forces
    equations /= np.sqrt(SKETCH * len(states) * total_mass)
    total: Array = equations.sum(axis=1)
    own = np.arange(p) if among is None or among >= p else np.sort(rng.permutation(p)[:among])
    chosen, weights, error = sparse_weights(equations[:, own], total, tolerance, most)
    chosen = own[chosen]
    order = np.argsort(chosen)
    return Sample(chosen[order], weights[order], error)


def sparse_weights(A: Array, b: Array, tolerance: float, most: int) -> tuple[Index, Array, float]:
    """Non-negative x with few entries and ||A x - b|| <= tolerance, columns added one by one.

    The active-set method of Lawson and Hanson, which ends before its optimum. Columns are added by
    their share in the residual, relative to their length.

    Returns
    -------
    chosen : (k,) columns of the entries above zero.
    x : (k,) their values.
    error : float
        The norm of the residual.
    """
    lengths = np.linalg.norm(A, axis=0)
    lengths[lengths == 0.0] = np.inf
    active: Index = np.zeros(0, dtype=np.int64)
    x: Array = np.zeros(0)
    gram: Array = np.zeros((0, 0))
    residual, refused = b.copy(), np.zeros(A.shape[1], dtype=bool)
    best = active, x, float(np.linalg.norm(b))
    while len(active) < most and best[2] > tolerance:
        gain = (residual @ A) / lengths
        gain[active], gain[refused] = -np.inf, -np.inf
        new = int(np.argmax(gain))
        if not gain[new] > 0.0:
            break
        gram = _bordered(gram, A[:, active].T @ A[:, new], float(A[:, new] @ A[:, new]))
        active, x = np.append(active, new), np.append(x, 0.0)
        while len(active):
            trial = _least_squares(gram, A[:, active].T @ b)
            down = trial <= 0.0
            if not down.any():
                x = trial
                break
            ratio = np.where(down, x / np.where(down, x - trial, 1.0), np.inf)
            first = int(np.argmin(ratio))
            x = x + ratio[first] * (trial - x)
            x[first] = 0.0
            refused[new] |= active[first] == new
            keep = np.flatnonzero(x > 0.0)
            active, x, gram = active[keep], x[keep], gram[np.ix_(keep, keep)]
        residual = b - A[:, active] @ x
        error = float(np.linalg.norm(residual))
        if error < best[2]:
            best = active, x, error
            refused[:] = False
    return best


def _least_squares(gram: Array, right: Array) -> Array:
    return np.linalg.lstsq(gram, right, rcond=1e-14)[0].astype(np.float64)


def _bordered(gram: Array, row: Array, corner: float) -> Array:
    """Gram matrix with one more row and column."""
    n = len(gram)
    found = np.empty((n + 1, n + 1))
    found[:n, :n], found[n, :n], found[:n, n], found[n, n] = gram, row, row, corner
    return found
