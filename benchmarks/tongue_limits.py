"""Stored shapes of the tongue, and what its limits depend on.

    python -m benchmarks tongue_limits --part postures   # stored shapes under gravity
    python -m benchmarks tongue_limits --part carried    # muscles that would carry the tongue in them
    python -m benchmarks tongue_limits --part volume     # change of volume over the bulk modulus

Needs the published model. All results are simulated.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from scipy.optimize import nnls

import sim
from benchmarks.report import finish, say
from benchmarks.tongue import SHARED, published
from emgface.anatomy.head.build import build_head
from emgface.anatomy.head.scene import TONGUE
from emgface.anatomy.jaw.series import ramps
from emgface.anatomy.tongue.actions import action_table, muscle_exciters
from emgface.anatomy.tongue.model import attached_nodes
from emgface.anatomy.tongue.parameters import TongueParameters, variant
from emgface.anatomy.tongue.published import TURN
from emgface.anatomy.tongue.run import simulate_tongue

SHAPES = ("rest", "jaw_open")
LOW = 0.005
"""Activation at which the effect of every muscle on a shape is measured."""


def postures(models: Sequence[str] = ()) -> pd.DataFrame:
    """Equilibrium with jaw and hyoid where they are in a stored shape, against that shape [mm].

    `models` are some of those compared, by default all.
    """
    tongue, rows = published(SHARED), list[dict[str, Any]]()
    for posture in SHAPES:
        for what, p, held in (
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
            d = settled(tongue, posture, p, {}, held)
            rows.append({"shape": posture, "model": what, **compared(tongue, posture, d)})
    return pd.DataFrame(rows)


def settled(
    tongue: xr.Dataset,
    posture: str,
    p: TongueParameters,
    levels: dict[str, float],
    held: Sequence[str] = ("jaw", "hyoid"),
) -> np.ndarray:
    """Displacement (node, axis) after 1 s with the bodies as in a stored shape and muscles at levels."""
    d = tongue["posture_displacement"].sel(posture=posture).values
    paths = {
        body: _towards(tongue["position"].values[nodes], d[nodes])
        for body, nodes in attached_nodes(tongue).items()
        if body in held
    }
    drive = {"SL": [(0.0, 0.0)]} | {m: [(0.0, 0.0), (0.2, a)] for m, a in levels.items()}
    motion = simulate_tongue(
        tongue, ramps(drive), duration=1.0, parameters=p, paths=paths, step=0.02, output=0.5
    )
    q = motion["node_position"].transpose("time", "node", "axis").values[-1]
    return q - tongue["position"].values


def compared(tongue: xr.Dataset, posture: str, d: np.ndarray) -> dict[str, Any]:
    """Distances of all nodes and of the tip from a stored shape [mm]."""
    stored = 1e3 * tongue["posture_displacement"].sel(posture=posture).values @ TURN
    ours, tip = 1e3 * d @ TURN, int(tongue["marker_node"][0])
    apart = np.linalg.norm(ours - stored, axis=1)
    return {
        "median": round(float(np.median(apart)), 2),
        "largest": round(float(apart.max()), 2),
        "tip apart": round(float(apart[tip]), 2),
        "tip x, z": f"{ours[tip, 0]:.2f}, {ours[tip, 2]:.2f}",
        "stored": f"{stored[tip, 0]:.2f}, {stored[tip, 2]:.2f}",
    }


def _towards(X: np.ndarray, d: np.ndarray) -> Any:
    """Path of nodes from X to X + d within 0.2 s."""
    return lambda t: X + d * np.clip(5.0 * t, 0.0, 1.0)


def carried() -> Iterator[dict[str, Any]]:
    """Muscles under gravity, each at a low level, and the sum that fits a stored shape best.

    The levels of the sum are those >= 0 whose displacements, as far as they are linear, leave the least
    squares at all nodes.
    """
    tongue, p = published(SHARED), variant("elements")
    names = muscle_exciters(tongue)
    for posture in SHAPES:
        passive = settled(tongue, posture, p, {})
        yield {"shape": posture, "muscles": "none", **compared(tongue, posture, passive)}
        effect = list[np.ndarray]()
        for name in names:
            say(f"{posture}, {name}")
            d = settled(tongue, posture, p, {name: LOW})
            effect.append((d - passive).ravel() / LOW)
            yield {
                "shape": posture,
                "muscles": f"{name.removeprefix('bi_')} {LOW:g}",
                **compared(tongue, posture, d),
            }
        wanted = tongue["posture_displacement"].sel(posture=posture).values - passive
        best, _ = nnls(np.stack(effect, axis=1), wanted.ravel())
        levels = {n: float(min(a, 1.0)) for n, a in zip(names, best, strict=True) if a > 1e-4}
        said = ", ".join(f"{n.removeprefix('bi_')} {a:.3f}" for n, a in levels.items())
        d = settled(tongue, posture, p, levels)
        yield {"shape": posture, "muscles": said, **compared(tongue, posture, d)}


def volume() -> Iterator[dict[str, Any]]:
    """Muscles whose change of volume is largest, at 0.3, over the bulk modulus."""
    own = build_head(["tongue"], preset="man", resolution="coarse").parts["tongue"]
    for name, tongue, p in (
        ("generated", own, TONGUE),
        ("published", published(SHARED), variant("elements", damping_tangent="passive")),
    ):
        for factor in (1.0, 10.0, 100.0, 1000.0):
            say(f"{name}, bulk modulus x {factor:g}")
            changed = p.model_copy(update={"kappa": factor * p.kappa, "gravity": False})
            row: dict[str, Any] = {"tongue": name, "bulk modulus kPa": 1e-3 * changed.kappa}
            try:
                table = action_table(tongue, changed, step=2e-2)
            except sim.SimulationError as error:
                yield row | {"ends": type(error).__name__}
                continue
            by = {str(one["muscle"]): one for one in table.to_dict("records")}
            percent = {muscle: float(one["volume_percent"]) for muscle, one in by.items()}
            worst = max(percent, key=lambda muscle: percent[muscle])
            yield row | {
                "largest, %": f"{percent[worst]:.2g} ({worst})",
                "above 1 %": sum(change > 1.0 for change in percent.values()),
                "SL: tip up mm": round(float(by["SL"]["tip_up"]), 1),
                "smallest det F": round(min(float(one["smallest_J"]) for one in by.values()), 2),
            }


def main(part: str = "postures", out: Path | None = None) -> None:
    """Run one part, print its table and store it."""
    parts = {
        "postures": postures,
        "carried": lambda: pd.DataFrame(carried()),
        "volume": lambda: pd.DataFrame(volume()),
    }
    finish(f"tongue-{part}", parts[part](), out)
