"""Base class of linearly implicit integrators: one linear solution, with or without constraints."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from sim.errors import InvertedElement
from sim.integrators.estimate import TurnedStep, of_input, relaxed, swing_of
from sim.integrators.linear_rows import LinearRows
from sim.integrators.step_solver import LinearStep, Solution, StepEstimates
from sim.integrators.workspace import Workspace
from sim.joints.contract import REACTIONS
from sim.linear import NotReached
from sim.snapping import concave
from sim.state import Array, Evaluation, Pose, State, StepReport, require_upright
from sim.system import System


def predicted_pose(system: System, state: State, h: float, theta: float) -> Pose:
    """Pose of the mass of a step, if R varies: that after a motion without forces by the same rule.

    Without moments the step then solves its equation exactly, gyroscopic terms included. Rigid joints
    restrict the change of the velocities by these terms.
    """
    kinematics = system.kinematics
    if not kinematics.matrix_varies:
        return state.pose
    w0 = kinematics.velocities(state)
    change = kinematics.coasted(w0, state.pose, h, theta) - w0
    if system.rows is not None and change.any():
        change = system.rows.restricted(change, state.pose)
    return kinematics.advance(state.pose, h * (w0 + theta * change), state.t + h)


def momentum_at(system: System, state: State, predicted: Pose) -> Array:
    """Momentum (n,) of a state in coordinates of the predicted pose, without the prescribed part."""
    kinematics = system.kinematics
    w = kinematics.velocities(state)
    u = kinematics.inertial(w, state.pose)
    if kinematics.matrix_varies:
        u = u - kinematics.inertial(np.zeros_like(w), predicted)
    return kinematics.momentum(u, predicted)


Equation = Callable[[System], LinearStep]
"""The equation of a step, of a system over it; raises InvertedElement."""


def step_of(
    equation: Equation, system: System, state: State, h: float, error: float, work: Workspace
) -> tuple[State, StepReport]:
    """Solve the equation of a step in the form required by the linear solver.

    `error` is the largest error of a position after an iterative solution [m]. Errors as
    `linear_step`.
    """
    form = work.form(system, rows_apart=True).during(state, h)
    try:
        return linear_step(form, state, equation(form), h, error, work)
    except NotReached:
        pass  # The matrix is then fully assembled and factorised.
    system = system.during(state, h)
    return linear_step(system, state, equation(system), h, error, work)


def linear_step(
    system: System, state: State, equation: LinearStep, h: float, error: float, work: Workspace
) -> tuple[State, StepReport]:
    """State at t + h with A v1 = rhs and q1 = q0 + h ((1 - moves) v0 + moves v1).

    Constraints are satisfied by the velocities, G(q0) v1 = 0; then the positions are projected to
    c(q1) = 0 by the displacement along the same G with the smallest norm of the mass, which keeps the
    rows of joints. Rows of joints and contact add their forces (`sim.integrators.linear_rows`).

    Raises InvertedElement if det F <= 0 at the end; NotConverged if the active set of contacts did not
    converge; SingularSystem if a matrix could not be factorised.
    """

    def f_at_end() -> Array:
        return (at_end or system.force(pose.q, missed.line.at(1.0))).f

    kinematics, pose0, t1 = system.kinematics, state.pose, state.t + h
    v0 = kinematics.velocities(state)
    A, rhs, moves = equation.A, equation.rhs, equation.moves
    conditions, under = system.constraints, None
    if system.contact is not None or system.rows is not None:
        under = LinearRows(system, state, equation, h, error, work).solve()
        solution, pose, v1 = under.solution, under.pose, under.solution.x
    else:
        start, now = work.steps.extrapolated(state.t, h, v0), kinematics.at(pose0, t1)
        solution = work.solve(system, A, rhs, now, start, error / (moves * h))
        v1 = solution.x
        pose = kinematics.advance(pose0, h * ((1 - moves) * v0 + moves * v1), t1)
    with work.timed("force"):
        least, element = system.smallest_J(pose.q)
    local_error, input_error, missed, at_end = None, None, equation.missed, None
    control = missed.control
    if control is not None and missed.estimated and work.estimates and least > 0.0:
        pushed = under.pushed if under else np.zeros_like(pose.q)
        with work.timed("force"):
            at_end = system.force(pose.q, missed.line.at(1.0))
        local_error = _estimate(system, state, missed, solution, pushed, pose, at_end, work)
        assert solution.roughly is not None  # Set by every solution of a step.
        of_step = missed.line, h, solution.roughly, pose
        input_error = of_input(system, control, *of_step)
    if conditions is not None:
        pose = work.constraints.projected(pose0, pose)
        done = work.constraints.projection
        solution = replace(
            solution,
            iterations=solution.iterations + done.iterations,
            factorisations=solution.factorisations + done.factorisations,
        )
        with work.timed("force"):
            least, element = system.smallest_J(pose.q)
        at_end = None  # of the pose before
    try:
        require_upright(element, least, t1)
    except InvertedElement as inverted:
        if not solution.definite:
            inverted.add_note(
                "the matrix of this step was not positive definite: the equilibrium has "
                "lost its stability, so that the occurrence and the time of this depend on "
                "rounding"
            )
        raise
    with work.timed("force"):
        start = kinematics.at(pose0, t1)
        bent = concave(kinematics, start, lambda: missed.here.f, pose, f_at_end)
        swing = None
        if system.mesh.n_elements or not kinematics.matrix_varies:
            assert solution.roughly is not None  # Set by every solution of a step.
            at_end = at_end or system.force(pose.q, missed.line.at(1.0))
            reaction = under.reaction if under else None
            step = TurnedStep(
                state, pose, v1, moves, missed.line, missed.D.force, solution.roughly, reaction
            )
            pushed = under.pushed if under else np.zeros_like(pose.q)
            swing = swing_of(system, step, missed.here.f, at_end.f, pushed)
    remembered = {**system.remember(pose.q), **(under.memory if under else {})}
    if under and under.reaction is not None:
        remembered[REACTIONS] = under.reaction
    return kinematics.state(pose, v1, remembered), StepReport(
        h=h,
        smallest_J=least,
        iterations=solution.iterations,
        factorisations=solution.factorisations,
        indefinite=int(not solution.definite),
        local_error=local_error,
        input_error=input_error,
        concave=bent,
        swing=swing,
    )


def _estimate(
    system: System,
    state: State,
    missed: StepEstimates,
    solution: Solution,
    pushed: Array,
    end: Pose,
    at_end: Evaluation,
    work: Workspace,
) -> Array:
    """Estimated error (n_nodes, 3) of an implicit Euler step that was linearised at its start [m].

    That of implicit Euler without the contribution of jumps of the load, and the displacement h
    A^-1 h r of one more Newton iteration, with the residual forces r at the end. The contact forces
    `pushed` (n_nodes, 3) at the end also serve at the start, since those of closed rows do no work.
    `at_end` has the forces at the end.
    """
    line, D, h = missed.line, missed.D, missed.line.h
    kinematics, pose = system.kinematics, state.pose
    w0, w1, at_start = kinematics.velocities(state), solution.x, missed.here
    error = 0.5 * h * (w1 - w0)  # the leading term, h^2/2 dv/dt
    assert solution.roughly is not None  # Set by every solution of a step.
    if line.rise.any():
        with work.timed("force"):
            at_start = system.force(state.q, line.at(0.0))
    inertia = kinematics.momentum(kinematics.inertial(w1, end) - kinematics.inertial(w0, pose), end)
    f0, f1 = at_start.f + pushed, at_end.f + pushed
    gained = inertia - h * (kinematics.generalised_force(f0, pose) - D.force(w0))
    unbalanced = h * (kinematics.generalised_force(f1, end) - D.force(w1)) - inertia
    return relaxed(system, error, 0.5 * gained - unbalanced, D, h, solution.roughly, end)
