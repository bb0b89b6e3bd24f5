"""The trapezoidal rule with one linear solution per step."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from sim.integrators.contract import Workspace, require_upright, symmetric_product
from sim.integrators.linearly_implicit import LinearStep, linear_step
from sim.state import Array, ControlAt, Evaluation, State, StepReport
from sim.system import System


@dataclass(frozen=True)
class LinearlyImplicitTrapezoidal:
    """The trapezoidal rule linearised at the start of the step.

    (M + h/2 D + h^2/4 K) v1 = (M - h/2 D - h^2/4 K) v0 + h f(q0), q1 = q0 + h/2 (v0 + v1).

    K, D and f are taken at q0 with the control of the step's end, as the published simulator does
    (recorded facts, item 6 of the description of its results).

    Attributes
    ----------
    tolerance : float
        As of `LinearlyImplicitEuler`.

    Notes
    -----
    Second order when control and damping matrix are constant, else first, since both are taken at
    one end of the step. Fast modes ring, and elements can invert.
    """

    order: ClassVar[int] = 1
    stability: ClassVar[str] = "A-stable"
    tolerance: float = 1e-6

    def step(
        self, system: System, state: State, control: ControlAt, h: float, work: Workspace
    ) -> tuple[State, StepReport]:
        """Advance by h; errors as `LinearlyImplicitEuler.step`."""
        system = system.during(state, h)
        at_end = control(state.t + h)

        def implicit(system: System) -> tuple[Evaluation, Array]:
            with work.timed("tangent"):
                here, K = system.tangent(state.q, at_end)
                A = 0.5 * h * system.damping(state.q, at_end, K)
                np.multiply(K, 0.25 * h * h, out=K)
                np.add(A, K, out=A)
            return here, A

        def near() -> Array:
            nearby = work.near(system)
            matrix = implicit(nearby)[1]
            matrix[nearby.pattern.diagonal] += nearby.mass
            return matrix

        here, A = implicit(system)
        require_upright(here.element, here.smallest_J, state.t)
        v0 = system.reduce(state.v)
        rhs = system.mass * v0 + h * system.reduce(here.f)
        rhs -= symmetric_product(system, A, v0)
        A[system.pattern.diagonal] += system.mass
        return linear_step(system, state, LinearStep(A, rhs, 0.5, self.tolerance, near), h, work)
