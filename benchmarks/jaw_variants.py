"""Published jaw model: its variants, their openings and chewing cycles, and causes of differences.

Parts of ``python -m benchmarks jaw``; they need the published model.
"""

import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

import sim
from benchmarks.report import say
from emgface.anatomy.jaw.outcomes import displacement, separation
from emgface.anatomy.jaw.published import import_jaw
from emgface.anatomy.jaw.run import OUTPUT, run_task
from emgface.anatomy.jaw.series import read_probes
from emgface.anatomy.jaw.tasks import TASKS, Task
from emgface.errors import EmgfaceError

SHARED = Path(os.environ.get("EMGFACE_SHARED", "../shared"))
PROBES = SHARED / "artisynth_models" / "jaw_larynx" / "probes" / "leftchew"


def published(variant: str, **options: Any) -> xr.Dataset:
    """The published model."""
    return import_jaw(SHARED / "artisynth_models" / "jaw_larynx", variant=variant, **options)  # pyright: ignore[reportArgumentType]


def two_sided(jaw: xr.Dataset) -> xr.Dataset:
    """The model whose condyles cannot leave their path."""
    held = jaw.copy(deep=True)
    own = [str(name).startswith("tmj") for name in jaw["joint"].values]
    held["joint_one_sided"][:] = np.where(own, 0, held["joint_one_sided"])
    return held


def models() -> dict[str, xr.Dataset]:
    """Variants of condylar path and hyoid."""
    found = {
        f"{condyle}, hyoid {hyoid}": published(variant, condyle=condyle)
        for condyle in ("planar", "curved")
        for hyoid, variant in (("fixed", "fixed"), ("free", "larynx"))
    }
    return found | {"curved two-sided, hyoid free": two_sided(found["curved, hyoid free"])}


def outcomes(jaw: xr.Dataset) -> dict[str, float | str]:
    """Openings and chewing cycle [mm]; the name of the error of a task that did not finish."""
    found = dict[str, float | str]()

    def measure(task: Task, read: Callable[[xr.Dataset], dict[str, float]], **options: Any) -> None:
        try:
            values = read(run_task(jaw, task, **options, check=False))
            found.update({name: round(float(x), 3) for name, x in values.items()})
        except sim.SimulationError as error:
            found.update(dict.fromkeys(read(_nothing(jaw)), type(error).__name__))

    for name, task in (("open", "open"), ("open, head 15 degrees back", "open_head")):
        measure(TASKS[task], lambda m, name=name: {name: separation(m).max()}, duration=2.0)
    measure(TASKS["chew"], chewed, excitation=read_probes(PROBES), duration=0.7)
    return found


def chewed(motion: xr.Dataset) -> dict[str, float]:
    """Incisor at the largest opening, largest lateral displacement, and hyoid [mm]."""
    d = displacement(motion, "lower_incisor")
    k = int(np.argmin(d[:, 2]))
    found = {"down": -d[k, 2], "back": -d[k, 1], "lateral": abs(d[k, 0])}
    found |= {"time s": float(motion["time"][k]), "largest lateral": np.abs(d[:, 0]).max()}
    hyoid = displacement(motion, "hyoid")[: k + 1]
    found |= {"hyoid up": hyoid[:, 2].max(), "hyoid forward": hyoid[:, 1].max()}
    return {f"chew, {name}": x for name, x in found.items()}


def _nothing(jaw: xr.Dataset) -> xr.Dataset:
    """A motion of two instants, whose outcomes have the names of those of a task."""
    return run_task(jaw, Task("", 5e-3, {"bi_close": [(0.0, 4e-4)]}), step=5e-3, check=False)


MEET = 0.54
"""Time shortly before the teeth meet in the published chewing cycle [s]."""
TIMED = 0.25
"""Shortest step that is run three times for its processor time [ms]."""


