"""Few weighted elements that replace all elements of a solid, by non-negative least squares.

Energy-conserving sampling and weighting (Farhat et al., International Journal for Numerical Methods
in Engineering 98, 2014) chooses positive weights with which the forces of few elements reproduce
those of all in the training states. The weighted forces still have an energy. A step computes the
positions of all nodes of the chosen elements, so that elements with common nodes are preferred.
"""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from sim._kernels import solid as kernel
from sim._kernels.element import NODES
from sim.reduced.tissue import ReducedSolid, solid_of
from sim.scene import Index
from sim.state import Array

SKETCH = 2000  #: least number of random sums of the equations of all training states
TOGETHER = 20  #: training states whose equations are formed together
NODE = 1.0  #: cost of a node in units of that of an element, whose displacements a step computes


@dataclass(frozen=True)
class Sample:
    """Chosen elements."""

    elements: Index  #: (k,) indices, ascending
    weights: Array  #: (k,) factors on their energies
    #: root mean square over the training states of the displacement [m] that the errors of the forces
    #: cause with the stiffness at rest
    error: float


def element_forces(solid: ReducedSolid, y: Array, activation: Array) -> Array:
    """Forces (n_elements, 24) of every element, of weight one, on its nodes at y (r,)."""
    elements = solid_of(solid.whole).pointwise
    size, none = len(solid.weight), np.zeros(0)
    q = solid.rest + (solid.modes[:, : len(y)] @ y).reshape(-1, 3)
    forces = np.zeros((size, 3 * NODES))
    for part, places in zip(elements.parts, elements.places, strict=True):
        own = part._replace(nodes=np.arange(part.nodes.size).reshape(part.nodes.shape))
        f = np.zeros((part.nodes.size, 3))
        of_laws = elements.laws, elements.fibres, activation, none, np.bool_(False)
        results = f, np.zeros(size), np.zeros(size), none
        kernel.evaluate(q[part.nodes.ravel()], own, places, *of_laws, *results)
        forces[part.element] = f.reshape(len(part.nodes), -1)
    return forces


def element_modes(solid: ReducedSolid) -> Array:
    """Modes (n_elements, 24, n) at the nodes of every element."""
    nodal = solid.modes.reshape(len(solid.rest), 3, -1)
    modes = np.zeros((len(solid.weight), 3 * NODES, nodal.shape[2]))
    for part in solid_of(solid.whole).pointwise.parts:
        modes[part.element] = nodal[part.nodes].reshape(len(part.nodes), 3 * NODES, -1)
    return modes


def sampled(
    solid: ReducedSolid,
    states: Array,
    activations: Array,
    *,
    tolerance: float,
    most: int,
    seed: int = 0,
) -> Sample:
    """Choose elements whose weighted forces cause the same displacements as those of all elements.

    Parameters
    ----------
    solid : ReducedSolid
        With all elements, and a stiffness that is positive definite.
    states : (k, r) coordinates.
    activations : (k, n_muscles).
    tolerance : float
        Of `Sample.error` [m].
    most : int
        Largest number of elements.
    seed : int
        Of the random sums of equations, whose norm replaces that of all equations.

    Notes
    -----
    Every equation is added to one of the sums, with a random sign (Clarkson and Woodruff, Journal of
    the ACM 63, 2017).
    """
    rng = np.random.default_rng(seed)
    sums, size = max(SKETCH, 4 * most), len(solid.weight)
    equations, flexible = np.zeros((sums, size)), np.linalg.inv(solid.stiffness)
    modes = element_modes(solid)
    for first in range(0, len(states), TOGETHER):
        own = slice(first, first + TOGETHER)
        pairs = zip(states[own], activations[own], strict=True)
        forces = np.stack([element_forces(solid, y, a) for y, a in pairs], axis=1)
        caused = ((forces @ modes) @ flexible).reshape(size, -1)
        to, sign = rng.integers(0, sums, caused.shape[1]), rng.choice([-1.0, 1.0], caused.shape[1])
        mixing = csr_array((sign, (to, np.arange(len(to)))), shape=(sums, len(to)))
        equations += mixing @ caused.T
    equations /= np.sqrt(len(states) * solid.mass)
    total: Array = equations.sum(axis=1)
    chosen, weights, error = sparse_weights(equations, total, tolerance, most, moving_nodes(solid))
    order = np.argsort(chosen)
    return Sample(chosen[order], weights[order], error)


