"""Jaw model: other simulators and checks, error and cost of steps, extreme measures, drive by sEMG.

    python -m benchmarks jaw --part reference      # as docs/jaw_published.md; needs the published model
    python -m benchmarks jaw --part checks         # acceptance checks of every variant; needs it, too
    python -m benchmarks jaw --part steps          # the generated jaw: error and time over the step
    python -m benchmarks jaw --part stability      # the generated jaw under bad parameters
    python -m benchmarks jaw --part extremes       # and with extreme measures
    python -m benchmarks jaw --part emg            # and driven by simulated sEMG

Motions are simulated. "reference" repeats every recorded motion with the recorded step and the values
of that program. Times are processor times, kernels warm.
"""

import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

import sim
from benchmarks.jaw_motions import reference
from benchmarks.jaw_published import checks
from benchmarks.report import finish
from emgface.anatomy.jaw.emg import EXCITER_WEIGHTS, excitation_of
from emgface.anatomy.jaw.outcomes import interincisal, outcome, point_displacement
from emgface.anatomy.jaw.recorded import JAW_PICKUP, score_motion, simulated_recording
from emgface.anatomy.jaw.run import run_excitation, run_task
from emgface.anatomy.jaw.series import Excitation, excitation_in
from emgface.anatomy.jaw.tasks import JAW_TASKS, JawTask
from emgface.anatomy.jaw.template import JAW_NORMS, template_jaw
from emgface.choices import configure
from emgface.errors import EmgfaceError
from emgface.signals.parameters import SignalChain

STEPS = {
    sim.LinearlyImplicitEuler: (10.0, 5.0, 2.0, 1.0, 0.5, 0.2, 0.1),
    sim.LinearlyImplicitTrapezoidal: (10.0, 5.0, 2.0, 1.0, 0.5, 0.2, 0.1),
    sim.SymplecticEuler: (1.0, 0.5, 0.2),
    sim.RungeKutta4: (1.0, 0.5),
    sim.ConvergedEuler: (10.0, 2.0),
    sim.Trapezoidal: (10.0, 2.0),
    sim.Sdirk2: (10.0, 2.0),
}
"""Integrators, and their steps [ms]; those without fused steps are measured at few."""

LEAST = 0.01
"""Difference of processor times [s] below which the clock decides it, and no time is stated."""


def steps() -> pd.DataFrame:
    """Error in 0.2 s of opening and processor time, over integrator and step.

    The time per step is the difference of motions of 0.2 and 0.04 s, without the layout of the scene.
    """
    jaw = template_jaw(preset="woman")
    task = JawTask("", 0.2, {"bi_ad": [(0.0, 0.0), (0.1, 0.5)], "bi_ip": [(0.0, 0.0), (0.1, 0.3)]})

    def end(integrator: Any, step: float, duration: float = 0.2) -> tuple[np.ndarray, float]:
        began = time.process_time()
        motion = run_task(
            jaw, task, step=step, duration=duration, output=0.02, integrator=integrator, check=False
        )
        spent = time.process_time() - began
        return motion["position"].transpose("time", "marker", "axis").values, spent

    end(sim.LinearlyImplicitEuler(), 1e-2)
    truth = end(sim.LinearlyImplicitTrapezoidal(), 5e-5)[0]
    rows = list[dict[str, Any]]()
    for scheme, lengths in STEPS.items():
        for ms in lengths:
            row: dict[str, Any] = {"integrator": scheme.__name__, "step ms": ms}
            try:
                short = min(end(scheme(), 1e-3 * ms, 0.04)[1] for _ in range(2))
                x, spent = end(scheme(), 1e-3 * ms)
                if spent < 0.5:
                    spent = min(spent, *(end(scheme(), 1e-3 * ms)[1] for _ in range(2)))
            except (sim.SimulationError, EmgfaceError) as error:
                rows.append(row | {"result": f"{type(error).__name__}: {str(error)[:90]}"})
                continue
            miss = 1e3 * np.linalg.norm(x - truth, axis=2)
            timed = spent - short > LEAST
            rows.append(
                row
                | {
                    "largest error mm": f"{miss.max():.2g}",
                    "error at the end mm": f"{miss[-1].max():.2g}",
                    "us per step": round(1e3 * ms * (spent - short) / 0.16) if timed else "",
                    "times real time": round(0.16 / (spent - short), 1) if timed else "",
                    "result": "",
                }
            )
    return pd.DataFrame(rows)


