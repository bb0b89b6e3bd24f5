"""Generated head: actions of the tongue, stability and cost of a step.

    python -m benchmarks head --part actions     # displacement of tip and back by every muscle
    python -m benchmarks head --part stability --out DIR   # muscles at 1.0; continues its table
    python -m benchmarks head --part opening     # how far parts of a head let the jaw open
    python -m benchmarks head --part held --out DIR  # what holds the jaw; keeps its rows in DIR
    python -m benchmarks head --part led         # muscles at 1.0 on a jaw that is led to 50 mm
    python -m benchmarks head --part led_single  # every muscle alone on that jaw
    python -m benchmarks head --part published --models DIR --out DIR  # experiments
    python -m benchmarks head --part cost        # processor time of a step against the face alone
    python -m benchmarks head --part face_on_jaw # the same of a face on a moving jaw
    python -m benchmarks head --part published_size  # the same, as large as the published head
    python -m benchmarks head --part precision --out DIR  # error and run time over scheme and step
    python -m benchmarks head --part checks --models DIR  # checks of the specification

All results are simulated. "cost" alternates the scenes, so that the load of the machine affects both.
"""

import itertools
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from scipy.optimize import brentq

import sim
from benchmarks.head_checks import checks
from benchmarks.head_cost import cost, face_on_jaw, precision, published_size
from benchmarks.head_sweeps import ALL, SWEEPS, WIDE
from benchmarks.report import Chart, finish, say
from emgface.anatomy.head.build import build_head
from emgface.anatomy.head.model import Head
from emgface.anatomy.head.run import raised, simulate_head
from emgface.anatomy.head.scene import TONGUE, HeadScene, head_scene
from emgface.anatomy.tongue.actions import action_table
from emgface.face.simulation_parameters import SimulationParameters
from emgface.files import write_text
from sim.integrators import Integrator
from sim.joints import Joint

Rows = Iterator[dict[str, object]]


def moved(motion: xr.Dataset, marker: str, k: int = -1) -> np.ndarray:
    """Displacement of a point from the start to an output [mm]."""
    x = motion["position"].sel(marker=marker).transpose("time", "axis").values
    return 1e3 * (x[k] - x[0])


def actions(preset: str, resolution: str) -> Rows:
    """Every muscle of the tongue raised to 0.3 and released within 1 s, without gravity."""
    tongue = build_head(["tongue"], preset=preset, resolution=resolution).parts["tongue"]
    for row in action_table(tongue, TONGUE, step=1e-2).to_dict("records"):
        yield {str(name): value for name, value in row.items()}


def stability(preset: str, resolution: str, known: pd.DataFrame) -> Rows:
    """Muscles at 1.0 within 0.1 s and held; jaw closed or opening, without and with contact."""
    heads = {
        name: build_head(ALL, preset=preset, resolution=resolution, contacts=pairs)
        for name, pairs in (("none", []), ("all", None))
    }
    head = heads["none"]
    tongue = {str(m)[:-2] for m in head.parts["tongue"]["muscle"].values}
    face = {str(m)[:-2] for m in head.parts["face"]["muscle"].values}
    together = {"all of the tongue": tongue, "all of the face": face, "all": tongue | face}
    single = {name: {name} for name in sorted(tongue) + sorted(face)}
    scenes = dict[str, HeadScene]()
    done = {tuple(row) for row in known[list(LABELS)].itertuples(index=False)}
    for jaw, contact, step, name in _cases(together, single):
        if (jaw, contact, step, name) in done:
            continue
        if contact not in scenes:
            scenes[contact] = head_scene(
                heads[contact], tongue=TONGUE.model_copy(update={"sigma_max": 300e3})
            )
        muscles = {**together, **single}[name]
        drive = {f"bi_{muscle}": 1.0 for muscle in sorted(muscles)}
        drive |= {"bi_open": 1.0} if jaw == "opening" else {"bi_close": 0.02}
        yield {
            **dict(zip(LABELS, (jaw, contact, step, name), strict=True)),
            **_survives(heads[contact], scenes[contact], drive, 1e-3 * step),
        }


LABELS = ("jaw", "contact", "step_ms", "muscles")