def cost() -> pd.DataFrame:
    """Error of the lower incisor in a second of chewing, and processor time, over integrator and step.

    The error is relative to trapezoidal steps of 0.025 ms, until and after the teeth meet. The time of
    the steps is the difference of motions of 1 and 0.2 s, which excludes the layout of the scene.
    """
    jaw, series = published("larynx"), read_probes(PROBES)

    def run(scheme: Any, ms: float, duration: float = 1.0) -> tuple[np.ndarray, float]:
        times, options = [], {"duration": duration, "step": 1e-3 * ms, "integrator": scheme()}
        motion = xr.Dataset()
        for _ in range(3 if ms >= TIMED else 1):
            began = time.process_time()
            motion = run_task(jaw, TASKS["chew"], excitation=series, **options, check=False)
            times.append(time.process_time() - began)
        return displacement(motion, "lower_incisor"), min(times)

    schemes, rows = (sim.LinearlyImplicitEuler, sim.LinearlyImplicitTrapezoidal), []
    truth = run(schemes[1], 0.025)[0]
    met = round(MEET / OUTPUT)
    for scheme in schemes:
        for ms in (10.0, 5.0, 2.5, 1.0, 0.5, 0.25, 0.1, 0.05):
            try:
                (d, whole), short = run(scheme, ms), run(scheme, ms, 0.2)[1]
            except (EmgfaceError, sim.SimulationError) as error:
                say(f"{scheme.__name__}: {error}")
                continue
            miss, spent = np.linalg.norm(d - truth, axis=1), (whole - short) / 0.8
            rows.append(
                {
                    "integrator": scheme.__name__,
                    "step ms": ms,
                    "largest error mm, open": f"{miss[:met].max():.2g}",
                    "teeth meet": f"{miss[met:].max():.2g}",
                    "rms error mm": f"{np.sqrt((miss**2).mean()):.2g}",
                    "ms per simulated s": round(1e3 * spent, 1),
                    "with the scene": round(1e3 * whole, 1),
                    "times real time": round(1.0 / spent, 1),
                }
            )
    return pd.DataFrame(rows)


def causes() -> pd.DataFrame:
    """Chewing and opening with the head back under changes of one setting each [mm, s]."""
    jaw = published("larynx")
    series = read_probes(PROBES)
    rows = list[dict[str, Any]]()

    def chew(name: str, **options: Any) -> None:
        model = options.pop("jaw", jaw)
        found = chewed(
            run_task(model, TASKS["chew"], excitation=series, duration=0.5, **options, check=False)
        )
        found = {key.removeprefix("chew, "): round(float(x), 3) for key, x in found.items()}
        rows.append({"case": f"chew, {name}", **found})

    chew("Peck, damping 1 N s/m")
    chew("Peck, damping 1 N s/m, steps of 0.25 ms", step=2.5e-4)
    for law in ("hill", "pennate", "spring"):
        chew(law, law=law)
    inert = jaw.copy(deep=True)
    inert["body_mass"][:] = 3.0 * inert["body_mass"]
    inert["body_inertia"][:] = 3.0 * inert["body_inertia"]
    chew("three times the mass", jaw=inert)

    def back(name: str, model: xr.Dataset, task: Task = TASKS["open_head"]) -> None:
        gape = separation(run_task(model, task, duration=2.0, check=False))
        rows.append(
            {
                "case": f"head back, {name}",
                "largest": round(gape.max(), 1),
                "end": round(gape[-1], 1),
            }
        )

    back("as published", jaw)
    weak = jaw.copy(deep=True)
    weak["muscle_passive_fraction"][:] = 0.1 * weak["muscle_passive_fraction"]
    back("passive forces a tenth", weak)
    tight = jaw.copy(deep=True)
    tight["muscle_passive_fraction"][:] = 3.0 * tight["muscle_passive_fraction"]
    back("passive forces three times", tight)
    for degrees in (5.0, 7.5, 10.0):
        part = Task("", 2.0, TASKS["open_head"].excitation, head=degrees)
        back(f"{degrees:g} degrees", jaw, part)
    for level in (0.2, 0.5):
        corners = {
            n: [(t, level * u) for t, u in c] for n, c in TASKS["open_head"].excitation.items()
        }
        back(f"openers at {level:g}", jaw, Task("", 2.0, corners, head=15.0))
    return pd.DataFrame(rows)
