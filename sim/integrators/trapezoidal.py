"""The trapezoidal rule solved to a tolerance."""

from dataclasses import dataclass
from typing import ClassVar

from sim.integrators.contract import require_upright
from sim.integrators.stage import Converged, Stage, middle_damping, report_of
from sim.integrators.workspace import Workspace
from sim.state import ControlAt, State, StepReport
from sim.system import System


@dataclass(frozen=True)
class Trapezoidal(Converged):
    """q1 = q0 + h/2 (v0 + v1), M (v1 - v0) = h/2 (f0 + f1), with f = f(q, a) - D v.

    One implicit stage of length h/2 from the base q0 + h/2 v0, v0 + h/2 M^-1 f0; D is taken at the
    predicted middle of the step. Attributes: as `Converged`.

    Notes
    -----
    Second order, A-stable but not L-stable: modes much faster than the step keep ringing from step to
    step, as Crank and Nicolson's rule does. `Sdirk2` damps them. Estimated error of a step
    h^2/12 (a1 - a0), the leading term h^3/12 d2v/dt2, with a1 = 2 (v1 - v0)/h - a0.
    """

    order: ClassVar[int] = 2
    stability: ClassVar[str] = "A-stable"

    def step(
        self, system: System, state: State, control: ControlAt, h: float, work: Workspace
    ) -> tuple[State, StepReport]:
        """Advance by h; errors as `ConvergedEuler.step`, and SceneError with ConstraintContact."""
        system.require_no_contact("Trapezoidal")
        system = work.form(system)
        t1, half, over = state.t + h, 0.5 * h, system.during(state, h)
        with work.timed("force"):
            here = system.during(state, 0.0).force(state.q, control(state.t))
        require_upright(here.element, here.smallest_J, state.t)
        with work.timed("tangent"):
            D = middle_damping(over, state, control, h)
        v0 = system.reduce(state.v)
        f0 = system.reduce(here.f) - D.times(v0)
        base_q = system.expand(system.reduce(state.q) + half * v0, state.q)
        base_v = system.expand(v0 + half * f0 / system.mass, state.v)
        stage = Stage(t1, base_q, base_v, half, control(t1), D)
        end = self._solve(over, stage, state, work)
        a0 = system.expand(f0 / system.mass, 0.0 * state.v)
        error = h * h / 6.0 * ((end.v - state.v) / h - a0)
        return State(t1, end.q, end.v, over.remember(end.q)), report_of(h, [end], error)
