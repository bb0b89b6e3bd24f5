"""Linearly implicit and explicit steps under the rows of joints, by their Schur complement."""

import numpy as np

from sim.errors import NotConverged, SceneError
from sim.integrators.step_solver import Solution
from sim.integrators.workspace import Workspace
from sim.joints.compiled import REDUNDANT, Rows
from sim.joints.contract import REACTIONS
from sim.matrix import Matrix
from sim.state import Array, Control, Pose, State
from sim.step_matrices import damping_matrix
from sim.system import System

LIMIT = 40
"""Refinements of a solution by an older factor."""

BESIDE = 1e-5
"""Time between the poses of the finite difference of the directions of rows [s]."""


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
    matrix. With an older factor the solution is refined: the remaining residual A w - h G'f is
    solved for again under the rows.

    Raises
    ------
    NotConverged
        The refinement did not converge.
    SingularSystem
        The matrix could not be factorised.
    """
    now, columns = rows.evaluate(pose), rows.columns
    found = work.steps.solve(A, rhs, start, error)
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
    solutions = found.iterations
    for _ in range(LIMIT):
        left = rhs - A.times(w)
        left[columns] += h * (now.G.T @ f)
        change = solve(left)
        free = w + change - h * (now.G.T @ f) @ X
        before = f
        new, f = with_rows(free)
        moved, w, solutions = float(np.abs(new - w).max()), new, solutions + 1
        if moved <= error:
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

    Raises
    ------
    SceneError
        A row is compliant or an inequality.
    """
    if not rows.rigid.all():
        raise SceneError(
            "an explicit integrator holds rigid joints alone: use LinearlyImplicitEuler for limits and "
            "joints with compliance"
        )
    kinematics, pose, columns = system.kinematics, state.pose, rows.columns
    w = kinematics.velocities(state)

    def rate(after: float) -> Array:
        now = rows.evaluate(kinematics.advance(pose, after * w, pose.t + after))
        return now.G @ w[columns] + now.drift

    G, X = rows.evaluate(pose).G, rows.inverse_mass(pose)
    turning = (rate(BESIDE) - rate(-BESIDE)) / (2.0 * BESIDE)
    f: Array = np.linalg.solve(G @ X[columns] @ G.T, -(G @ a[columns] + turning)).astype(np.float64)
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
