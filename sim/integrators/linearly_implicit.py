"""What the linearly implicit integrators share: one linear solution, with or without conditions."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sim.integrators.contract import Solution, Workspace, require_upright
from sim.state import Array, State, StepReport
from sim.system import System


@dataclass(frozen=True)
class LinearStep:
    """The equation of one step.

    Attributes
    ----------
    A : (pattern.nnz,) matrix for the velocities.
    rhs : (n_free,) right-hand side [N s].
    moves : float
        Share of the new velocity in the motion.
    error : float
        Largest error of a position that an iterative solution leaves [m].
    near : callable
        A of the system that `Workspace.near` gives.
    """

    A: Array
    rhs: Array
    moves: float
    error: float
    near: Callable[[], Array]


def linear_step(
    system: System, state: State, equation: LinearStep, h: float, work: Workspace
) -> tuple[State, StepReport]:
    """State at t + h with A v1 = rhs and q1 = q0 + h ((1 - moves) v0 + moves v1).

    Conditions hold for the velocities, G(q0) v1 = 0; then the positions are brought back to c(q1) = 0
    by one projection, the smallest in the norm of the mass, along the same G.

    Raises
    ------
    InvertedElement
        det F <= 0 at the end.
    SingularSystem
        A matrix could not be factorised.
    SceneError
        The scene has a barrier.
    """
    system.require_passable("a linearly implicit step")
    v0, t1 = system.reduce(state.v), state.t + h
    A, rhs, moves = equation.A, equation.rhs, equation.moves
    conditions = system.constraints
    if conditions is None:
        found = work.solve_any(A, rhs, v0, equation.error / (moves * h), equation.near)
        v1 = found.x
        q1 = system.expand(system.reduce(state.q) + h * ((1 - moves) * v0 + moves * v1), state.q)
    else:
        _, G = conditions.evaluate(state.q)
        v1, _ = work.solve_constrained(A, G, rhs, np.zeros(conditions.n))
        q1 = system.expand(system.reduce(state.q) + h * ((1 - moves) * v0 + moves * v1), state.q)
        c, _ = conditions.evaluate(q1)
        mass = np.zeros(system.pattern.nnz)
        mass[system.pattern.diagonal] = system.mass
        back, _ = work.solve_constrained(mass, G, np.zeros(len(v1)), -c)
        q1 = system.expand(system.reduce(q1) + back, q1)
        found = Solution(v1, 2, 2)
    with work.timed("force"):
        least, element = system.smallest_J(q1)
    require_upright(element, least, t1)
    new = State(t1, q1, system.expand(v1, state.v), system.remember(q1))
    # the leading error of implicit Euler, h^2/2 dv/dt
    error = 0.5 * h * (new.v - state.v) if moves == 1.0 else None
    return new, StepReport(
        h=h,
        smallest_J=least,
        iterations=found.iterations,
        factorisations=found.factorisations,
        indefinite=int(not found.definite),
        local_error=error,
    )
