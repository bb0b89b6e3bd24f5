"""Linearly implicit step under the rows of joints and contacts, (8) of docs/step.md."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csr_array

from sim.contact.compliance import Compliance, learnt
from sim.contact.rows import NO_ROWS, ContactRows
from sim.contact.step import ContactStep
from sim.errors import NotConverged
from sim.integrators.rows_of_step import STILL, JointRows, RowsAt, RowsOfStep, inverted
from sim.integrators.step_solver import LinearStep, Solution
from sim.integrators.workspace import Workspace
from sim.joints.compiled import CompiledJoints
from sim.linear.equations import Equations
from sim.state import Array, Pose, State
from sim.system import System

AHEAD_OF_STEP = 1.5  #: factor on the initial velocity for the search range of vertices
ROW_ADDITIONS = 6  #: largest number of additions of violated rows
ROW_PASSES, STALE = 40, 6
"""Largest number of passes of a solution under rows, and that after which the compliance is computed
again."""
ROW_MOTION_SHARE = (
    0.1  #: motion of rows that remains, relative to the tolerance of solution or contact
)
FEW = 24  #: number of columns of the compliance that take the time of two corrections
UPDATE_FROM = (
    0.01  #: change, relative to the largest one in a solution, from which an update is made
)
EXACT = 0.01  #: relative error of the Delassus matrix below which it is not updated


@dataclass(frozen=True)
class StepUnderRows:
    """End of a step under rows.

    `solution` is that of the velocities, and solves roughly under the rows that act at the end.
    `pushed` (n_points, 3) are the contact forces there [N], `near` (k,) the rows of contacts, `active`
    those with a force, and `reaction` (m,) the forces of joints. `solve_under_rows` solves for a
    right-hand side (n,) under the rows that act, and those of contacts at rest that it would close,
    exactly; with the normal impulses (k,).
    """

    solution: Solution
    pose: Pose
    memory: Mapping[str, Array]
    pushed: Array
    near: ContactRows
    active: ContactRows
    reaction: Array | None
    solve_under_rows: Callable[[Array], tuple[Array, Array]]


class LinearRows:
    """Iteration of a step: solve with the current rows, and add the violated ones.

    A w = rhs + h G'f with the forces f of rows. Rigid rows of joints are satisfied by the velocities,
    G w = -drift; with a time a = h + damping time compliant ones are c + a (G w + drift) + compliance f
    = 0, and limits c + h (G w + drift) >= 0. Contacts are g + h G w >= 0, with Coulomb's law. The forces
    follow from the Delassus matrix S = h G A^-1 G', which in small scenes is exact. In large ones it is
    that of an earlier matrix A with updates (`sim.contact.compliance`), and the residual of the
    equation is solved for again until the forces no longer change, from those of the last step. Rigid
    rows of joints then precondition these solutions (`sim.linear.equations`), which satisfy them.

    The equation is that without rows; `h` is the length of the step [s] and `error` the largest error
    of an iterative solution [m].
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
        self._system, self._state, self._equation, self._h = system, state, equation, h
        self._work, self._until = work, state.t + h
        self._w0 = system.kinematics.velocities(state)
        self._start = system.kinematics.at(state.pose, self._until)
        self._error = error / (equation.moves * h)
        # dense in small scenes, None in others
        known = None if system.constraints is not None else inverted(equation.A, equation.rhs)
        self._inverse, self._found = known or (None, Solution(equation.rhs))
        self._guess = self._found.x if known else work.steps.extrapolated(state.t, h, self._w0)
        self._last: tuple[ContactRows, RowsAt, Array, Array] | None = None
        contact = system.contact
        self._step = None if contact is None else ContactStep(contact, state, self._until)
        left = 0.0 if self._step is None else self._step.tolerances.residual
        self._settled = max(h * self._error, left)
        self._rows = RowsOfStep(system, self._step, self._alone, self._delassus, h * h)
        self._equations, self._joints = None, None
        if system.rows is not None:
            self._lay_out_joints(system.rows)

    def _alone(self, r: Array) -> Array:
        """Solution for (n,) or (k, n) by the factor at hand, without rows."""
        assert self._found.alone is not None  # every solution of a step has it
        return self._found.alone(r)

    def _exactly(self, r: Array) -> Array:
        """Solution (n,) for a further right-hand side, with G x = 0 for rigid rows in large scenes."""
        rows = self._found
        assert rows.again is not None  # every solution of a step has it
        more = rows.again(r, self._error)
        self._found = replace(
            rows,
            iterations=rows.iterations + more.iterations,
            factorisations=rows.factorisations + more.factorisations,
            definite=rows.definite and more.definite,
        )
        return more.x

    def _compliance(self) -> Compliance:
        """Compliance of earlier matrices, whose new parts are those of the factor at hand."""
        return self._work.contact.compliance(self._h**2, lambda f: self._h**2 * self._alone(f))

    def _delassus(self, G: csr_array) -> Array:
        """G A^-1 G' (m, m)."""
        if not G.shape[0]:
            return np.zeros((0, 0))
        if self._inverse is not None:
            product = np.asarray(G @ (G @ self._inverse).T)
        else:
            product = self._compliance().between(G, G) / self._h**2
        return 0.5 * (product + product.T)

    def _learn(self, at: RowsAt, f: Array, w: Array, largest: float) -> float:
        """Update of an inexact Delassus matrix such that impulses f (m,) change velocities by w (n,).

        `largest` is the largest rate of a row of earlier changes in the solution, and the result with
        this one. Small changes are not learnt: an update has their relative error, so that rounding
        would grow from step to step.
        """
        if self._inverse is not None:
            return largest
        _, size, more = learnt(f, at.G @ w, at.S @ f, EXACT)
        if more is not None and size > UPDATE_FROM * largest:
            at.S += more
            self._compliance().learn(at.G.T @ f, self._h**2 * w)
        return max(largest, size)

    def _lay_out_joints(self, rows: CompiledJoints) -> None:
        """Rows of joints, and equations of the rigid ones if the solutions satisfy them."""
        h = self._h
        now, time = rows.evaluate(self._start), np.where(rows.unilateral, h, h + rows.damping_time)
        value = now.drift + np.where(rows.rigid, 0.0, now.c / time)
        self._joints = JointRows(
            rows.columns, now.G, h * value, h * rows.compliance / time, rows.unilateral
        )
        alone = self._inverse is None and self._system.constraints is None
        if alone and rows.rigid.any():
            self._rigid = np.flatnonzero(rows.rigid)
            own = rows.columns, now.G[self._rigid], -now.drift[self._rigid]
            self._equations = Equations(*own)

    def _begin(self, rows: ContactRows, at: RowsAt) -> tuple[Array, Array]:
        """Initial velocities (n,) and forces (m,): those of the last rows, or of the last step."""
        f = np.zeros(len(at.value))
        if self._inverse is not None:
            return self._found.x, f
        if self._last is not None:
            before, known, w, forces = self._last
            return w, at.carried(rows, before, known, forces)
        f = at.before
        rhs = self._equation.rhs + self._h * (at.G.T @ f)
        about = self._start, self._guess, self._error, self._equations
        self._found = self._work.solve(self._system, self._equation.A, rhs, *about)
        return self._found.x, f

    def _with_equations(self, at: RowsAt, Aw: Array, f: Array) -> Array:
        """Forces (m,) with those of the rigid rows that a solution w satisfies, from A w."""
        if self._equations is None:
            return f
        h, f = self._h, f.copy()
        left = Aw - self._equation.rhs - h * (at.G.T @ f)
        f[self._rigid] += self._equations.multipliers(left) / h
        return f

    # -- the step ----------------------------------------------------------------------------------

    def solve(self) -> StepUnderRows:
        """Velocities and pose at the end.

        Raises NotConverged if the forces did not converge, or new rows appear in every iteration;
        SingularSystem if a matrix could not be factorised.
        """
        step, h, system, state = self._step, self._h, self._system, self._state
        kinematics, joints, moves = system.kinematics, system.rows, self._equation.moves
        rows = near = NO_ROWS
        if step is not None:
            way = np.linalg.norm(state.v, axis=1) * h
            way += np.linalg.norm(self._start.q - state.q, axis=1)
            rows = step.entering(step.at_start(AHEAD_OF_STEP * way))
        for _ in range(ROW_ADDITIONS):
            used, at, w, f = self._under_some(rows)
            way = h * ((1.0 - moves) * self._w0 + moves * w)
            pose = kinematics.advance(state.pose, way, self._until)
            acting = at.acting(f, used.gaps(pose.q - state.q))
            if step is None:
                break
            near = step.at(pose.q)
            missed = self._rows.missed(used, acting, pose, near).without(rows)
            if not len(missed):
                break
            rows = rows.joined(step.entering(missed))
        else:
            reason = "new contact constraints appear in every iteration"
            raise NotConverged((), self._until, reason)
        memory, pushed, reaction = dict[str, Array](), np.zeros_like(pose.q), None
        if step is not None:
            out_of = near if moves == 1.0 else step.through(rows, pose.q, near)
            pose, near = self._rows.remove_penetration(pose, out_of)
        if joints is not None:
            pose, w, impulse = joints.projected(pose, w)
            reaction = f[: len(joints.names)] + impulse / h
        if step is not None:
            near = near if joints is None else step.at(pose.q)
            memory = dict(step.memory(pose.q, near, at.remembered, acting))
            pushed = acting.on_nodes(used, len(pose.q))
        on, rests = f != 0.0, np.zeros(len(f), dtype=bool)
        on[at.blocks.equations] = True
        rests[at.first] = (f[at.first] == 0.0) & (acting.gap < 100.0 * STILL)

        def solve_under_rows(rhs: Array) -> tuple[Array, Array]:
            x, impulse = at.kept(on, rhs, self._exactly, exactly=True)
            closes = rests & (at.G @ x < 0.0)
            if closes.any():
                x, impulse = at.kept(on | closes, rhs, self._exactly, exactly=True)
            return x, impulse[at.first]

        def roughly(rhs: Array) -> Array:
            assert self._found.roughly is not None  # every solution of a step has it
            return at.kept(on, rhs, self._found.roughly)[0]

        return StepUnderRows(
            replace(self._found, x=w, roughly=roughly),
            pose,
            memory,
            pushed,
            used,
            used.take(np.flatnonzero(f[at.first] > 0.0)),
            reaction,
            solve_under_rows,
        )

    def _under_some(self, rows: ContactRows) -> tuple[ContactRows, RowsAt, Array, Array]:
        """Those rows that may become active, with velocities (n,) and forces (m,) under all of them."""
        if self._step is None or self._inverse is not None:
            return rows, *self.under(rows)
        tolerances, u = self._step.tolerances, self._start.q - self._step.q0
        kinematics = self._system.kinematics

        def gaps(w: Array) -> Array:
            return rows.gaps(u + self._h * kinematics.displacements(w, self._start))

        on = self._step.multipliers(rows, np.ones(len(rows))).normal > 0.0
        on |= gaps(self._guess) < tolerances.likely
        while True:
            some = rows.take(np.flatnonzero(on))
            at, w, f = self.under(some)
            more = ~on & (gaps(w) < -tolerances.residual)
            if not more.any():
                return some, at, w, f
            on |= more

    def under(self, rows: ContactRows) -> tuple[RowsAt, Array, Array]:
        """Rows, and velocities (n,) and forces (m,) under them."""
        A, rhs, h = self._equation.A, self._equation.rhs, self._h
        at = self._rows.at(rows, self._start, self._joints)
        w, f = self._begin(rows, at)
        Aw = A.times(w)
        f = self._with_equations(at, Aw, f)
        if self._found.factorisations and len(np.unique(at.G.indices)) <= FEW:
            self._work.contact.discard()  # a new factor gives few columns faster than corrections
        at.S = self._delassus(at.G)
        before, most, largest = at.before, 100.0 * STILL, 0.0
        if self._inverse is None:
            before, most = f, max(ROW_MOTION_SHARE * self._settled, most)
        for k in range(ROW_PASSES):
            if k == STALE and self._inverse is None:
                self._work.contact.discard()
                at.S = self._delassus(at.G)
            # gaps without forces, whose change by f follows from the matrix
            gap = at.value + h * (at.G @ w) - h * h * (at.S @ f)
            new = at.forces(gap, before, 0.01 * most, self._until)
            change = h * h * float(np.abs(at.S @ (new - f)).max(initial=0.0))
            # in very short steps even considerable forces move rows by less
            if change == 0.0 or (change <= most and (k or self._inverse is None)):
                self._last = rows, at, w, f
                return at, w, f
            moved = self._exactly(rhs + h * (at.G.T @ new) - Aw)
            w = w + moved
            Aw = A.times(w)
            new = self._with_equations(at, Aw, new)
            largest = self._learn(at, h * (new - f), moved, largest)
            f = before = new
        raise NotConverged(
            (), self._until, "the contact and joint forces of the step do not converge"
        )
