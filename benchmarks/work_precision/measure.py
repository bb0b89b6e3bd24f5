"""Run every setting on every gesture, and compute errors and run times."""

import statistics
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import pandas as pd
import xarray as xr

import sim
from benchmarks.drives import SAMPLE, gesture
from benchmarks.report import say
from benchmarks.unit import unit_seconds
from benchmarks.work_precision.errors import errors, other_person
from benchmarks.work_precision.models import MODELS, Case, Model, compiled, finest
from benchmarks.work_precision.settings import Setting, settings_of
from emgface.face.simulation_parameters import SimulationParameters

Clock = Callable[[], float]

COUNTS: Final = ("steps", "rejected", "iterations", "factorisations")
TIME: Final = "run time s/s"
ERRORS: Final = ("error rms mm", "error max mm", "change of rho")
ALIKE: Final = 1.02  #: ratio of errors that are regarded as equal
FINER: Final = 4  #: number of steps of the reference solution per smallest step compared with it


@dataclass(frozen=True, eq=False)
class Measured:
    """Errors of a measurement.

    `stepping` has one row per setting and instruction: the error of the *time stepping* relative to
    SDIRK2 of the same model in steps of a quarter of the smallest compared step (``error rms mm``
    and ``error max mm`` of the lip markers every 10 ms, ``change of rho``), ``run time s/s`` per
    simulated second, counts of the solver, ``smallest J``, ``status`` ("ok" or the name of the
    failure) and ``requested mm`` of error control. `models` has one row per model and instruction:
    the error of the *discretisation*, the distance of the model, solved with the reference steps,
    from the `finest` one. `unit` is the time of one factorisation and solution of the first model
    [s].
    """

    stepping: pd.DataFrame
    models: pd.DataFrame
    finest: str
    unit: float


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
) -> Measured:
    """Run every setting of every model on every instruction.

    `parameters` contain tissue and loads; their solver is not used. `settings` are by default those
    of `settings_of` for each model, and all are measured for the first of the `models`, with `full`
    for every model. `instructions` are gestures, A to F, of `duration` [s]. Times are medians of
    `repeats` interleaved runs; `processor` measures processor time instead of wall time: less
    affected by other processes, but too long with several threads.
    """
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
    rows: list[dict[str, object]] = []
    elements: dict[Model, int] = {}
    unit = float("nan")
    for model in present:
        say(f"reference solutions, {model.name}")
        case = compiled(face, parameters, model)
        elements[model] = case.elements
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
        runs: dict[tuple[Setting, str], list[dict[str, object]]] = {}
        for repeat in range(repeats):
            for setting in own:
                say(f"{setting.name}, {repeat + 1} of {repeats}")
                for i, drive in drives.items():
                    row = _row(case, setting, drive, duration, exact[model][i], goals[i], clock)
                    runs.setdefault((setting, i), []).append(row)
        for (setting, i), repeated in runs.items():
            rows.append(
                {
                    "model": model.name,
                    "family": setting.family,
                    "setting": setting.label,
                    "instruction": i,
                    "requested mm": 1e3 * _requested(setting),
                    **repeated[0],
                    TIME: statistics.median(float(str(row[TIME])) for row in repeated),
                }
            )
    best = finest(present)
    gaps = [
        {"model": m.name, "elements": elements[m], "instruction": i}
        | errors(exact[m][i], exact[best][i], goals[i])
        for m in present
        for i in goals
    ]
    return Measured(pd.DataFrame(rows), pd.DataFrame(gaps), best.name, unit)


def _requested(setting: Setting) -> float:
    """Tolerance of the error control [m]; NaN for other step controls."""
    steps = setting.steps
    return steps.tolerance if isinstance(steps, sim.ErrorControlledStep) else float("nan")


def _reference(model: Model, step: float) -> Setting:
    tight = sim.Sdirk2(tolerance=1e-8, residual_tolerance=1e-6)
    return Setting("reference", f"{1e3 * step:g} ms", tight, sim.HalvingStep(step), model)


def _run(
    case: Case,
    setting: Setting,
    drive: sim.Activation,
    duration: float,
    clock: Clock = time.perf_counter,
) -> tuple[xr.Dataset, float]:
    work = sim.Workspace(case.system, setting.linear)
    start = clock()
    trajectory, _ = sim.simulate(
        case.system,
        drive,
        duration=duration,
        integrator=setting.integrator,
        steps=setting.steps,
        every=SAMPLE,
        probes=(sim.Markers(case.nodes, case.names), sim.SmallestJ(), sim.Iterations()),
        initial=case.start,
        work=work,
    )
    return trajectory, (clock() - start) / duration


def _row(
    case: Case,
    setting: Setting,
    drive: sim.Activation,
    duration: float,
    exact: xr.Dataset,
    goal: xr.Dataset,
    clock: Clock,
) -> dict[str, object]:
    """Errors, time and counts of one run, or the name of its failure."""
    try:
        trajectory, seconds = _run(case, setting, drive, duration, clock)
    except sim.SimulationError as error:
        return {TIME: float("nan"), "status": type(error).__name__}
    return {
        TIME: seconds,
        **errors(trajectory, exact, goal),
        **{name: float(trajectory[name].sum()) for name in COUNTS},
        "smallest J": float(trajectory["smallest_J"].min()),
        "status": "ok",
    }


def worst(stepping: pd.DataFrame) -> pd.DataFrame:
    """Maximum over the instructions of every setting in `stepping`, and Pareto-optimal settings.

    ``Pareto`` marks settings to which no other setting of the same model is superior in both time
    and error. Errors within 2 % are regarded as equal, so that of settings that solve the same
    equations the fastest is marked. A setting that failed on an instruction is not marked.
    """
    keys = ["model", "family", "setting"]
    groups = stepping.groupby(keys, sort=False, dropna=False)
    table = groups[[TIME, *ERRORS, *COUNTS]].agg(lambda values: values.max(skipna=False))
    table["smallest J"] = groups["smallest J"].min()
    status = groups["status"].agg(lambda s: ", ".join(sorted(set(s) - {"ok"})) or "ok")
    table = table.assign(status=status).reset_index()
    ok = table["status"] == "ok"
    beaten: list[bool] = []
    for _, one in table.iterrows():
        rivals = table[ok & (table["model"] == one["model"])]
        seconds, error = rivals[TIME], rivals["error max mm"]
        faster = (seconds < one[TIME]) & (error <= ALIKE * one["error max mm"])
        better = (seconds <= one[TIME]) & (error < one["error max mm"])
        beaten.append(bool((faster | better).any()))
    return table.assign(Pareto=ok & ~np.array(beaten))
