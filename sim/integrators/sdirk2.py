"""Two-stage singly diagonally implicit Runge-Kutta method, solved to a tolerance."""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from sim.integrators.converged_euler import InelasticLimits
from sim.integrators.stage import (
    Stage,
    by_joints,
    final_state,
    hits_limit,
    middle_damping,
    report_of,
)
from sim.integrators.workspace import Workspace
from sim.state import Array, ControlAt, Pose, State, StepReport, require_upright
from sim.system import System

GAMMA = 1.0 - 1.0 / math.sqrt(2.0)
ERROR = abs(3.0 * GAMMA**2 - 2.0 * GAMMA**3 - 1.0 / 6.0)  # leading error of dy/dt = lambda y


def _error(h: float, y0: Array, y1: Array, y2: Array) -> Array:
    """ERROR h^3 d2y/dt2, from rates y (velocities, accelerations) at 0, gamma h and h.

    The error of the inner stage is (gamma h)^2/2 d2y/dt2, so that the second difference of the three
    rates is gamma d2y/dt2.
    """
    return ERROR * h / GAMMA * ((y2 - y1) / (1.0 - GAMMA) - (y1 - y0) / GAMMA)


@dataclass(frozen=True)
class Sdirk2(InelasticLimits):
    """Stages at t + gamma h and t + h, both of implicit length gamma h, gamma = 1 - 1/sqrt 2.

    The second stage starts from the base y0 + (1 - gamma) h k1, with k1 = (y1 - y0)/(gamma h) the slope
    of the first stage; its result is that of the step. Both share one factor. D is evaluated at the
    predicted middle of the step. Attributes: as `Tolerances`.

    Notes
    -----
    Second order, L-stable. With rigid joints and tissue the order appears at short steps only: on a
    small block velocities converged with order 1.3 to 1.5 between 1e-3 and 1e-4 s, 2.0 below. The
    activation of the stages is that of the line with the same mean and first moment over the step; the
    weights of the stages integrate it exactly. The estimated error of a step requires one evaluation of
    the forces and one solution (`sim.integrators.estimate`). A step in which a limit of a joint is hit
    is one of `ConvergedEuler`: impacts are inelastic, and of first order.

    Source: Alexander 1977, Diagonally implicit Runge-Kutta methods for stiff O.D.E.'s, SIAM J. Numer.
    Anal. 14, p. 1006.
    """

    order: ClassVar[int] = 2
    stability: ClassVar[str] = "L-stable"

    def step(
        self, system: System, state: State, control: ControlAt, h: float, work: Workspace
    ) -> tuple[State, StepReport]:
        """Advance by h; errors as `ConvergedEuler.step`."""
        given, system = system, work.form(system, state)
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
        if hits_limit(system, state, first, h):
            return self.inelastic(given, state, control, h, work)
        further = (1.0 - GAMMA) / GAMMA  # slope of the first stage
        u1 = kinematics.inertial(first.w, first.pose)
        base = kinematics.advance(state.pose, further * s * first.w, t1 - s)
        u = u0 + further * (u1 - u0)
        if first.contact is not None and system.contact is not None:
            after = (further - 1.0) * s
            w, base = _stopped(system, first.w, base, first.contact.base(base, after), after)
            # the velocity of an impact changes once, and is not extrapolated
            kick = first.contact.kick(system.contact.pushing(state)) / s
            change = (w - first.w) - (further - 1.0) * kick
            u = u + kinematics.inertial(change, first.pose)
            u = u - kinematics.inertial(np.zeros_like(change), first.pose)
        inside = kinematics.state(first.pose, first.w, {**state.memory, **first.memory})
        end = self._solve(whole, Stage(t1, base, u, s, line.at(1.0), D), inside, work)
        if hits_limit(system, state, end, h):
            return self.inelastic(given, state, control, h, work)
        with work.timed("force"):
            f0 = system.during(state, 0.0).force(state.q, line.at(0.0)).f
        if first.contact is not None:
            f0 = f0 + first.contact.pushed  # as in `ConvergedEuler`
        u2 = kinematics.inertial(end.w, end.pose)
        rates = (
            kinematics.generalised_force(f0, state.pose)
            + by_joints(system, state.pose, first.reaction)
            - D.force(w0),
            kinematics.momentum(u1 - u0, first.pose) / s,
            kinematics.momentum(u2 - u, end.pose) / s,
        )
        error = _error(h, w0, first.w, end.w)
        error = self._freed(whole, error, _error(h, *rates), D, s, end, work)
        missed = self._of_input(whole, control, line, s, end, work)
        parts = ((1.0 - GAMMA, first), (GAMMA, end))
        lag = self._of_contact(whole, h, s, parts, work)
        memory = {**whole.remember(end.pose.q), **end.memory}
        w = end.w
        if end.contact is not None:
            ahead = kinematics.advance(end.pose, s * w, t1 + s)
            w, _ = _stopped(system, w, ahead, end.contact.outside(ahead, s), s)
        return final_state(system, end, w, memory, h), report_of(
            h, [first, end], error, missed, lag
        )


def _stopped(
    system: System, w: Array, ahead: Pose, moved: Pose, after: float
) -> tuple[Array, Pose]:
    """Velocities w (n,) at the end of a stage and the pose to which they lead, both without penetration.

    A vertex that has reached a face within the stage still has its velocity towards the face, which an
    inelastic impact removes.

    `ahead` and `moved` are the pose to which the velocities lead after a time [s], and the same without
    penetration.
    """
    if moved is ahead:
        return w, ahead
    return w + system.kinematics.between(ahead, moved) / after, moved
