"""Motions of a head that may fail: how they end, and the smallest det F.

A part of ``python -m benchmarks head``.
"""

from collections.abc import Iterator
from typing import Final

import numpy as np
import xarray as xr

import sim
from emgface.anatomy.head.model import Head
from emgface.anatomy.head.run import raised, simulate_head
from emgface.anatomy.head.scene import HeadScene
from sim.integrators import Integrator

Rows = Iterator[dict[str, object]]
ALL: Final = ("face", "jaw", "tongue", "hyoid")
WIDE: Final = {"bi_open": 1.0, "bi_infrahyoid": 0.3, "bi_retracthyoid": 0.35}
"""Excitations of the task "gape" of a jaw."""


def moved(motion: xr.Dataset, marker: str, k: int = -1) -> np.ndarray:
    """Displacement of a point from the start to an output [mm]."""
    x = motion["position"].sel(marker=marker).transpose("time", "axis").values
    return 1e3 * (x[k] - x[0])


def survives(
    head: Head,
    scene: HeadScene,
    drive: dict[str, float],
    step: float,
    *,
    rise: float = 0.1,
    duration: float = 0.16,
    output: float = 0.02,
    integrator: Integrator | None = None,
) -> dict[str, object]:
    try:
        motion = simulate_head(
            head,
            raised(drive, rise=rise, jaw=False),
            duration=duration,
            step=step,
            output=output,
            scene=scene,
            integrator=integrator,
        )
    except sim.SimulationError as error:
        return {"end": type(error).__name__, "why": str(error)[:90]}
    return {
        "end": "reached",
        "smallest_J": round(float(motion["smallest_J"].min()), 3)
        if "smallest_J" in motion
        else None,
        "incisor_down_mm": round(-moved(motion, "lower_incisor")[2], 1),
    }
