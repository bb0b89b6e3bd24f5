"""Seven checks of inverse tracking: what was wanted, what is measured, and whether it is met.

    python -m benchmarks inverse-checks [RECORDING.nc ...] [--only 1,2,6]

1 particle with 16 muscles; 2 derivatives of a step; 3 known activations of the face; 4 variants and
weights of the sEMG on simulated volunteers, whose recordings are the arguments; 5 stored run of a jaw,
with the published model; 6 infeasible targets and contact; 7 cost. The form is that of steps. A check
whose recordings or models are absent is listed as not run.
"""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import pandas as pd
import typer

import sim
from benchmarks.inverse import SIMULATION, inverted, means
from benchmarks.report import markdown
from benchmarks.unit import unit_seconds
from emgface.face.motion import settle_face
from emgface.face.recipe import compose_scene
from emgface.face.template import template_face
from emgface.volunteers.instructions import PHASES, true_activation
from sim.inverse import (
    ActiveForces,
    PointTarget,
    Weights,
    laplace,
    minimise_in_box,
    require_affine,
    step_response,
    track,
)
from tests.inverse import test_response as responses
from tests.inverse import test_track as tracks
from tests.inverse.points import constant_muscles, particle

WEIGHTS = tuple(f"step:assisted:{10.0**k:g}" for k in range(-3, 4))
PUBLISHED = 0.83  #: correlation of activations with sEMG, simulated data, Eskes et al. 2017
COARSE = {"step": 0.02, "output": 0.02, "sigma_max": 115e3}  #: steps and stress of check 4
H = 0.01


@dataclass(frozen=True)
class Result:
    """One line of the table; `passed` is None if the check was not run."""

    check: str
    wanted: str
    measured: str
    passed: bool | None


def limited(check: str, value: float, limit: float, unit: str = "") -> Result:
    """Line of a value that must not exceed a limit."""
    measured = f"{value:.2g}{unit}"
    return Result(check, f"at most {limit:g}{unit}", measured, bool(value <= limit))


def particles() -> Iterator[Result]:
    """Check 1."""
    system, last = particle(tracks.ENDS, constant_muscles(tracks.ENDS))
    weights = Weights(size=1e-10, change=0.0)
    found, _ = track(system, [tracks.lissajous(last)], duration=0.5, weights=weights)
    error = float(np.abs(found["tracked"] - found["wanted"]).max()) * 1e-3 / 3e-3
    yield limited("1 Lissajous figure, distance over its size", error, 1e-6)
    programmes = [minimise_in_box(*tracks.problem(seed)).violation for seed in range(1000)]
    worst = max(float(found["violation"].max()), *programmes)
    yield limited("1 change of one activation that is left, and in 1000 programmes", worst, 1e-10)
    rng = np.random.default_rng(0)
    J = 1.0 + 0.3 * rng.random((3, 16))
    y = J @ np.full(16, 0.4)
    least = minimise_in_box(J.T @ J + 1e-7 * np.eye(16), J.T @ y, np.zeros(16), np.ones(16)).x
    error = float(np.abs(least - np.linalg.pinv(J) @ y).max())
    yield limited("1 weight of the size: distance from the solution of least norm", error, 1e-6)


def derivatives() -> Iterator[Result]:
    """Check 2."""

    def off(found: np.ndarray, exact: np.ndarray) -> float:
        return float(np.abs(found - exact).max() / np.abs(exact).max())

    for name, (make, integrator) in responses.CASES.items():
        system = make()
        work, a = sim.Workspace(system), responses.A0
        state = responses.moving(system, integrator, work)
        found = step_response(system, integrator, state, a, H, work, ActiveForces(system))
        exact = responses.differences(system, integrator, state, a)
        yield limited(f"2 H against differences: {name}", off(found.H, exact), 1e-6)
    system, state, found = responses.pressed()
    closed = responses.closed_nodes(system, state, found)
    exact = responses.held_differences(system, state, found, closed)
    yield limited(f"2 H with {found.rows} rows of contact", off(found.H, exact), 1e-6)
    try:
        require_affine(responses.block(terms=(responses.stiffening,)))
        refused = False
    except sim.SceneError:
        refused = True
    yield Result(
        "2 affine form with stiffening", "refused", "refused" if refused else "no", refused
    )


