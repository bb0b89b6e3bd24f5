"""Outputs of a simulation, and the labelled trajectory that they form."""

from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np
import xarray as xr

from sim.errors import SWING_LOST, LostSwingWarning, SimulationError
from sim.probes import Probe, recorded
from sim.state import Array, Control, Outputs, State, StepReport, Swing
from sim.system import System


@dataclass(eq=False)
class Log:
    """Outputs so far, times [s] between which stability was lost, and energies of turning tissue."""

    system: System
    probes: Sequence[Probe]
    times: list[Array] = field(default_factory=list[Array])
    records: list[list[Array]] = field(default_factory=list[list[Array]])
    unstable: list[float] = field(default_factory=list[float])
    swings: list[tuple[float, Swing]] = field(default_factory=list[tuple[float, Swing]])

    def add(self, state: State, control: Control, report: StepReport | None) -> None:
        """Record an output."""
        rows = (p.record(self.system, state, control, report) for p in self.probes)
        self.times.append(np.array([state.t]))
        self.records.append([np.array([x], dtype=np.float64) for row in rows for x in row])

    def add_all(self, outputs: Outputs, activation: Array) -> None:
        """Record several outputs under activations (n, n_muscles)."""
        rows = (recorded(p, self.system, outputs, activation) for p in self.probes)
        self.times.append(outputs.t)
        self.records.append([x for row in rows for x in row])

    def lost_swing(self) -> LostSwingWarning | None:
        """Warning if a share above `SWING_LOST` of the energy of turning tissue was lost."""
        whole = Swing.united([swing for _, swing in self.swings])
        if whole is None or whole.lost <= 0.0:
            return None
        share = whole.lost / (whole.lost + whole.kinetic + max(whole.damped, 0.0))
        if not share > SWING_LOST:
            return None
        time, worst = max(self.swings, key=lambda one: one[1].lost)
        return LostSwingWarning(share, time, worst.node)

    @contextmanager
    def noting_lost_stability(self) -> Generator[None]:
        """Add an earlier loss of stability to an error message."""
        try:
            yield
        except SimulationError as error:
            if self.unstable:
                error.add_note(
                    f"the equilibrium lost stability between {self.unstable[0]:.4g} and "
                    f"{self.unstable[-1]:.4g} s, so that the occurrence and the time of this "
                    "depend on rounding"
                )
            raise

    def dataset(self, attrs: Mapping[str, object]) -> xr.Dataset:
        """Labelled trajectory."""
        variables = [v for p in self.probes for v in p.variables()]
        data: dict[str, xr.DataArray] = {}
        for i, variable in enumerate(variables):
            values = np.concatenate([record[i] for record in self.records])
            coords = {name: list(labels) for name, labels in (variable.coords or {}).items()}
            data[variable.name] = xr.DataArray(
                np.moveaxis(values, 0, -1),
                dims=(*variable.dims, "time"),
                coords=coords,
                attrs={"units": variable.units},
            )
        time_axis = xr.DataArray(np.concatenate(self.times), dims="time", attrs={"units": "s"})
        return xr.Dataset(data, coords={"time": time_axis}, attrs=attrs)
