"""What each part of a scene costs in a step, and that an absent part costs nothing.

Scenes that differ by one part are evaluated in turn, round after round, so that a drift of the machine
hits all of them. Every time is the median over the rounds; the spread beside it is that between the two
halves of the rounds. 'The same again' is a second, independently compiled copy of the first scene: what
it differs by is the noise of the measurement, and a part that is switched off must not differ by more.

    python benchmarks/cost_of_parts.py FACE.nc [--rounds 15] [--out cost.csv]
"""

import argparse
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

import sim
from emgface.face.model import load_face
from emgface.face.recipe import compose_scene
from emgface.face.simulation_parameters import SimulationParameters

LEVEL = 0.02  # of all muscles; low, since the step is the first one and linear
SIGMA_MAX = 100e3
PHASES = ("force", "tangent", "damping", "factorisation", "solution", "whole step")


def scenes(face):
    """Name to (scene, share of activation); each differs from 'tissue alone' by what it is named."""

    def scene(**changes):
        base = {"sigma_max": SIGMA_MAX, "gravity": False, "alpha": 0.0, "beta": 0.0}
        return compose_scene(face, SimulationParameters(**(base | changes)))

    def bare(made):
        """The scene without its muscles."""
        solid = replace(made.terms[0], muscles=None)
        return replace(made, terms=(solid, *made.terms[1:]))

    alone = bare(scene())
    quadratic = {"bulk_potential": "quadratic"}
    tense = {"skin": {"kappa": 250e3}, "prestress": {"method": "stretch"}}
    return {
        "tissue alone": (alone, 0.0),
        "the same again": (bare(scene()), 0.0),
        "+ muscles, at rest": (scene(), 0.0),
        "+ muscles, active": (scene(), LEVEL),
        "+ muscles, active, stiffening 1 (off)": (scene(stiffening=1.0), LEVEL),
        "+ muscles, active, stiffening 10": (scene(stiffening=10.0), LEVEL),
        "+ muscles at rest, stiffening 10": (scene(stiffening=10.0), 0.0),
        "+ line muscles, active": (scene(muscle_form="lines"), LEVEL),
        "+ gravity": (bare(scene(gravity=True)), 0.0),
        "+ skin and prestretch": (bare(scene(**tense)), 0.0),
        "+ walls behind the lips": (bare(scene(support=1000.0)), 0.0),
        "+ damping, current": (replace(alone, damping=sim.Rayleigh()), 0.0),
        "+ damping, at rest": (replace(alone, damping=sim.RestRayleigh()), 0.0),
        "+ element volume": (bare(scene(incompressibility="element", **quadratic)), 0.0),
        "+ nodal volume": (bare(scene(incompressibility="nodal", **quadratic)), 0.0),
    }


class Stepped:
    """One compiled scene, ready to be timed phase by phase."""

    def __init__(self, scene, level):
        self.system = sim.compile_scene(scene)
        self.control = self.system.control(np.full(len(self.system.muscles), level))
        self.state = self.system.rest_state()
        self.work = sim.Workspace(self.system)
        self.step = sim.LinearlyImplicitEuler()

    def times(self):
        """Seconds of every phase, once."""
        system, q, control, h = self.system, self.state.q, self.control, 0.01
        found, clock = {}, time.perf_counter
        start = clock()
        system.force(q, control)
        found["force"] = clock() - start
        start = clock()
        _, K = system.tangent(q, control)
        found["tangent"] = clock() - start
        start = clock()
        D = system.damping(q, control, K)
        found["damping"] = clock() - start
        A = h * D + h * h * K
        A[system.pattern.diagonal] += system.mass
        rhs = np.ones(system.pattern.n)
        self.work.seconds.clear()
        start = clock()
        self.work.solve_any(A, rhs)
        both = clock() - start
        found["factorisation"] = self.work.seconds["factorisation"]
        found["solution"] = both - found["factorisation"]
        start = clock()
        self.step.step(system, self.state, control, h, self.work)
        found["whole step"] = clock() - start
        return found


def measure(face, rounds):
    """Median milliseconds of every scene and phase, with the spread of the whole step."""
    made = {name: Stepped(*scene) for name, scene in scenes(face).items()}
    times = {name: {phase: [] for phase in PHASES} for name in made}
    for k in range(rounds + 1):
        for name, scene in made.items():
            for phase, seconds in scene.times().items():
                if k:  # the first round warms up
                    times[name][phase].append(1e3 * seconds)
    rows = {}
    for name, found in times.items():
        row = {phase: float(np.median(values)) for phase, values in found.items()}
        whole = np.array(found["whole step"])
        halves = np.median(whole[: rounds // 2]), np.median(whole[rounds // 2 :])
        row["spread of step"] = float(abs(halves[1] - halves[0]))
        row["unknowns"] = made[name].system.pattern.n
        row["non-zeros (million)"] = made[name].system.pattern.nnz / 1e6
        rows[name] = row
    table = pd.DataFrame.from_dict(rows, orient="index").rename_axis("scene")
    for phase in ("force", "tangent"):
        table.insert(
            PHASES.index(phase) * 2 + 1, f"{phase} - alone", table[phase] - table[phase].iloc[0]
        )
    return table


def main():
    """Print the table and write it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("face", type=Path)
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    face = load_face(options.face)
    table = measure(face, options.rounds)
    print(f"{face.attrs['name']}, milliseconds, medians of {options.rounds} alternating rounds")
    print(table.round(2).to_string())
    if options.out:
        options.out.parent.mkdir(parents=True, exist_ok=True)
        table.round(3).to_csv(options.out)


if __name__ == "__main__":
    main()
