"""Generated head: actions of the tongue, stability, cost of a step, and closing with an open jaw.

    python -m benchmarks head --part actions     # displacement of tip and back by every muscle
    python -m benchmarks head --part stability   # all muscles at 1.0, alone and together, by step
    python -m benchmarks head --part cost        # processor time of a step against the face alone
    python -m benchmarks head --part face_on_jaw # the same of a face on a moving jaw
    python -m benchmarks head --part closing     # area of the mouth by orbicularis against jaw opening
    python -m benchmarks head --part coupling    # jaw moved by the tongue, tongue moved by the jaw

All results are simulated. "cost" alternates the scenes, so that the load of the machine affects both.
"""

import statistics
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

import sim
from benchmarks.report import finish, say
from emgface.anatomy.head.build import build_head
from emgface.anatomy.head.model import Head
from emgface.anatomy.head.run import activation_of, raised, simulate_head
from emgface.anatomy.head.scene import TONGUE, HeadScene, head_scene
from emgface.anatomy.tongue.actions import action_table

Rows = Iterator[dict[str, object]]
ALL = ("face", "jaw", "tongue", "hyoid")


def moved(motion: xr.Dataset, marker: str, k: int = -1) -> np.ndarray:
    """Displacement of a point from the start to an output [mm]."""
    x = motion["position"].sel(marker=marker).transpose("time", "axis").values
    return 1e3 * (x[k] - x[0])


def actions(preset: str, resolution: str) -> Rows:
    """Every muscle of the tongue raised to 0.3 and released within 1 s, without gravity."""
    tongue = build_head(["tongue"], preset=preset, resolution=resolution).parts["tongue"]
    for row in action_table(tongue, TONGUE, step=1e-2).to_dict("records"):
        yield {str(name): value for name, value in row.items()}


def stability(preset: str, resolution: str) -> Rows:
    """Muscles at 1.0 within 0.1 s and held, with a closed and an opening jaw, without contact."""
    head = build_head(ALL, preset=preset, resolution=resolution, contacts=[])
    names = [str(e) for e in head.lists["exciter"].values if str(e).startswith("bi_")]
    tissue = {str(m)[:-2] for p in ("face", "tongue") for m in head.parts[p]["muscle"].values}
    single = [name for name in names if name[3:] in tissue]
    scene = head_scene(head, tongue=TONGUE.model_copy(update={"sigma_max": 300e3}))
    cases = {
        "all of the tongue": [
            f"bi_{m}" for m in sorted(tissue) if m.isupper() and m in _tongue(head)
        ],
        "all of the face": [f"bi_{m}" for m in sorted(tissue) if m not in _tongue(head)],
        "all": single,
        **{name[3:]: [name] for name in single},
    }
    for opening in (0.0, 1.0):
        for step in (1e-3, 5e-3, 20e-3):
            for case, exciters in cases.items():
                if len(exciters) == 1 and (step != 5e-3 or opening):
                    continue  # each muscle alone at the default step and with a closed jaw only
                drive = {name: 1.0 for name in exciters}
                drive |= {"bi_open": opening} if opening else {"bi_close": 0.02}
                yield {
                    "jaw": "opened" if opening else "closed",
                    "step_ms": 1e3 * step,
                    "muscles": case,
                    **_survives(head, scene, drive, step),
                }


def _tongue(head: Head) -> set[str]:
    return {str(m)[:-2] for m in head.parts["tongue"]["muscle"].values}


def _survives(
    head: Head, scene: HeadScene, drive: dict[str, float], step: float
) -> dict[str, object]:
    try:
        motion = simulate_head(
            head,
            raised(drive, rise=0.1, jaw=False),
            duration=0.16,
            step=step,
            output=0.02,
            scene=scene,
        )
    except sim.SimulationError as error:
        return {"end": type(error).__name__, "why": str(error)[:90]}
    return {
        "end": "reached",
        "smallest_J": round(float(motion["smallest_J"].min()), 3),
        "incisor_down_mm": round(-moved(motion, "lower_incisor")[2], 1),
    }


def face_on_jaw(preset: str, resolution: str) -> Rows:
    """Cost of a face on a moving jaw, whose condyles are on curves, without contact."""
    return timed(
        {"face": (["face"], []), "face on a jaw": (["face", "jaw"], [])}, preset, resolution
    )


