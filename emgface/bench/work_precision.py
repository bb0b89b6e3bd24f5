"""Error against run time: every setting of the solver is one point."""

import statistics
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from emgface.bench.drives import SAMPLE, gesture
from emgface.bench.unit import unit_seconds
from emgface.face.motion import settle_face
from emgface.face.recipe import compose_scene
from emgface.face.simulation_parameters import SimulationParameters
from sim import (
    ConvergedEuler,
    ErrorControlledStep,
    FixedStep,
    HalvingStep,
    Iterations,
    LinearlyImplicitEuler,
    LinearlyImplicitTrapezoidal,
    Markers,
    Sdirk2,
    SimulationError,
    SmallestJ,
    State,
    System,
    Trapezoidal,
    Workspace,
    compile_scene,
    simulate,
)
from sim.integrators import Integrator
from sim.steps import StepControl

Floats = NDArray[np.float64]
Progress = Callable[[str], None]

REFERENCE_STEP = SAMPLE / 16
"""Step of the solution that errors are measured against [s]."""


@dataclass(frozen=True, eq=False)
class Setting:
    """One way to solve a scene.

    Attributes
    ----------
    family : str
        Settings of one family make one line of the figure.
    label : str
        What tells it from others of its family.
    integrator : Integrator
    steps : StepControl
    volume : str
        "pointwise", "element", "nodal" or "hard".
    linear : str
        Linear solver, or "auto".
    """

    family: str
    label: str
    integrator: Integrator
    steps: StepControl
    volume: str = "pointwise"
    linear: str = "auto"

    @property
    def name(self) -> str:
        """Family and label."""
        return f"{self.family}: {self.label}"


def standard_settings(
    nodes: NDArray[np.int64], volumes: Sequence[str] = ("pointwise",)
) -> list[Setting]:
    """Integrators x steps x tolerances x linear solvers for each volumetric part.

    Parameters
    ----------
    nodes : ndarray of int
        Nodes of the lip markers, which error control watches.
    volumes : sequence of str
    """
    found: list[Setting] = []
    single: dict[str, Integrator] = {
        "linearly implicit Euler": LinearlyImplicitEuler(),
        "linearly implicit trapezoidal": LinearlyImplicitTrapezoidal(),
    }
    converged: dict[str, Integrator] = {
        "Euler": ConvergedEuler(),
        "trapezoidal": Trapezoidal(),
        "SDIRK2": Sdirk2(),
    }
    for volume in volumes:
        tail = "" if len(volumes) == 1 else f", {volume}"
        for milli in (40, 20, 10, 5, 2.5):
            h, label = milli * 1e-3, f"{milli:g} ms"
            if milli <= 20:
                for name, integrator in single.items():
                    found.append(Setting(name + tail, label, integrator, FixedStep(h), volume))
            for name, integrator in converged.items():
                found.append(Setting(name + tail, label, integrator, HalvingStep(h), volume))
        for tolerance in (1e-4, 1e-5, 1e-7):
            loose = ConvergedEuler(tolerance=tolerance, residual_tolerance=20.0 * tolerance)
            family, label = f"Euler 10 ms, iteration tolerance{tail}", f"{tolerance * 1e3:g} mm"
            found.append(Setting(family, label, loose, HalvingStep(0.01), volume))
        for tolerance in (1e-3, 3e-4, 1e-4, 3e-5):
            iterated = Sdirk2(tolerance=min(1e-6, 0.01 * tolerance))
            steps = ErrorControlledStep(tolerance, 0.02, nodes)
            family, label = f"SDIRK2, error control{tail}", f"{tolerance * 1e3:g} mm"
            found.append(Setting(family, label, iterated, steps, volume))
        if volume != "hard":
            family = f"Euler 10 ms, SuperLU{tail}"
            found.append(
                Setting(family, "10 ms", ConvergedEuler(), HalvingStep(0.01), volume, "superlu")
            )
    return found


