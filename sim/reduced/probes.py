"""Probes of reduced models: positions of nodes, and the estimated error of the reduction."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sim.probes import AXES, Report, Values, Variable
from sim.reduced.closure import Closure, each_product, features_of
from sim.reduced.fused import OMITTED
from sim.state import Array, Control, Outputs, State, StepReport
from sim.system import System

SILENT = StepReport(h=0.0, smallest_J=float("nan"))  #: of a state that no step has reached


class _OfOutputs(ABC):
    """Probe that evaluates one state as several outputs."""

    @abstractmethod
    def record_all(self, system: System, outputs: Outputs, activation: Array) -> tuple[Array, ...]:
        """Values of every variable along the first axis, under activations (n, n_muscles)."""

    def record(self, system: System, state: State, control: Control, report: Report) -> Values:
        """Values at one time."""
        outputs = Outputs.at_state(state, report or SILENT)
        return tuple(x[0] for x in self.record_all(system, outputs, control.activation[None]))


@dataclass(frozen=True, eq=False)
class ReducedMarkers(_OfOutputs):
    """Positions of named nodes, q0 + Phi y (marker, axis) [m], as a variable ``position``."""

    rest: Array  #: (k, 3) their positions at y = 0 [m]
    modes: Array  #: (3 k, r) rows of the moving modes
    names: Sequence[str]  #: names of the nodes
    closure: Closure | None = None  #: correction of their positions

    def variables(self) -> tuple[Variable, ...]:
        """One variable."""
        coords = {"marker": self.names, "axis": AXES}
        return (Variable("position", "m", ("marker", "axis"), coords),)

    def record_all(self, system: System, outputs: Outputs, activation: Array) -> tuple[Array, ...]:
        """Sum the modes, and the correction."""
        n = len(outputs.t)
        moved = each_product(self.modes, outputs.q.reshape(n, -1)).reshape(n, -1, 3)
        if self.closure is None:
            return (self.rest + moved,)
        features = features_of(outputs, activation, self.closure.weights.shape[1])
        return (self.rest + moved + self.closure(features),)


@dataclass(frozen=True)
class Features(_OfOutputs):
    """Features of a `Closure`, as a variable ``feature``."""

    n: int  #: number of coordinates, omitted coordinates and muscles

    def variables(self) -> tuple[Variable, ...]:
        """One variable."""
        coords = {"of_closure": [str(k) for k in range(self.n)]}
        return (Variable("feature", "1", ("of_closure",), coords),)

    def record_all(self, system: System, outputs: Outputs, activation: Array) -> tuple[Array, ...]:
        """Record the features."""
        return (features_of(outputs, activation, self.n),)


@dataclass(frozen=True, eq=False)
class ReductionError(_OfOutputs):
    """Largest displacement of named nodes by the omitted modes [m], as ``reduction_estimate``."""

    modes: Array  #: (3 k, n - r) rows of the omitted modes

    def variables(self) -> tuple[Variable, ...]:
        """One variable, and the smallest det F of the step."""
        return Variable("reduction_estimate", "m"), Variable("smallest_J", "1")

    def record_all(self, system: System, outputs: Outputs, activation: Array) -> tuple[Array, ...]:
        """Norm of the displacement of the worst node."""
        n, reports = len(outputs.t), zip(outputs.q, outputs.reports, strict=True)
        J = [system.smallest_J(q)[0] if r is SILENT else r.smallest_J for q, r in reports]
        if OMITTED not in outputs.memory:
            return np.zeros(n), np.array(J)
        moved = each_product(self.modes, outputs.memory[OMITTED][:, 0]).reshape(n, -1, 3)
        return np.sqrt((moved**2).sum(axis=2)).max(axis=1, initial=0.0), np.array(J)
