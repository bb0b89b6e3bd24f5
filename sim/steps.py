"""Step control: it alone divides an interval and rejects; a rejected step leaves no trace."""

from dataclasses import dataclass
from typing import Protocol

from sim.errors import InvertedElement, NotConverged, SceneError, SingularSystem
from sim.integrators.contract import Integrator, Workspace
from sim.state import ControlAt, State, StepReport
from sim.system import System


class StepControl(Protocol):
    """Carries a state over one output interval."""

    @property
    def h(self) -> float:
        """Output interval and largest step [s]."""
        ...

    def advance(
        self,
        integrator: Integrator,
        system: System,
        state: State,
        control: ControlAt,
        until: float,
        work: Workspace,
    ) -> tuple[State, StepReport]:
        """State at the time `until`, with one report for the interval."""
        ...


def _require_positive(h: float) -> None:
    if not h > 0.0:
        raise SceneError(f"step h = {h!r} s, expected a number > 0")


@dataclass(frozen=True)
class FixedStep:
    """Steps of one size; a failure ends the simulation.

    Attributes
    ----------
    h : float
        Step and output interval [s].
    """

    h: float = 0.01

    def __post_init__(self) -> None:
        """Check the step."""
        _require_positive(self.h)

    def advance(
        self,
        integrator: Integrator,
        system: System,
        state: State,
        control: ControlAt,
        until: float,
        work: Workspace,
    ) -> tuple[State, StepReport]:
        """One step."""
        return integrator.step(system, state, control, until - state.t, work)


@dataclass(frozen=True)
class HalvingStep:
    """Steps of one size, divided in two wherever the integrator fails.

    Attributes
    ----------
    h : float
        Largest step and output interval [s].
    max_halvings : int
        Divisions before the failure is passed on.
    """

    h: float = 0.01
    max_halvings: int = 8

    def __post_init__(self) -> None:
        """Check the step."""
        _require_positive(self.h)

    def advance(
        self,
        integrator: Integrator,
        system: System,
        state: State,
        control: ControlAt,
        until: float,
        work: Workspace,
    ) -> tuple[State, StepReport]:
        """Cover the interval; after a failure halve, after two good steps of a size double."""
        start, total = state.t, until - state.t
        done, level, good = 0, 0, 0  # done is counted in units of total / 2^max_halvings
        finest = 1 << self.max_halvings
        reports: list[StepReport] = []
        rejected = 0
        while done < finest:
            size = finest >> level
            t1 = until if done + size == finest else start + total * (done + size) / finest
            try:
                state, report = integrator.step(system, state, control, t1 - state.t, work)
            except (InvertedElement, NotConverged, SingularSystem):
                if level == self.max_halvings:
                    raise
                level, good, rejected = level + 1, 0, rejected + 1
                continue
            reports.append(report)
            done, good = done + size, good + 1
            if level and good >= 2 and done % (finest >> (level - 1)) == 0:
                level, good = level - 1, 0
        return state, _united(reports, rejected)


def _united(reports: list[StepReport], rejected: int) -> StepReport:
    if len(reports) == 1 and rejected == 0:
        return reports[0]
    return StepReport(
        h=min(r.h for r in reports),
        smallest_J=min(r.smallest_J for r in reports),
        steps=len(reports),
        rejected=rejected,
        iterations=sum(r.iterations for r in reports),
        factorisations=sum(r.factorisations for r in reports),
        residual=max(r.residual for r in reports),
        increment=max(r.increment for r in reports),
        line_search=min(r.line_search for r in reports),
        shifts=sum(r.shifts for r in reports),
        indefinite=sum(r.indefinite for r in reports),
    )
