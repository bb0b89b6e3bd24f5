"""The trapezoidal rule with one linear solution per step."""

from dataclasses import dataclass
from typing import ClassVar

from sim.integrators.contract import Workspace, require_upright, symmetric_product
from sim.integrators.linearly_implicit import linear_step
from sim.state import ControlAt, State, StepReport
from sim.system import System


@dataclass(frozen=True)
class LinearlyImplicitTrapezoidal:
    """The trapezoidal rule linearised at the start of the step.

    (M + h/2 D + h^2/4 K) v1 = (M - h/2 D - h^2/4 K) v0 + h f(q0), q1 = q0 + h/2 (v0 + v1).

    K, D and f are taken at q0 with the control of the step's end, as the published simulator does
    (recorded facts, item 6 of the description of its results).

    Notes
    -----
    Second order when control and damping matrix are constant, else first, since both are taken at
    one end of the step. Fast modes ring, and elements can invert.
    """

    order: ClassVar[int] = 1
    stability: ClassVar[str] = "A-stable"

    def step(
        self, system: System, state: State, control: ControlAt, h: float, work: Workspace
    ) -> tuple[State, StepReport]:
        """Advance by h; errors as `LinearlyImplicitEuler.step`."""
        system = system.during(state, h)
        at_end = control(state.t + h)
        with work.timed("tangent"):
            here, K = system.tangent(state.q, at_end)
            D = system.damping(state.q, at_end, K)
        require_upright(here.element, here.smallest_J, state.t)
        implicit = 0.5 * h * D + 0.25 * h * h * K
        v0 = system.reduce(state.v)
        rhs = system.mass * v0 + h * system.reduce(here.f)
        rhs -= symmetric_product(system, implicit, v0)
        implicit[system.pattern.diagonal] += system.mass
        return linear_step(system, state, implicit, rhs, h, 0.5, work)
