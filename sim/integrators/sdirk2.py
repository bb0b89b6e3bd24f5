"""Two-stage singly diagonally implicit Runge-Kutta method, solved to a tolerance."""

import math
from dataclasses import dataclass
from typing import ClassVar

from sim.integrators.contract import require_upright
from sim.integrators.stage import Converged, Stage, middle_damping, report_of
from sim.integrators.workspace import Workspace
from sim.state import Array, ControlAt, State, StepReport
from sim.system import System

GAMMA = 1.0 - 1.0 / math.sqrt(2.0)
ERROR = abs(3.0 * GAMMA**2 - 2.0 * GAMMA**3 - 1.0 / 6.0)  # leads the error of dy/dt = lambda y


def _error(h: float, v0: Array, v1: Array, v2: Array) -> Array:
    """ERROR h^3 d2v/dt2, from the velocities at 0, gamma h and h.

    The inner stage is itself wrong by (gamma h)^2/2 d2v/dt2, so that the second difference of the three
    gives gamma d2v/dt2.
    """
    difference = ((v2 - v1) / (1.0 - GAMMA) - (v1 - v0) / GAMMA) / h**2
    return ERROR * h**3 / GAMMA * difference


@dataclass(frozen=True)
class Sdirk2(Converged):
    """Stages at t + gamma h and t + h, both of implicit length gamma h, gamma = 1 - 1/sqrt 2.

    The second stage starts from the base y0 + (1 - gamma) h k1, with k1 = (y1 - y0)/(gamma h) the slope
    that the first has found, and is the end of the step. Both share one factor. D is taken at the
    predicted middle of the step. Attributes: as `Converged`.

    Notes
    -----
    Second order, L-stable; the estimated error of a step costs nothing. Source: Alexander 1977,
    Diagonally implicit Runge-Kutta methods for stiff O.D.E.'s, SIAM J. Numer. Anal. 14, p. 1006.
    """

    order: ClassVar[int] = 2
    stability: ClassVar[str] = "L-stable"

    def step(
        self, system: System, state: State, control: ControlAt, h: float, work: Workspace
    ) -> tuple[State, StepReport]:
        """Advance by h; errors as `ConvergedEuler.step`, and SceneError with ConstraintContact."""
        system.require_no_contact("Sdirk2")
        system = work.form(system)
        s, t1 = GAMMA * h, state.t + h
        part, whole = system.during(state, s), system.during(state, h)
        inner = control(state.t + s)
        with work.timed("force"):
            here = part.force(state.q, inner)
        require_upright(here.element, here.smallest_J, state.t)
        with work.timed("tangent"):
            D = middle_damping(part, state, control, h)
        stage = Stage(state.t + s, state.q, state.v, s, inner, D)
        first = self._solve(part, stage, state, work, here)

        def base(y0: Array, y1: Array) -> Array:
            return y0 + (1.0 - GAMMA) / GAMMA * (y1 - y0)

        inside = State(state.t + s, first.q, first.v, state.memory)
        stage = Stage(t1, base(state.q, first.q), base(state.v, first.v), s, control(t1), D)
        end = self._solve(whole, stage, inside, work)
        return State(t1, end.q, end.v, whole.remember(end.q)), report_of(
            h, [first, end], _error(h, state.v, first.v, end.v)
        )
