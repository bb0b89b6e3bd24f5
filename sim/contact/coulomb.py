"""Forces of equations, inequalities and Coulomb contacts that share one Delassus matrix."""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import LinAlgError, lstsq

from sim._kernels.coulomb import sweep
from sim.pattern import Flags
from sim.scene import Index
from sim.state import Array

SWEEPS, TURNS = 100, 40
"""Sweeps between two attempts to solve directly for the present states of all contacts; attempts."""

SINGULAR = 1e-12  #: relative size of singular values that are due to rows that repeat each other
REPEATED = 1e-9  #: share of its mobility that a row must retain under the equations
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

    Parameters
    ----------
    S : (m, m) symmetric positive semi-definite.
    r : (m,) rates without forces.
    before : (m,) initial forces.
    error : tolerance of the rates.

    Notes
    -----
    Source: Jean 1999, The non-smooth contact dynamics method, Comput. Methods Appl. Mech. Eng. 177,
    235-257. The fixed points of the sweeps obey Coulomb's law, not the associated one that a quadratic
    programme over the friction cones has.
    """
    e, u = blocks.equations, blocks.rest
    f, left = np.zeros(len(r)), 0.0
    Seu = S[e[:, None], u]
    found = np.zeros((len(e), len(u) + 1))
    if len(e):
        found = np.linalg.solve(S[e[:, None], e], np.column_stack([Seu, r[e]]))
    if len(u):
        W = np.ascontiguousarray(S[u[:, None], u] - Seu.T @ found[:, :-1])
        b, x = r[u] - Seu.T @ found[:, -1], before[u].copy()
        # rows that the equations hold already may contradict them by rounding
        idle = np.abs(np.diag(W)) <= REPEATED * np.abs(np.diag(S)[u])
        W[idle], W[:, idle], b[idle], x[idle] = 0.0, 0.0, 0.0, 0.0
        first = np.searchsorted(u, blocks.first) if len(u) else blocks.first
        left = np.inf
        for turn in range(TURNS + 1):
            # directions of sliding change from step to step, so that those of the initial forces are
            # not exact
            stale = turn == 0 and _slides(first, blocks.friction, x).any()
            direct = None if stale else _direct(W, b, first, blocks.friction, x)
            if direct is not None:
                x, left = direct, 0.0
                break
            if left <= error or turn == TURNS:
                break
            left = sweep(W, b, first, blocks.friction, x, SWEEPS, error)
            # an indefinite matrix may have rows that sweeps cannot close
            left = max(left, -float((W @ x + b)[first].min()))
        f[u] = x
    f[e] = -found[:, -1] - found[:, :-1] @ f[u]
    return f, left


def _slides(first: Index, friction: Array, x: Array) -> Flags:
    """Contacts with friction whose tangential force is at its bound."""
    n = first[friction > 0.0]
    bound = friction[friction > 0.0] * x[n]
    return (x[n] > 0.0) & (np.hypot(x[n + 1], x[n + 2]) >= bound * (1.0 - 1e-9))


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
    new, found = np.zeros_like(x), np.zeros(0)
    if len(rows):
        try:
            found = lstsq(columns[rows], -b[rows], cond=SINGULAR, check_finite=False)[0]
        except LinAlgError:
            return None
    new[rows] = found
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
