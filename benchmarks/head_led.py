"""A head whose jaw is led to 50 mm, and motions of any head that may fail.

Parts of ``python -m benchmarks head``.
"""

import itertools
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr
from scipy.optimize import brentq

import sim
from benchmarks.head_sweeps import ALL
from emgface.anatomy.head.build import build_head
from emgface.anatomy.head.model import Head
from emgface.anatomy.head.run import raised, simulate_head
from emgface.anatomy.head.scene import TONGUE, HeadScene, head_scene
from emgface.face.simulation_parameters import SimulationParameters
from sim.integrators import Integrator
from sim.joints import Joint

Rows = Iterator[dict[str, object]]


def moved(motion: xr.Dataset, marker: str, k: int = -1) -> np.ndarray:
    """Displacement of a point from the start to an output [mm]."""
    x = motion["position"].sel(marker=marker).transpose("time", "axis").values
    return 1e3 * (x[k] - x[0])


def survives(
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
        row = survives(head, scene, drive, 1e-3 * step, **CONVERGED)
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
            row = survives(head, scene, {f"bi_{name}": 1.0}, 20e-3, **CONVERGED)
            yield {"muscle": name, "step_ms": 20.0, **row}
