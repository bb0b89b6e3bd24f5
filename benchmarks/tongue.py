"""Tongue: another simulator's motions, stored postures, stability, error and cost of steps.

    python -m benchmarks tongue --part reference   # table of docs/tongue.md; needs the published model
    python -m benchmarks tongue --part postures    # equilibria and stored shapes; needs it, too
    python -m benchmarks tongue --part stability   # muscles at full activation; needs it, too
    python -m benchmarks tongue --part precision   # error and time over the step; needs it, too

"reference" repeats every recorded motion with the recorded scheme and step. Positions are recorded in
single precision; "beyond storage" is what remains of a distance after the largest rounding of each
coordinate.
"""

import json
import os
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

import sim
from benchmarks.report import finish, say
from emgface.anatomy.jaw.series import Excitation, ramps
from emgface.anatomy.tongue.actions import muscle_exciters
from emgface.anatomy.tongue.model import attached_nodes
from emgface.anatomy.tongue.parameters import TongueParameters, variant
from emgface.anatomy.tongue.published import TURN, import_tongue
from emgface.anatomy.tongue.run import simulate_tongue
from emgface.anatomy.tongue.scene import tongue_activation, tongue_scene
from emgface.errors import TongueError
from sim.linear import linear_solver

SHARED = Path(os.environ.get("EMGFACE_SHARED", "../shared"))
RECORDED = {"line": "lines", "element": "elements", "stable": "stable"}
"""Variant by its name in the recorded motions."""
MEDIAN, TIP = 1.0, 1.5
"""Largest distances of all nodes (median) and of the tip from a stored shape [mm]."""
EULER = sim.LinearlyImplicitEuler(tolerance=1e-9)


def published(shared: Path, model: str = "", **options: Any) -> xr.Dataset:
    """Published tongue, with the fibre directions of a recorded model if it is named.

    That program finds the segments around a point in a list without those of equal midpoints, and takes
    their directions from the list with them. Directions of GGP and STY, whose fibres share segments,
    are therefore those of other segments, by up to 26 and 59 degrees.
    """
    tongue = import_tongue(shared / "artisynth_models" / "tongue", **options)
    if model:
        with np.load(shared / "artisynth_reference" / f"{model}.npz") as arrays:
            for k, muscle in enumerate(tongue["muscle"].values):
                own = np.flatnonzero(tongue["bundle_muscle"].values == k)
                element = arrays[f"tongue_bundle_{muscle}_elements"]
                rank = np.argsort(element)[
                    np.argsort(np.argsort(tongue["bundle_index"].values[own]))
                ]
                rows = arrays[f"tongue_bundle_{muscle}_directions"][rank] @ TURN.T
                tongue["bundle_direction"].values[own] = rows
    return tongue


CHANGES: dict[str, dict[str, object]] = {
    "gravity off": {"gravity": False},
    "activation stiffening of the passive material switched off": {"stiffening": 1.0},
    "hard incompressibility switched off": {"incompressibility": "element"},
}
"""Parameters that the recorded changes of a model change."""


def parameters_of(case: Mapping[str, Any]) -> TongueParameters:
    """Parameters of a recorded case; TongueError if its variant, scheme or a change is not known."""
    stated = case.get("changes_against_the_model_file") or []
    gravity = [float(g) for g in case["gravity"]]
    strange = [change for change in stated if change not in CHANGES]
    if case["variant"] not in RECORDED:
        strange.append(f"variant {case['variant']}")
    if case["integrator"] != "ConstrainedBackwardEuler":
        strange.append(f"integrator {case['integrator']}")
    if gravity[:2] != [0.0, 0.0] or gravity[2] not in (0.0, -9.8):
        strange.append(f"gravity {gravity}")
    if strange:
        raise TongueError(
            f"{case['name']} cannot be repeated because of {', '.join(strange)}: expected the variants "
            f"{', '.join(RECORDED)}, ConstrainedBackwardEuler, gravity of 9.8 m/s^2 or none, and the "
            f"changes {', '.join(CHANGES)}"
        )
    changes = {k: v for change in stated for k, v in CHANGES[change].items()}
    return variant(RECORDED[case["variant"]], **changes | {"gravity": gravity[2] != 0.0})


