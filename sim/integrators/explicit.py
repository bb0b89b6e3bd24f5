"""Explicit methods, for scenes that are not stiff: no matrix, no solver, a bounded step."""

from dataclasses import dataclass
from typing import ClassVar

from sim.errors import SceneError
from sim.integrators.contract import require_upright
from sim.integrators.workspace import Workspace
from sim.linear import symmetric_product
from sim.state import Array, Control, ControlAt, State, StepReport
from sim.system import System


def _acceleration(system: System, q: Array, v: Array, control: Control, work: Workspace) -> Array:
    """M^-1 (f(q, a) - D(q) v) per free unknown."""
    if system.constraints:
        raise SceneError(
            "an explicit integrator cannot hold constraints: use an implicit one or a soft term"
        )
    system.require_passable("an explicit integrator")
    system.require_no_contact("an explicit integrator")
    with work.timed("force"):
        f = system.reduce(system.force(q, control).f)
    if system.scene.damping is not None:
        with work.timed("tangent"):
            D = system.damping(q, control)
        f -= symmetric_product(system.pattern, D, system.reduce(v))
    return f / system.mass


def _finish(system: System, q: Array, v: Array, state: State, h: float) -> tuple[State, StepReport]:
    over = system.during(state, h)
    least, element = over.smallest_J(q)
    require_upright(element, least, state.t + h)
    report = StepReport(h=h, smallest_J=least, iterations=0, factorisations=0)
    return State(state.t + h, q, v, over.remember(q)), report


@dataclass(frozen=True)
class SymplecticEuler:
    """v1 = v0 + h M^-1 (f(q0) - D v0), q1 = q0 + h v1.

    Notes
    -----
    First order; stable for h < 2/omega of the fastest mode, and h < 2/(alpha + beta omega^2) with
    Rayleigh damping. Without damping it keeps a nearby energy. Source: Hairer, Lubich and Wanner,
    Geometric Numerical Integration, I.1.
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
        SceneError
            The scene has constraints.
        """
        at_start = control.chord(state.t, h).at(0.0)
        a0 = _acceleration(system.during(state, 0.0), state.q, state.v, at_start, work)
        v1 = system.reduce(state.v) + h * a0
        q1 = system.expand(system.reduce(state.q) + h * v1, state.q)
        return _finish(system, q1, system.expand(v1, state.v), state, h)


@dataclass(frozen=True)
class RungeKutta4:
    """The classical four-stage method for (q, v).

    Notes
    -----
    Fourth order for smooth forces; stable for h < 2.8/omega of the fastest mode. Source: Hairer, Norsett
    and Wanner, Solving Ordinary Differential Equations I, Table II.1.2.
    """

    order: ClassVar[int] = 4
    stability: ClassVar[str] = "conditional"

    def step(
        self, system: System, state: State, control: ControlAt, h: float, work: Workspace
    ) -> tuple[State, StepReport]:
        """Advance by h; errors as `SymplecticEuler.step`."""
        w0, v0 = system.reduce(state.q), system.reduce(state.v)
        at_start = system.during(state, 0.0)
        line = control.moments(state.t, h, (0.0, 0.5, 1.0))
        dw, dv = v0, _acceleration(at_start, state.q, state.v, line.at(0.0), work)
        sum_w, sum_v = dw, dv
        for fraction, weight in ((0.5, 2.0), (0.5, 2.0), (1.0, 1.0)):
            s = fraction * h
            q = system.expand(w0 + s * dw, state.q)
            v = v0 + s * dv
            dw = v
            part = system.during(state, s)
            dv = _acceleration(part, q, system.expand(v, state.v), line.at(fraction), work)
            sum_w, sum_v = sum_w + weight * dw, sum_v + weight * dv
        q1 = system.expand(w0 + h / 6.0 * sum_w, state.q)
        return _finish(system, q1, system.expand(v0 + h / 6.0 * sum_v, state.v), state, h)
