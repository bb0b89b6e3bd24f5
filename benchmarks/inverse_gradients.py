"""Derivatives over a trial: cost against the number of coefficients, and kinks by contact.

    python -m benchmarks inverse-gradients [--part cost|contact]

`--part cost`: processor time of a step of the face with the derivatives of the markers by all spline
coefficients, propagated forward, for several distances of the splines. The line "adjoint, at least" is
the intercept of a straight line through these times: the step, its factor and the derivatives of its
equation, which an adjoint requires as well, without any column. Below it are the gradients that the
bounded quasi-Newton method L-BFGS-B needs for the first quadratic model of a trial.

`--part contact`: with contact, the derivative along a random direction against differences of the
trial over shorter and shorter ways, and the number of steps whose set of contacts changes on the way.
"""

import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.optimize import minimize

import sim
import sim.inverse.sensitivities as sensitivities
from benchmarks.inverse import SIMULATION
from benchmarks.report import finish, say
from emgface.face.motion import settle_face
from emgface.face.recipe import compose_scene
from emgface.face.simulation_parameters import SimulationParameters
from emgface.face.template import template_face
from sim.inverse import PointTarget, Splines, linearise, minimise_in_box, prior

H = 0.01
DURATION = 0.8
SPACINGS = (0.8, 0.4, 0.2, 0.1, 0.06, 0.03)
WAYS = (1e-1, 1e-2, 1e-3, 1e-5)
PURSED = {"OOP": 0.5, "OOM": 0.3, "BUC": 0.2, "DAO": 0.2}  #: activations; others have 0.02
ENOUGH = 1e-3  #: share of the largest decrease that may be left


def main(part: str = "cost", out: Path | None = None) -> None:
    """Measure and print."""
    table = {"cost": cost, "contact": contact}[part](template_face(resolution="coarse"))
    finish(f"inverse_gradients_{part}", table, out)


def _course(splines: Splines, muscles: tuple[str, ...], most: float) -> np.ndarray:
    """Coefficients of activations that rise and fall once."""
    level = np.array([PURSED.get(m[:-2], 0.02) for m in muscles])
    t = np.linspace(0.0, 1.0, splines.n)
    return np.clip(most * np.sin(np.pi * t) ** 2, 0.2, 1.0)[:, None] * level


def cost(face) -> pd.DataFrame:
    """Times for each distance of the splines."""
    system = sim.compile_scene(compose_scene(face, SIMULATION))
    nodes, work = face["marker_node"].values.astype(np.int64), sim.Workspace(system)
    target = [PointTarget(nodes, np.zeros(1), system.mesh.X[None, nodes] + 1e-3, 1e-3)]
    rows, steps = [], round(DURATION / H)
    for number, spacing in enumerate((SPACINGS[0], *SPACINGS)):  # the first warms the kernels
        splines = Splines(DURATION, spacing)
        c = _course(splines, system.muscles, 0.6)
        spent = []
        for derivatives in (False, True):
            begun = time.process_time()
            found = linearise(system, target, splines, c, h=H, work=work, derivatives=derivatives)
            spent.append(1e3 * (time.process_time() - begun) / steps)
        if number:
            rows.append((f"{spacing:g} s", c.size, *spent, spent[1] / spent[0]))
        if spacing == 0.06 and number:
            told = gradients(found, splines, len(system.muscles))
    names = [
        "distance of the splines",
        "coefficients",
        "step [ms]",
        "with derivatives [ms]",
        "ratio",
    ]
    table = pd.DataFrame(rows, columns=names)
    _, least = np.polyfit(table[names[1]], table[names[3]], 1)
    step = float(table[names[2]].median())
    table.loc[len(table)] = ("adjoint, at least", "", step, float(least), float(least) / step)
    say(told)
    return table


