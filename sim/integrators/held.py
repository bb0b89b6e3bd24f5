"""Linearly implicit and explicit steps under the rows of joints, by their Schur complement."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sim.contact.rows import Flags
from sim.errors import NotConverged, SceneError
from sim.integrators.step_solver import Solution
from sim.integrators.workspace import Workspace
from sim.joints.compiled import REDUNDANT, Rows, RowValues
from sim.joints.contract import REACTIONS
from sim.linear.gmres import gmres
from sim.matrix import Matrix
from sim.state import Array, Control, Pose, State
from sim.step_matrices import damping_matrix
from sim.system import System

LIMIT = 40  #: refinements of a solution by an older factor

SLOW, CHANGES = 0.3, 10
"""Ratio of refinements above which they are replaced by GMRES, and most changes of its active rows."""

BESIDE = 1e-5  #: time between the poses of the finite difference of the directions of rows [s]


def held_solution(
    system: System,
    rows: Rows,
    A: Matrix,
    rhs: Array,
    start: Array,
    pose: Pose,
    h: float,
    error: float,
    work: Workspace,
) -> tuple[Solution, Array]:
    """Velocities of A w = rhs + h G'f with the forces f of rows, and f.

    Rigid rows are satisfied by the velocities, G w = -drift; with a time a = h + damping time
    compliant ones are c + a (G w + drift) + compliance f = 0, and inequalities c + h (G w + drift)
    >= 0. S = h G X G' with X = A^-1 E of the velocities on which rows depend is their Delassus
    matrix. Under constraints all solutions are those of the saddle matrix. With an older factor the
    solution is refined: the remaining residual A w - h G'f is solved for again under the rows.

    Raises NotConverged if the refinement did not converge; SingularSystem if the matrix could not be
    factorised.
    """
    now, columns = rows.evaluate(pose), rows.columns
    found = work.solve(system, A, rhs, pose, start, error)
    solve = found.roughly
    assert solve is not None  # set by `solve`
    X = work.steps.columns(columns, solve)
    time = np.where(rows.unilateral, h, h + rows.damping_time)
    S = h * now.G @ X[:, columns] @ now.G.T
    S[np.diag_indices_from(S)] += rows.compliance / time
    target = now.drift + np.where(rows.rigid, 0.0, now.c / time)
    before = np.zeros(len(target))

    def with_rows(free: Array) -> tuple[Array, Array]:
        f = rows.forces(S, now.G @ free[columns] + target, before)
        return free + h * (now.G.T @ f) @ X, f

    w, f = with_rows(found.x)
    solutions, moved = found.iterations, np.inf
    for _ in range(LIMIT):
        left = rhs - A.times(w)
        left[columns] += h * (now.G.T @ f)
        change = solve(left)
        free = w + change - h * (now.G.T @ f) @ X
        before = f
        new, f = with_rows(free)
        last, moved = moved, float(np.abs(new - w).max())
        w, solutions = new, solutions + 1
        if moved <= error:
            break
        if moved > SLOW * last:  # an older factor, or one of a part of the matrix
            krylov = _Krylov(A, rhs, rows, now, target, S, X, solve, h, error)
            w, f, more = krylov.solved(w, f, pose.t)
            solutions += more
            break
    else:
        raise NotConverged((), pose.t, "the solution under joints does not settle")

    def roughly(r: Array) -> Array:
        x = solve(r)
        on = ~rows.unilateral | (f > 0.0)
        G, held = now.G[on], S[np.ix_(on, on)]
        return (
            x - h * (G.T @ np.linalg.lstsq(held, G @ x[columns], rcond=REDUNDANT)[0]) @ X
            if on.any()
            else x
        )

    return Solution(w, solutions, found.factorisations, found.definite, roughly), f


@dataclass(frozen=True, eq=False)
class _Krylov:
    """GMRES under rows, A w = rhs + h G'f, G w + target + kappa f = 0, with kappa within S.

    The preconditioner solves both equations with the factor at hand, x - h X G' S^-1 G x, so that every
    iterate satisfies the rigid rows; yielding ones are eliminated, A + h G' kappa^-1 G. Source: Keller,
    Gould and Wathen 2000, Constraint preconditioning for indefinite linear systems, SIAM J. Matrix
    Anal. Appl. 21, 1300-1317.
    """

    A: Matrix
    rhs: Array
    rows: Rows
    now: RowValues
    target: Array
    S: Array
    X: Array
    solve: Callable[[Array], Array]
    h: float
    error: float

    def solved(self, w: Array, f: Array, t: float) -> tuple[Array, Array, int]:
        """Velocities (n,), forces (m,) and number of solutions, from initial ones.

        Raises NotConverged if the iteration or its active rows do not converge.
        """
        G, columns, count = self.now.G, self.rows.columns, 0
        on = ~self.rows.unilateral | (f > 0.0)
        for _ in range(CHANGES):
            w, f, more = self._with(on, w, t)
            count += more
            new = ~self.rows.unilateral | np.where(on, f > 0.0, G @ w[columns] + self.target < 0.0)
            if (new == on).all():
                return w, f, count
            on = new
        raise NotConverged((), t, "the active limits of joints do not converge")

    def _with(self, on: Flags, w: Array, t: float) -> tuple[Array, Array, int]:
        G, columns, h = self.now.G, self.rows.columns, self.h
        kappa = self.rows.compliance / (h + self.rows.damping_time)
        soft = on & (self.rows.compliance > 0.0)
        hard = on & ~soft
        inverse = np.linalg.pinv(self.S[np.ix_(on, on)], rcond=REDUNDANT, hermitian=True)

        def precondition(r: Array) -> Array:
            x = self.solve(r)
            return x - h * (G[on].T @ (inverse @ (G[on] @ x[columns]))) @ self.X

        def product(x: Array) -> Array:
            out = self.A.times(x)
            out[columns] += h * G[soft].T @ ((G[soft] @ x[columns]) / kappa[soft])
            return out

        rhs, missed = self.rhs.copy(), (G @ w[columns] + self.target)[hard]
        rhs[columns] -= h * G[soft].T @ (self.target[soft] / kappa[soft])
        back = np.linalg.lstsq(self.S[np.ix_(hard, hard)], missed, rcond=REDUNDANT)[0]
        w = w - h * (G[hard].T @ back) @ self.X
        found = gmres(product, precondition, rhs, w, self.error, LIMIT)
        if not found.reached:
            raise NotConverged((), t, "the solution under joints does not settle")
        w, f = found.x, np.zeros(len(on))
        f[soft] = -(G @ w[columns] + self.target)[soft] / kappa[soft]
        left = self.A.times(w) - self.rhs
        left[columns] -= h * G[soft].T @ f[soft]
        borne = G[hard] @ self.solve(left)[columns]
        f[hard] = np.linalg.lstsq(self.S[np.ix_(hard, hard)], borne, rcond=REDUNDANT)[0]
        return w, f, found.iterations + 1


def free_acceleration(system: System, state: State, control: Control) -> Array:
    """Accelerations (n,) without rows, M^-1 (R'f - D w - b) with the inertial forces b."""
    kinematics = system.kinematics
    f = kinematics.generalised_force(system.force(state.q, control).f, state.pose)
    if system.is_damped:
        D = damping_matrix(system, state.pose, state.v, control)
        f = f - D.force(kinematics.velocities(state))
    return kinematics.solve_mass(f - kinematics.inertial_force(state), state.pose)


def held_acceleration(system: System, rows: Rows, a: Array, state: State) -> tuple[Array, Array]:
    """Accelerations (n,) under rigid rows, G dw/dt + dG/dt w + ddrift/dt = 0, and the forces of rows.

    Raises SceneError if a row is compliant or an inequality.
    """
    if not rows.rigid.all():
        raise SceneError(
            "an explicit integrator holds rigid joints alone: use LinearlyImplicitEuler for limits and "
            "joints with compliance"
        )
    return _held_acceleration(system, rows, a, state)


def forces_at(system: System, state: State, control: Control) -> Array:
    """Forces (m,) of rows at a state: yielding ones by their law, rigid ones by the acceleration.

    Those of inequalities are of the step before.
    """
    rows = system.rows
    assert rows is not None  # callers ask for it by them
    now, w = rows.evaluate(state.pose), system.kinematics.velocities(state)
    f, soft = np.zeros(len(now.c)), rows.compliance > 0.0
    if REACTIONS in state.memory:
        f[rows.unilateral] = state.memory[REACTIONS][rows.unilateral]
    rate = now.G @ w[rows.columns] + now.drift
    f[soft] = -((now.c + rows.damping_time * rate)[soft] / rows.compliance[soft])
    a, push = free_acceleration(system, state, control), np.zeros(len(w))
    push[rows.columns] = now.G.T @ f
    a = a + system.kinematics.solve_mass(push, state.pose)
    if rows.rigid.any():
        f[rows.rigid] = _held_acceleration(system, rows, a, state)[1][rows.rigid]
    return f


def _held_acceleration(system: System, rows: Rows, a: Array, state: State) -> tuple[Array, Array]:
    """Accelerations (n,) and forces (m,) of the rigid rows."""
    kinematics, pose, columns = system.kinematics, state.pose, rows.columns
    w = kinematics.velocities(state)

    def rate(after: float) -> Array:
        now = rows.evaluate(kinematics.advance(pose, after * w, pose.t + after))
        return now.G @ w[columns] + now.drift

    on = rows.rigid
    G, X = rows.evaluate(pose).G, rows.inverse_mass(pose)
    turning = (rate(BESIDE) - rate(-BESIDE)) / (2.0 * BESIDE)
    f, held = np.zeros(len(G)), G[on]
    f[on] = np.linalg.solve(held @ X[columns] @ held.T, -(held @ a[columns] + turning[on]))
    return a + X @ (G.T @ f), f


def forces_of_rows(system: System, state: State, control: Control) -> Array:
    """Forces (m,) of rows: those of the step that led to a state, otherwise of the motion at it.

    Without such a step they are NaN if a row is compliant or an inequality.
    """
    rows = system.rows
    assert rows is not None  # callers check that the scene has joints
    if REACTIONS in state.memory:
        return state.memory[REACTIONS]
    if not rows.rigid.all():
        return np.full(len(rows.names), np.nan)
    return held_acceleration(system, rows, free_acceleration(system, state, control), state)[1]