def _cases(*groups: Iterable[str]) -> Iterator[tuple[str, str, float, str]]:
    """Single muscles at 5 ms with closed jaw, all together at every step, jaw and contact."""
    together, single = groups
    for contact in ("none", "all"):
        for step in (5.0, 20.0, 1.0):  # the most expensive steps last
            if step == 1.0:
                yield from (("closed", contact, 5.0, name) for name in single)
            for jaw in ("closed", "opening"):
                yield from ((jaw, contact, step, name) for name in together)


def _survives(
    head: Head,
    scene: HeadScene,
    drive: dict[str, float],
    step: float,
    *,
    rise: float = 0.1,
    duration: float = 0.16,
    output: float = 0.02,
    integrator: Integrator | None = None,
) -> dict[str, object]:
    try:
        motion = simulate_head(
            head,
            raised(drive, rise=rise, jaw=False),
            duration=duration,
            step=step,
            output=output,
            scene=scene,
            integrator=integrator,
        )
    except sim.SimulationError as error:
        return {"end": type(error).__name__, "why": str(error)[:90]}
    return {
        "end": "reached",
        "smallest_J": round(float(motion["smallest_J"].min()), 3)
        if "smallest_J" in motion
        else None,
        "incisor_down_mm": round(-moved(motion, "lower_incisor")[2], 1),
    }


STRENGTHENED = ("ad", "pd", "ip", "sp", "sh", "oh", "th", "gh", "stet", "steh", "mh")
"""Muscles that open the jaw or hold the hyoid below, without their side."""


def opening(preset: str, resolution: str) -> Rows:
    """Widest opening of jaw, tongue and face together, with normal and with eightfold strength."""
    cases = [(("jaw", "hyoid"), 1.0, 5.0), (("jaw", "tongue", "hyoid"), 1.0, 5.0),
             (("face", "jaw", "hyoid"), 1.0, 5.0), *((ALL, k, h) for k in (1.0, 8.0)
                                                    for h in (1.0, 5.0, 10.0))]  # fmt: skip
    for parts, strength, step in cases:
        head = build_head(parts, preset=preset, resolution=resolution, contacts=[])
        jaw = head.parts["jaw"].copy(deep=True)
        opens = [str(name).rpartition("_")[0] in STRENGTHENED for name in jaw["muscle"].values]
        jaw["muscle_force_max"][opens] *= strength
        strong = Head(head.lists, {**head.parts, "jaw": jaw})
        row = _survives(
            strong, head_scene(strong), WIDE, 1e-3 * step, rise=0.3, duration=1.0, output=0.05
        )
        yield {"parts": ", ".join(parts), "strength": strength, "step_ms": step, **row}


OPEN, SLID = 50e-3, np.array([0.0, 10.7e-3, -6.1e-3])
"""Distance between incisors to which a jaw is led, and the motion of its condyles when muscles open it
wide [m]."""
LED_RISE = 0.3  #: time in which it opens [s]


def led_jaw(head: Head, scene: HeadScene) -> HeadScene:
    """A head whose jaw turns about its condyles and slides with them, from closed to `OPEN`."""
    jaw = head.parts["jaw"]
    at = {str(n): x for n, x in zip(jaw["point"].values, jaw["point_position"].values, strict=True)}
    hinge = 0.5 * (at["condyle_L"] + at["condyle_R"])
    body = next(b for b in scene.scene.bodies if b.name == "jaw")
    arm = np.asarray(body.centre) - hinge

    def turned(x: np.ndarray, angle: float) -> np.ndarray:
        """About the axis to the right, the front going down."""
        c, s = np.cos(angle), np.sin(angle)
        return np.array([x[0], c * x[1] + s * x[2], c * x[2] - s * x[1]])

    incisor = at["lower_incisor"] - hinge
    angle = brentq(
        lambda a: float(np.linalg.norm(turned(incisor, a) + SLID - incisor)) - OPEN, 0.1, 1.2
    )

    def motion(t: float) -> tuple[np.ndarray, tuple[float, ...]]:
        part = min(t / LED_RISE, 1.0)
        part *= part * (3.0 - 2.0 * part)
        half = -0.5 * part * angle
        return hinge + part * SLID + turned(arm, part * angle), (
            np.cos(half),
            np.sin(half),
            0.0,
            0.0,
        )

    joints = tuple(j for j in scene.scene.joints if not _acts_on(j, "jaw", scene))
    members = (*scene.scene.reductions, sim.PrescribedBody("jaw", motion))
    return replace(scene, scene=replace(scene.scene, joints=joints, reductions=members))


