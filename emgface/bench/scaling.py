"""Growth: time and memory of a step against the number of elements, phase by phase."""

import statistics
import time
from collections.abc import Callable, Sequence

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from emgface.bench.drives import gesture
from emgface.bench.unit import STEP, step_matrix
from emgface.face.recipe import compose_scene
from emgface.face.refine import refine_face
from emgface.face.simulation_parameters import SimulationParameters
from sim import FixedStep, LinearlyImplicitEuler, System, Workspace, compile_scene, simulate
from sim.linear import linear_solver

Floats = NDArray[np.float64]
Progress = Callable[[str], None]

PHASES = ("force", "tangent", "analysis", "factorisation", "solution", "step")


def _median(call: Callable[[], object], repeats: int) -> float:
    times: list[float] = []
    for _ in range(repeats):
        start = time.perf_counter()
        call()
        times.append(time.perf_counter() - start)
    return statistics.median(times)


def phase_seconds(system: System, repeats: int) -> tuple[dict[str, float], float]:
    """Median seconds of every phase of a linearly implicit step of 10 ms, and the factor's size [B]."""
    control, q = system.control(np.zeros(len(system.muscles))), system.scene.mesh.X
    start = time.perf_counter()
    linear = linear_solver()
    linear.analyse(system.pattern)
    analysis = time.perf_counter() - start
    A, rhs = step_matrix(system), np.ones(system.pattern.n)
    linear.factorise(A)
    found = {
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
    found["step"] = (time.perf_counter() - start) / steps
    return found, size


def measure(
    faces: Sequence[xr.Dataset],
    parameters: SimulationParameters,
    *,
    refine: bool = True,
    repeats: int = 3,
    progress: Progress | None = None,
) -> xr.Dataset:
    """Time every phase on faces of growing size and fit the exponents.

    Parameters
    ----------
    faces : sequence of Dataset
        Face models, such as one template face at several resolutions.
    parameters : SimulationParameters
        Tissue and loads.
    refine : bool
        Whether the last face is also divided, each element into eight.
    repeats : int
        Calls per phase; times are medians.
    progress : callable, optional
        Told what is being run.

    Returns
    -------
    Dataset
        Dim ``mesh``: ``seconds(mesh, phase)``, ``factor_bytes``, ``unknowns``, ``nonzeros``; coord
        ``elements``. ``exponent(phase)`` is the slope of log time against log elements by least
        squares, ``factor_exponent`` that of the factor's size.
    """
    tell = progress or (lambda _: None)
    chosen = list(faces)
    if refine:
        chosen.append(refine_face(chosen[-1]))
    seconds: list[list[float]] = []
    sizes: list[float] = []
    counts: list[tuple[int, int, int]] = []
    Workspace(compile_scene(compose_scene(chosen[0], parameters)))  # what the first one loads
    for face in chosen:
        tell(f"{face.sizes['element']} elements")
        system = compile_scene(compose_scene(face, parameters))
        found, size = phase_seconds(system, repeats)
        seconds.append([found[phase] for phase in PHASES])
        sizes.append(size)
        counts.append((face.sizes["element"], system.pattern.n, system.pattern.nnz))
    elements = np.array([c[0] for c in counts], dtype=np.float64)
    data = np.array(seconds)
    return xr.Dataset(
        {
            "seconds": (("mesh", "phase"), data, {"units": "s"}),
            "factor_bytes": ("mesh", np.array(sizes), {"units": "B"}),
            "unknowns": ("mesh", [c[1] for c in counts], {"units": "1"}),
            "nonzeros": ("mesh", [c[2] for c in counts], {"units": "1"}),
            "exponent": ("phase", [slope(elements, column) for column in data.T], {"units": "1"}),
            "factor_exponent": ((), slope(elements, np.array(sizes)), {"units": "1"}),
        },
        coords={"elements": ("mesh", elements.astype(int)), "phase": list(PHASES)},
        attrs={"origin": "simulated", "face": str(chosen[0].attrs.get("name", ""))},
    )


def slope(elements: Floats, values: Floats) -> float:
    """Exponent p of values ~ elements^p, by least squares in logarithms; NaN with fewer than two."""
    ok = np.isfinite(values) & (values > 0.0)
    if ok.sum() < 2:
        return float("nan")
    return float(np.polyfit(np.log(elements[ok]), np.log(values[ok]), 1)[0])
