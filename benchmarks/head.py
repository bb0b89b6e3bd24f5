"""Generated head: cost of a step, and error over run time.

    python -m benchmarks head --part cost            # processor time of a step against the face alone
    python -m benchmarks head --part published_size  # the same, as large as the published head
    python -m benchmarks head --part precision --out DIR  # error and run time over scheme and step

All results are simulated. "cost" alternates the scenes, so that the load of the machine affects both.
"""

import statistics
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd

import sim
from benchmarks.report import finish, say
from emgface.anatomy.head.build import build_head
from emgface.anatomy.head.model import Head
from emgface.anatomy.head.run import probes, raised, scene_activation
from emgface.anatomy.head.scene import HeadScene, head_scene
from sim.integrators import Integrator

Rows = Iterator[dict[str, object]]
ALL: Final = ("face", "jaw", "tongue", "hyoid")
FACE_ELEMENTS: Final = 6342  #: of the published face
LEVELS: Final = {"face": {"bi_OOP": 0.2}, "jaw": {"bi_open": 0.1}, "tongue": {"bi_GGP": 0.2}}


def _drive(head: Head, system: sim.System) -> sim.Activation:
    """Lips, openers and tongue of a head, as far as it has them."""
    levels = {k: v for part, own in LEVELS.items() if part in head.named for k, v in own.items()}
    return scene_activation(head, system, raised(levels, jaw=len(head.named) > 1))[0]


SCENES: Final = {
    "face, lips": (("face",), ["lip-lip"]),
    "face, lips and teeth": (("face",), ["lip-lip", "lips-teeth"]),
    "face, jaw, tongue, hyoid; lips": (ALL, ["lip-lip"]),
    "face, jaw, tongue, hyoid; all contacts": (ALL, None),
}


def cost(preset: str, resolution: str) -> Rows:
    """Cost of contact and of all parts of a head."""
    return timed(SCENES, preset, resolution)


def published_size(preset: str, resolution: str) -> Rows:
    """The same with about as many nodes as the published face (8720) and tongue (946) have."""
    scenes = {name: scene for name, scene in SCENES.items() if name != "face, lips and teeth"}
    return timed(scenes, preset, FACE_ELEMENTS, steps=32, repeats=2, tongue_resolution="medium")


def timed(
    scenes: Mapping[str, tuple[Sequence[str], list[str] | None]],
    preset: str,
    resolution: str | int,
    steps: int = 20,
    repeats: int = 3,
    tongue_resolution: str | None = None,
) -> Rows:
    """Median processor time of simulations of `steps` steps of 5 ms, without compiling.

    `scenes` are parts and contacts by name; ratios are those to the first.
    """
    runs = dict[str, tuple[sim.System, sim.Activation]]()
    for name, (parts, contacts) in scenes.items():
        head = build_head(
            parts, preset=preset, resolution=resolution, tongue_resolution=tongue_resolution,
            contacts=contacts,
        )  # fmt: skip
        system = head_scene(head).system
        runs[name] = system, _drive(head, system)
    seconds: dict[str, list[float]] = {name: [] for name in runs}
    for _ in range(repeats):
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
    for name, samples in seconds.items():
        middle = statistics.median(samples)
        yield {
            "scene": name,
            "unknowns": runs[name][0].kinematics.pattern.n,
            "ms_per_step": round(1e3 * middle / steps, 1),
            "over_the_first": round(middle / base, 2),
        }


DURATION: Final = 0.2  #: of the motions whose error is measured [s]
STEPS: Final = (20.0, 10.0, 5.0, 2.5)
SCHEMES: Final[Mapping[str, Integrator]] = {
    "linearly implicit Euler": sim.LinearlyImplicitEuler(),
    "implicit Euler": sim.ConvergedEuler(),
    "SDIRK2": sim.Sdirk2(),
}


def precision(preset: str, resolution: str) -> Rows:
    """Error of the named points of a head over scheme, step and contact, and processor time.

    Errors are distances every 20 ms from SDIRK2 with steps of 1.25 ms, with contacts from linearly
    implicit Euler with 1 ms, which alone is measured there.
    """
    for what, contacts, reference, names in (
        ("without contact", [], ("SDIRK2", 1.25), tuple(SCHEMES)),
        ("all contacts", None, ("linearly implicit Euler", 1.0), ("linearly implicit Euler",)),
    ):
        head = build_head(ALL, preset=preset, resolution=resolution, contacts=contacts)
        scene = head_scene(head)
        exact, _ = _points(head, scene, *reference)
        for name in names:
            for step in STEPS:
                say(f"{what}, {name}, {step:g} ms")
                row = {"scene": what, "scheme": name, "step ms": step}
                try:
                    x, seconds = _points(head, scene, name, step)
                except sim.SimulationError as error:
                    yield {**row, "status": type(error).__name__}
                    continue
                apart = 1e3 * np.linalg.norm(x - exact, axis=2)
                yield {
                    **row,
                    "error rms mm": float(np.sqrt((apart**2).mean())),
                    "error max mm": float(apart.max()),
                    "run time s/s": seconds / DURATION,
                    "status": "ok",
                }


def _points(head: Head, scene: HeadScene, name: str, step: float) -> tuple[np.ndarray, float]:
    """Positions (time, point, axis) of the named points [m], and processor time [s]."""
    began = time.process_time()
    motion, _ = sim.simulate(
        scene.system,
        _drive(head, scene.system),
        duration=DURATION,
        steps=sim.FixedStep(1e-3 * step),
        every=20e-3,
        integrator=SCHEMES[name],
        probes=probes(head, scene)[:1],
    )
    spent = time.process_time() - began
    return motion["position"].transpose("time", "marker", "axis").values, spent


PARTS: Final = {part.__name__: part for part in (cost, published_size, precision)}


def main(
    part: str = "cost", preset: str = "man", resolution: str = "coarse", out: Path | None = None
) -> None:
    """Run one part, print its table and store it."""
    finish(f"head_{part}", pd.DataFrame(PARTS[part](preset, resolution)), out)
