"""Rows of the battery that need a whole face."""

from collections.abc import Callable

import numpy as np
import xarray as xr

import sim
from emgface.bench.stability.trial import IMPLICIT, Trial
from emgface.face.recipe import compose_scene
from emgface.face.simulation_parameters import SimulationParameters


def _system(face: xr.Dataset, **changes: object) -> Callable[[], sim.System]:
    values = {"gravity": False} | changes
    return lambda: sim.compile_scene(
        compose_scene(face, SimulationParameters.model_validate(values))
    )


def _all(
    level: float, ramp: float, group: tuple[str, ...] = ()
) -> Callable[[sim.System], sim.Activation]:
    def activation(system: sim.System) -> sim.Activation:
        peak = np.array(
            [level if not group or name.startswith(group) else 0.0 for name in system.muscles]
        )
        return sim.Activation(np.array([0.0, ramp]), np.stack([0.0 * peak, peak]))

    return activation


def face_trials(face: xr.Dataset) -> list[Trial]:
    """Rows 4, 9 and 11 on a face."""
    found: list[Trial] = []
    step = sim.HalvingStep(0.01)
    implicit = dict(IMPLICIT)
    for kilo in (100, 300, 600, 1000):
        found.append(
            Trial(
                4,
                "all muscles 0 to 1 in one step",
                f"face, {kilo} kPa",
                _system(face, sigma_max=kilo * 1e3),
                _all(1.0, 0.01),
                0.1,
                step,
                implicit,
            )  # fmt: skip
        )
    for kilo in (100, 300):
        found.append(
            Trial(
                9,
                "lips pressed together",
                f"OOP + OOM to 1 in 0.1 s, {kilo} kPa, no contact",
                _system(face, sigma_max=kilo * 1e3),
                _all(1.0, 0.1, ("OOP", "OOM")),
                0.3,
                step,
                implicit,
            )  # fmt: skip
        )

    def stays(system: sim.System, start: sim.State, end: sim.State, energy: np.ndarray) -> str:
        moved = float(np.abs(end.q - start.q).max())
        return "" if moved < 1e-8 else f"it has moved by {moved:.1e} m"

    found.append(
        Trial(
            11,
            "10 s without activation",
            "face without gravity stays at rest",
            _system(face),
            _all(0.0, 0.1),
            10.0,
            sim.HalvingStep(0.1),
            {name: IMPLICIT[name] for name in ("linearly implicit Euler", "Euler", "SDIRK2")},
            judge=stays,
        )  # fmt: skip
    )
    return found
