"""Row of invalid input."""

from collections.abc import Iterator

import numpy as np

import sim
from benchmarks.integrators import EXPLICIT, IMPLICIT, STATIC
from benchmarks.stability.bodies import Block, driven
from benchmarks.stability.material_rows import STEP
from benchmarks.stability.trial import Trial

TITLE = "invalid activation or muscle"


def bad_input() -> Iterator[Trial]:
    """Row 10: invalid activations and muscles, each refused by its own error."""
    for name, value in (
        ("NaN", np.nan), ("infinite", np.inf), ("negative", -0.1), ("above 1", 1.1),
    ):  # fmt: skip
        yield Trial(
            10, TITLE, f"{name} activation", Block().system, driven((value, 0.0), 0.1), 0.1, STEP,
            IMPLICIT | STATIC | EXPLICIT, refusal="ControlError",
        )  # fmt: skip
    for name, make, refusal in (
        ("muscle without elements", _empty_muscle, "SceneError"),
        ("fibre outside the mesh", _fibre_outside, "MeshError"),
    ):
        yield Trial(
            10, TITLE, name, make, driven((0.0, 0.0), 0.1), 0.1, STEP,
            {"Euler": IMPLICIT["Euler"]}, refusal=refusal,
        )  # fmt: skip


def _empty_muscle() -> sim.System:
    sim.Muscles(("none",), np.zeros(0, int), np.zeros(0, int), np.zeros((0, 3)))
    raise AssertionError("a muscle without elements was accepted")


def _fibre_outside() -> sim.System:
    scene = Block().scene()
    line = sim.LineMuscles(
        ("out",), (sim.LineFibre(0, np.array([[1.0, 1.0, 1.0], [1.1, 1.0, 1.0]])),)
    )
    return sim.compile_scene(sim.Scene(scene.mesh, (*scene.terms, line), scene.reductions))