@dataclass(frozen=True, eq=False)
class _Case:
    """A scene with its rest state and its drives."""

    system: System
    start: State
    nodes: NDArray[np.int64]
    names: tuple[str, ...]


def parameters_for(parameters: SimulationParameters, volume: str) -> SimulationParameters:
    """Parameters with another volumetric part."""
    changes: dict[str, Any] = {"incompressibility": volume}
    if volume != "pointwise":
        changes["bulk_potential"] = "quadratic"
    return SimulationParameters.model_validate(parameters.model_dump() | changes)


def _case(face: xr.Dataset, parameters: SimulationParameters, volume: str) -> _Case:
    chosen = parameters_for(parameters, volume)
    system = compile_scene(compose_scene(face, chosen))
    rest = system.rest_state()
    if chosen.gravity:
        settled = settle_face(face, chosen)["node_position"].values
        rest = replace(rest, q=np.ascontiguousarray(settled))
    names = tuple(map(str, face["marker"].values))
    return _Case(system, rest, face["marker_node"].values.astype(np.int64), names)


def _markers(trajectory: xr.Dataset, duration: float, every: float) -> Floats:
    """Positions (time, marker, axis) at the multiples of `every` [s]."""
    wanted = every * np.arange(1, round(duration / every) + 1)
    nearest = trajectory["position"].sel(time=wanted, method="nearest", tolerance=1e-6)
    return nearest.transpose("time", "marker", "axis").values


def measure(
    face: xr.Dataset,
    parameters: SimulationParameters,
    *,
    settings: Iterable[Setting] | None = None,
    instructions: Sequence[str] = ("A", "D", "E"),
    volumes: Sequence[str] = ("pointwise",),
    duration: float = 0.8,
    repeats: int = 3,
    progress: Progress | None = None,
) -> xr.Dataset:
    """Run every setting on every instruction.

    Parameters
    ----------
    face : Dataset
        Face model.
    parameters : SimulationParameters
        Tissue and loads; the solver in it is not used.
    settings : iterable of Setting, optional
        `standard_settings` by default.
    instructions : sequence of str
        Gestures, A to F.
    volumes : sequence of str
        Volumetric parts of the standard settings.
    duration : float
        Simulated time [s].
    repeats : int
        Runs per setting, interleaved; times are medians.
    progress : callable, optional
        Told what is being run.

    Returns
    -------
    Dataset
        Dims ``setting``, ``instruction``: ``error_rms``, ``error_max`` of the lip markers [m] against
        SDIRK2 at h/16 = 0.625 ms of the same scene, at common instants; ``run_time`` [s per
        simulated second], ``steps``, ``rejected``, ``iterations``, ``factorisations``, ``smallest_J``,
        ``status`` ("ok" or the name of the failure). Coords ``family``, ``volume``; ``pareto(setting)``
        marks settings that no other beats in both time and error. attrs: ``unit_s``, the time of one
        factorisation and solution.
    """
    tell = progress or (lambda _: None)
    nodes = face["marker_node"].values.astype(np.int64)
    chosen = list(standard_settings(nodes, volumes) if settings is None else settings)
    cases: dict[str, _Case] = {}
    exact: dict[tuple[str, str], xr.Dataset] = {}
    for volume in dict.fromkeys(s.volume for s in chosen):
        tell(f"reference solutions, {volume}")
        cases[volume] = _case(face, parameters, volume)
        for instruction in instructions:
            fine = Setting(
                "reference",
                "reference",
                Sdirk2(tolerance=1e-8, residual_tolerance=1e-6),
                HalvingStep(REFERENCE_STEP),
                volume,
            )
            exact[volume, instruction] = _run(cases[volume], fine, instruction, duration)[0]
    columns: dict[str, list[list[float]]] = {
        name: []
        for name in (
            "error_rms", "error_max", "run_time", "steps", "rejected", "iterations", "factorisations",
            "smallest_J",
        )
    }  # fmt: skip
    status: list[list[str]] = []
    for setting in chosen:
        tell(setting.name)
        rows = [
            _measured(
                cases[setting.volume], setting, exact[setting.volume, i], i, duration, repeats
            )
            for i in instructions
        ]
        for name, values in columns.items():
            values.append([float(row[name]) for row in rows])
        status.append([str(row["status"]) for row in rows])
    units = {"error_rms": "m", "error_max": "m", "run_time": "s/s"}
    data = {
        name: (("setting", "instruction"), np.array(values), {"units": units.get(name, "1")})
        for name, values in columns.items()
    }
    found = xr.Dataset(
        {**data, "status": (("setting", "instruction"), np.array(status, dtype=object))},
        coords={
            "setting": [s.name for s in chosen],
            "family": ("setting", [s.family for s in chosen]),
            "label": ("setting", [s.label for s in chosen]),
            "volume": ("setting", [s.volume for s in chosen]),
            "instruction": list(instructions),
        },
        attrs={
            "origin": "simulated",
            "face": str(face.attrs.get("name", "")),
            "n_elements": face.sizes["element"],
            "unit_s": unit_seconds(next(iter(cases.values())).system),
            "reference": "SDIRK2, steps of 0.625 ms, iterated to 1e-5 mm",
            "duration_s": duration,
        },
    )
    found["pareto"] = ("setting", pareto(found))
    return found


