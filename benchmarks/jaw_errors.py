"""Estimated and true error of motions of jaws under bursts and jumps between steps, and of tasks.

A part of ``python -m benchmarks jaw``; it needs the published model.
"""

from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

import sim
from benchmarks.jaw_variants import PROBES, published
from emgface.anatomy.jaw.run import run_task
from emgface.anatomy.jaw.series import Excitation, ramps, read_probes
from emgface.anatomy.jaw.tasks import TASKS, Task
from emgface.anatomy.jaw.template import template_jaw
from emgface.errors import EmgfaceError

CORNER, FINEST = 1e-5, 4e-6  # s
STEPS = (1.0, 0.5, 0.25)  # ms
DESIRED = 1e-4  # m
LAST = 0.4  # s


def _pulse(exciter: str, start: float, length: float, level: float = 1.0) -> Excitation:
    """Constant excitation for a time."""
    rise, fall = (start, start + CORNER), (start + length, start + length + CORNER)
    times = (0.0, *rise, *fall)
    return ramps({exciter: list(zip(times, (0.0, 0.0, level, level, 0.0), strict=True))})


def cases() -> dict[str, tuple[Task, Excitation | None]]:
    """Excitations by name; those of a task where none is given."""
    then = {"bi_open": [(0.2, 1.0), (0.2 + CORNER, 0.0)]}
    then["bi_close"] = [(0.2, 0.0), (0.2 + CORNER, 1.0), (0.3, 1.0), (0.3 + CORNER, 0.0)]
    pulses = {
        "closers for 2 ms": _pulse("bi_close", 0.1003, 0.002),
        "closers at 0.3 for 1 ms": _pulse("bi_close", 0.0707, 0.001, 0.3),
        "openers for 0.7 ms": _pulse("bi_open", 0.1003, 0.0007),
        "right digastric for 2 ms": _pulse("ad_R", 0.0901, 0.002),
        "openers for 100 ms": _pulse("bi_open", 0.0502, 0.1),
        "closers for 50 ms, from rest": _pulse("bi_close", 0.1507, 0.05),
        "left masseter for 60 ms": _pulse("sm_L", 0.0804, 0.06),
        "left lateral pterygoid for 100 ms": _pulse("ip_L", 0.0503, 0.1),
        "lateral pterygoids at 0.5": _pulse("bi_ip", 0.0302, 0.2, 0.5),
        "openers, then closers": ramps(then),
    }
    found: dict[str, tuple[Task, Excitation | None]] = {
        name: (Task("", LAST), drive) for name, drive in pulses.items()
    }
    found |= {name: (TASKS[name], None) for name in ("open", "clench", "cycles")}
    found["chew"] = TASKS["chew"], read_probes(PROBES)
    return found


def errors() -> pd.DataFrame:
    """True error relative to steps of 0.004 ms, and estimated error [mm], of three jaws."""
    jaws = {
        "generated": template_jaw(preset="woman"),
        "free hyoid": published("larynx"),
        "fixed hyoid": published("fixed"),
    }
    rows = list[dict[str, Any]]()
    for name, (task, drive) in cases().items():
        for kind, jaw in jaws.items():
            rows.append({"excitation": name, "jaw": kind} | _compared(jaw, task, drive))
    return pd.DataFrame(rows)


def _compared(jaw: xr.Dataset, task: Task, drive: Excitation | None) -> dict[str, Any]:
    def run(**options: Any) -> xr.Dataset:
        return run_task(jaw, task, excitation=drive, **options)

    truth = run(step=FINEST, check=False)
    moved = np.linalg.norm(truth["position"] - truth["position"].isel(time=0), axis=1)
    row: dict[str, Any] = {"moves mm": f"{1e3 * moved.max():.3g}"}
    for ms in STEPS:
        try:
            row[f"{ms:g} ms"] = _told(run(step=1e-3 * ms), truth)
        except (EmgfaceError, sim.SimulationError) as error:
            row[f"{ms:g} ms"] = type(error).__name__
    try:
        motion = run(step=1e-3 * STEPS[1], tolerance=DESIRED)
        row["desired 0.1 mm"] = _told(motion, truth)
        row["its step ms"] = f"{1e3 * motion.attrs['step_s']:.2g}"
    except (EmgfaceError, sim.SimulationError) as error:
        row["desired 0.1 mm"] = type(error).__name__
    return row


def _told(motion: xr.Dataset, truth: xr.Dataset) -> str:
    """True and estimated error [mm]."""
    miss = np.linalg.norm(motion["position"].values - truth["position"].values, axis=1).max()
    return f"{1e3 * miss:.2g} ({1e3 * motion.attrs['numerical_error']:.2g})"
