"""Interface of step controls, and shared functions."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import numpy as np

from sim.errors import InvertedElement, NotConverged, SceneError, SingularSystem
from sim.integrators.contract import Integrator
from sim.integrators.workspace import Workspace
from sim.state import Array, ControlAt, State, StepReport
from sim.system import System

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
    ) -> Iterator[tuple[State, StepReport]]:
        """States after each group of steps that end at the given times [s], with one report each."""
        ...


def require_positive(h: float) -> None:
    """Refuse a step that is not a positive number."""
    if not h > 0.0:
        raise SceneError(f"step h = {h!r} s, expected a number > 0")


def united(reports: list[StepReport], rejected: int) -> StepReport:
    """Combine several reports, and add rejected attempts."""
    if len(reports) == 1 and rejected == 0:
        return reports[0]
    return StepReport(
        h=min(r.h for r in reports),
        smallest_J=min(r.smallest_J for r in reports),
        steps=sum(r.steps for r in reports),
        rejected=rejected + sum(r.rejected for r in reports),
        iterations=sum(r.iterations for r in reports),
        factorisations=sum(r.factorisations for r in reports),
        residual=max(r.residual for r in reports),
        increment=sum(r.increment for r in reports),
        line_search=min(r.line_search for r in reports),
        shifts=sum(r.shifts for r in reports),
        indefinite=sum(r.indefinite for r in reports),
        jump=float(np.fmax.reduce([r.jump for r in reports])),
        touching=sum(r.touching for r in reports),
        local_error=_sum([r.local_error for r in reports]),
        error=sum(r.error for r in reports),
    )


def _sum(errors: list[Array | None]) -> Array | None:
    known = [e for e in errors if e is not None]
    return np.sum(known, axis=0) if known and len(known) == len(errors) else None