def _run(
    case: _Case, setting: Setting, instruction: str, duration: float
) -> tuple[xr.Dataset, float]:
    work = Workspace(case.system, setting.linear)
    start = time.perf_counter()
    trajectory, _ = simulate(
        case.system,
        gesture(instruction, case.system.muscles, duration),
        duration=duration,
        integrator=setting.integrator,
        steps=setting.steps,
        probes=(Markers(case.nodes, case.names), SmallestJ(), Iterations()),
        initial=case.start,
        work=work,
    )
    return trajectory, (time.perf_counter() - start) / duration


def _measured(
    case: _Case,
    setting: Setting,
    exact: xr.Dataset,
    instruction: str,
    duration: float,
    repeats: int,
) -> dict[str, float | str]:
    times: list[float] = []
    trajectory = None
    try:
        for _ in range(repeats):
            trajectory, seconds = _run(case, setting, instruction, duration)
            times.append(seconds)
    except SimulationError as error:
        nothing = dict.fromkeys(
            ("error_rms", "error_max", "run_time", "steps", "rejected", "iterations",
             "factorisations", "smallest_J"), float("nan"))  # fmt: skip
        return nothing | {"status": type(error).__name__}
    assert trajectory is not None
    every = max(setting.steps.h, SAMPLE)
    gap = _markers(trajectory, duration, every) - _markers(exact, duration, every)
    distance = np.linalg.norm(gap, axis=-1)
    counts = {
        name: float(trajectory[name].sum())
        for name in ("steps", "rejected", "iterations", "factorisations")
    }
    return {
        "error_rms": float(np.sqrt((distance**2).mean())),
        "error_max": float(distance.max()),
        "run_time": statistics.median(times),
        "smallest_J": float(trajectory["smallest_J"].min()),
        "status": "ok",
        **counts,
    }


def pareto(found: xr.Dataset) -> NDArray[np.bool_]:
    """Settings that no other setting with the same volumetric part beats in both time and error.

    Times and errors are the worst over the instructions; a setting that failed on one is out.
    """
    ok = (found["status"] == "ok").all("instruction").values
    seconds = found["run_time"].max("instruction").values
    error = found["error_max"].max("instruction").values
    volume = found["volume"].values
    best = np.zeros(len(ok), dtype=bool)
    for i in np.flatnonzero(ok):
        rivals = ok & (volume == volume[i])
        beaten = rivals & (seconds <= seconds[i]) & (error <= error[i])
        beaten &= (seconds < seconds[i]) | (error < error[i])
        best[i] = not beaten.any()
    return best
