"""Steps chosen by the estimated error of the positions that matter."""

from dataclasses import dataclass, replace

import numpy as np

from sim.errors import NotConverged, SceneError
from sim.integrators.contract import Integrator, TimeIntegrator
from sim.integrators.workspace import Workspace
from sim.scene import Index
from sim.state import Array, ControlAt, State, StepReport
from sim.steps.contract import FAILURES, Watch, require_positive, united
from sim.system import System


@dataclass(frozen=True, eq=False)
class ErrorControlledStep:
    """Steps h/2^k within every interval h, k by the estimated error at watched nodes.

    A step is accepted if its estimated error is at most tolerance * step/horizon, and the tolerance
    where it is longer than the horizon: the errors made within one horizon, the time over which the
    tissue forgets, then sum to the tolerance. The estimate is that of the integrator, which costs
    nothing; without one the step is repeated in two halves. Steps never cross the end of an interval,
    where the activation may bend.

    Attributes
    ----------
    tolerance : float
        Error wanted at the watched nodes [m].
    h : float
        Largest step [s].
    nodes : (k,) watched nodes, such as the lip markers; all if None.
    horizon : float
        Time over which errors add up [s].
    max_halvings : int
        Smallest step is h/2^max_halvings; a step that fails there passes its failure on.

    Raises
    ------
    SceneError
        A number is not positive.

    Notes
    -----
    Error per unit step and the doubling estimate: Hairer, Norsett and Wanner, Solving Ordinary
    Differential Equations I, II.4.
    """

    tolerance: float = 1e-4
    h: float = 0.01
    nodes: Index | None = None
    horizon: float = 0.03
    max_halvings: int = 10

    def __post_init__(self) -> None:
        """Check the ranges."""
        require_positive(self.h)
        for name in ("tolerance", "horizon"):
            if not getattr(self, name) > 0.0:
                raise SceneError(f"{name} = {getattr(self, name)!r}, expected a number > 0")

    def advance(
        self,
        integrator: Integrator,
        system: System,
        state: State,
        control: ControlAt,
        until: float,
        work: Workspace,
        watch: Watch | None = None,
    ) -> tuple[State, StepReport]:
        """Cover the interval; the division begins where that of the interval before ended.

        Raises
        ------
        InvertedElement, NotConverged, SingularSystem
            The smallest step failed.
        NotConverged
            The smallest step misses the tolerance.
        SceneError
            The integrator is not one of motion.
        """
        if not isinstance(integrator, TimeIntegrator):
            raise SceneError(
                f"{type(integrator).__name__} has no order in time, expected an integrator of motion"
            )
        start, total = state.t, until - state.t
        finest = 1 << self.max_halvings
        done, level = 0, min(work.level, self.max_halvings)
        reports: list[StepReport] = []
        rejected = 0
        gain = 2.0**integrator.order  # of the accuracy, by halving a step
        while done < finest:
            size = finest >> level
            last = done + size == finest
            h = (until if last else start + total * (done + size) / finest) - state.t
            allowed = self.tolerance * min(h / self.horizon, 1.0)
            try:
                new, report, error = self._attempt(integrator, system, state, control, h, work)
            except FAILURES:
                if level == self.max_halvings:
                    raise
                error, new, report = np.inf, state, None
            if report is None or not error <= allowed:
                if level == self.max_halvings:
                    raise NotConverged(
                        (error,), state.t + h, f"the smallest step {h:.2g} s misses the tolerance"
                    )
                level, rejected = level + 1, rejected + 1
                continue
            new = replace(new, t=until) if last else new
            if watch is not None:
                watch(state, new)
            state = new
            reports.append(replace(report, error=error))
            done += size
            aligned = level > 0 and done % (finest >> (level - 1)) == 0
            if aligned and error * 1.5 * gain <= allowed:
                level -= 1
        work.level = level
        return state, united(reports, rejected)

    def _attempt(
        self,
        integrator: TimeIntegrator,
        system: System,
        state: State,
        control: ControlAt,
        h: float,
        work: Workspace,
    ) -> tuple[State, StepReport, float]:
        new, report = integrator.step(system, state, control, h, work)
        if report.local_error is not None:
            return new, report, self._largest(report.local_error)
        middle, first = integrator.step(system, state, control, 0.5 * h, work)
        better, second = integrator.step(system, middle, control, state.t + h - middle.t, work)
        error = (better.q - new.q) / (2.0**integrator.order - 1.0)
        return better, united([first, second], 0), self._largest(error)

    def _largest(self, error: Array) -> float:
        watched = error if self.nodes is None else error[self.nodes]
        return float(np.linalg.norm(watched, axis=1).max())
