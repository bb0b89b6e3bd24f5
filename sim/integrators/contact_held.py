"""Linearly implicit step of scenes with bodies, attachments or joints, with rows of contact.

Contact and joints share one Delassus matrix h G A^-1 G' and one complementarity problem
(`sim.integrators.rows_of_bodies`).
"""

import numpy as np

from sim.contact.rows import Rows
from sim.contact.step import ContactStep
from sim.errors import NotConverged, SingularSystem
from sim.integrators.contact_linear import FASTER, ROUNDS, Touched
from sim.integrators.rows_of_bodies import STILL, RowsAt, RowsOfBodies, SolveMany, dense
from sim.integrators.workspace import Workspace
from sim.multibody import MOST
from sim.state import Array, State
from sim.step_matrices import LinearStep
from sim.system import System

LIMIT = 40  #: largest number of refinements of a solution by an older factor


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
        self._rows = RowsOfBodies(system, self._step, self._lay_out_solver(work), state.t + h)

    def _lay_out_solver(self, work: Workspace) -> SolveMany:
        """Solve for the motion without rows: densely if it is small, else as the workspace does."""
        A, rhs = self._equation.A, self._equation.rhs
        self._factorisations, self._definite = 1, True
        if len(rhs) <= MOST and not A.products and self._system.constraints is None:
            whole = dense(A.pattern, A.values)
            try:
                inverse, values = np.linalg.inv(whole), np.linalg.eigvalsh(whole)
            except np.linalg.LinAlgError as error:
                raise SingularSystem("the matrix of the step is singular") from error
            self._free, self._solutions, self._definite = inverse @ rhs, 1, values[0] > 0.0
            return lambda rows: rows @ inverse
        start = work.steps.extrapolated(self._state.t, self._h, self._w0)
        found = work.solve(self._system, A, rhs, self._start, start, self._error)
        self._free, self._solutions, self._definite = found.x, found.iterations, found.definite
        assert found.roughly is not None  # Every solution of a step has one.
        self._factorisations = found.factorisations
        return found.roughly

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
            at, w, f = self._held(rows)
            way = h * ((1.0 - self._equation.moves) * self._w0 + self._equation.moves * w)
            pose = kinematics.advance(state.pose, way, t1)
            near = step.at(pose.q)
            acting = at.acting(f, rows.gaps(pose.q - state.q))
            missed = self._rows.missed(rows, acting, pose, near)
            if not len(missed):
                break
            rows = rows.joined(step.entering(missed))
        else:
            raise NotConverged((), t1, "new contact constraints appear in every iteration")
        (pose, near), reaction = self._rows.moved_out(pose, near), None
        if system.rows is not None:
            pose, w, impulse = system.rows.projected(pose, w)
            reaction, near = f[: self._rows.joints] + impulse / h, step.at(pose.q)
        return Touched(
            w,
            pose,
            step.memory(pose.q, near, at.remembered, acting),
            rows.spread(acting.on_vertices(rows), len(pose.q)),
            lambda rhs: self._rows.kept(at, f != 0.0, rhs),
            self._solutions,
            self._factorisations,
            self._definite,
            rows.take(np.flatnonzero(acting.force > 0.0)),
            reaction,
        )

    def _held(self, rows: Rows) -> tuple[RowsAt, Array, Array]:
        """Rows, and velocities (n,) and forces (m,) under them."""
        h, start, joints = self._h, self._start, self._system.rows
        at = self._rows.at(rows, start)
        at.value /= h
        if joints is not None:
            now, j = joints.evaluate(start), self._rows.joints
            time = np.where(joints.unilateral, h, h + joints.damping_time)
            at.G[:j, joints.columns], at.compliance[:j] = now.G, joints.compliance / time
            at.value[:j] = now.drift + np.where(joints.rigid, 0.0, now.c / time)
        A, rhs = self._equation.A, self._equation.rhs
        at.X = X = self._rows.many(at.G)

        def with_rows(free: Array, f: Array) -> tuple[Array, Array]:
            new = self._rows.forces(at, h, at.G @ free + at.value, f, STILL / h)
            return free + h * (new @ X), new

        w, f = with_rows(self._free, at.before)
        for _ in range(LIMIT):
            missing = rhs + h * (f @ at.G) - A.times(w)
            free = w + self._rows.many(missing[None])[0] - h * (f @ X)
            new, f = with_rows(free, f)
            moved, w = float(np.abs(new - w).max()), new
            self._solutions += 1
            if moved <= self._error:
                return at, w, f
        raise NotConverged((), self._state.t + h, "the solution under contact does not settle")