def recorded_levels(case: Mapping[str, Any]) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Times [s] and levels of every target, a(t) = amax clip((t - start)/ramp, 0, 1).

    Raises TongueError if a target occurs twice, whose excitations the recording neither adds nor
    replaces by a stated rule.
    """
    given = case["excitations"]
    targets = [str(e["target"]) for e in given]
    if twice := sorted({t for t in targets if targets.count(t) > 1}):
        raise TongueError(
            f"{case['name']} excites {', '.join(twice)} twice, expected every target once: add its "
            "excitations, or leave one out"
        )
    corners = {0.0, *(e["start_s"] for e in given), *(e["start_s"] + e["ramp_s"] for e in given)}
    time = np.array(sorted(corners))
    levels = dict[str, np.ndarray]()
    for e in given:
        ramp = e["ramp_s"]
        rising = np.clip((time - e["start_s"]) / ramp, 0.0, 1.0) if ramp else np.ones(len(time))
        levels[str(e["target"])] = e["amax"] * rising
    return time, levels


def driven(
    tongue: xr.Dataset, case: dict[str, Any], p: TongueParameters
) -> tuple[sim.System, sim.Activation]:
    """Scene of a recorded case, and its activation."""
    system = sim.compile_scene(tongue_scene(tongue, p))
    time, levels = recorded_levels(case)
    known = set(map(str, tongue["exciter"].values))
    drive = {f"bi_{t}" if f"bi_{t}" in known else t: u for t, u in levels.items()}
    if unknown := sorted(set(drive) - known):
        raise TongueError(
            f"{case['name']} excites {', '.join(unknown)}, expected whole muscles: "
            f"{', '.join(e.removeprefix('bi_') for e in muscle_exciters(tongue))}, or one side of them"
        )
    excitation = Excitation(time, drive)
    values = excitation.activation(tongue)[0].transpose("time", "muscle").values
    return system, sim.Activation(excitation.time, tongue_activation(tongue, system, values))


def recorded_tongue(name: str) -> tuple[sim.System, sim.Activation]:
    """Scene of a recorded case by its name, and its activation."""
    case, _ = recorded(name)
    return driven(published(SHARED, f"tongue/model_{case['variant']}"), case, parameters_of(case))


def repeated(
    tongue: xr.Dataset, case: dict[str, Any], p: TongueParameters, until: float | None = None
) -> xr.Dataset:
    """Positions of all nodes over time under the excitations, scheme and step of a recorded case."""
    system, activation = driven(tongue, case, p)
    motion, _ = sim.simulate(
        system,
        activation,
        duration=case["t_end_s"] if until is None else until,
        steps=sim.FixedStep(case["h_s"]),
        every=case["output_interval_s"],
        integrator=EULER,
        probes=(sim.Positions(),),
        work=sim.Workspace(system, linear_solver().name),  # a factor of every matrix, as there
    )
    return motion


def distances(motion: xr.Dataset, theirs: np.ndarray, storage: bool = False) -> np.ndarray:
    """Distance (time, node) of nodes from the recorded ones [mm], beyond the rounding of storage."""
    ours = motion["node_position"].transpose("time", "node", "axis").values @ TURN
    n, nodes = min(len(ours), len(theirs)), 946
    apart = np.abs(ours[:n, :nodes] - theirs[:n, :nodes])
    if storage:
        apart = np.maximum(apart - 0.5 * np.spacing(np.abs(theirs[:n, :nodes])), 0.0)
    return 1e3 * np.linalg.norm(apart, axis=2)


def recorded(name: str, part: str = "tongue") -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Description and arrays of a recorded case."""
    path = SHARED / "artisynth_reference" / part / f"{name}.json"
    for own in (path, path.with_suffix(".npz")):
        if not own.is_file():
            raise TongueError(
                f"{own} not found: set EMGFACE_SHARED to the folder that contains artisynth_reference, "
                "and name a recorded case"
            )
    with np.load(path.with_suffix(".npz")) as arrays:
        return json.loads(path.read_text()), dict(arrays)