def known() -> Iterator[Result]:
    """Check 3: all nodes of the template tracked, and a point whose muscles are redundant."""
    system = sim.compile_scene(compose_scene(template_face(resolution="coarse"), SIMULATION))
    t = H * np.arange(51)
    for instruction in PHASES:
        truth = true_activation(instruction).sel(muscle=list(system.muscles))
        total = truth.sum("muscle").values
        onset = float(truth["time_true"][int((total > 0.5 * total.max()).argmax())])
        true = truth.interp(time_true=max(onset - 0.2, 0.0) + t).transpose("time_true", ...).values
        motion, _ = sim.simulate(
            system, sim.Activation(t, true), duration=0.5, integrator=sim.LinearlyImplicitEuler(),
            steps=sim.FixedStep(H), probes=(sim.Positions(),),
        )  # fmt: skip
        q = motion["node_position"].transpose("time", ...).values
        target = PointTarget(np.arange(q.shape[1]), motion["time"].values, q, 1e-6)
        weights = Weights(size=0.0, change=1e-12, rounds=3)
        found, _ = track(system, [target], duration=0.5, weights=weights)
        error = float(np.abs(found["activation"].values.T - true[1:]).max())
        yield limited(f"3 error of all activations, instruction {instruction}", error, 1e-4)
    yield null_directions()


def null_directions() -> Result:
    """Share of the error of 16 muscles at one point that the unresolved directions do not contain."""
    system, last = particle(tracks.ENDS, constant_muscles(tracks.ENDS))
    true, work = np.random.default_rng(0).uniform(0.2, 0.6, 16), sim.Workspace(system)
    euler, active, silent = sim.LinearlyImplicitEuler(), ActiveForces(system), np.zeros(16)
    found = step_response(system, euler, system.rest_state(), silent, H, work, active)
    J = 1e6 * H * found.H  # the position in micrometres
    rest, precision = np.full(16, 0.4), np.full(16, 1e-4)
    posterior = laplace(J, J @ true, silent, rest, precision)
    free = posterior.unresolved(np.full(16, 1e2))
    error = posterior.mean - true
    inside = np.linalg.lstsq(free.T, error, rcond=None)[0] @ free
    left = float(np.linalg.norm(error - inside) / np.linalg.norm(error))
    name = (
        f"3 redundant muscles: error {np.abs(error).max():.2f} outside {len(free)} null directions"
    )
    assert last == len(tracks.ENDS)
    return limited(name, left, 1e-4)


def variants(recordings: Sequence[Path]) -> Iterator[Result]:
    """Check 4."""
    wanted = f"motion < hybrid <= assisted >= {PUBLISHED}"
    if not recordings:
        yield Result("4 variants", wanted, "not run, no recordings", None)
        return
    face = template_face(resolution="coarse")
    mechanics = SIMULATION.model_copy(update=COARSE)
    rest = settle_face(face, mechanics)
    settings, rows = ["step:motion", "step:hybrid", *WEIGHTS], []
    for path in recordings:
        rows += inverted(path, settings, face, rest, mechanics, None)[0]
    table = means(rows).set_index("setting")
    swept = table.loc[list(WEIGHTS)]
    knee = str(swept["left out [mm]"].idxmin())
    three = {"motion": "step:motion", "hybrid": "step:hybrid", f"assisted {knee[14:]}": knee}
    r = {label: float(table["correlation"][setting]) for label, setting in three.items()}
    low, middle, high = r.values()
    told = ", ".join(f"{label} {value:.2f}" for label, value in r.items())
    yield Result(
        f"4 correlation of activations, {len(recordings)} trials", wanted, told,
        low < middle <= high and high >= PUBLISHED,
    )  # fmt: skip
    moved = swept["left out [mm]"]
    yield Result(
        "4 weight of the sEMG from 1e-3 to 1e3: knee by left-out markers",
        "inside",
        f"{knee[14:]}: {moved.min():.2f} mm, ends {moved.iloc[0]:.2f} and {moved.iloc[-1]:.2f} mm",
        knee not in (WEIGHTS[0], WEIGHTS[-1]),
    )


