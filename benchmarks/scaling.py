"""Time and memory of a step as functions of the number of elements, by phase."""

import statistics
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from benchmarks.drives import gesture
from benchmarks.refine import refine_face
from benchmarks.report import face_of, finish, say
from benchmarks.unit import STEP, step_matrix
from emgface.face.contact_parameters import NO_CONTACT
from emgface.face.recipe import compose_scene
from emgface.face.simulation_parameters import SimulationParameters
from sim import FixedStep, LinearlyImplicitEuler, System, Workspace, compile_scene, simulate
from sim.linear import linear_solver

Floats = NDArray[np.float64]

PHASES = ("force", "tangent", "analysis", "factorisation", "solution", "step")


def _median(call: Callable[[], object], repeats: int) -> float:
    times: list[float] = []
    for _ in range(repeats):
        start = time.perf_counter()
        call()
        times.append(time.perf_counter() - start)
    return statistics.median(times)


def phase_seconds(system: System, repeats: int) -> tuple[dict[str, float], float]:
    """Median seconds of every phase of a linearly implicit step of 10 ms, and size of the factor [B]."""
    control, q = system.control(np.zeros(len(system.muscles))), system.scene.mesh.X
    start = time.perf_counter()
    linear = linear_solver()
    linear.analyse(system.pattern)
    analysis = time.perf_counter() - start
    A, rhs = step_matrix(system), np.ones(system.pattern.n)
    linear.factorise(A)
    seconds = {
        "force": _median(lambda: system.force(q, control), repeats),
        "tangent": _median(lambda: system.tangent(q, control), repeats),
        "analysis": analysis,
        "factorisation": _median(lambda: linear.factorise(A), repeats),
        "solution": _median(lambda: linear.solve(rhs), repeats),
    }
    size = float(getattr(linear, "factor_bytes", float("nan")))
    steps, work = 3, Workspace(system)
    activation = gesture("D", system.muscles, 0.8)
    start = time.perf_counter()
    simulate(
        system,
        activation,
        duration=steps * STEP,
        integrator=LinearlyImplicitEuler(),
        steps=FixedStep(STEP),
        probes=(),
        work=work,
    )
    seconds["step"] = (time.perf_counter() - start) / steps
    return seconds, size


def measure(
    faces: Sequence[xr.Dataset],
    parameters: SimulationParameters,
    *,
    refine: bool = True,
    repeats: int = 3,
) -> pd.DataFrame:
    """Time every phase on faces of increasing size.

    With `refine`, the last face is also divided, each element into eight. Times are medians of
    `repeats` calls. One row per mesh: elements, unknowns, nonzeros, milliseconds per phase and size
    of the factor.
    """
    chosen = [*faces, *([refine_face(faces[-1])] if refine else [])]
    rows: list[dict[str, float]] = []
    Workspace(compile_scene(compose_scene(chosen[0], parameters)))  # loads libraries and kernels
    for face in chosen:
        say(f"{face.sizes['element']} elements")
        system = compile_scene(compose_scene(face, parameters))
        seconds, size = phase_seconds(system, repeats)
        rows.append(
            {
                "elements": face.sizes["element"],
                "unknowns": system.pattern.n,
                "nonzeros": system.pattern.nnz,
                **{f"{phase} ms": 1e3 * seconds[phase] for phase in PHASES},
                "factor MB": size / 1e6,
            }
        )
    return pd.DataFrame(rows)


def exponents(table: pd.DataFrame) -> pd.DataFrame:
    """Exponents p of values ~ elements^p in a table of `measure`, by least squares in logarithms."""
    names = [*(f"{phase} ms" for phase in PHASES), "factor MB"]
    elements = table["elements"].to_numpy(dtype=float)
    return pd.DataFrame([{n: slope(elements, table[n].to_numpy(dtype=float)) for n in names}])


def slope(elements: Floats, values: Floats) -> float:
    """Exponent p of values ~ elements^p, by least squares in logarithms; NaN with fewer than two."""
    ok = np.isfinite(values) & (values > 0.0)
    if ok.sum() < 2:
        return float("nan")
    return float(np.polyfit(np.log(elements[ok]), np.log(values[ok]), 1)[0])


def main(out: Path = Path("bench"), face: Path | None = None) -> None:
    """Measure the template face at three resolutions, or one face; print table and exponents."""
    faces = [
        face_of(face, name) for name in (("coarse", "medium", "fine") if face is None else "-")
    ]
    table = measure(faces, SimulationParameters(contact=NO_CONTACT))
    finish("scaling", table, out)
    finish("scaling-exponents", exponents(table), out)
