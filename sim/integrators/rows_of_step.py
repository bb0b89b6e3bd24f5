"""Rows of joints and contacts over a step, and their forces from one Delassus matrix.

Rows act on points; with v = R w + gamma their derivatives by the velocities are those of the points
times R.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from sim.contact.cone import Blocks, forces
from sim.contact.rows import ContactForces, ContactRows, Multipliers, across
from sim.contact.step import CORRECTIONS, ContactStep
from sim.dense import reported, solve_under_rows
from sim.errors import NotConverged
from sim.integrators.newton import PotentialOfMoves
from sim.integrators.step_solver import Solution
from sim.joints.compiled import REDUNDANT
from sim.linear.contract import Matrix
from sim.multibody import MOST_DENSE
from sim.pattern import Flags, Sparsity
from sim.scene import Index
from sim.state import Array, Pose
from sim.system import System

STILL = 1e-12  #: error of a position that contact forces leave in a step [m]
REPEATS, CLOSED_SHARE, ROUGHLY = 30, 1e-11, 1e-6
"""Largest number of corrections of a solution under rows, and relative openings that end them, also of
an approximate solution."""
RATE_ERROR = 1e4  #: error of the rates that forces may leave, relative to the wanted one
ON_FACE = 1e-7  #: gap below which a row is kept closed while others are opened [m]

Solve = Callable[[Array], Array]
"""Solution (n,) for a right-hand side (n,) with the matrix A of a step or a similar one."""

Delassus = Callable[[csr_array], Array]
"""Matrix G A^-1 G' (m, m) of directions G (m, n)."""


def dense(p: Sparsity, values: Array) -> Array:
    """Matrix (n, n) of values on a sparsity pattern."""
    A = np.zeros((p.n, p.n))
    row = np.repeat(np.arange(p.n), np.diff(p.indptr))
    A[row, p.indices] = A[p.indices, row] = values
    return A


def inverted(A: Matrix, rhs: Array) -> tuple[Array, Solution] | None:
    """Inverse (n, n) of the matrix of a small scene with the solution by it; None for others."""
    if len(rhs) > MOST_DENSE or A.products:
        return None
    whole = dense(A.pattern, A.values)
    with reported("the matrix of the step"):
        values = np.linalg.eigvalsh(whole)
        inverse = np.asarray(np.linalg.inv(whole), dtype=np.float64)

    def alone(r: Array) -> Array:
        return np.asarray(r @ inverse)

    def again(r: Array, _: float) -> Solution:
        return Solution(np.asarray(inverse @ r), 0, 0)

    definite = bool(values[0] > 0.0)
    return inverse, Solution(inverse @ rhs, 1, 1, definite, alone, again, alone)


@dataclass(frozen=True, eq=False)
class JointRows:
    """Rows of joints at a pose, in front of those of contacts."""

    columns: Index  #: (k,) velocities on which they depend
    G: Array  #: (j, k)
    value: Array  #: (j,)
    compliance: Array  #: (j,)
    unilateral: Flags  #: (j,)


def joint_rows(phi: PotentialOfMoves, d: Array) -> JointRows:
    """Rows (3) of docs/step.md, r + compliance f = 0 or r >= 0, of joints at a motion d (n,).

    Rigid rows hold for velocities, r = s (G w + drift), so that stages keep their order and no fast mode
    is left in their forces; with a time constant T, r = (c + T (G w + drift))/(1 + T/s).
    """
    rows, s = phi.system.rows, phi.duration
    assert rows is not None  # callers check that the scene has joints
    now, share = rows.evaluate(phi.pose(d)), 1.0 + rows.damping_time / s
    rate = np.zeros(len(now.c)) if s == math.inf else now.G @ d[rows.columns] / s + now.drift
    r = (now.c + rows.damping_time * rate) / share
    if s < math.inf:
        r[rows.rigid] = s * rate[rows.rigid]
    G = rows.by_motion(now.G, d)
    return JointRows(rows.columns, G, r, rows.compliance / share, rows.unilateral)


