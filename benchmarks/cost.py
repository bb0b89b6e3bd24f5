"""Cost of each part of a scene in a step, and a check that an absent part costs nothing.

Scenes that differ by one part are evaluated alternately, so that changes of the machine's speed
affect all of them. 'The same scene again' is a second, independently compiled copy of the first
scene, whose difference from the first is the noise of the measurement.
"""

import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
import xarray as xr

import sim
from benchmarks.report import Chart, face_of, finish, say
from benchmarks.unit import STEP, unit_seconds
from emgface.face.contact_parameters import NO_CONTACT
from emgface.face.muscle_parameters import SIGMA_MAX
from emgface.face.recipe import compose_scene
from emgface.face.simulation_parameters import SimulationParameters
from sim.linear import ReusedFactor

LEVEL: Final = 0.02
"""Activation of all muscles, which is low because the step is the first one and linear."""
PHASES: Final = ("force", "tangent", "damping", "factorisation", "solution", "step",
                 "step with a new factor")  # fmt: skip


def scenes(face: xr.Dataset) -> dict[str, tuple[sim.Scene, float]]:
    """Scenes by name, with the activation of all muscles; each adds one part to 'tissue alone'."""

    def scene(**changes: Any) -> sim.Scene:
        base = {"sigma_max": SIGMA_MAX, "gravity": False, "alpha": 0.0, "beta": 0.0}
        base["contact"] = NO_CONTACT
        return compose_scene(face, SimulationParameters.model_validate(base | changes))

    def bare(made: sim.Scene, **changes: Any) -> sim.Scene:
        """Drop the muscles."""
        solid = made.terms[0]
        assert isinstance(solid, sim.Solid)
        changed = replace(solid, muscles=None, **changes)
        return replace(made, terms=(changed, *made.terms[1:]))

    alone = bare(scene())
    solid = alone.terms[0]
    assert isinstance(solid, sim.Solid)
    relaxing = tuple(replace(m, relaxation=sim.Prony((0.3,), (0.1,))) for m in solid.materials)
    tense = {"skin": {"kappa": 250e3}, "prestress": {"method": "stretch"}}
    quadratic = {"bulk_potential": "quadratic"}
    return {
        "tissue alone": (alone, 0.0),
        "the same scene again": (bare(scene()), 0.0),
        "+ muscles, at rest": (scene(), 0.0),
        "+ muscles, active": (scene(), LEVEL),
        "+ muscles, active, stiffening 1 (off)": (scene(stiffening=1.0), LEVEL),
        "+ muscles, active, stiffening 10": (scene(stiffening=10.0), LEVEL),
        "+ line muscles, active": (scene(muscle_form="lines"), LEVEL),
        "+ gravity": (bare(scene(gravity=True)), 0.0),
        "+ skin and prestretch": (bare(scene(**tense)), 0.0),
        "+ relaxation": (bare(scene(), materials=relaxing), 0.0),
        "+ walls behind the lips": (bare(scene(support=1000.0)), 0.0),
        "+ damping, current": (replace(alone, damping=sim.Rayleigh()), 0.0),
        "+ damping, at rest": (replace(alone, damping=sim.RestRayleigh()), 0.0),
        "+ element volume": (bare(scene(incompressibility="element", **quadratic)), 0.0),
        "+ nodal volume": (bare(scene(incompressibility="nodal", **quadratic)), 0.0),
        "+ hard volume": (bare(scene(incompressibility="hard")), 0.0),
    }


class _Stepped:
    """One compiled scene and the times of its phases."""

    def __init__(self, scene: sim.Scene, level: float) -> None:
        self.system = sim.compile_scene(scene)
        self.control = self.system.control(np.full(len(self.system.muscles), level))
        self.state = self.system.rest_state()
        self.work = sim.Workspace(self.system)

    def seconds(self) -> dict[str, float]:
        """Seconds of every phase of one linearly implicit step.

        The step is computed twice, first without an earlier factor; 'factorisation' is that of the
        second.
        """
        system, q, clock = self.work.form(self.system), self.state.q, time.perf_counter
        found: dict[str, float] = {}
        start = clock()
        system.force(q, self.control)
        found["force"] = clock() - start
        start = clock()
        _, K = system.tangent(q, self.control)
        found["tangent"] = clock() - start
        start = clock()
        system.damping(q, self.control, K)
        found["damping"] = clock() - start
        if isinstance(self.work.linear, ReusedFactor):
            self.work.linear.forget()
        for name in ("step with a new factor", "step"):
            self.work.seconds.clear()
            start = clock()
            sim.LinearlyImplicitEuler().step(self.system, self.state, self.control, STEP, self.work)
            found[name] = clock() - start
        for phase in ("factorisation", "solution"):
            found[phase] = self.work.seconds.get(phase, 0.0)
        return found


def measure(
    face: xr.Dataset, *, rounds: int = 15, only: Sequence[str] | None = None
) -> pd.DataFrame:
    """Time every scene.

    Times are medians over `rounds` of all scenes, or of those named in `only`. The table has one
    row per scene: milliseconds per phase; force, tangent and step minus those of the first scene;
    the difference of the step between the two halves of the rounds ("spread"); and the step in
    units U of `benchmarks.unit`.
    """
    made = {n: _Stepped(*scene) for n, scene in scenes(face).items() if only is None or n in only}
    times = np.zeros((rounds, len(made), len(PHASES)))
    for k in range(-1, rounds):
        say(f"round {k + 1} of {rounds}")
        for i, scene in enumerate(made.values()):
            found = scene.seconds()
            if k >= 0:  # the first round warms up
                times[k, i] = [1e3 * found[phase] for phase in PHASES]
    whole, half = times[..., PHASES.index("step")], rounds // 2
    table = pd.DataFrame(np.median(times, axis=0), columns=[f"{phase} ms" for phase in PHASES])
    for phase in ("force", "tangent", "step"):
        table[f"{phase} - alone ms"] = table[f"{phase} ms"] - table[f"{phase} ms"].iloc[0]
    table["spread ms"] = np.abs(np.median(whole[:half], axis=0) - np.median(whole[half:], axis=0))
    systems = [scene.system for scene in made.values()]
    table["step U"] = table["step ms"] / (1e3 * unit_seconds(systems[0]))
    table["nonzeros"] = [system.pattern.nnz for system in systems]
    table.insert(0, "scene", list(made))
    return table


def main(out: Path = Path("bench"), face: Path | None = None, rounds: int = 15) -> None:
    """Measure, print and store."""
    phases = ("tangent ms", "factorisation ms", "solution ms")
    chart = Chart("scene", phases, "time of a step [ms]")
    finish("cost", measure(face_of(face), rounds=rounds), out, chart)
