"""Inverse tracking: distance from the target beside that of runs recorded with another simulator.

    python -m benchmarks inverse-recorded --part points   # a point with muscles, in a plane and in space
    python -m benchmarks inverse-recorded --part jaw      # stored trace of the lower incisor
    python -m benchmarks inverse-recorded --part tongue   # three nodes in the midline of the tongue
    python -m benchmarks inverse-recorded --part tip      # stored traces of 22 nodes at the tip

All require the recorded runs, and jaw and tongue also the published models. Every target is tracked
step by step with the recorded step and the default chase rule; the weight of the size is 1e-8 for the
points, and 0.01 for jaw and tongue, whose targets are in units of 0.1 mm. The jaw has one excitation
for each of its 24 muscles where the stored run has 25 groups of both sides.
"""

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

import sim
from benchmarks.jaw import TO_MM
from benchmarks.jaw_variants import published as published_jaw
from benchmarks.report import finish
from benchmarks.tongue import published as published_tongue
from emgface.anatomy.jaw.scene import jaw_scene
from emgface.anatomy.tongue.parameters import variant
from emgface.anatomy.tongue.published import TURN
from emgface.anatomy.tongue.scene import LINE, tongue_scene
from sim.inverse import PointTarget, Weights, track
from tests.inverse.points import recorded

SHARED = Path(os.environ.get("EMGFACE_SHARED", "../shared"))
RECORDED = SHARED / "artisynth_reference" / "inverse"
STORED = SHARED / "artisynth_models"
JUMP = 0.1
"""Largest change of an activation in a step towards the infeasible targets of the tip; without a limit
an element inverts."""
SIZE, CLOSERS = 1e-4, ("at", "mt", "pt", "sm", "dm", "mp")
H = 0.01


def main(part: str = "points", out: Path | None = None) -> None:
    """Track and print."""
    parts: dict[str, Callable[[], list[dict[str, Any]]]] = {
        "points": points, "jaw": jaw, "tongue": tongue, "tip": tip
    }  # fmt: skip
    finish(f"inverse_{part}", pd.DataFrame(parts[part]()).map(shown), out)


def shown(value: Any) -> Any:
    """Number with three digits."""
    return f"{value:.3g}" if isinstance(value, float) else value


def _table(path: Path) -> np.ndarray:
    return np.loadtxt(path, skiprows=2)[:, 1:]


def _distances(x: np.ndarray, target: np.ndarray, unit: float = 1e3) -> tuple[float, float]:
    """Root mean square and largest distance of points (n, k, 3), in mm if they are in metres."""
    d = unit * np.linalg.norm(x - target, axis=2)
    return float(np.sqrt((d**2).mean())), float(d.max())


def _row(case: str, own: np.ndarray, theirs: np.ndarray, target: np.ndarray, unit: float = 1e3):
    ours, others = _distances(own, target, unit), _distances(theirs, target, unit)
    names = ("rms", "largest", "rms, recorded", "largest, recorded")
    return {"case": case, **dict(zip(names, (*ours, *others), strict=True))}


def points() -> list[dict[str, Any]]:
    """Points in the plane and in space, in the unit of the model."""
    rows = []
    for name in ("point2d", "point3d"):
        system, target, run, _ = recorded(RECORDED, name)
        found, _ = track(
            system, [target], duration=0.5, integrator=sim.LinearlyImplicitTrapezoidal(),
            weights=Weights(size=1e-8, change=0.0),
        )  # fmt: skip
        x = found["tracked"].values.T.reshape(run["target"].shape)
        rows.append(_row(name, x, run["actual"], run["target"], 1.0))
    return rows


def jaw() -> list[dict[str, Any]]:
    """Lower incisor of the published jaw on a fixed hyoid."""
    folder = STORED / "jaw_larynx" / "stored_results" / "inverse"
    wanted = _table(folder / "tracked_positions.txt") / TO_MM
    reached = _table(folder / "source_positions.txt") / TO_MM
    parts = jaw_scene(published_jaw("fixed", values="program"))
    system = sim.compile_scene(parts.scene)
    active = np.isin(system.muscles, list(parts.muscles))
    node = np.array([parts.points["lower_incisor"]])
    time = H * np.arange(len(wanted))
    target = PointTarget(node, time, wanted[:, None], SIZE)
    found, _ = track(
        system, [target], duration=float(time[-1]), h=H,
        weights=Weights(size=0.01, change=0.0, high=active.astype(float)),
    )  # fmt: skip
    x = SIZE * found["tracked"].values.T.reshape(-1, 1, 3)
    own = found["activation"].max("time").to_series()
    closers = [str(m) for m in own.index if str(m)[:-2] in CLOSERS]
    largest = own[[str(m) for m in own.index if str(m)[:-2] not in CLOSERS]].nlargest(6)
    told = ", ".join(f"{m} {a:.3f}" for m, a in largest.items())
    row = _row("incisor", x, reached[1:, None], wanted[1:, None])
    ends = {"largest closer": float(own[closers].max()), "largest opener": float(largest.iloc[0])}
    return [row | ends | {"largest": told}]


def tongue() -> list[dict[str, Any]]:
    """Three nodes in the midline, line muscles, hard volumes, no gravity."""
    told = json.loads((RECORDED / "tongue3.json").read_text())
    run = np.load(RECORDED / "tongue3.npz")
    row = _tracked(
        "midline", told["model"]["target_node_indices"], run["target"], run["actual"], "lines"
    )
    return [row]


def tip() -> list[dict[str, Any]]:
    """22 nodes at the tip, line muscles."""
    rows = []
    root = STORED / "tongue" / "stored_results" / "invtongue" / "tip_lateral"
    X = published_tongue(SHARED)["position"].values @ TURN
    for name in ("protrude", "lateral", "protrude_lateral"):
        wanted = _table(root / name / "ref_target_position.txt").reshape(-1, 22, 3)
        reached = _table(root / name / "model_target_position.txt").reshape(-1, 22, 3)
        nodes = [int(np.linalg.norm(X - x, axis=1).argmin()) for x in reached[0]]
        off = float(np.linalg.norm(X[nodes] - reached[0], axis=1).max())
        if off > 1e-6:
            raise SystemExit(f"{name}: a stored node is {off:g} m from every node of the mesh")
        rows.append(_tracked(name, nodes, wanted[1:], reached[1:], "lines", JUMP))
    return rows


def _tracked(
    case: str,
    nodes: list[int],
    wanted: np.ndarray,
    reached: np.ndarray,
    form: str,
    jump: float = 1.0,
):
    model = published_tongue(SHARED)
    p = variant(form, gravity=False)
    system = sim.compile_scene(tongue_scene(model, p))
    index = np.array(nodes)
    wanted, reached = wanted @ TURN.T, reached @ TURN.T
    time = H * np.arange(len(wanted) + 1)
    high = np.array([float(LINE not in m) for m in system.muscles])
    position = np.concatenate([system.mesh.X[None, index], wanted])
    found, _ = track(
        system, [PointTarget(index, time, position, SIZE)], duration=float(time[-1]), h=H,
        weights=Weights(size=0.01, change=0.0, high=high, jump=jump),
    )  # fmt: skip
    x = SIZE * found["tracked"].values.T.reshape(wanted.shape)
    own = found["activation"].max("time").to_series().nlargest(5)
    print(f"{case}: largest activations:", ", ".join(f"{m} {a:.3f}" for m, a in own.items()))
    saturated = int((found["saturated"] > 0).any() and found["saturated"].max())
    return _row(case, x, reached, wanted) | {"saturated at once": saturated}