@dataclass(eq=False)
class RowsAt:
    """Rows of joints, then those of contacts, each with its tangents."""

    G: csr_array  #: (m, n) derivatives by the velocities
    #: (m,) values: gaps, and displacements along tangents since the start of the step [m]
    value: Array
    compliance: Array  #: (m,)
    blocks: Blocks
    before: Array  #: (m,) initial forces
    contact_vertex: Index  #: (m,) contact vertex of every row, -1 for joints
    first: Index  #: (k,) row of the normal of every contact
    rub: Index  #: contacts with friction
    tangents: tuple[Array, Array]  #: unit vectors of these
    remembered: Multipliers  #: of the contacts
    scale: float  #: of the Delassus matrix of motions
    S: Array  #: (m, m) Delassus matrix G A^-1 G', which the caller sets

    @property
    def joints(self) -> int:
        """Number of rows of joints."""
        return int((self.contact_vertex < 0).sum())

    @property
    def broken(self) -> float:
        """Largest violation of a joint that does not yield [m, rad]."""
        j = self.joints
        r, equation = self.value[:j], np.zeros(j, dtype=bool)
        equation[self.blocks.equations] = True
        open_by = np.where(equation, np.abs(r), -r)[self.compliance[:j] == 0.0]
        return float(open_by.max(initial=0.0))

    def acting(self, f: Array, gap: Array) -> ContactForces:
        """Contact forces of the forces (m,) of rows, with gaps (k,)."""
        friction = np.zeros((len(gap), 3))
        for i, e in enumerate(self.tangents):
            friction[self.rub] += f[self.first[self.rub] + 1 + i, None] * e
        none = np.zeros(len(gap))
        return ContactForces(
            gap, f[self.first], 0.0 * friction, friction, none > 0.0, none, 0.0, 0.0
        )

    def carried(self, rows: ContactRows, before: ContactRows, known: "RowsAt", f: Array) -> Array:
        """Forces (m,) that these rows had among earlier ones with forces f, zero for new ones."""
        out, j = np.zeros(len(self.value)), self.joints
        out[:j] = f[:j]
        _, mine, theirs = np.intersect1d(rows.keys, before.keys, return_indices=True)
        rubs = rows.friction[mine] > 0.0
        for i in range(3):
            some = slice(None) if i == 0 else rubs
            out[self.first[mine[some]] + i] = f[known.first[theirs[some]] + i]
        return out

    def forces(self, value: Array, before: Array, error: float, until: float) -> Array:
        """Forces (m,) for values (m,) without forces, equation (5) of docs/step.md.

        Raises NotConverged if they did not converge to `error`; `until` is the time for its message.
        """
        W = self.scale * self.S
        W[np.diag_indices(len(W))] += self.compliance
        f, left = forces(W, value, self.blocks, before, error)
        _require_converged(left, error, until)
        return f

    def kept(
        self,
        on: Flags,
        rhs: Array,
        solve: Solve,
        wanted: Array | None = None,
        *,
        exactly: bool = False,
    ) -> tuple[Array, Array]:
        """Solution (n,) for a right-hand side under some rows, and impulses (m,).

        The rows stay closed, or open by `wanted` (m,).

        Rigid rows are corrected again with `exactly`, because the matrix S may be of another factor.
        """
        x, f = solve(rhs), np.zeros(len(on))
        if not on.any():
            return x, f
        G = self.G[np.flatnonzero(on)]
        x, f[on] = solve_under_rows(
            x,
            G,
            self.S[np.ix_(on, on)],
            lambda more: solve(G.T @ more),
            "the matrix of active rows",
            wanted=0.0 if wanted is None else wanted[on],
            soft=self.compliance[on] / self.scale,
            cutoff=REDUNDANT,
            repeats=REPEATS if exactly else 2,
            most=(CLOSED_SHARE if exactly else ROUGHLY) * float((abs(G) @ np.abs(x)).max()),
        )
        return x, f


