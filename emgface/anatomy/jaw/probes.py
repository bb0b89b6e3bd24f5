"""Probes of a jaw: lengths of its muscles and the force of a morsel."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

import sim
from emgface.anatomy.jaw.model import Floats
from sim.probes import Variable
from sim.state import Control, Outputs, State, StepReport


@dataclass(frozen=True, eq=False)
class Lines:
    """Lengths [m] of straight lines between points ``ends`` (n, 2) and their rates [m/s]."""

    ends: np.ndarray
    names: tuple[str, ...]

    def variables(self) -> tuple[Variable, ...]:
        """Variables ``muscle_length`` and ``muscle_rate``."""
        coords = {"muscle": self.names}
        return (
            Variable("muscle_length", "m", ("muscle",), coords),
            Variable("muscle_rate", "m/s", ("muscle",), coords),
        )

    def record(
        self, system: sim.System, state: State, control: Control, report: StepReport | None
    ) -> tuple[Floats, Floats]:
        """Measure the lines."""
        return self._lengths(state.q, state.v)

    def record_all(
        self, system: sim.System, outputs: Outputs, activation: Floats
    ) -> tuple[Floats, Floats]:
        """Measure the lines at all outputs."""
        return self._lengths(outputs.q, outputs.v)

    def _lengths(self, q: Floats, v: Floats) -> tuple[Floats, Floats]:
        a, b = self.ends.T
        way, rate = q[..., b, :] - q[..., a, :], v[..., b, :] - v[..., a, :]
        length = np.linalg.norm(way, axis=-1)
        return length, (way * rate).sum(axis=-1) / length


@dataclass(frozen=True, eq=False)
class Resistance:
    """Force of a morsel [N]."""

    term: sim.Crushable

    def variables(self) -> tuple[Variable, ...]:
        """Variable ``morsel_force``."""
        return (Variable("morsel_force", "N"),)

    def record(
        self, system: sim.System, state: State, control: Control, report: StepReport | None
    ) -> tuple[float]:
        """Force at the end of a step, after which an intact morsel is remembered."""
        return (float(self._force(state.q, state.v, state.memory)),)

    def record_all(self, system: sim.System, outputs: Outputs, activation: Floats) -> tuple[Floats]:
        """Force at all outputs."""
        return (self._force(outputs.q, outputs.v, outputs.memory),)

    def _force(self, q: Floats, v: Floats, memory: Mapping[str, Floats]) -> Floats:
        term = self.term
        d = (q[..., term.node, :] - term.origin) @ term.normal
        rate = v[..., term.node, :] @ term.normal
        intact = [x[..., 0] > 0.0 for name, x in memory.items() if name.startswith("Crushable")]
        whole = np.any(intact, axis=0) & (d < term.diameter)
        force = term.force_max * (1.0 - d / term.diameter) - term.damping * rate
        return np.where(whole, np.maximum(force, 0.0), 0.0)
