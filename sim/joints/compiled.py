"""Rows of all joints of a scene: values, derivatives by velocities, forces from the Schur complement."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from sim._kernels.joints import ALIGNED, ANGLE, TRAVEL, TURN, RowTable, rows_at
from sim.dense import least, solved
from sim.errors import NotConverged, SceneError
from sim.joints.contract import Joint, Row, number_of
from sim.kinematics import Kinematics
from sim.kinematics.rotations import vector_gradient
from sim.pattern import Flags, Index
from sim.state import Array, Pose

REDUNDANT = 1e-9  #: fraction of its mobility 1/m that a row must retain under the preceding rows

JOINT_MATRIX = "the matrix of the rows of joints"

PROJECTIONS, DRIFT = 5, 1e-13
"""Largest number of projections of positions after a step, and their tolerance [m, rad]."""


UNMET = 1e-6
"""Violation of a row after all projections above which its joints contradict others [m, rad]."""


@dataclass(frozen=True, eq=False)
class RowValues:
    """Rows at a pose."""

    c: Array  #: (m,) values [m or rad]
    G: Array  #: (m, k) derivatives by the velocities of `CompiledJoints.columns`
    drift: Array  #: (m,) rates due to prescribed motions


class CompiledJoints:
    """Rows laid out for a scene.

    Raises SceneError if a body does not exist, a row depends on fixed bodies only, or a rigid row
    depends linearly on others.

    `bodies` are numbers of bodies by name. Each row has a name, a compliance, a damping time, and is
    `unilateral` if it is an inequality or `rigid` if it is an equation without compliance; `joints` are
    the names of their joints in the order of the scene, and `columns` (k,) the velocities on which any
    row depends.
    """

    def __init__(
        self, joints: Sequence[Joint], bodies: Mapping[str, int], kinematics: Kinematics, rest: Pose
    ) -> None:
        parts = [joint.rows() for joint in joints]
        rows = [row for part in parts for row in part]
        self.joints = tuple(joint.name for joint in joints)
        self._joint: Index = np.repeat(np.arange(len(parts)), [len(part) for part in parts])
        self.names = tuple(row.name for row in rows)
        self._kinematics, self.table = kinematics, row_table(rows, bodies, rest)
        self.unilateral: Flags = np.array([row.unilateral for row in rows], dtype=bool)
        self.compliance = np.array([row.compliance for row in rows])
        self.damping_time = np.array([row.damping_time for row in rows])
        self.rigid: Flags = ~self.unilateral & (self.compliance == 0.0)
        self._number = kinematics.body_columns(len(rest.frames))
        points = np.unique(self.table.point[self.table.point >= 0])
        R = kinematics.matrix(rest)[(3 * points[:, None] + np.arange(3)).ravel()]
        touched = np.zeros(kinematics.pattern.n, dtype=bool)
        touched[R.indices] = True
        for side in (self.table.body_a, self.table.body_b):
            first = self._number[side]
            touched[(first[first >= 0][:, None] + np.arange(6)).ravel()] = True
        self.columns: Index = np.flatnonzero(touched)
        own = self._number[self._number >= 0] + 3
        self._turning: Index = np.unique(own[touched[own]])
        self._lay_out_points(kinematics.matrix(rest))
        self._require_independent(rest)
        _require_compatible(rows)

    def _lay_out_points(self, R: csr_array) -> None:
        """Places of the entries of R, whose sparsity is fixed, in the rows of points."""
        self._held: Index = np.flatnonzero(self.table.point >= 0)
        axis = np.arange(3)
        component = (3 * self.table.point[self._held][:, None] + axis).ravel()
        first, count = R.indptr[component], np.diff(R.indptr)[component]
        ends = np.cumsum(count)
        self._place: Index = np.repeat(first - ends + count, count) + np.arange(int(count.sum()))
        self._row: Index = np.repeat(np.repeat(self._held, 3), count)
        self._axis: Index = np.repeat(np.tile(axis, len(self._held)), count)
        self._column: Index = np.searchsorted(self.columns, R.indices[self._place])

    def _derivatives(self, frames: Array, q: Array) -> tuple[Array, Array, Array, Array]:
        """Values (n, m), and derivatives by twists of bodies a and b and by points, at n poses."""
        shape = len(q), len(self.names)
        c, JP, (JA, JB) = np.empty(shape), np.empty((*shape, 3)), np.empty((2, *shape, 6))
        rows_at(self.table, frames, q, c, JA, JB, JP)
        return c, JA, JB, JP

    def evaluate(self, pose: Pose) -> RowValues:
        """Values and derivatives at a pose."""
        m, table, kinematics = len(self.names), self.table, self._kinematics
        c, JA, JB, JP = (x[0] for x in self._derivatives(pose.frames[None], pose.q[None]))
        G, drift = np.zeros((m, len(self.columns))), np.zeros(m)
        own = np.arange(m)
        for side, slope in ((table.body_a, JA), (table.body_b, JB)):
            first = self._number[side]
            k = np.flatnonzero(first >= 0)
            place = np.searchsorted(self.columns, first[k])[:, None] + np.arange(6)
            G[own[k, None], place] += slope[k]
        attached = self._held
        if len(attached):
            entry = JP[self._row, self._axis] * kinematics.matrix(pose).data[self._place]
            np.add.at(G, (self._row, self._column), entry)
        moved = kinematics.drift(pose, pose.t)
        if moved is not None:
            twists = kinematics.prescribed_twists(pose.t)
            for side, slope in ((table.body_a, JA), (table.body_b, JB)):
                k = np.flatnonzero(side >= 0)
                drift[k] += (slope[k] * twists[side[k]]).sum(axis=1)
            drift[attached] += (JP[attached] * moved[table.point[attached]]).sum(axis=1)
        return RowValues(c, G, drift)

    def by_motion(self, G: Array, d: Array) -> Array:
        """Derivatives (m, k) by the motion d (n,) to a pose, from those by the velocities there."""
        out = G.copy()
        for first in self._turning.tolist():
            place = np.flatnonzero(self.columns == first) + np.arange(3)
            theta = np.broadcast_to(d[first : first + 3], (len(G), 3))
            out[:, place] = vector_gradient(theta, G[:, place])
        return out

    def reactions(self, frames: Array, q: Array, f: Array) -> tuple[Array, Array]:
        """Force [N] and moment [N m] (n, n_joints, 3) of each joint on body b, or its point, at n poses.

        The moment is about the place of the joint on b; the opposite force acts on body a. Poses are
        along the first axis, with forces or moments of the rows f (n, m) [N or N m].
        """
        table = self.table
        _, JA, JB, JP = self._derivatives(frames, q)
        on_b = np.where((table.body_b >= 0)[:, None], JB, -JA)
        turns = (table.kind == ALIGNED) | (table.kind == ANGLE) | (table.kind == TURN)
        push = f[..., None] * np.where((table.point >= 0)[:, None], JP, on_b[..., :3])
        turn = f[..., None] * on_b[..., 3:]
        force, moment = np.zeros((2, len(f), len(self.joints), 3))
        for k, joint in enumerate(self._joint.tolist()):
            if turns[k]:
                moment[:, joint] += turn[:, k]
            else:
                force[:, joint] += push[:, k]
        return force, moment

    def inverse_mass(self, pose: Pose) -> Array:
        """Solutions (n, k) of M x = e for the velocities of `columns`."""
        unit = np.zeros((self._kinematics.pattern.n, len(self.columns)))
        unit[self.columns, np.arange(len(self.columns))] = 1.0
        return self._kinematics.solve_mass(unit, pose)

    def inverse_under_rows(self, pose: Pose) -> Callable[[Array], Array]:
        """Map p (n,) -> x with M x = p + G'f and G x = 0 for the rigid rows at a pose."""
        X, G = self.inverse_mass(pose), self.evaluate(pose).G[self.rigid]
        S = G @ X[self.columns] @ G.T

        def inverse(p: Array) -> Array:
            x = self._kinematics.solve_mass(p, pose)
            return x - X @ (G.T @ solved(S, G @ x[self.columns], JOINT_MATRIX)) if len(G) else x

        return inverse

    def restricted(self, w: Array, pose: Pose) -> Array:
        """Velocities (n,) less what rigid rows do not allow, w - M^-1 G'(G M^-1 G')^-1 G w."""
        if not self.rigid.any():
            return w
        X, G = self.inverse_mass(pose), self.evaluate(pose).G[self.rigid]
        f = least(G @ X[self.columns] @ G.T, G @ w[self.columns], JOINT_MATRIX, REDUNDANT)
        return w - X @ (G.T @ f)

    def projected(
        self, pose: Pose, w: Array, *, momentum: bool = False
    ) -> tuple[Pose, Array, Array]:
        """Project pose and velocities to the rows, with the smallest change in the norm of the mass.

        It is the end of a step, (10) of docs/step.md.

        Also returns the impulses (m,) of the rows on the velocities. The rows of a step have the
        directions at its start; the impulses therefore contain the forces due to their rotation. With
        `momentum` the velocities keep their momentum while the pose, and with it R, is moved.
        """
        inverse, before, kinematics = self.inverse_mass(pose), pose, self._kinematics
        for _ in range(PROJECTIONS):
            now = self.evaluate(pose)
            on = self.rigid | (self.unilateral & (now.c < -DRIFT))
            if not np.abs(now.c[on]).max(initial=0.0) > DRIFT:
                break
            back = inverse @ _least(now.G[on], inverse[self.columns], -now.c[on])
            pose = kinematics.advance(pose, back, pose.t)
        else:
            self._require_met(pose)
        if momentum and pose is not before:
            u = kinematics.inertial(w, before) - kinematics.inertial(np.zeros_like(w), pose)
            w = kinematics.solve_mass(kinematics.momentum(u, pose), pose)
            inverse = self.inverse_mass(pose)
        now = self.evaluate(pose)
        G, rate = now.G[self.rigid], (now.G @ w[self.columns] + now.drift)[self.rigid]
        impulse = np.zeros(len(self.names))
        if len(G):
            impulse[self.rigid] = solved(G @ inverse[self.columns] @ G.T, -rate, JOINT_MATRIX)
        return pose, w + inverse @ (now.G.T @ impulse), impulse

    def _require_met(self, pose: Pose) -> None:
        """Raise NotConverged if rigid rows or inequalities remain violated after projections."""
        c = self.evaluate(pose).c
        left = np.where(self.rigid, np.abs(c), np.where(self.unilateral, -c, 0.0))
        if left.max(initial=0.0) > UNMET:
            name, most = self.names[int(left.argmax())], float(left.max())
            reason = (
                f"the rows of joints contradict each other: {name!r} is off by {most:.3g} m or rad"
            )
            raise NotConverged((), pose.t, reason)

    def _require_independent(self, rest: Pose) -> None:
        if not self.names:
            return
        G, X = self.evaluate(rest).G, self.inverse_mass(rest)[self.columns]
        S, left = G @ X @ G.T, list[int]()
        for k in np.flatnonzero(self.rigid).tolist():
            own = S[k, k]
            if left and own > 0.0:
                others = S[np.ix_(left, left)]
                own -= S[k, left] @ solved(others, S[left, k], JOINT_MATRIX)
            if not own > REDUNDANT * S[k, k]:
                why = (
                    "acts on nothing that moves" if not S[k, k] > 0.0 else "repeats rows before it"
                )
                raise SceneError(
                    f"joint row {self.names[k]!r} {why}: leave it out or give the joint a compliance"
                )
            left.append(k)