def stability() -> pd.DataFrame:
    """Outcome of the generated jaw under stiff muscles, long steps, bad starts and impossible tasks."""
    jaw = template_jaw(preset="woman")
    stiff = jaw.copy(deep=True)
    stiff["spring_stiffness"][:] = 100.0 * stiff["spring_stiffness"]
    tense, weightless = jaw.copy(deep=True), jaw.copy(deep=True)
    tense["muscle_passive_fraction"][:] = 100.0 * tense["muscle_passive_fraction"]
    weightless["body_inertia"][:] = 0.0
    off = jaw.copy(deep=True)
    off["joint_origin"][0] = off["joint_origin"][0] + [0.0, 0.0, 1e-3]
    both = JawTask("", 0.4, {"bi_open": [(0.0, 1.0)], "bi_close": [(0.0, 1.0)]})
    cases = {
        "stiffness of springs x 100, opening": (stiff, JAW_TASKS["open"], {"duration": 0.4}),
        "passive stiffness of muscles x 100, opening": (
            tense,
            JAW_TASKS["open"],
            {"duration": 0.4},
        ),
        "start 1 mm off the joint surface": (off, JAW_TASKS["open"], {"duration": 0.4}),
        "all openers and closers at 1 from t = 0": (jaw, both, {}),
        "pull of 500 N downwards on the incisor": (
            jaw,
            JAW_TASKS["pull"],
            {"duration": 0.4, "load": (0.0, 0.0, -500.0)},
        ),
        "bodies without inertia": (weightless, JAW_TASKS["open"], {"duration": 0.4}),
        "10 s of clench": (jaw, JAW_TASKS["clench"], {"duration": 10.0}),
        **{
            f"opening, steps of {h:g} ms": (
                jaw,
                JAW_TASKS["open"],
                {"duration": 0.4, "step": 1e-3 * h},
            )
            for h in (0.1, 1.0, 10.0, 50.0)
        },
    }
    rows = list[dict[str, Any]]()
    for name, (model, task, options) in cases.items():
        row: dict[str, Any] = {"case": name}
        try:
            motion = run_task(model, task, output=0.05, **options, check=False)
            d = point_displacement(motion, "lower_incisor")
            half = len(d) // 2
            row |= {
                "result": "finished",
                "interincisal mm": round(float(interincisal(motion)[-1]), 2),
                "drift of second half mm": f"{np.linalg.norm(d[-1] - d[half]):.2g}",
                "sideways mm": f"{np.abs(d[:, 0]).max():.2g}",
            }
        except (EmgfaceError, sim.SimulationError) as error:
            row["result"] = f"{type(error).__name__}: {' '.join(str(error).split())}"
        rows.append(row)
    return pd.DataFrame(rows)


DRAFT = 5e-3
"""Time step of extremes and EMG [s]."""
NORMS = {"gape": (40.0, 55.0), "protrusion": (5.0, 10.0), "laterotrusion": (7.0, 12.0)}
"""Border movements of adults [mm]; sources in docs/jaw.md."""


def people() -> Iterator[tuple[str, dict[str, float]]]:
    """Measures 3 standard deviations from the means of women, one by one, and all together at random."""
    mean = {n.name: 1e-3 * n.women[0] for n in JAW_NORMS}
    spread = {n.name: 1e-3 * n.women[1] for n in JAW_NORMS}
    for name in mean:
        for sign in (-3.0, 3.0):
            yield f"{name} {sign:+.0f} sd", {name: mean[name] + sign * spread[name]}
    rng = np.random.default_rng(7)
    for k in range(20):
        drawn = rng.standard_normal(len(mean)).clip(-3.0, 3.0)
        yield (
            f"random {k + 1}",
            {n: mean[n] + z * spread[n] for n, z in zip(mean, drawn.tolist(), strict=True)},
        )


