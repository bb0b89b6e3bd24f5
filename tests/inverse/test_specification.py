"""Checks of inverse tracking: required and measured values (``--table`` prints them).

1 particle with 16 muscles; 2 derivatives of a step; 3 known activations of the face; 6 infeasible
targets and contact.
"""

from collections.abc import Callable, Iterator

import numpy as np
import pytest

import sim
from emgface.face.recipe import compose_scene
from emgface.face.simulation_parameters import SimulationParameters
from emgface.face.template import template_face
from emgface.inverse.posterior import Posterior
from emgface.volunteers.instructions import INSTRUCTION_PHASES, true_activation
from sim.inverse import (
    ActiveForces,
    PointTarget,
    Weights,
    minimise_in_box,
    require_affine,
    step_response,
    track,
)
from tests.inverse import test_response as responses
from tests.inverse import test_track as tracks
from tests.inverse.points import constant_muscles, particle
from tests.specification import Result, limited, refused

SIMULATION = SimulationParameters(
    solver="linearly_implicit", gravity=False, contact={"method": "none"}
)
H = 0.01


def particles() -> Iterator[Result]:
    """Check 1."""
    system, last = particle(tracks.ENDS, constant_muscles(tracks.ENDS))
    weights = Weights(size=1e-10, change=0.0)
    tracked, _ = track(system, [tracks.lissajous(last)], duration=0.5, weights=weights)
    error = float(np.abs(tracked["tracked"] - tracked["wanted"]).max()) * 1e-3 / 3e-3
    yield limited("1 Lissajous figure, distance over its size", error, 1e-6)
    programmes = [minimise_in_box(*tracks.problem(seed)).violation for seed in range(1000)]
    worst = max(float(tracked["violation"].max()), *programmes)
    yield limited("1 change of one activation that is left, and in 1000 programmes", worst, 1e-10)
    rng = np.random.default_rng(0)
    J = 1.0 + 0.3 * rng.random((3, 16))
    y = J @ np.full(16, 0.4)
    least = minimise_in_box(J.T @ J + 1e-7 * np.eye(16), J.T @ y, np.zeros(16), np.ones(16)).x
    error = float(np.abs(least - np.linalg.pinv(J) @ y).max())
    yield limited("1 weight of the size: distance from the solution of least norm", error, 1e-6)


def derivatives() -> Iterator[Result]:
    """Check 2."""

    def off(response: np.ndarray, exact: np.ndarray) -> float:
        return float(np.abs(response - exact).max() / np.abs(exact).max())

    for name, (make, integrator) in responses.CASES.items():
        system = make()
        work, a = sim.Workspace(system), responses.A0
        state = responses.moving(system, integrator, work)
        response = step_response(system, integrator, state, a, H, work, ActiveForces(system))
        exact = responses.differences(system, integrator, state, a)
        yield limited(f"2 H against differences: {name}", off(response.H, exact), 1e-6)
    system, state, response = responses.pressed()
    closed = responses.closed_nodes(system, state, response)
    exact = responses.held_differences(system, state, response, closed)
    yield limited(f"2 H with {response.rows} rows of contact", off(response.H, exact), 1e-6)
    stiffening = responses.block(terms=(responses.stiffening,))
    yield refused(
        "2 affine form with stiffening", sim.SceneError, lambda: require_affine(stiffening)
    )


def known() -> Iterator[Result]:
    """Check 3: all nodes of the template tracked, and a point whose muscles are redundant."""
    system = sim.compile_scene(compose_scene(template_face(resolution="coarse"), SIMULATION))
    t = H * np.arange(51)
    for instruction in INSTRUCTION_PHASES:
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
        tracked, _ = track(system, [target], duration=0.5, weights=weights)
        error = float(np.abs(tracked["activation"].values.T - true[1:]).max())
        yield limited(f"3 error of all activations, instruction {instruction}", error, 1e-4)
    yield null_directions()


def null_directions() -> Result:
    """Share of the error of 16 muscles at one point that the unresolved directions do not contain."""
    system, last = particle(tracks.ENDS, constant_muscles(tracks.ENDS))
    true, work = np.random.default_rng(0).uniform(0.2, 0.6, 16), sim.Workspace(system)
    euler, active, silent = sim.LinearlyImplicitEuler(), ActiveForces(system), np.zeros(16)
    response = step_response(system, euler, system.rest_state(), silent, H, work, active)
    J = 1e6 * H * response.H  # the position in micrometres
    rest, precision = np.full(16, 0.4), np.full(16, 1e-4)
    covariance = np.linalg.inv(J.T @ J + np.diag(precision))
    posterior = Posterior(covariance @ (J.T @ (J @ true) + precision * rest), covariance)
    free = posterior.unresolved(np.full(16, 1e2))
    error = posterior.mean - true
    inside = np.linalg.lstsq(free.T, error, rcond=None)[0] @ free
    left = float(np.linalg.norm(error - inside) / np.linalg.norm(error))
    name = (
        f"3 redundant muscles: error {np.abs(error).max():.2f} outside {len(free)} null directions"
    )
    assert last == len(tracks.ENDS)
    return limited(name, left, 1e-4)


def limits() -> Iterator[Result]:
    """Check 6."""
    for name, (tracked, end), jump in (
        ("6 target 50 mm away", tracks.infeasible(), 0.05),
        ("6 contact that opens and closes", tracks.pressed_and_released(), 0.1),
    ):
        a = np.concatenate(
            [np.zeros((len(tracked["muscle"]), 1)), tracked["activation"].values], axis=1
        )
        bounded = bool(a.min() >= 0.0 and a.max() <= 1.0 and np.isfinite(end.q).all())
        text = f"{a.min():.2g} to {a.max():.2g}, last misfit {float(tracked['misfit'][-1]):.3g}"
        yield Result(f"{name}: activations and misfit", "within 0-1, finite", text, bounded)
        largest = float(np.abs(np.diff(a, axis=1)).max())
        yield limited(f"{name}: largest change in a step", largest, jump + 1e-12)
        if "contact" in name:
            rows = tracked["rows"].values
            text = f"{rows.min():.0f} to {rows.max():.0f}"
            yield Result(f"{name}: rows", "several numbers", text, bool(rows.max() > rows.min()))


FAST = particles, limits, lambda: iter([null_directions()])
SLOW = derivatives, known


@pytest.mark.parametrize("check", FAST)
def test_required_values_are_met(check: Callable[[], Iterator[Result]], specified) -> None:
    specified(check())


@pytest.mark.slow
@pytest.mark.parametrize("check", SLOW)
def test_required_values_of_faces_and_laws_are_met(check, specified) -> None:
    specified(check())


def test_the_null_directions_of_redundant_muscles_are_counted() -> None:
    assert "14 null directions" in null_directions().check
