"""Run every setting on every gesture, and compare."""

import statistics
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from emgface.bench.drives import SAMPLE, gesture
from emgface.bench.unit import unit_seconds
from emgface.bench.work_precision.errors import Errors, errors, other_person
from emgface.bench.work_precision.models import MODELS, Case, Model, compiled, finest
from emgface.bench.work_precision.settings import Setting, settings_of
from emgface.face.simulation_parameters import SimulationParameters
from sim import (
    Activation,
    ErrorControlledStep,
    HalvingStep,
    Iterations,
    Markers,
    Sdirk2,
    SimulationError,
    SmallestJ,
    Workspace,
    simulate,
)

Progress = Callable[[str], None]
Clock = Callable[[], float]

COUNTS: Final = ("steps", "rejected", "iterations", "factorisations")
MEASURED: Final = {
    "error_rms": "m",
    "error_max": "m",
    "change_rho": "1",
    "run_time": "s/s",
    **dict.fromkeys((*COUNTS, "smallest_J"), "1"),
}
"""What is kept of every run, with its unit."""
ALIKE: Final = 1.02
"""Ratio of errors that counts as none."""
FINER: Final = 4
"""Steps of a reference to the smallest step that is compared with it."""


def measure(
    face: xr.Dataset,
    parameters: SimulationParameters,
    *,
    settings: Iterable[Setting] | None = None,
    models: Sequence[Model] = MODELS,
    instructions: Sequence[str] = ("A", "D", "E"),
    duration: float = 0.4,
    repeats: int = 3,
    full: bool = False,
    processor: bool = False,
    progress: Progress | None = None,
) -> xr.Dataset:
    """Run every setting of every model on every instruction.

    Parameters
    ----------
    face : Dataset
        Face model.
    parameters : SimulationParameters
        Tissue and loads; the solver in it is not used.
    settings : iterable of Setting, optional
        Those of `settings_of` for each model by default.
    models : sequence of Model
        Meshes and treatments of the volume. The first is measured widely.
    instructions : sequence of str
        Gestures, A to F.
    duration : float
        Simulated time [s].
    repeats : int
        Runs per setting, interleaved; times are medians.
    full : bool
        Whether every model is measured as widely as the first.
    processor : bool
        Whether the time of the processor is taken in place of that of the wall clock: fairer on a
        machine that does other work, too high with several threads.
    progress : callable, optional
        Told what is being run.

    Returns
    -------
    Dataset
        Of every ``setting`` and ``instruction`` the error of its *time stepping*: ``error_rms``,
        ``error_max`` of the lip markers [m] every 10 ms and ``change_rho`` [1] against SDIRK2 of the
        same model in steps of a quarter of the smallest compared with it; ``run_time`` [s per
        simulated second], ``steps``, ``rejected``, ``iterations``, ``factorisations``,
        ``smallest_J``, ``status`` ("ok" or the name of the failure). Coords ``family``, ``label``,
        ``model_of``, ``requested`` [m] of error control; ``pareto(setting)`` marks settings that none
        of the same model beats in both time and error.

        Of every ``model`` the error of its *discretisation*: ``difference_rms``, ``difference_max``
        [m] and ``difference_rho`` of its reference from that of the finest model, attrs ``finest``;
        ``elements``, ``unknowns``.

        attrs: ``unit_s``, the time of one factorisation and solution of the first model.
    """
    tell = progress or (lambda _: None)
    clock = time.process_time if processor else time.perf_counter
    nodes = face["marker_node"].values.astype(np.int64)
    if settings is None:
        chosen = [
            s
            for i, model in enumerate(models)
            for s in settings_of(model, nodes, base=i == 0, full=full)
        ]
    else:
        chosen = list(settings)
    present = tuple(dict.fromkeys(s.model for s in chosen))
    goals: dict[str, xr.Dataset] = {}
    exact: dict[Model, dict[str, xr.Dataset]] = {}
    rows: dict[Setting, list[_Row]] = {}
    sizes: list[tuple[int, int]] = []
    unit = float("nan")
    for model in present:
        tell(f"reference solutions, {model.name}")
        case = compiled(face, parameters, model)
        sizes.append((case.elements, case.system.pattern.n))
        own = [s for s in chosen if s.model == model]
        if not goals:
            unit = unit_seconds(case.system, clock=clock)
            for i in instructions:
                drive = other_person(i, case.system.muscles, duration)
                goals[i] = _run(case, _reference(model, 0.01), drive, duration)[0]
        step = min(s.steps.h for s in own) / FINER
        drives = {i: gesture(i, case.system.muscles, duration) for i in instructions}
        exact[model] = {
            i: _run(case, _reference(model, step), drive, duration)[0]
            for i, drive in drives.items()
        }
        runs: dict[Setting, dict[str, list[_Row]]] = {s: {i: [] for i in drives} for s in own}
        for repeat in range(repeats):
            for setting in own:
                tell(f"{setting.name}, {repeat + 1} of {repeats}")
                for i, drive in drives.items():
                    runs[setting][i].append(
                        _row(case, setting, drive, duration, exact[model][i], goals[i], clock)
                    )
        rows |= {s: [_median(r) for r in of.values()] for s, of in runs.items()}
    data = {
        name: (
            ("setting", "instruction"),
            np.array([[row.values[name] for row in rows[s]] for s in chosen]),
            {"units": units},
        )
        for name, units in MEASURED.items()
    }
    status = np.array([[row.status for row in rows[s]] for s in chosen], dtype=object)
    best = finest(present)
    gaps = {m: [errors(exact[m][i], exact[best][i], goals[i]) for i in goals] for m in present}
    found = xr.Dataset(
        {
            **data,
            "status": (("setting", "instruction"), status),
            **_differences(gaps),
            "elements": ("model", [n for n, _ in sizes], {"units": "1"}),
            "unknowns": ("model", [n for _, n in sizes], {"units": "1"}),
        },
        coords={
            "setting": [s.name for s in chosen],
            "family": ("setting", [s.family for s in chosen]),
            "label": ("setting", [s.label for s in chosen]),
            "model_of": ("setting", [s.model.name for s in chosen]),
            "requested": ("setting", [_requested(s) for s in chosen], {"units": "m"}),
            "model": [m.name for m in present],
            "instruction": list(instructions),
        },
        attrs={
            "origin": "simulated",
            "face": str(face.attrs.get("name", "")),
            "unit_s": unit,
            "finest": best.name,
            "reference": f"SDIRK2 of the same model, 1/{FINER} of the smallest step, 1e-5 mm",
            "duration_s": duration,
            "repeats": repeats,
            "clock": "processor" if processor else "wall",
        },
    )
    found["pareto"] = ("setting", pareto(found))
    return found


