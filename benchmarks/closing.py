"""Lips closed by strong muscles: failures, smallest det F, depths and run time of the preset "study".

    python -m benchmarks closing                      # generated face (coarse)
    python -m benchmarks closing --resolution medium --stress 100,300
    python -m benchmarks closing --face FACE.nc --level 0.25 --muscles OOP+OOM

Activations rise linearly within 0.1 s, or within `--ramp`, and are then held to 0.3 s. Without gravity.
U is one factorisation and solution of the matrix of the same face, measured in the same process.
"""

import time
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd
import xarray as xr

import sim
from benchmarks.report import face_of, finish, say
from benchmarks.unit import unit_seconds
from emgface.face.integration import integrator_of, steps_of
from emgface.face.penetration import Penetration
from emgface.face.recipe import compose_scene
from emgface.face.simulation_parameters import SimulationParameters

DURATION: Final = 0.3  #: [s]
MUSCLES: Final = ("OOP+OOM", "OOM", "OOP+DAO", "LLSAN+OOP", "OOP+OOM+MEN+DLI", "all")


def closed_by(
    face: xr.Dataset,
    muscles: str,
    stress: float,
    level: float,
    ramp: float,
    damping: str,
    volume: str,
    renewals: int | None = None,
) -> dict[str, object]:
    """One row: a face closed by the muscles of both sides whose names a text joins by +."""
    soft = {"bulk_potential": "quadratic"} if volume in ("element", "nodal") else {}
    options = {"damping_tangent": damping, "incompressibility": volume, "gravity": False} | soft
    options["contact"] = {"renewals": renewals}
    p = SimulationParameters.model_validate({"sigma_max": 1e3 * stress, **options})
    system, into = sim.compile_scene(compose_scene(face, p)), Penetration(face)
    names = () if muscles == "all" else tuple(muscles.split("+"))
    peak = np.array([level * (not names or n.startswith(names)) for n in system.muscles])
    activation = sim.Activation(np.array([0.0, ramp]), np.stack([0.0 * peak, peak]))
    row: dict[str, object] = {"muscles": muscles, "kPa": stress, "level": level, "volume": volume}
    row["damping"] = damping
    unit, start = unit_seconds(system, time.process_time), time.process_time()
    try:
        motion, end = sim.simulate(
            system,
            activation,
            duration=DURATION,
            integrator=integrator_of(p),
            steps=steps_of(face, p),
            probes=(sim.SmallestJ(), sim.Iterations()),
        )
    except sim.SimulationError as error:
        spent = time.process_time() - start
        return row | {"status": f"{type(error).__name__}: {error}", "s": spent, "U": spent / unit}
    spent = time.process_time() - start
    return row | {
        "status": "ok",
        "smallest det F": float(motion["smallest_J"].min()),
        "lips in lips um": 1e6 * into.lips(end.q),
        "iterations": float(motion["iterations"].sum()),
        "rejected": float(motion["rejected"].sum()),
        "s": spent,
        "s per simulated s": spent / DURATION,
        "U per 10 ms": spent / unit / (DURATION / 0.01),
    }


def main(
    out: Path | None = None,
    face: Path | None = None,
    resolution: str = "coarse",
    muscles: list[str] = list(MUSCLES),  # noqa: B006
    stress: str = "100,300,600",
    level: float = 1.0,
    ramp: float = 0.1,
    damping: str = "rest",
    volume: str = "pointwise",
    renewals: int | None = None,
) -> None:
    """Measure, print and store; `renewals` are those of contact (default: of the solver)."""
    used, rows = face_of(face, resolution), list[dict[str, object]]()
    for name in muscles:
        for kilo in stress.split(","):
            say(f"{name}, {kilo} kPa")
            rows.append(closed_by(used, name, float(kilo), level, ramp, damping, volume, renewals))
    finish("closing", pd.DataFrame(rows), out)