def _require_compatible(rows: Sequence[Row]) -> None:
    """Raise SceneError for two bounds of one motion of which the lower is above the upper."""
    bounds = dict[tuple[object, ...], dict[float, Row]]()
    for row in (row for row in rows if row.unilateral and row.kind in (TRAVEL, ANGLE)):
        place = row.origin.tobytes(), row.axes.tobytes(), row.i, row.point
        own = bounds.setdefault((row.kind, row.body_a, row.body_b, *place), {})
        other = own.get(row.sign)
        if other is None or row.sign * (row.offset - other.offset) > 0.0:
            own[row.sign] = row
    for own in bounds.values():
        if len(own) == 2 and own[1.0].offset > own[-1.0].offset:
            raise SceneError(
                f"joint rows {own[1.0].name!r} and {own[-1.0].name!r} contradict each other: at least "
                f"{own[1.0].offset:.4g} and at most {own[-1.0].offset:.4g}, expected a range in common"
            )


def _least(G: Array, X: Array, wanted: Array) -> Array:
    """Impulses G'f (k,) for given changes of the rows, the smallest ones if rows are redundant."""
    if not len(G):
        return np.zeros(len(X))
    return G.T @ least(G @ X @ G.T, wanted, JOINT_MATRIX, REDUNDANT)