def gradients(found: sim.inverse.Linearised, splines: Splines, n: int) -> str:
    """Gradients that L-BFGS-B needs for the quadratic model that one set of derivatives determines."""
    t = H * np.arange(1, len(found.residual) + 1)
    silent = np.zeros((len(t), n))
    problem = found.normal(1.0) + prior(splines, t, 0.5, 0.3, 2.0, silent, np.zeros(n))
    low, high = np.zeros(len(problem.c)), np.ones(len(problem.c))
    best = problem.value(minimise_in_box(problem.Q, problem.c, low, high).x)
    values: list[float] = []

    def both(x: np.ndarray) -> tuple[float, np.ndarray]:
        values.append(problem.value(x) - best)
        return values[-1], problem.Q @ x - problem.c

    minimize(
        both, low, jac=True, method="L-BFGS-B", bounds=list(zip(low, high, strict=True)),
        options={"maxiter": 20000, "maxfun": 20000, "ftol": 0.0, "gtol": 0.0},
    )  # fmt: skip
    enough = int(np.argmax(np.array(values) <= ENOUGH * values[0]))
    reached = "" if values[enough] <= ENOUGH * values[0] else "not even after "
    return (
        f"L-BFGS-B reaches the minimum of the quadratic model of {len(low)} coefficients within "
        f"{ENOUGH:g} of the decrease after {reached}{enough or len(values)} gradients"
    )


class _Listed(sensitivities.LinearRows):
    """Solver of contact steps that lists the active rows of every step."""

    found: list[tuple] = []

    def solve(self):
        """Solution of the step."""
        solution = super().solve()
        self.found.append(tuple(solution.active.keys))
        return solution


def contact(face) -> pd.DataFrame:
    """Errors of the derivative against differences over shorter ways, for two tolerances."""
    mechanics = SimulationParameters(solver="linearly_implicit", gravity=False, sigma_max=115e3)
    q = np.ascontiguousarray(settle_face(face, mechanics)["node_position"].values)
    scene, nodes = compose_scene(face, mechanics), face["marker_node"].values.astype(np.int64)
    sensitivities.LinearRows = _Listed
    rows = []
    for tolerance in (2e-3, 2e-4):
        terms = (
            replace(t, tolerance=tolerance) if isinstance(t, sim.ConstraintContact) else t
            for t in scene.terms
        )
        system = sim.compile_scene(replace(scene, terms=tuple(terms)))
        try:
            rows += [(tolerance, *row) for row in _along(system, q, nodes)]
        except sim.NotConverged as error:
            say(f"tolerance {tolerance:g}: {error}")
    names = [
        "tolerance of the contact", "way", "steps", "contacts change in, least", "most",
        "largest error of a step over the largest derivative",
    ]  # fmt: skip
    return pd.DataFrame(rows, columns=names)


def _along(system: sim.System, q: np.ndarray, nodes: np.ndarray) -> list[tuple]:
    """Derivative along a random direction against differences, from a settled face."""
    rest = system.rest_state()
    start, work = sim.State(0.0, q, rest.v, rest.memory), sim.Workspace(system)
    target = [PointTarget(nodes, np.zeros(1), q[None, nodes], 1e-3)]
    splines = Splines(0.2, 0.1)
    a = np.array([PURSED.get(m[:-2], 0.02) for m in system.muscles])
    c = np.linspace(0.2, 1.0, splines.n)[:, None] * a
    way = np.random.default_rng(1).standard_normal(c.shape) * a

    def at(c: np.ndarray, derivatives: bool = False):
        _Listed.found.clear()
        one = linearise(
            system, target, splines, c, decayed=0.0, initial=start, work=work,
            derivatives=derivatives,
        )  # fmt: skip
        return one, list(_Listed.found)

    here, contacts = at(c, True)
    along, rows = here.J @ way.ravel(), []
    for size in WAYS:
        (ahead, one), (behind, two) = at(c + size * way), at(c - size * way)
        slope = (behind.residual - ahead.residual) / (2.0 * size)
        error = np.linalg.norm(along - slope, axis=1) / np.linalg.norm(slope, axis=1).max()
        changed = [sum(x != y for x, y in zip(o, contacts, strict=True)) for o in (one, two)]
        rows.append((size, len(contacts), min(changed), max(changed), float(error.max())))
    return rows