def _requested(setting: Setting) -> float:
    """Error that the steps are chosen by [m]; NaN without such a choice."""
    steps = setting.steps
    return steps.tolerance if isinstance(steps, ErrorControlledStep) else float("nan")


def _reference(model: Model, step: float) -> Setting:
    tight = Sdirk2(tolerance=1e-8, residual_tolerance=1e-6)
    return Setting("reference", f"{1e3 * step:g} ms", tight, HalvingStep(step), model)


def _differences(gaps: dict[Model, list[Errors]]) -> dict[str, tuple[object, ...]]:
    return {
        f"difference_{short}": (
            ("model", "instruction"),
            np.array([[getattr(e, name) for e in row] for row in gaps.values()]),
            {"units": units},
        )
        for short, name, units in (
            ("rms", "rms", "m"),
            ("max", "largest", "m"),
            ("rho", "rho", "1"),
        )
    }


def _run(
    case: Case,
    setting: Setting,
    drive: Activation,
    duration: float,
    clock: Clock = time.perf_counter,
) -> tuple[xr.Dataset, float]:
    work = Workspace(case.system, setting.linear)
    start = clock()
    trajectory, _ = simulate(
        case.system,
        drive,
        duration=duration,
        integrator=setting.integrator,
        steps=setting.steps,
        every=SAMPLE,
        probes=(Markers(case.nodes, case.names), SmallestJ(), Iterations()),
        initial=case.start,
        work=work,
    )
    return trajectory, (clock() - start) / duration


@dataclass(frozen=True, eq=False)
class _Row:
    values: dict[str, float]
    status: str = "ok"


def _row(
    case: Case,
    setting: Setting,
    drive: Activation,
    duration: float,
    exact: xr.Dataset,
    goal: xr.Dataset,
    clock: Clock,
) -> _Row:
    try:
        trajectory, seconds = _run(case, setting, drive, duration, clock)
    except SimulationError as error:
        return _Row(dict.fromkeys(MEASURED, float("nan")), type(error).__name__)
    gap = errors(trajectory, exact, goal)
    counts = {name: float(trajectory[name].sum()) for name in COUNTS}
    return _Row(
        {
            "error_rms": gap.rms,
            "error_max": gap.largest,
            "change_rho": gap.rho,
            "run_time": seconds,
            "smallest_J": float(trajectory["smallest_J"].min()),
            **counts,
        }
    )


def _median(repeated: list[_Row]) -> _Row:
    """The first run with the median time of all."""
    seconds = statistics.median(row.values["run_time"] for row in repeated)
    return _Row(repeated[0].values | {"run_time": seconds}, repeated[0].status)


def pareto(found: xr.Dataset) -> NDArray[np.bool_]:
    """Settings that no other of the same model beats in both time and error.

    An error within 2 % is no other error: of settings that solve the same equations, the fastest stays.
    Times and errors are the worst over the instructions; a setting that failed on one is out.
    """
    ok = (found["status"] == "ok").all("instruction").values
    seconds = found["run_time"].max("instruction").values
    error = found["error_max"].max("instruction").values
    model = found["model_of"].values
    best = np.zeros(len(ok), dtype=bool)
    for i in np.flatnonzero(ok):
        rivals = ok & (model == model[i])
        faster = (seconds < seconds[i]) & (error <= ALIKE * error[i])
        better = (seconds <= seconds[i]) & (error < error[i])
        best[i] = not (rivals & (faster | better)).any()
    return best