def cost(preset: str, resolution: str) -> Rows:
    """Cost of contact and of all parts of a head."""
    scenes = {
        "face, lips": (["face"], ["lip-lip"]),
        "face, lips and teeth": (["face"], ["lip-lip", "lips-teeth"]),
        "face, jaw, tongue, hyoid; lips": (ALL, ["lip-lip"]),
        "face, jaw, tongue, hyoid; all contacts": (ALL, None),
    }
    return timed(scenes, preset, resolution)


def timed(
    scenes: Mapping[str, tuple[Sequence[str], list[str] | None]],
    preset: str,
    resolution: str,
    steps: int = 20,
) -> Rows:
    """Median processor time of simulations of `steps` steps of 5 ms, without compiling.

    `scenes` are parts and contacts by name; ratios are those to the first.
    """
    runs = dict[str, tuple[sim.System, sim.Activation]]()
    for name, (parts, contacts) in scenes.items():
        head = build_head(parts, preset=preset, resolution=resolution, contacts=contacts)
        levels = {"bi_OOP": 0.2} | ({"bi_open": 0.1} if "jaw" in parts else {})
        levels |= {"bi_GGP": 0.2} if "tongue" in parts else {}
        system = sim.compile_scene(head_scene(head).scene)
        runs[name] = system, activation_of(head, system, raised(levels, jaw=len(parts) > 1))[0]
    seconds: dict[str, list[float]] = {name: [] for name in runs}
    for _ in range(3):
        for name, (system, drive) in runs.items():
            start = time.process_time()
            sim.simulate(
                system,
                drive,
                duration=5e-3 * steps,
                steps=sim.FixedStep(5e-3),
                integrator=sim.LinearlyImplicitEuler(),
                probes=(),
            )
            seconds[name].append(time.process_time() - start)
    base = statistics.median(seconds[next(iter(scenes))])
    for name, found in seconds.items():
        middle = statistics.median(found)
        yield {
            "scene": name,
            "unknowns": runs[name][0].kinematics.pattern.n,
            "ms_per_step": round(1e3 * middle / steps, 1),
            "over_the_first": round(middle / base, 2),
        }


def closing(preset: str, resolution: str) -> Rows:
    """Experiment 4: area of the mouth with and without orbicularis against the opening of the jaw."""
    head = build_head(ALL, preset=preset, resolution=resolution, contacts=["lip-lip"])
    scene = head_scene(head)
    for opening in (0.0, 0.1, 0.2, 0.4):
        jaw = {"bi_open": opening} if opening else {"bi_close": 0.02}
        for ring in ("none", "bi_OOP", "bi_OOM"):
            drive = jaw | ({} if ring == "none" else {ring: 0.3})
            motion = simulate_head(
                head, raised(drive, rise=0.15, jaw=False), duration=0.35, step=1e-2, scene=scene
            )
            yield {
                "open": opening,
                "orbicularis": ring.removeprefix("bi_"),
                "incisor_down_mm": round(-moved(motion, "lower_incisor")[2], 2),
                "area_mm2": round(1e6 * float(motion["mouth_area"][-1]), 1),
                "gap_mm": round(1e3 * float(motion["lip_opening"][-1]), 2),
            }


def coupling(preset: str, resolution: str) -> Rows:
    """Experiment 6: displacements by muscles of the tongue on the free jaw, and by those of the jaw."""
    head = build_head(("jaw", "tongue", "hyoid"), preset=preset, resolution=resolution, contacts=[])
    scene = head_scene(head)
    for name, drive in {
        "rest": {},
        "GGP 0.5": {"bi_GGP": 0.5},
        "HG 0.5": {"bi_HG": 0.5},
        "STY 0.5": {"bi_STY": 0.5},
        "GH and MH 0.5": {"bi_GH": 0.5, "bi_MH": 0.5},
        "openers 0.2": {"bi_open": 0.2},
    }.items():
        motion = simulate_head(head, raised(drive, rise=0.1), duration=0.3, scene=scene)
        row: dict[str, object] = {"drive": name}
        for marker in ("lower_incisor", "hyoid", "tip", "back"):
            forward, up = moved(motion, marker)[1:]
            row |= {f"{marker}_forward": round(forward, 2), f"{marker}_up": round(up, 2)}
        yield row


PARTS = {f.__name__: f for f in (actions, stability, cost, face_on_jaw, closing, coupling)}


def main(
    part: str = "actions",
    preset: str = "man",
    resolution: str = "coarse",
    out: Path | None = None,
) -> None:
    """Run one part and print its table."""
    rows = list[dict[str, object]]()
    for row in PARTS[part](preset, resolution):
        rows.append(row)
        say(str(row))
    finish(f"head_{part}", pd.DataFrame(rows), out)


__all__ = ["main"]
