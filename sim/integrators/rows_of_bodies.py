"""Rows of joints and contacts in scenes with bodies, and their forces from one Delassus matrix.

Rows act on points; with v = R w + gamma their derivatives by the velocities are those of the points
times R.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from sim.contact.coulomb import Blocks, forces
from sim.contact.rows import Acting, Multipliers, Rows
from sim.contact.step import CORRECTIONS, ContactStep
from sim.errors import NotConverged
from sim.joints.compiled import REDUNDANT
from sim.pattern import Flags, Sparsity
from sim.scene import Index
from sim.state import Array, Pose
from sim.system import System

STILL = 1e-12  #: error of a position that contact forces leave in a step [m]
ON_FACE = 1e-7  #: gap below which a row is kept closed while others are opened [m]

SolveMany = Callable[[Array], Array]
"""Solutions (k, n) for right-hand sides (k, n) with the matrix of a step or a similar one."""


def dense(p: Sparsity, values: Array) -> Array:
    """Matrix (n, n) of values on a sparsity pattern."""
    A = np.zeros((p.n, p.n))
    row = np.repeat(np.arange(p.n), np.diff(p.indptr))
    A[row, p.indices] = A[p.indices, row] = values
    return A


@dataclass(eq=False)
class RowsAt:
    """Rows of joints, which the caller fills in, then those of contacts, each with its tangents."""

    G: Array  #: (m, n) derivatives by the velocities
    #: (m,) values: gaps, and displacements along tangents since the start of the step [m]
    value: Array
    compliance: Array  #: (m,)
    blocks: Blocks
    before: Array  #: (m,) initial forces
    slot: Index  #: (m,) slot of the contact of every row, -1 for joints
    first: Index  #: (k,) row of the normal of every contact
    rub: Index  #: contacts with friction
    tangents: tuple[Array, Array]  #: unit vectors of these
    remembered: Multipliers  #: of the contacts
    X: Array  #: (m, n) solutions for the rows of G

    def acting(self, f: Array, gap: Array) -> Acting:
        """Contact forces of the forces (m,) of rows, with gaps (k,)."""
        friction = np.zeros((len(gap), 3))
        for i, e in enumerate(self.tangents):
            friction[self.rub] += f[self.first[self.rub] + 1 + i, None] * e
        none = np.zeros(len(gap))
        return Acting(gap, f[self.first], friction, none > 0.0, none, 0.0, 0.0)


class RowsOfBodies:
    """Rows of one step.

    Parameters
    ----------
    many : solver with the matrix of the step.
    until : end of the step, for messages [s].

    Attributes
    ----------
    joints : number of rows of joints.
    """

    def __init__(self, system: System, step: ContactStep, many: SolveMany, until: float) -> None:
        self._system, self._step, self._many, self._until = system, step, many, until
        self.joints = 0 if system.rows is None else len(system.rows.names)

    def many(self, rhs: Array) -> Array:
        """Solutions (k, n) for right-hand sides (k, n)."""
        return self._many(rhs) if len(rhs) else np.zeros_like(rhs)

    def _directions(self, rows: Rows, pose: Pose, every: tuple[Array, ...]) -> list[Array]:
        """Derivatives (k, n) of the motions of rows along some directions (k, 3) by the velocities."""
        k, n_points = len(rows), len(pose.q)
        R = self._system.kinematics.matrix(pose)
        column = (3 * rows.nodes[:, :, None] + np.arange(3)).reshape(k, 12)
        ends = 12 * np.arange(k + 1)
        out: list[Array] = []
        for e in every:
            entry = (rows.weight[:, :, None] * e[:, None, :]).ravel()
            N = csr_array((entry, column.ravel(), ends), shape=(k, 3 * n_points))
            out.append(np.asarray((N @ R).toarray(), dtype=np.float64))
        return out

    def at(self, rows: Rows, pose: Pose) -> RowsAt:
        """Rows at a pose; those of joints are zero."""
        j, u, joints = self.joints, pose.q - self._step.q0, self._system.rows
        rub = np.flatnonzero(rows.friction > 0.0)
        size = np.where(rows.friction > 0.0, 3, 1)
        first, m = j + np.cumsum(size) - size, j + int(size.sum())
        G, value, before = np.zeros((m, self._system.pattern.n)), np.zeros(m), np.zeros(m)
        remembered = self._step.multipliers(rows, np.ones(len(rows)))
        G[first] = self._directions(rows, pose, (rows.normal,))[0]
        value[first], before[first] = rows.gaps(u), remembered.normal
        tangents, slid = _across(rows.normal[rub]), rows.take(rub)
        sides = self._directions(slid, pose, tangents)
        for i, (e, side) in enumerate(zip(tangents, sides, strict=True)):
            place = first[rub] + 1 + i
            G[place] = side
            value[place] = np.einsum("ki,ki->k", e, slid.displacement(u))
            before[place] = np.einsum("ki,ki->k", e, remembered.tangent[rub])
        limits = np.zeros(j, dtype=bool) if joints is None else joints.unilateral
        blocks = Blocks(
            np.flatnonzero(~limits),
            np.r_[np.flatnonzero(limits), first],
            np.r_[np.zeros(int(limits.sum())), rows.friction],
        )
        none, slot = np.zeros((0, 0)), np.r_[np.full(j, -1), np.repeat(rows.slot, size)]
        parts = blocks, before, slot, first, rub, tangents, remembered, none
        return RowsAt(G, value, np.zeros(m), *parts)

    def forces(self, at: RowsAt, scale: float, r: Array, before: Array, error: float) -> Array:
        """Forces (m,) of the Delassus matrix scale G X' for values r (m,) without forces.

        Raises NotConverged if they did not converge to `error`.
        """
        product = scale * at.G @ at.X.T
        S = 0.5 * (product + product.T)
        S[np.diag_indices_from(S)] += at.compliance
        f, left = forces(S, r, at.blocks, before, error)
        if left > 1e4 * error:
            reason = f"contact forces did not converge, {left:.2g} are left"
            raise NotConverged((), self._until, reason)
        return f

    def missed(self, rows: Rows, acting: Acting, pose: Pose, near: Rows) -> Rows:
        """Rows that a motion to a pose violates beyond a small correction; `near` are those there."""
        step = self._step
        passed = step.passed(pose.q, near)
        deep = step.considerable(passed, pose.q - step.q0, rows.slot[acting.force > 0.0])
        return passed.take(np.flatnonzero(deep)).without(rows)

    def moved_out(self, pose: Pose, near: Rows, *, search: bool = True) -> tuple[Pose, Rows]:
        """Pose with penetrations removed by the least motion in the norm of the matrix, and its rows.

        With `search` rows are searched at every pose.
        """
        for _ in range(CORRECTIONS):
            gap = near.gaps(pose.q - self._step.q0)
            if not (gap < -self._step.tolerances.noticed).any():
                break
            closed = near.take(np.flatnonzero(gap < ON_FACE))
            G = self._directions(closed, pose, (closed.normal,))[0]
            X, wanted, k = self._many(G), gap[gap < ON_FACE], np.arange(len(closed))
            S = G @ X.T
            blocks = Blocks(np.empty(0, dtype=np.int64), k, np.zeros(len(k)))
            f, _ = forces(0.5 * (S + S.T), wanted, blocks, np.zeros(len(k)), STILL)
            pose = self._system.kinematics.advance(pose, f @ X, pose.t)
            near = self._step.at(pose.q) if search else near
        return pose, near

    def kept(self, at: RowsAt, on: Flags, rhs: Array) -> Array:
        """Solution (n,) of the equation under some rows (m,), which stay closed."""
        x = self._many(rhs[None])[0]
        if not on.any():
            return x
        G, X = at.G[on], at.X[on]
        return x - np.asarray(np.linalg.lstsq(G @ X.T, G @ x, rcond=REDUNDANT)[0] @ X, np.float64)


def _across(normal: Array) -> tuple[Array, Array]:
    """Two unit vectors (k, 3) perpendicular to normals and each other."""
    axis: Index = np.argmin(np.abs(normal), axis=1)
    one: Array = np.cross(normal, np.eye(3)[axis]).astype(np.float64)
    one /= np.linalg.norm(one, axis=1, keepdims=True)
    other: Array = np.cross(normal, one).astype(np.float64)
    return one, other