def row_table(rows: Sequence[Row], bodies: Mapping[str, int], rest: Pose) -> RowTable:
    """Table of rows, their frames in the axes of bodies, which are those of space at rest."""
    a = [number_of(row.body_a, bodies, row.name) for row in rows]
    b = [number_of(row.body_b, bodies, row.name) for row in rows]
    for row in rows:
        if row.point >= len(rest.q):
            raise SceneError(
                f"joint row {row.name} refers to point {row.point}, expected 0..{len(rest.q) - 1}"
            )

    def origins(bodies: list[int]) -> Array:
        centres = np.vstack([rest.frames[:, :3], np.zeros(3)])
        return np.array([row.origin - centres[k] for row, k in zip(rows, bodies, strict=True)])

    def whole(values: list[int]) -> Index:
        return np.array(values, dtype=np.int64)

    axes = np.array([row.axes for row in rows], dtype=np.float64).reshape(-1, 3, 3)
    return RowTable(
        whole([row.kind for row in rows]),
        whole(a),
        whole(b),
        whole([row.point for row in rows]),
        whole([row.i for row in rows]),
        whole([row.j for row in rows]),
        np.array([row.sign for row in rows], dtype=np.float64),
        np.array([row.offset for row in rows], dtype=np.float64),
        origins(a).reshape(-1, 3),
        axes,
        origins(b).reshape(-1, 3),
        axes,
        np.array([row.curve for row in rows]).reshape(-1, 6),
    )
