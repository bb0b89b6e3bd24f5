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


def _error(h: float, y0: Array, y1: Array, y2: Array) -> Array:
    """ERROR h^3 d2y/dt2, from rates y (velocities, accelerations) at 0, gamma h and h.

    The inner stage is itself wrong by (gamma h)^2/2 d2y/dt2, so that the second difference of the three
    gives gamma d2y/dt2.
    """
    return ERROR * h / GAMMA * ((y2 - y1) / (1.0 - GAMMA) - (y1 - y0) / GAMMA)


@dataclass(frozen=True)
class Sdirk2(Converged):
    """Stages at t + gamma h and t + h, both of implicit length gamma h, gamma = 1 - 1/sqrt 2.

    The second stage starts from the base y0 + (1 - gamma) h k1, with k1 = (y1 - y0)/(gamma h) the slope
    that the first has found, and is the end of the step. Both share one factor. D is taken at the
    predicted middle of the step. Attributes: as `Converged`.

    Notes
    -----
    Second order, L-stable. The stages take their activation from the line with its mean and first moment
    over the step, of which their weights give the mean exactly. The estimated error of a step costs one
    evaluation of the forces and one solution (`sim.integrators.estimate`). Source: Alexander 1977,
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
        line = control.moments(state.t, h, (GAMMA, 1.0))
        inner = line.at(GAMMA)
        with work.timed("force"):
            here = part.force(state.q, inner)
        require_upright(here.element, here.smallest_J, state.t)
        with work.timed("tangent"):
            D = middle_damping(part, state, line, h)
        kinematics = system.kinematics
        w0 = kinematics.velocities(state)
        u0 = kinematics.inertial(w0, state.pose)
        first = self._solve(
            part, Stage(state.t + s, state.pose, u0, s, inner, D), state, work, here
        )
        further = (1.0 - GAMMA) / GAMMA  # the slope of the first stage over its share of the step
        u1 = kinematics.inertial(first.w, first.pose)
        way = further * kinematics.between(state.pose, first.pose)
        base = kinematics.advance(state.pose, way, t1 - s)
        u = u0 + further * (u1 - u0)
        inside = kinematics.state(first.pose, first.w, state.memory)
        end = self._solve(whole, Stage(t1, base, u, s, line.at(1.0), D), inside, work)
        with work.timed("force"):
            at_start = system.during(state, 0.0).force(state.q, line.at(0.0))
        u2 = kinematics.inertial(end.w, end.pose)
        rates = (
            kinematics.generalised_force(at_start.f, state.pose) - D.force(w0),
            kinematics.momentum(u1 - u0, first.pose) / s,
            kinematics.momentum(u2 - u, end.pose) / s,
        )
        error = _error(h, w0, first.w, end.w)
        error = self._freed(whole, error, _error(h, *rates), D, s, end.pose, work)
        memory = whole.remember(end.pose.q)
        return kinematics.state(end.pose, end.w, memory), report_of(h, [first, end], error)