def _acts_on(joint: Joint, body: str, scene: HeadScene) -> bool:
    """True if a joint connects a body, or a point on it, with space."""
    assert scene.jaw is not None  # the head has a jaw
    own = {scene.jaw.points[n] for n in ("condyle_L", "condyle_R", "bite_L", "bite_R")}
    return any(body in (row.body_a, row.body_b) or row.point in own for row in joint.rows())


def led(preset: str, resolution: str) -> Rows:
    """Passive tissue, and all muscles of tongue and face at 1.0, while the jaw is led to 50 mm.

    Steps are converged: a linearly implicit one evaluates the forces with the bones at their end and the
    tissue at its start, which inverts elements that the bone crosses by a third in a step.
    """
    head, scene = _led(preset, resolution)
    tongue, face = (
        {f"bi_{str(m)[:-2]}": 1.0 for m in head.parts[part]["muscle"].values}
        for part in ("tongue", "face")
    )
    drives = {"none": {}, "tongue": tongue, "face": face, "all": tongue | face}
    for (name, drive), step in itertools.product(drives.items(), (5.0, 20.0, 1.0)):
        if step == 1.0 and name not in ("none", "all"):
            continue
        row = _survives(head, scene, drive, 1e-3 * step, **CONVERGED)
        yield {"muscles": name, "step_ms": step, **row}


CONVERGED: Mapping[str, Any] = {
    "rise": 0.1, "duration": 0.4, "output": 0.04, "integrator": sim.ConvergedEuler(),
}  # fmt: skip
"""Motions of a jaw that is led."""


def _led(preset: str, resolution: str) -> tuple[Head, HeadScene]:
    """Head without contact and 300 kPa, whose jaw is led."""
    head = build_head(ALL, preset=preset, resolution=resolution, contacts=[])
    return head, led_jaw(
        head,
        head_scene(
            head,
            face=SimulationParameters(sigma_max=300e3),
            tongue=TONGUE.model_copy(update={"sigma_max": 300e3}),
        ),
    )


def led_single(preset: str, resolution: str) -> Rows:
    """Every muscle of tongue and face at 1.0, both sides, while the jaw is led to 50 mm."""
    head, scene = _led(preset, resolution)
    for part in ("tongue", "face"):
        for name in sorted({str(m)[:-2] for m in head.parts[part]["muscle"].values}):
            row = _survives(head, scene, {f"bi_{name}": 1.0}, 20e-3, **CONVERGED)
            yield {"muscle": name, "step_ms": 20.0, **row}


PARTS = {
    f.__name__: f
    for f in (actions, opening, led, led_single, cost, face_on_jaw, published_size, precision)
}
ERRORS = "run time s/s", ("error max mm",), "largest error of a point [mm]", "scheme", "scene"
CHARTS = {"precision": Chart(*ERRORS, log=True)}


def main(
    part: str = "actions",
    preset: str = "man",
    resolution: str = "coarse",
    out: Path | None = None,
    rows: int = 1000,
    models: Path | None = None,
) -> None:
    """Run one part and print its table; "stability" continues that of `out`, by at most `rows` rows.

    `models` is the folder of the published models.
    """
    if part == "checks":
        table = checks(models)
    elif part in SWEEPS:
        table = SWEEPS[part](preset, resolution, out, models)
    elif part != "stability":
        table = pd.DataFrame(PARTS[part](preset, resolution))
    else:
        stored = None if out is None else out / "head_stability.csv"
        table = pd.DataFrame(columns=list(LABELS))
        if stored is not None and stored.is_file():
            table = pd.read_csv(stored, keep_default_na=False)
        found = stability(preset, resolution, table)
        for row in itertools.islice(found, rows):
            say(str(row))
            table = pd.concat([table, pd.DataFrame([row])], ignore_index=True)
            if stored is not None:
                write_text(stored, table.to_csv(index=False))
    finish(f"head_{part}", table, out, CHARTS.get(part))


__all__ = ["main"]