def jaw() -> Iterator[Result]:
    """Check 5."""
    from benchmarks.inverse_recorded import STORED
    from benchmarks.inverse_recorded import jaw as stored

    if not STORED.is_dir():
        yield Result("5 stored run of the jaw", "rms at most 0.05 mm", "not run, no model", None)
        return
    (row,) = stored()
    yield limited("5 incisor, rms distance", row["rms"], 0.05, " mm")
    yield limited("5 largest closer", row["largest closer"], 0.01)
    openers = row["largest closer"] < row["largest opener"]
    yield Result("5 largest activation", "an opener", row["largest"], openers)


def limits() -> Iterator[Result]:
    """Check 6."""
    for name, (found, end), jump in (
        ("6 target 50 mm away", tracks.infeasible(), 0.05),
        ("6 contact that opens and closes", tracks.pressed_and_released(), 0.1),
    ):
        a = np.concatenate(
            [np.zeros((len(found["muscle"]), 1)), found["activation"].values], axis=1
        )
        bounded = bool(a.min() >= 0.0 and a.max() <= 1.0 and np.isfinite(end.q).all())
        told = f"{a.min():.2g} to {a.max():.2g}, last misfit {float(found['misfit'][-1]):.3g}"
        yield Result(f"{name}: activations and misfit", "within 0-1, finite", told, bounded)
        largest = float(np.abs(np.diff(a, axis=1)).max())
        yield limited(f"{name}: largest change in a step", largest, jump + 1e-12)
        if "contact" in name:
            rows = found["rows"].values
            told = f"{rows.min():.0f} to {rows.max():.0f}"
            yield Result(f"{name}: rows", "several numbers", told, bool(rows.max() > rows.min()))


def cost() -> Iterator[Result]:
    """Check 7: medians of processor times, taken in turn, kernels warm."""
    face = template_face(resolution="coarse")
    system = sim.compile_scene(compose_scene(face, SIMULATION))
    work, nodes = sim.Workspace(system), face["marker_node"].values.astype(np.int64)
    goal = system.mesh.X[nodes][None] + np.array([0.0, 0.0, 1e-3])
    target = PointTarget(nodes, np.zeros(1), goal, 1e-3)
    integrator, pairs = sim.LinearlyImplicitEuler(), []
    for k in range(8):
        state, begun = system.rest_state(), time.process_time()
        for i in range(10):
            control = sim.Control(np.full(20, 0.01 * i), state.t + H)
            state, _ = integrator.step(system, state, control, H, work)
        middle = time.process_time()
        track(system, [target], duration=0.1, weights=Weights(chase=0.05), work=work)
        if k:
            pairs.append((middle - begun, time.process_time() - middle))
    forward, tracked = np.median(pairs, axis=0) / 10
    unit = unit_seconds(system, time.process_time)
    yield limited(
        f"7 tracked step ({tracked / unit:.1f} U) over forward step ({forward / unit:.1f} U), "
        f"U = {1e3 * unit:.1f} ms",
        float(tracked / forward), 2.0,
    )  # fmt: skip


def run(only: str = "", recordings: Sequence[Path] = ()) -> list[Result]:
    """Lines of the checks with these numbers, all by default."""
    checks: dict[str, Callable[[], Iterator[Result]]] = {
        "1": particles, "2": derivatives, "3": known, "4": lambda: variants(recordings), "5": jaw,
        "6": limits, "7": cost,
    }  # fmt: skip
    return [one for key, check in checks.items() if not only or key in only.split(",")
            for one in check()]  # fmt: skip


def main(
    recordings: Annotated[
        list[Path] | None, typer.Argument(help="Of simulated volunteers.")
    ] = None,
    only: Annotated[str, typer.Option(help="Numbers of checks, separated by commas.")] = "",
) -> None:
    """Run the checks and print their table."""
    told = {True: "yes", False: "**no**", None: ""}
    table = pd.DataFrame(
        [(o.check, o.wanted, o.measured, told[o.passed]) for o in run(only, recordings or [])],
        columns=["check", "required", "measured", "met"],
    )
    print(markdown(table), flush=True)