def reference(names: list[str] | None = None) -> pd.DataFrame:
    """Largest distance of a node from every recorded motion, over time and at the end [mm]."""
    folder, rows = SHARED / "artisynth_reference" / "tongue", list[dict[str, Any]]()
    models: dict[str, xr.Dataset] = {}
    paths = [p for p in folder.glob("*_*.json") if not p.stem.startswith(("model_", "internal"))]
    unknown = sorted(set(names or ()) - {p.stem for p in paths})
    if unknown or not paths:
        raise TongueError(
            f"no recorded case {', '.join(unknown)} in {folder}: set EMGFACE_SHARED to the folder that "
            f"contains artisynth_reference, and name some of {', '.join(sorted(p.stem for p in paths))}"
        )
    for path in sorted(p for p in paths if not names or p.stem in names):
        case, arrays = recorded(path.stem)
        theirs, t = arrays["pos_tongue"], arrays["t"]
        if t[-1] == 0.0:
            rows.append({"case": path.stem, "ends there": str(case.get("ended_early"))[:60]})
            continue  # without any output
        model = f"tongue/model_{case['variant']}"
        tongue = models.setdefault(model, published(SHARED, model))
        say(path.stem)
        began = time.process_time()
        motion = repeated(tongue, case, parameters_of(case), float(t[-1]))
        apart = distances(motion, theirs)
        moved = np.linalg.norm(theirs[-1] - theirs[0], axis=1).max() * 1e3
        rows.append(
            {
                "case": path.stem,
                "until s": float(t[-1]),
                "step ms": 1e3 * case["h_s"],
                "displacement mm": f"{moved:.2f}",
                "largest mm": f"{apart.max():.1e}",
                "at the end mm": f"{apart[-1].max():.1e}",
                "beyond storage": f"{distances(motion, theirs, storage=True).max():.1e}",
                "cpu ms per step": round(
                    1e3 * (time.process_time() - began) / (float(t[-1]) / case["h_s"]), 1
                ),
                "theirs": round(case.get("cpu_ms_per_step_median", np.nan), 1),
            }
        )
    return pd.DataFrame(rows)


FULL = 0.1  # s, in which activations rise to 1


def stability(models: list[str] | None = None) -> pd.DataFrame:
    """Smallest det F of every muscle at activation 1, alone and all together, over the step.

    The step of 1 ms is taken for all muscles together.
    """
    tongue, rows = published(SHARED), list[dict[str, Any]]()
    names = [*(e.removeprefix("bi_") for e in muscle_exciters(tongue)), "all"]
    for model in models or ("elements", "lines"):
        for name in names:
            row: dict[str, Any] = {"muscles as": model, "muscle": name}
            drive = muscle_exciters(tongue) if name == "all" else [_exciter(tongue, name)]
            excitation = ramps({e: [(0.0, 0.0), (FULL, 1.0)] for e in drive})
            for step in (20, 5, 1):
                if step == 1 and name != "all":
                    continue
                row[f"{step} ms"] = _at_full(tongue, excitation, model, 1e-3 * step)
            say(" ".join(map(str, row.values())))
            rows.append(row)
    return pd.DataFrame(rows)


def _exciter(tongue: xr.Dataset, name: str) -> str:
    return next(e for e in muscle_exciters(tongue) if e.removeprefix("bi_") == name)


def _at_full(tongue: xr.Dataset, excitation: Excitation, model: str, step: float) -> str:
    """Smallest det F until 0.2 s, or the failure."""
    p = variant(model, gravity=False, damping_tangent="passive")
    output = max(step, 0.02)
    try:
        motion = simulate_tongue(
            tongue, excitation, duration=0.2, parameters=p, step=step, output=output
        )
    except sim.SimulationError as error:
        return type(error).__name__
    return f"{float(motion['smallest_J'].min()):.2g}"


def precision(models: list[str] | None = None) -> pd.DataFrame:
    """Largest and rms error of a node at 0.2 s and processor time over scheme and step [mm, s].

    Errors are distances from SDIRK2 with 1.25 ms, or from implicit Euler with 1.25 ms with "lines".
    """
    tongue, rows = published(SHARED), list[dict[str, Any]]()
    excitation = ramps({"bi_GGP": [(0.0, 0.0), (FULL, 0.2)]})
    schemes = {
        "linearly implicit Euler": sim.LinearlyImplicitEuler(),
        "implicit Euler": sim.ConvergedEuler(),
        "SDIRK2": sim.Sdirk2(),
    }
    for model in models or ("elements", "lines"):
        p = variant(model)
        finest: np.ndarray | None = None
        for scheme, step in (
            ("SDIRK2", 1.25),
            *((s, h) for s in schemes for h in (20.0, 10.0, 5.0, 2.5)),
        ):
            if model == "lines" and scheme == "SDIRK2" and step < 2.0:
                scheme = "implicit Euler"
            began = time.process_time()
            try:
                motion = simulate_tongue(
                    tongue,
                    excitation,
                    duration=0.2,
                    parameters=p,
                    step=1e-3 * step,
                    output=0.2,
                    integrator=schemes[scheme],
                )
            except sim.SimulationError as error:
                rows.append({"muscles as": model, "scheme": scheme, "step ms": step})
                rows[-1]["largest mm"] = type(error).__name__
                continue
            spent = time.process_time() - began
            q = motion["node_position"].transpose("time", "node", "axis").values[-1]
            if finest is None:
                finest = q
                continue
            apart = 1e3 * np.linalg.norm(q - finest, axis=1)
            rows.append(
                {
                    "muscles as": model,
                    "scheme": scheme,
                    "step ms": step,
                    "rms mm": f"{np.sqrt((apart**2).mean()):.2g}",
                    "largest mm": f"{apart.max():.2g}",
                    "cpu s": round(spent, 2),
                }
            )
    return pd.DataFrame(rows)


