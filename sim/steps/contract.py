"""Interface of step controls, and shared functions."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

from sim.errors import (
    InvertedElement,
    NotConverged,
    SceneError,
    SingularSystem,
    UnstableDamping,
)
from sim.integrators.contract import Integrator
from sim.integrators.workspace import Workspace
from sim.state import ControlAt, Outputs, State, StepReport
from sim.system import System, damping_matrix

GROWTH, DIVIDED, PERSISTS = 1.0, 4, 6
"""Growth of velocities by negative damping within the largest step, relative to them, that ends a
motion; number of halvings of a step from which it is tested; number of successive states at which it
is found. Tissue that snaps through has it at two or three, and then goes on."""

FAILURES = (InvertedElement, NotConverged, SingularSystem)
"""Failures of a step that a smaller step may avoid."""
Watch = Callable[[State, State], None]
"""Observer of the states before and after every accepted step."""


@dataclass(frozen=True, eq=False)
class Motion:
    """A system, the control that drives it, and the method that moves it."""

    integrator: Integrator
    system: System
    control: ControlAt
    work: Workspace

    def step(self, state: State, h: float) -> tuple[State, StepReport]:
        """One step of length h [s]."""
        new, report = self.integrator.step(self.system, state, self.control, h, self.work)
        contact = self.system.contact
        if contact is not None and len(contact.pushing(new)):
            report = replace(report, touching=1)
        return new, report


class DampingWatch:
    """Refuses a motion that its damping feeds faster than steps of at most h [s] can follow.

    Only damping by a current tangent can do so. With D the damping and M the mass, it multiplies the
    kinetic energy by e^(2 r t), r = -w'Dw/(w'Mw). This is tested for steps of h/2^level, level >=
    `DIVIDED`, to which a control divides its steps where such a motion has begun.
    """

    def __init__(self, motion: Motion, h: float) -> None:
        self._motion, self._h = motion, h
        self._fed, self._last = 0, -math.inf

    def require_damped(self, state: State, level: int) -> None:
        """Test a state, once; UnstableDamping if r h exceeds `GROWTH` in `PERSISTS` successive ones."""
        system, law = self._motion.system, self._motion.system.damping_law
        if law is None or law.rest is not None or state.t <= self._last:
            return
        if level < DIVIDED:
            self._fed = 0
            return
        self._last = state.t
        D = damping_matrix(system, state.pose, state.v, self._motion.control(state.t))
        w = system.kinematics.velocities(state)
        inertial = system.kinematics.apply_mass(w, state.pose)
        fed, twice = -float(w @ D.times(w)), float(w @ inertial)
        self._fed = self._fed + 1 if fed * self._h > GROWTH * twice else 0
        if self._fed >= PERSISTS:
            raise UnstableDamping(fed / twice, state.t)


class StepControl(Protocol):
    """Interface: advances a state over one interval."""

    @property
    def h(self) -> float:
        """Interval and largest step [s]."""
        ...

    def advance(
        self, motion: Motion, state: State, until: float, watch: Watch | None = None
    ) -> tuple[State, StepReport]:
        """State at the time `until`, with one report for the interval."""
        ...


@runtime_checkable
class StepsThrough(StepControl, Protocol):
    """Step control whose step times are known in advance."""

    def through(
        self, motion: Motion, state: State, groups: Sequence[Sequence[float]]
    ) -> Iterator[Outputs]:
        """States after each group of steps that end at the given times [s]."""
        ...


def require_positive(h: float) -> None:
    """Refuse a step that is not a positive number."""
    if not 0.0 < h < math.inf:
        raise SceneError(f"step h = {h!r} s, expected a finite number > 0")
