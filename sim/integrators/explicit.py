"""Explicit methods for scenes that are not stiff, with a bounded step."""

from dataclasses import dataclass
from typing import ClassVar

from sim.errors import SceneError
from sim.integrators.constrained_acceleration import constrained_acceleration, free_acceleration
from sim.integrators.contract import require_no_contact
from sim.integrators.workspace import Workspace
from sim.state import Array, Control, ControlAt, Pose, State, StepReport, require_upright
from sim.system import System


def _acceleration(system: System, state: State, control: Control, work: Workspace) -> Array:
    """Accelerations dw/dt under the rows of joints."""
    if system.constraints:
        raise SceneError(
            "an explicit integrator does not support constraints: use an implicit integrator or "
            "a soft term"
        )
    require_no_contact(system, "an explicit integrator")
    if system.rows is not None and not system.rows.rigid.all():
        raise SceneError(
            "an explicit integrator holds rigid joints alone: use LinearlyImplicitEuler for limits and "
            "joints with compliance"
        )
    with work.timed("force"):
        a = free_acceleration(system, state, control)
    return a if system.rows is None else constrained_acceleration(system, system.rows, a, state)[0]


def _finish(
    system: System, pose: Pose, w: Array, state: State, h: float
) -> tuple[State, StepReport]:
    if system.rows is not None:
        pose, w, _ = system.rows.projected(pose, w)
    over = system.during(state, h)
    least, element = over.smallest_J(pose.q)
    require_upright(element, least, state.t + h)
    report = StepReport(h=h, smallest_J=least, iterations=0, factorisations=0)
    return system.kinematics.state(pose, w, over.remember(pose.q)), report


@dataclass(frozen=True)
class SymplecticEuler:
    """v1 = v0 + h M^-1 (f(q0) - D v0), q1 = q0 + h v1; bodies rotate freely for h after this impulse.

    Notes
    -----
    The free rotation keeps the angular momentum, I1 w1 = I0 w, with the angular velocity w after the
    impulse and the rotation h/2 (w + w1); an explicit gyroscopic moment would add energy in every step.
    First order; stable for h < 2/omega of the fastest mode, and h < 2/(alpha + beta omega^2) with
    Rayleigh damping. Without damping it conserves an energy that differs from the exact one by a
    term of the order of h. Source: Hairer, Lubich and Wanner, Geometric Numerical Integration, I.1.
    """

    order: ClassVar[int] = 1
    stability: ClassVar[str] = "conditional"

    def step(
        self, system: System, state: State, control: ControlAt, h: float, work: Workspace
    ) -> tuple[State, StepReport]:
        """Advance by h.

        Raises
        ------
        InvertedElement
            det F <= 0 or NaN at the end of the step: the step is too long.
        NotConverged
            A body turns too far in the step.
        SceneError
            The scene has constraints.
        """
        at_start = control.chord(state.t, h).at(0.0)
        kinematics, pose = system.kinematics, state.pose
        a0 = _acceleration(system.during(state, 0.0), state, at_start, work)
        w = kinematics.velocities(state) + h * (a0 + kinematics.gyration(state))
        w1 = kinematics.coasted(w, pose, h, 0.5)
        # nodes and centres move with their final velocities, which coasting leaves alone
        pose = kinematics.advance(pose, h * (0.5 * (w + w1)), state.t + h)
        return _finish(system, pose, w1, state, h)


@dataclass(frozen=True)
class RungeKutta4:
    """The classical four-stage method for (q, v).

    Notes
    -----
    Fourth order for smooth forces; stable for h < 2.8/omega of the fastest mode. Rotations are
    integrated in the rotation vector since the start of the step. Source: Hairer, Norsett and
    Wanner, Solving Ordinary Differential Equations I, Table II.1.2; Munthe-Kaas 1999, High order
    Runge-Kutta methods on manifolds, Appl. Numer. Math. 29, 115-127.
    """

    order: ClassVar[int] = 4
    stability: ClassVar[str] = "conditional"

    def step(
        self, system: System, state: State, control: ControlAt, h: float, work: Workspace
    ) -> tuple[State, StepReport]:
        """Advance by h; errors as `SymplecticEuler.step`."""
        kinematics, pose = system.kinematics, state.pose
        at_start = system.during(state, 0.0)
        line = control.moments(state.t, h, (0.0, 0.5, 1.0))
        w0 = kinematics.velocities(state)
        # d are coordinates around the start, with dd/dt = B(d) w (Munthe-Kaas)
        rate, a = w0, _acceleration(at_start, state, line.at(0.0), work)
        sum_rate, sum_a = rate, a
        for fraction, weight in ((0.5, 2.0), (0.5, 2.0), (1.0, 1.0)):
            s = fraction * h
            d, w = s * rate, w0 + s * a
            inside = kinematics.state(kinematics.advance(pose, d, state.t + s), w, state.memory)
            rate = kinematics.rate(d, w)
            a = _acceleration(system.during(state, s), inside, line.at(fraction), work)
            sum_rate, sum_a = sum_rate + weight * rate, sum_a + weight * a
        end = kinematics.advance(pose, h / 6.0 * sum_rate, state.t + h)
        return _finish(system, end, w0 + h / 6.0 * sum_a, state, h)