class RowsOfStep:
    """Rows of one step; `scale` is the square of its implicit part [s^2]."""

    def __init__(
        self,
        system: System,
        step: ContactStep | None,
        solve: Solve,
        delassus: Delassus,
        scale: float,
    ) -> None:
        self._system, self.solve, self._delassus = system, solve, delassus
        self._contact, self._scale = step, scale

    @property
    def _step(self) -> ContactStep:
        assert self._contact is not None  # callers have rows of contact
        return self._contact

    def _directions(self, rows: ContactRows, pose: Pose, selected: Index, e: Array) -> csr_array:
        """Derivatives (m, n) by the velocities of the motions of rows `selected` (m,) along e (m, 3)."""
        m, n_points = len(selected), len(pose.q)
        column = (3 * rows.nodes[selected][:, :, None] + np.arange(3)).reshape(m, 12)
        entry = rows.weight[selected][:, :, None] * e[:, None, :]
        ends = 12 * np.arange(m + 1)
        N = csr_array((entry.ravel(), column.ravel(), ends), shape=(m, 3 * n_points))
        return csr_array(N @ self._system.kinematics.matrix(pose))

    def at(
        self, rows: ContactRows, pose: Pose, joints: JointRows | None = None, d: Array | None = None
    ) -> RowsAt:
        """Rows at a pose, with derivatives by the velocities there, or by the motion d (n,) to it."""
        k, n = len(rows), self._system.pattern.n
        rub = np.flatnonzero(rows.friction > 0.0)
        j = 0 if joints is None else len(joints.value)
        size = np.where(rows.friction > 0.0, 3, 1)
        first = j + np.cumsum(size) - size
        m = j + int(size.sum())
        value, compliance, before = np.zeros(m), np.zeros(m), np.zeros(m)
        remembered = Multipliers.with_bounds(rows, np.ones(k), np.zeros(k), np.zeros((k, 3)))
        tangents, slid = across(rows.normal[rub]), np.zeros((len(rub), 3))
        if k:
            u, remembered = pose.q - self._step.q0, self._step.multipliers(rows, np.ones(k))
            value[first], before[first] = rows.gaps(u), remembered.normal
            slid = rows.displacement(u)[rub]
        for i, e in enumerate(tangents):
            place = first[rub] + 1 + i
            value[place] = np.einsum("ki,ki->k", e, slid)
            before[place] = np.einsum("ki,ki->k", e, remembered.tangent[rub])
        order = np.argsort(np.r_[first, first[rub] + 1, first[rub] + 2])
        along = np.concatenate([rows.normal, *tangents])[order]
        slopes = csr_array((m - j, n))
        if k:
            slopes = self._directions(rows, pose, np.r_[np.arange(k), rub, rub][order], along)
        if k and d is not None:
            slopes = self._system.kinematics.gradients(slopes, d)
        limits = np.zeros(0, dtype=bool)
        if joints is not None:
            value[:j], compliance[:j], limits = joints.value, joints.compliance, joints.unilateral
            ends = np.r_[len(joints.columns) * np.arange(j + 1), np.full(m - j, joints.G.size)]
            own = (joints.G.ravel(), np.tile(joints.columns, j), ends)
            below = slopes.data, slopes.indices, np.r_[np.zeros(j, np.int64), slopes.indptr]
            above = csr_array(own, shape=(m, n))
            slopes = csr_array(csr_array(below, (m, n)) + above) if k else above
        blocks = Blocks(
            np.flatnonzero(~limits),
            np.r_[np.flatnonzero(limits), first],
            np.r_[np.zeros(int(limits.sum())), rows.friction],
        )
        contact_vertex = np.r_[np.full(j, -1), np.repeat(rows.contact_vertex, size)]
        parts = blocks, before, contact_vertex, first, rub, tangents, remembered
        return RowsAt(slopes, value, compliance, *parts, self._scale, np.zeros((0, 0)))

    def missed(
        self, rows: ContactRows, acting: ContactForces, pose: Pose, near: ContactRows
    ) -> ContactRows:
        """Rows that a motion to a pose violates beyond a small correction; `near` are those there."""
        step = self._step
        passed = step.passed(pose.q, near)
        deep = step.considerable(passed, pose.q - step.q0, rows.contact_vertex[acting.force > 0.0])
        return passed.take(np.flatnonzero(deep)).without(rows)

    def remove_penetration(
        self, pose: Pose, near: ContactRows, *, search: bool = True
    ) -> tuple[Pose, ContactRows]:
        """Pose with penetrations removed by the least motion in the norm of the matrix, and its rows.

        With `search` rows are searched at every pose. Raises NotConverged if the forces that close the
        rows do not converge, which the matrix of tissue that has lost its stability may cause.
        """
        for _ in range(CORRECTIONS):
            gap = near.gaps(pose.q - self._step.q0)
            if not (gap < -self._step.tolerances.noticed).any():
                break
            # Rows that the correction may close are inequalities of it: without them, a row just above
            # a threshold on one side of a symmetric face would be penetrated, and that opposite not.
            within = gap < max(ON_FACE, -gap.min())
            closed = near.take(np.flatnonzero(within))
            k = np.arange(len(closed))
            G = self._directions(closed, pose, k, closed.normal)
            blocks = Blocks(k[:0], k, np.zeros(len(k)))
            S, none = self._delassus(G), np.zeros(len(k))
            f, left = forces(S, gap[within], blocks, none, STILL)
            _require_converged(left, STILL, pose.t)
            pose = self._system.kinematics.advance(pose, self.solve(G.T @ f), pose.t)
            near = self._step.at(pose.q) if search else near
        return pose, near


def _require_converged(left: float, error: float, until: float) -> None:
    """Raise NotConverged if sweeps would change rates by more than rounding of `error` allows."""
    if not left <= RATE_ERROR * error:
        reason = f"contact forces did not converge, {left:.2g} are left"
        raise NotConverged((), until, reason)
