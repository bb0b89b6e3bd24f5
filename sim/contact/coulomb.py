"""Forces of equations, inequalities and Coulomb contacts that share one Delassus matrix.

They solve (5) of docs/step.md under the conditions (3).
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import lstsq
from scipy.linalg.lapack import dgecon, dgetrf, dgetrs

from sim._kernels.coulomb import sweep
from sim.contact.pushes import pushes
from sim.dense import reported, solved
from sim.pattern import Flags
from sim.scene import Index
from sim.state import Array

SWEEPS, TURNS = 100, 40
"""Sweeps between two attempts to solve directly for the present states of all contacts; attempts."""

CHANGES = 20  #: largest number of changes of the active set before sweeps

SINGULAR = 1e-12  #: relative size of singular values that are due to rows that repeat each other
REPEATED = 1e-9  #: share of its mobility that a row must retain under the equations
PROXIMAL = 1e-9  #: regularisation of proximal points, relative to the mobility
SLIP = 1e-9  #: share of the largest rate up to which a direct solution may violate a row


@dataclass(frozen=True, eq=False)
class Blocks:
    """Kinds of the unknown forces of m rows."""

    equations: Index  #: rows with S f + r = 0
    first: Index  #: (k,) first row of every other block
    #: (k,) Coulomb's coefficient; 0 for an inequality of one row, else the row is followed by two of
    #: tangential directions
    friction: Array

    @property
    def rest(self) -> Index:
        """Rows of all blocks."""
        size = np.where(self.friction > 0.0, 3, 1)
        start = np.repeat(self.first, size)
        return start + np.arange(len(start)) - np.repeat(np.cumsum(size) - size, size)


def forces(S: Array, r: Array, blocks: Blocks, before: Array, error: float) -> tuple[Array, float]:
    """Forces (m,), and the largest change of a rate that a further sweep would make.

    Equations are eliminated. Sweeps over the other blocks find which contacts are open, stick or slide,
    from the states of the initial forces; a direct solution for these states satisfies the rows to
    rounding, also where rows repeat each other. Forces of sweeps alone would leave a rate of `error` in
    every step, with which a stack turns over hundreds of steps.

    S (m, m) is symmetric positive semi-definite, r (m,) are the rates without forces and `before` (m,)
    the initial forces.

    Source: Jean 1999, The non-smooth contact dynamics method, Comput. Methods Appl. Mech. Eng. 177,
    235-257. The fixed points of the sweeps obey Coulomb's law, not the associated one that a quadratic
    programme over the friction cones has.
    """
    e, u = blocks.equations, blocks.rest
    f, left = np.zeros(len(r)), 0.0
    Seu = S[e[:, None], u]
    found = np.zeros((len(e), len(u) + 1))
    if len(e):
        found = solved(
            S[e[:, None], e], np.column_stack([Seu, r[e]]), "the matrix of equations of joints"
        )
    if len(u):
        among, b, x = S, r[u] - Seu.T @ found[:, -1], before[u].copy()
        if len(e):
            among = np.ascontiguousarray(S[u[:, None], u] - Seu.T @ found[:, :-1])
        # rows that the equations hold already may contradict them by rounding
        idle = np.abs(np.diag(among)) <= REPEATED * np.abs(np.diag(S)[u])
        if idle.any():
            among = np.where(idle[:, None] | idle, 0.0, among)
            b[idle], x[idle] = 0.0, 0.0
        first = np.searchsorted(u, blocks.first)
        f[u], left = _of_contacts(among, b, first, blocks.friction, x, error)
    f[e] = -found[:, -1] - found[:, :-1] @ f[u]
    return f, left


def _of_contacts(
    W: Array, b: Array, first: Index, friction: Array, x: Array, error: float
) -> tuple[Array, float]:
    """Forces of contacts and limits from initial ones; those that remain open are left out."""
    size = np.where(friction > 0.0, 3, 1)
    closed = (x[first] > 0.0) | ((W @ x + b)[first] < 0.0)
    if not closed.any():
        return np.zeros_like(x), 0.0
    while True:
        rows = np.flatnonzero(np.repeat(closed, size))
        some, start = W[rows[:, None], rows], np.cumsum(size[closed]) - size[closed]
        f, left = np.zeros_like(x), 0.0
        f[rows], left = _among(some, b[rows], start, friction[closed], x[rows], error)
        more = ~closed & ((W @ f + b)[first] < -error)
        if not more.any() or left == np.inf:
            return f, left
        closed, x = closed | more, f


def _among(
    W: Array, b: Array, first: Index, friction: Array, x: Array, error: float
) -> tuple[Array, float]:
    """Forces by a direct solution for the states of contacts, which sweeps find."""
    left = np.inf
    for turn in range(TURNS + 1):
        # directions of sliding change from step to step, so that those of the initial forces are not
        # exact
        stale = turn == 0 and _slides(first, friction, x).any()
        direct = None if stale else _direct(W, b, first, friction, x)
        if direct is None and turn == 0 and not (friction > 0.0).any():
            direct = _frictionless(W, b, first, friction, x)
        if direct is not None:
            return direct, 0.0
        if left <= error or turn == TURNS:
            break
        left = sweep(W, b, first, friction, x, SWEEPS, error)
        with np.errstate(invalid="ignore", over="ignore"):
            bounded = bool(np.isfinite(W @ x).all())
        if not bounded:
            return np.zeros_like(x), np.inf  # forces grow without bound if W is indefinite
        # an indefinite matrix may have rows that sweeps cannot close
        left = max(left, -float((W @ x + b)[first].min()))
    return x, left


def _slides(first: Index, friction: Array, x: Array) -> Flags:
    """Contacts with friction whose tangential force is at its bound."""
    n = first[friction > 0.0]
    bound = friction[friction > 0.0] * x[n]
    return (x[n] > 0.0) & (np.hypot(x[n + 1], x[n + 2]) >= bound * (1.0 - 1e-9))


def _solution(A: Array, b: Array) -> Array:
    """Solution of A x = b, the smallest one if rows repeat each other."""
    lu, pivots, info = dgetrf(A)
    if info == 0 and dgecon(lu, float(np.abs(A).sum(axis=0).max()))[0] > SINGULAR:
        return np.asarray(dgetrs(lu, pivots, b)[0])
    with reported("the matrix of active contacts"):
        return np.asarray(lstsq(A, b, cond=SINGULAR, check_finite=False)[0])


def _frictionless(W: Array, b: Array, first: Index, friction: Array, x: Array) -> Array | None:
    """Forces of contacts without friction by the primal-dual active set from x, or None.

    It ends wrongly where rows repeat each other with different gaps, of which only one can be closed.
    Proximal points, the forces of W + c 1 with the gaps b - c x, then approach a solution.

    Source: Hintermueller, Ito and Kunisch 2002, The primal-dual active set strategy as a semismooth
    Newton method, SIAM J. Optim. 13, 865-888; Rockafellar 1976, Monotone operators and the proximal
    point algorithm, SIAM J. Control Optim. 14, 877-898.
    """
    start, closed = x, x > 0.0
    for _ in range(CHANGES):
        on, x = np.flatnonzero(closed), np.zeros_like(x)
        if len(on):
            x[on] = _solution(W[on[:, None], on], -b[on])
        new = np.where(closed, x > 0.0, W @ x + b < 0.0)
        if (new == closed).all():
            direct = _direct(W, b, first, friction, x)
            if direct is not None:
                return direct
            break
        closed = new
    c, x = PROXIMAL * float(np.abs(np.diag(W)).max()), start
    for _ in range(CHANGES):
        x = pushes(W + c * np.eye(len(W)), b - c * x, x > 0.0)
        direct = _direct(W, b, first, friction, x)
        if direct is not None:
            return direct
    return None


def _direct(W: Array, b: Array, first: Index, friction: Array, x: Array) -> Array | None:
    """Forces for the states of contacts at x, or None if these are not those of the solution."""
    n, rubs = first, np.flatnonzero(friction > 0.0)
    closed = x[n] > 0.0
    tangent = n[rubs, None] + np.array([1, 2])
    slides, size = _slides(first, friction, x), np.linalg.norm(x[tangent], axis=1)
    sticks = closed[rubs] & ~slides
    rows = np.concatenate([n[closed], tangent[sticks].ravel()])
    # friction of sliding contacts is a multiple of their normal force
    columns = W[:, rows].copy()
    pushes = np.searchsorted(n[closed], n[rubs[slides]])
    along = friction[rubs[slides], None] * x[tangent[slides]] / size[slides, None]
    for k, place, direction in zip(pushes, tangent[slides], along, strict=True):
        columns[:, k] += W[:, place] @ direction
    new = np.zeros_like(x)
    if len(rows):
        new[rows] = _solution(columns[rows], -b[rows])
    new[tangent[slides]] = along * new[n[rubs[slides]], None]
    rate = W @ new + b
    limit = SLIP * max(float(np.abs(b).max()), np.finfo(float).tiny)
    good = (new[n] >= 0.0).all() and (rate[n] >= -limit).all()
    good = good and float(np.abs(rate[rows]).max(initial=0.0)) <= limit
    held = np.linalg.norm(new[tangent[sticks]], axis=1)
    good = good and (held <= friction[rubs[sticks]] * new[n[rubs[sticks]]] * (1.0 + 1e-9)).all()
    slip = rate[tangent[slides]]
    across = slip[:, 0] * along[:, 1] - slip[:, 1] * along[:, 0]
    good = good and (np.einsum("ki,ki->k", slip, along) <= limit).all()
    good = good and float(np.abs(across).max(initial=0.0)) <= limit
    return new if good else None