SHAPES = ("rest", "jaw_open")


def postures(models: Sequence[str] = ()) -> pd.DataFrame:
    """Equilibrium with jaw and hyoid where they are in a stored shape, against that shape [mm].

    `models` are some of those compared, by default all.
    """
    tongue, rows = published(SHARED), list[dict[str, Any]]()
    for posture in SHAPES:
        for what, p, fixed in (
            ("elements", variant("elements"), ("jaw", "hyoid")),
            ("elements, no gravity", variant("elements", gravity=False), ("jaw", "hyoid")),
            ("elements, hyoid stays", variant("elements"), ("jaw",)),
            ("elements, kappa x 10", variant("elements", kappa=103700.0), ("jaw", "hyoid")),
            ("lines", variant("lines", incompressibility="element"), ("jaw", "hyoid")),
            ("linear", variant("linear"), ("jaw", "hyoid")),
        ):
            if models and what not in models:
                continue
            say(f"{posture}, {what}")
            d = settled(tongue, posture, p, fixed)
            rows.append({"shape": posture, "model": what, **compared(tongue, posture, d)})
    return pd.DataFrame(rows)


def settled(
    tongue: xr.Dataset,
    posture: str,
    p: TongueParameters,
    fixed: Sequence[str] = ("jaw", "hyoid"),
) -> np.ndarray:
    """Displacement (node, axis) after 1 s with the bodies as in a stored shape."""
    d = tongue["posture_displacement"].sel(posture=posture).values
    paths = {
        body: _towards(tongue["position"].values[nodes], d[nodes])
        for body, nodes in attached_nodes(tongue).items()
        if body in fixed
    }
    motion = simulate_tongue(
        tongue,
        ramps({"SL": [(0.0, 0.0)]}),
        duration=1.0,
        parameters=p,
        paths=paths,
        step=0.02,
        output=0.5,
    )
    q = motion["node_position"].transpose("time", "node", "axis").values[-1]
    return q - tongue["position"].values


def compared(tongue: xr.Dataset, posture: str, d: np.ndarray) -> dict[str, Any]:
    """Distances of all nodes and of the tip from a stored shape [mm]."""
    stored = 1e3 * tongue["posture_displacement"].sel(posture=posture).values @ TURN
    ours, tip = 1e3 * d @ TURN, int(tongue["marker_node"][0])
    apart = np.linalg.norm(ours - stored, axis=1)
    judged = {
        "median": np.median(apart) <= MEDIAN,
        "tip": apart[tip] <= TIP,
        "signs": (ours[tip, [0, 2]] * stored[tip, [0, 2]] > 0.0).all(),
    }
    missed = [name for name, met in judged.items() if not met]
    return {
        "median": round(float(np.median(apart)), 2),
        "largest": round(float(apart.max()), 2),
        "tip apart": round(float(apart[tip]), 2),
        "tip x, z": f"{ours[tip, 0]:.2f}, {ours[tip, 2]:.2f}",
        "stored": f"{stored[tip, 0]:.2f}, {stored[tip, 2]:.2f}",
        "basis": "free",
        "met": f"{', '.join(missed)} no" if missed else "yes",
    }


def _towards(X: np.ndarray, d: np.ndarray) -> Any:
    """Path of nodes from X to X + d within 0.2 s."""
    return lambda t: X + d * np.clip(5.0 * t, 0.0, 1.0)


def main(part: str = "reference", out: Path | None = None, case: list[str] | None = None) -> None:
    """Run one part, print its table and store it; `case` are recorded cases, or models to be tested."""
    parts = {
        "reference": lambda: reference(case),
        "postures": lambda: postures(case or ()),
        "stability": lambda: stability(case),
        "precision": lambda: precision(case),
    }
    finish(f"tongue-{part}", parts[part](), out)
