"""Quasi-static inverse tracking: known activations, optimality, targets out of reach."""

from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr

import sim
from emgface.inverse.doubts import doubts
from emgface.inverse.run import motion_misfit
from sim.inverse import PointTarget, SeparationTarget, Weights, equilibria
from tests.inverse.test_response import block

TIMES = np.array([0.5, 1.0])
TRUE = np.array([[0.3, 0.05], [0.1, 0.4]])
EXACT = sim.Static(tolerance=1e-10, residual_tolerance=1e-8)


@pytest.fixture(scope="module")
def tracked():
    """A block, two of its nodes, and their positions in two equilibria with known activations."""
    system, positions = block(), []
    state, work = system.rest_state(), sim.Workspace(system)
    for t, a in zip(TIMES, TRUE, strict=True):
        state, _ = EXACT.step(system, state, sim.Control(a, t), 0.5, work)
        positions.append(state.q)
    nodes = np.array([25, 26])
    return system, nodes, np.array(positions)[:, nodes]


def test_known_activations_are_recovered_from_two_nodes(tracked):
    system, nodes, position = tracked
    target = PointTarget(nodes, TIMES, position, 1e-6)
    weights = Weights(size=0.0, change=1e-12)
    states, state = equilibria(
        system, [target], TIMES, weights=weights, static=EXACT, tolerance=1e-9
    )
    assert states["activation"].values == pytest.approx(TRUE.T, abs=1e-5)
    assert state.t == pytest.approx(1.0)
    assert float(states["violation"].max()) <= 1e-10


def test_activations_minimise_the_objective(tracked):
    """With weights that matter, no small change of an activation lowers the objective."""
    system, nodes, position = tracked
    target, w = PointTarget(nodes, TIMES, position, 1e-3), Weights(size=0.1, change=0.0)
    states, _ = equilibria(system, [target], TIMES[:1], weights=w, static=EXACT, tolerance=1e-9)
    best = states["activation"].values[:, 0]

    def objective(a):
        work = sim.Workspace(system)
        q = EXACT.step(system, system.rest_state(), sim.Control(a), 1.0, work)[0].q
        r = (target.value(q) - target.wanted(0.5)) / target.size
        return 0.5 * (r @ r) + 0.05 * (a @ a)

    least = objective(best)
    for change in (1e-3, -1e-3):
        for i in range(2):
            a = best.copy()
            a[i] = max(a[i] + change, 0.0)
            assert objective(a) >= least


def test_a_target_out_of_reach_saturates_and_lost_markers_are_left_out(tracked):
    system, nodes, position = tracked
    far = position[:1] + 20.0 * (position[:1] - system.mesh.X[nodes])
    states, _ = equilibria(
        system, [PointTarget(nodes, TIMES[:1], far, 1e-3)], TIMES[:1], weights=Weights(size=1e-9)
    )
    assert float(states["saturated"][0]) >= 1
    assert float(states["activation"].max()) <= 1.0
    lost = PointTarget(nodes, TIMES, np.full_like(position, np.nan), 1e-3)
    states, _ = equilibria(system, [lost], TIMES)
    assert float(np.abs(states["activation"]).max()) == 0.0
    assert np.isnan(states["misfit"]).all()


def test_a_separation_is_followed(tracked):
    system, nodes, _ = tracked
    base = np.flatnonzero(system.mesh.X[:, 2] == 0.0)
    rest = SeparationTarget(nodes, base, np.zeros(1), np.zeros(1)).value(system.mesh.X)[0]
    target = SeparationTarget(nodes, base, TIMES, rest - np.array([0.1e-3, 0.3e-3]), size=1e-6)
    states, _ = equilibria(system, [target], TIMES, weights=Weights(size=1e-6, change=0.0))
    assert states["misfit"].values == pytest.approx(0.0, abs=1.0)
    assert (
        states["activation"].sum("muscle").values[1] > states["activation"].sum("muscle").values[0]
    )


def test_no_target_is_an_error():
    with pytest.raises(sim.SceneError, match="0 targets"):
        equilibria(block(), [], TIMES)


@pytest.mark.parametrize(("duration", "least", "most"), [(40.0, 0.0, 0.01), (0.02, 0.3, 1.5)])
def test_a_face_in_motion_misses_equilibria_that_change_fast(duration, least, most):
    """Of known activations: a slow motion passes through their equilibria, a fast one does not."""
    system, nodes, n = block(), np.array([25, 26]), 21
    time = np.linspace(0.0, duration, n)
    activations = np.linspace(0.0, 1.0, n)[:, None] * TRUE[1]
    state, work = system.rest_state(), sim.Workspace(system)
    positions = []
    for t, a in zip(time, activations, strict=True):
        state, _ = EXACT.step(system, state, sim.Control(a, t), 0.5, work)
        positions.append(state.q[nodes])
    target = PointTarget(nodes, time, np.array(positions), 1e-3)
    problem = SimpleNamespace(
        system=system,
        target=target,
        duration=duration,
        h=time[1],
        state=system.rest_state(),
        work=work,
    )
    moved = np.sqrt(np.mean((target.position - system.mesh.X[nodes]) ** 2))
    assert least <= motion_misfit(problem, activations) / moved <= most
    result = xr.Dataset(attrs={"rest_ratio": 0.0, "misfit_ratio": 0.0})
    ratio = motion_misfit(problem, activations) / moved
    said = " ".join(doubts(result.assign_attrs(motion_misfit_ratio=ratio)))
    assert ("too fast" in said) == (least > 0.0)