def moving_nodes(solid: ReducedSolid) -> Index:
    """Nodes (n_elements, 8) of every element that move; -1 where there is none, or a second time."""
    moving = np.full((len(solid.weight), NODES), -1)
    still = np.flatnonzero(~solid.modes.reshape(len(solid.rest), -1).any(axis=1))
    for part in solid_of(solid.whole).pointwise.parts:
        nodes = np.sort(part.nodes, axis=1)
        none = np.isin(nodes, still)
        none[:, 1:] |= nodes[:, 1:] == nodes[:, :-1]
        nodes[none] = -1
        moving[part.element] = nodes
    return moving


def sparse_weights(
    A: Array, b: Array, tolerance: float, most: int, nodes: Index | None = None
) -> tuple[Index, Array, float]:
    """Non-negative x with few entries and ||A x - b|| <= tolerance, columns added one by one.

    The active-set method of Lawson and Hanson, which ends before its optimum. The next column is that
    which alone reduces the squared residual most in relation to its cost, 1 and `NODE` for each of its
    nodes that no other chosen column has. A (m, n) has at most `most` columns chosen; `nodes` (n, k)
    are -1 for none, and by default no column has any. Returns the columns (k,) of the entries above
    zero, these entries (k,) and the norm of the residual.
    """
    lengths = np.linalg.norm(A, axis=0)
    lengths[lengths == 0.0] = np.inf
    active: Index = np.zeros(0, dtype=np.int64)
    x: Array = np.zeros(0)
    gram: Array = np.zeros((0, 0))
    residual, refused = b.copy(), np.zeros(A.shape[1], dtype=bool)
    own: Index = np.full((A.shape[1], 1), -1) if nodes is None else nodes
    rows, right = np.ascontiguousarray(A.T), A.T @ b  # a column is a row of the former
    quick = rows.astype(np.float32)  # of which many are read to find one
    best = active, x, float(np.linalg.norm(b))
    while len(active) < most and best[2] > tolerance:
        known = np.zeros(own.max() + 2, dtype=bool)
        known[own[active]] = known[-1] = True
        cost = 1.0 + NODE * (~known[own]).sum(axis=1)
        gain = (quick @ residual.astype(np.float32)) / (lengths * np.sqrt(cost))
        gain[active], gain[refused] = -np.inf, -np.inf
        new = int(np.argmax(gain))
        if not gain[new] > 0.0:
            break
        gram = _bordered(gram, rows[active] @ rows[new], float(rows[new] @ rows[new]))
        active, x = np.append(active, new), np.append(x, 0.0)
        while len(active):
            trial = _least_squares(gram, right[active])
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
        residual = b - x @ rows[active]
        error = float(np.linalg.norm(residual))
        if error < best[2]:
            best = active, x, error
            refused[:] = False
    return best


def _least_squares(gram: Array, right: Array) -> Array:
    scale = 1.0 / np.sqrt(np.maximum(np.diagonal(gram), 1e-300))
    scaled = gram * scale * scale[:, None] + 1e-13 * np.eye(len(gram))
    return scale * np.linalg.solve(scaled, scale * right)


def _bordered(gram: Array, row: Array, corner: float) -> Array:
    """Gram matrix with one more row and column."""
    n = len(gram)
    matrix = np.empty((n + 1, n + 1))
    matrix[:n, :n], matrix[n, :n], matrix[:n, n], matrix[n, n] = gram, row, row, corner
    return matrix