def extremes() -> pd.DataFrame:
    """Border movements of the generated jaw with extreme measures, and their asymmetry."""
    rows = list[dict[str, Any]]()
    for name, measures in people():
        row: dict[str, Any] = {"measures": name}
        try:
            jaw = template_jaw(preset="woman", measures=measures)
            gape = run_task(jaw, JAW_TASKS["gape"], step=DRAFT, check=False)
            forward = run_task(jaw, JAW_TASKS["protrude"], step=DRAFT, check=False)
            aside = run_task(jaw, JAW_TASKS["lateral"], step=DRAFT, check=False)
            measured = {
                "gape": float(interincisal(gape).max()),
                "protrusion": outcome(forward)["end_forward"],
                "laterotrusion": outcome(aside)["end_right"],
            }
            outside = [n for n, (low, high) in NORMS.items() if not low <= measured[n] <= high]
            sideways = max(
                float(np.abs(point_displacement(m, n)[:, 0]).max())
                for m in (gape, forward)
                for n in ("lower_incisor", "hyoid", "thyroid")
            )
            row |= {n: round(x, 1) for n, x in measured.items()}
            row |= {"asymmetry mm": sideways, "outside": ", ".join(outside)}
        except (EmgfaceError, sim.SimulationError) as error:
            row["outside"] = f"{type(error).__name__}: {error}"
        rows.append(row)
    return pd.DataFrame(rows)


def emg(persons: int = 4) -> pd.DataFrame:
    """Scores of motions driven by simulated sEMG, with the channels of muscles and of others."""
    jaw = template_jaw(preset="woman")
    truth = run_task(jaw, JAW_TASKS["cycles"], step=DRAFT, check=False)
    effort = run_task(jaw, JAW_TASKS["effort"], step=DRAFT, check=False)
    other = {"own": {}, "masseter and digastric exchanged": {"MAS": "DIG", "DIG": "MAS"}}
    rows = list[dict[str, Any]]()

    def add(feature: str, channels: str, person: object, scores: xr.Dataset) -> None:
        row = {"feature": feature, "channels": channels, "person": person}
        numbers = {"rho": scores["rho"], "amplitude ratio": scores["amplitude_ratio"]}
        rows.append(
            row
            | {name: float(x[0]) for name, x in numbers.items()}
            | {"rmse mm": 1e3 * float(scores["rmse"][0])}
        )

    for person in range(persons):
        recording = simulated_recording(truth, person=person)
        maximum = simulated_recording(effort, person=person, repetition=2)
        for kind in ("wamp", "rms", "mav", "envelope"):
            chosen = {"feature": {"kind": kind}, "normalisation": {"outside": "clip"}}
            chain = configure(SignalChain, chosen, where="benchmark")
            for name, exchanged in other.items():
                given = [_renamed(r, exchanged) for r in (recording, maximum)]
                u = excitation_of(given[0], chain, reference=given[1:])
                add(
                    kind,
                    name,
                    person,
                    score_motion(
                        recording, run_excitation(jaw, excitation_in(u), step=DRAFT, check=False)
                    ),
                )
        add(
            "none",
            "true drive under the electrodes",
            person,
            score_motion(recording, _true(jaw, truth)),
        )
    table = pd.DataFrame(rows)
    keys = ["feature", "channels"]
    return (
        table.groupby(keys, sort=False)
        .median(numeric_only=True)
        .drop(columns="person")
        .reset_index()
    )


def _renamed(recording: xr.Dataset, names: dict[str, str]) -> xr.Dataset:
    labels = [str(c) for c in recording["channel"].values]
    return recording.assign_coords(channel=[names.get(c[:-2], c[:-2]) + c[-2:] for c in labels])


def _true(jaw: xr.Dataset, truth: xr.Dataset) -> xr.Dataset:
    """Motion under the drive that ideal electrodes without noise and window would record."""
    a, values = truth["activation"], dict[str, np.ndarray]()
    for exciter, sources in EXCITER_WEIGHTS.items():
        for side in ("_L", "_R"):
            parts = [
                weight * share * a.sel(muscle=muscle + side).values
                for channel, weight in sources.items()
                for muscle, share in JAW_PICKUP[channel].items()
            ]
            values[exciter + side] = np.sum(parts, axis=0)
    given = Excitation(truth["time"].values, values, 0.0)
    return run_excitation(jaw, given, step=DRAFT, check=False)


PARTS: dict[str, Callable[[], pd.DataFrame]] = {
    part.__name__: part for part in (reference, checks, steps, stability, extremes, emg)
}


def main(part: str = "steps", out: Path | None = None) -> None:
    """Measure one part, print and store."""
    finish(f"jaw_{part}", PARTS[part](), out)
