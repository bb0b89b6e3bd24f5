"""Implicit Euler solved to a tolerance: Newton on the incremental potential."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from sim.errors import NotConverged
from sim.integrators.contract import Workspace, require_upright
from sim.integrators.incremental import IncrementalPotential, Point
from sim.state import Control, Evaluation, State, StepReport
from sim.system import System


@dataclass(frozen=True)
class ConvergedEuler:
    """The minimiser of the incremental potential of one implicit Euler step.

    phi(q) = 1/(2 h^2) |q - q0 - h v0|^2_M + E(q) + 1/(2 h) (q - q0)' D0 (q - q0),

    with D0 the damping matrix at the start of the step. Newton's method with a line search that keeps
    det F > 0 at every Gauss point and phi decreasing. A factor serves, with secant updates, as long as
    the iteration contracts, over many steps; a matrix that is not positive definite is shifted.

    Attributes
    ----------
    tolerance : float
        Largest estimated error of a nodal position left by the iteration [m].
    residual_tolerance : float
        Largest nodal residual force [N].
    max_iterations : int
    keep_factor : float
        The factor is renewed after an iteration that shrinks the residual by less than this.

    Notes
    -----
    First order. Source of the potential: the variational form of implicit Euler (Martin et al. 2011,
    Example-based elastic materials); the damping is lagged so that the step has a potential.
    """

    tolerance: float = 1e-6
    residual_tolerance: float = 1e-4
    max_iterations: int = 80
    keep_factor: float = 0.6
    order: ClassVar[int] = 1

    def step(
        self, system: System, state: State, control: Control, h: float, work: Workspace
    ) -> tuple[State, StepReport]:
        """Advance by h.

        Raises
        ------
        InvertedElement
            det F <= 0 at the start of the step.
        NotConverged
            The tolerances were not met, or no step length lowers the potential.
        SingularSystem
            The matrix could not be factorised.
        """
        with work.timed("force"):
            here = system.force(state.q, control)
        require_upright(here.element, here.smallest_J, state.t)
        with work.timed("tangent"):
            D = system.damping(state.q, control)
        problem = IncrementalPotential(system, state, control, h, D, work)
        point = _start(problem, here)
        factorisations = shifts = 0
        made_here = not work.has_factor_for(ConvergedEuler, h)
        if made_here:
            factorisations, shifts = _factorise(problem, point, work)
        residuals, last, shortest = [point.residual], np.inf, 1.0
        for iteration in range(1, self.max_iterations + 1):
            direction = work.secants.direction(point.g, lambda r: work.solve(h * h * r))
            found = problem.search(point, direction)
            if found is None:
                if made_here:
                    raise NotConverged(
                        tuple(residuals), state.t + h, "no step lowers the potential"
                    )
                contraction = np.inf
            else:
                length, new = found
                work.secants.learn(new.d - point.d, new.g - point.g)
                point = new
                residuals.append(point.residual)
                contraction = residuals[-1] / residuals[-2] if length == 1.0 else np.inf
                shortest = min(shortest, length)
                moved = length * float(np.abs(direction).max())
                # what a linearly converging iteration leaves after a move, from the last two moves
                theta = min(moved / last, 0.99) if last < np.inf else 0.5
                left, last = moved * theta / (1.0 - theta), moved
                if left <= self.tolerance and point.residual <= self.residual_tolerance:
                    q1 = problem.positions(point.d)
                    v1 = system.expand(point.d / h, state.v)
                    return State(state.t + h, q1, v1, state.memory), StepReport(
                        h=h,
                        smallest_J=point.here.smallest_J,
                        iterations=iteration,
                        factorisations=factorisations,
                        residual=point.residual,
                        increment=left,
                        line_search=shortest,
                        shifts=shifts,
                    )
            made_here = contraction > self.keep_factor
            if made_here:
                made, shifted = _factorise(problem, point, work)
                factorisations, shifts = factorisations + made, shifts + shifted
        raise NotConverged(
            tuple(residuals), state.t + h, f"limit of {self.max_iterations} iterations"
        )


def _factorise(problem: IncrementalPotential, point: Point, work: Workspace) -> tuple[int, int]:
    """Renew the factor; returns how many factorisations and shifts that took."""
    system = problem.system
    with work.timed("tangent"):
        A = problem.matrix(point.d)
    shifts = work.factorise(A, system.mass, system.pattern.diagonal)
    work.factor_of = (ConvergedEuler, problem.h)
    return 1 + shifts, shifts


def _start(problem: IncrementalPotential, at_rest: Evaluation) -> Point:
    """Start from the inertial guess d = h v0 where it is feasible and better, else from d = 0."""
    start = problem.point(np.zeros_like(problem.v0), at_rest)
    guess = problem.h * problem.v0
    if not guess.any():
        return start
    moved = problem.point(guess)
    better = moved.here.smallest_J > 0.0 and moved.residual < start.residual
    return moved if better else start
