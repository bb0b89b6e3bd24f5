"""Probes of reduced models: positions of nodes, and the estimated error of the reduction."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sim.probes import AXES, Variable
from sim.reduced.closure import Closure, features_of
from sim.reduced.fused import OMITTED
from sim.state import Array, Control, State, StepReport
from sim.system import System


@dataclass(frozen=True, eq=False)
class ReducedMarkers:
    """Positions of named nodes, q0 + Phi y (marker, axis) [m], as a variable ``position``."""

    rest: Array  #: (k, 3) their positions at y = 0 [m]
    modes: Array  #: (3 k, r) rows of the moving modes
    names: Sequence[str]  #: names of the nodes
    closure: Closure | None = None  #: correction of their positions

    def variables(self) -> tuple[Variable, ...]:
        """One variable."""
        coords = {"marker": self.names, "axis": AXES}
        return (Variable("position", "m", ("marker", "axis"), coords),)

    def record(
        self, system: System, state: State, control: Control, report: StepReport | None
    ) -> tuple[Array | float, ...]:
        """Sum the modes, and the correction."""
        position = self.rest + (self.modes @ state.q.reshape(-1)).reshape(-1, 3)
        return (position if self.closure is None else position + self.closure(state, control),)


@dataclass(frozen=True)
class Features:
    """Features of a `Closure`, as a variable ``feature``."""

    n: int  #: number of coordinates, omitted coordinates and muscles

    def variables(self) -> tuple[Variable, ...]:
        """One variable."""
        coords = {"of_closure": [str(k) for k in range(self.n)]}
        return (Variable("feature", "1", ("of_closure",), coords),)

    def record(
        self, system: System, state: State, control: Control, report: StepReport | None
    ) -> tuple[Array | float, ...]:
        """Record the features."""
        return (features_of(state, control, self.n),)


@dataclass(frozen=True, eq=False)
class ReductionError:
    """Largest displacement of named nodes by the omitted modes [m], as ``reduction_estimate``."""

    modes: Array  #: (3 k, n - r) rows of the omitted modes

    def variables(self) -> tuple[Variable, ...]:
        """One variable, and the smallest det F of the step."""
        return Variable("reduction_estimate", "m"), Variable("smallest_J", "1")

    def record(
        self, system: System, state: State, control: Control, report: StepReport | None
    ) -> tuple[Array | float, ...]:
        """Norm of the displacement of the worst node."""
        J = system.smallest_J(state.q)[0] if report is None else report.smallest_J
        if OMITTED not in state.memory:
            return 0.0, J
        moved = (self.modes @ state.memory[OMITTED][0]).reshape(-1, 3)
        return float(np.sqrt((moved**2).sum(axis=1).max(initial=0.0))), J
