"""Linearly implicit step of scenes with bodies, attachments or joints, with rows of contact.

Rows act on points; with v = R w + gamma their derivatives by the velocities are those of the points
times R. Contact and joints share one Delassus matrix h G A^-1 G' and one complementarity problem.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from sim.contact.coulomb import Blocks, forces
from sim.contact.rows import Acting, Rows
from sim.contact.step import CORRECTIONS, ContactStep
from sim.errors import NotConverged, SingularSystem
from sim.integrators.contact_linear import FASTER, ROUNDS, Touched
from sim.integrators.workspace import Workspace
from sim.joints.compiled import REDUNDANT
from sim.multibody import MOST
from sim.scene import Index
from sim.state import Array, Pose, State
from sim.step_matrices import LinearStep
from sim.system import System

LIMIT = 40  #: largest number of refinements of a solution by an older factor
STILL = 1e-12  #: error of a position that contact forces leave in a step [m]
ON_FACE = 1e-7  #: gap below which a row is kept closed while others are opened [m]


@dataclass(frozen=True, eq=False)
class _Held:
    """Rows of joints (j), then those of contacts, and the solution under them."""

    #: (m, n) derivatives by the velocities, and A^-1 G'
    G: Array
    X: Array
    #: velocities (n,), forces (m,)
    w: Array
    f: Array
    solutions: int


class HeldContact:
    """Iteration of a step: solve with the current rows, and add the violated ones.

    Parameters
    ----------
    equation : of the velocities without rows.
    h, error : length of the step [s] and largest error of an iterative solution [m].
    """

    def __init__(
        self,
        system: System,
        state: State,
        equation: LinearStep,
        h: float,
        error: float,
        work: Workspace,
    ) -> None:
        assert system.contact is not None  # Callers check that the scene has contact.
        self._system, self._state, self._equation, self._h = system, state, equation, h
        self._w0 = system.kinematics.velocities(state)
        self._step = ContactStep(system.contact, state, state.t + h)
        self._start = system.kinematics.at(state.pose, state.t + h)
        self._error = error / (equation.moves * h)
        self._joints = 0 if system.rows is None else len(system.rows.names)
        self._lay_out_solver(work)

    def _lay_out_solver(self, work: Workspace) -> None:
        """Solve for the motion without rows: densely if it is small, else as the workspace does."""
        A, rhs = self._equation.A, self._equation.rhs
        self._factorisations, self._definite = 1, True
        if len(rhs) <= MOST and not A.products:
            p = A.pattern
            dense = np.zeros((p.n, p.n))
            row = np.repeat(np.arange(p.n), np.diff(p.indptr))
            dense[row, p.indices] = dense[p.indices, row] = A.values
            try:
                inverse, values = np.linalg.inv(dense), np.linalg.eigvalsh(dense)
            except np.linalg.LinAlgError as error:
                raise SingularSystem("the matrix of the step is singular") from error
            self._many: Callable[[Array], Array] = lambda rows: rows @ inverse
            self._free, self._solutions, self._definite = inverse @ rhs, 1, values[0] > 0.0
            return
        start = work.steps.extrapolated(self._state.t, self._h, self._w0)
        found = work.steps.solve(A, rhs, start, self._error)
        self._free, self._solutions, self._definite = found.x, found.iterations, found.definite
        assert found.roughly is not None  # Every solution of a step has one.
        self._factorisations, self._many = found.factorisations, found.roughly

    def solve(self) -> Touched:
        """Velocities and pose at the end.

        Raises NotConverged if the forces did not converge, or new rows appear in every iteration;
        SingularSystem if a matrix could not be factorised.
        """
        step, h, system, state = self._step, self._h, self._system, self._state
        kinematics, t1 = system.kinematics, state.t + h
        speed = (
            np.sqrt((state.v**2).sum(axis=1)) + np.linalg.norm(self._start.q - state.q, axis=1) / h
        )
        rows = step.entering(step.at_start(FASTER * h * speed))
        for _ in range(ROUNDS):
            held = self._held(rows)
            way = h * ((1.0 - self._equation.moves) * self._w0 + self._equation.moves * held.w)
            pose = kinematics.advance(state.pose, way, t1)
            near = step.at(pose.q)
            acting = self._acting(rows, held, pose)
            passed = step.passed(pose.q, near)
            deep = step.considerable(passed, pose.q - state.q, rows.slot[acting.force > 0.0])
            missed = passed.take(np.flatnonzero(deep)).without(rows)
            if not len(missed):
                break
            rows = rows.joined(step.entering(missed))
        else:
            raise NotConverged((), t1, "new contact constraints appear in every iteration")
        (pose, near), w, reaction = self._moved_out(pose, near), held.w, None
        if system.rows is not None:
            pose, w, impulse = system.rows.projected(pose, w)
            reaction, near = held.f[: self._joints] + impulse / h, step.at(pose.q)
        pushed = rows.spread(acting.on_vertices(rows), len(pose.q))
        return Touched(
            w,
            pose,
            step.memory(pose.q, near, self._remembered, acting),
            pushed,
            lambda rhs: self._roughly(held, rhs),
            held.solutions,
            self._factorisations,
            self._definite,
            rows.take(np.flatnonzero(acting.force > 0.0)),
            reaction,
        )

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

    def _held(self, rows: Rows) -> _Held:
        """Solution under the rows of joints and contacts."""
        h, j, joints = self._h, self._joints, self._system.rows
        start, n = self._start, len(self._free)
        rub = np.flatnonzero(rows.friction > 0.0)
        size = np.where(rows.friction > 0.0, 3, 1)
        first = j + np.cumsum(size) - size
        G, target = np.zeros((j + int(size.sum()), n)), np.zeros(j + int(size.sum()))
        u = start.q - self._state.q
        G[first] = self._directions(rows, start, (rows.normal,))[0]
        target[first] = rows.gaps(u) / h
        self._tangents = tangents = _across(rows.normal[rub])
        slid = rows.take(rub)
        sides = self._directions(slid, start, tangents)
        for i, (e, side) in enumerate(zip(tangents, sides, strict=True)):
            G[first[rub] + 1 + i] = side
            target[first[rub] + 1 + i] = np.einsum("ki,ki->k", e, slid.displacement(u)) / h
        compliance = np.zeros(len(G))
        equations, limits = np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64)
        if joints is not None:
            now = joints.evaluate(start)
            time = np.where(joints.unilateral, h, h + joints.damping_time)
            G[:j, joints.columns], compliance[:j] = now.G, joints.compliance / time
            target[:j] = now.drift + np.where(joints.rigid, 0.0, now.c / time)
            equations, limits = (
                np.flatnonzero(~joints.unilateral),
                np.flatnonzero(joints.unilateral),
            )
        blocks = Blocks(
            equations, np.r_[limits, first], np.r_[np.zeros(len(limits)), rows.friction]
        )
        before = np.zeros(len(G))
        self._remembered = self._step.multipliers(rows, np.ones(len(rows)))
        before[first] = self._remembered.normal
        for i, e in enumerate(tangents):
            before[first[rub] + 1 + i] = np.einsum("ki,ki->k", e, self._remembered.tangent[rub])
        self._first = first
        return self._settled(G, target, compliance, blocks, before)

    def _settled(
        self, G: Array, target: Array, compliance: Array, blocks: Blocks, f: Array
    ) -> _Held:
        h, A, rhs = self._h, self._equation.A, self._equation.rhs
        X = self._many(G) if len(G) else np.zeros_like(G)
        product = h * G @ X.T
        S = 0.5 * (product + product.T)
        S[np.diag_indices_from(S)] += compliance

        def with_rows(free: Array, f: Array) -> tuple[Array, Array]:
            new, left = forces(S, G @ free + target, blocks, f, STILL / h)
            if left > 1e4 * STILL / h:
                until = self._state.t + h
                raise NotConverged(
                    (), until, f"contact forces did not converge, {left:.2g} m/s are left"
                )
            return free + h * (new @ X), new

        w, f = with_rows(self._free, f)
        for k in range(LIMIT):
            missing = rhs + h * (f @ G) - A.times(w)
            free = w + self._many(missing[None])[0] - h * (f @ X)
            new, f = with_rows(free, f)
            moved, w = float(np.abs(new - w).max()), new
            if moved <= self._error:
                return _Held(G, X, w, f, self._solutions + k + 1)
        raise NotConverged((), self._state.t + h, "the solution under contact does not settle")

    def _acting(self, rows: Rows, held: _Held, pose: Pose) -> Acting:
        """Contact forces at a pose."""
        rub, friction = np.flatnonzero(rows.friction > 0.0), np.zeros((len(rows), 3))
        for i, e in enumerate(self._tangents):
            friction[rub] += held.f[self._first[rub] + 1 + i, None] * e
        none = np.zeros(len(rows))
        gap = rows.gaps(pose.q - self._state.q)
        return Acting(gap, held.f[self._first], friction, none > 0.0, none, 0.0, 0.0)

    def _moved_out(self, pose: Pose, near: Rows) -> tuple[Pose, Rows]:
        """Pose with penetrations removed by the least motion in the norm of the matrix, and its rows."""
        for _ in range(CORRECTIONS):
            gap = near.gaps(pose.q - self._state.q)
            if not (gap < -self._step.tolerances.noticed).any():
                break
            closed = near.take(np.flatnonzero(gap < ON_FACE))
            G = self._directions(closed, pose, (closed.normal,))[0]
            X, wanted, k = self._many(G), gap[gap < ON_FACE], np.arange(len(closed))
            S = G @ X.T
            blocks = Blocks(np.empty(0, dtype=np.int64), k, np.zeros(len(k)))
            f, _ = forces(0.5 * (S + S.T), wanted, blocks, np.zeros(len(k)), STILL)
            pose = self._system.kinematics.advance(pose, f @ X, pose.t)
            near = self._step.at(pose.q)
        return pose, near

    def _roughly(self, held: _Held, rhs: Array) -> Array:
        """Solution of the equation whose closed rows stay so."""
        x = self._many(rhs[None])[0]
        on = np.flatnonzero(held.f != 0.0)
        if not len(on):
            return x
        G, X = held.G[on], held.X[on]
        return x - np.asarray(np.linalg.lstsq(G @ X.T, G @ x, rcond=REDUNDANT)[0] @ X, np.float64)


def _across(normal: Array) -> tuple[Array, Array]:
    """Two unit vectors (k, 3) perpendicular to normals and each other."""
    axis: Index = np.argmin(np.abs(normal), axis=1)
    one: Array = np.cross(normal, np.eye(3)[axis]).astype(np.float64)
    one /= np.linalg.norm(one, axis=1, keepdims=True)
    other: Array = np.cross(normal, one).astype(np.float64)
    return one, other
