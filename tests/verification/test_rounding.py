"""Effect of rounding of the rest positions on the motion, and its report."""

from dataclasses import replace

import numpy as np
import pytest

import sim
from sim.integrators import INTEGRATORS
from sim.snapping import snapped
from tests.bodies import crossed_muscles, grid

MOVED = 1e-14
"""Perturbation of every free coordinate [m], a hundred units in the last place of a face."""

KNOWN = 1e3
"""Growth of a perturbation that is accepted, because it accumulates over steps and nodes."""

TIGHT = {"tolerance": 1e-12, "residual_tolerance": 1e-9}


def block():
    """Block with fibres at the kink of their passive curve and nodes on their walls."""
    mesh = grid((2, 2, 3), (0.02, 0.02, 0.03))
    bottom = np.flatnonzero(mesh.X[:, 2] == 0.0)
    top = np.flatnonzero(mesh.X[:, 2] == 0.03)
    side = np.flatnonzero(mesh.X[:, 0] == 0.0)
    walls = sim.Support(
        np.setdiff1d(side, bottom), np.tile([1.0, 0.0, 0.0], (len(side) - 3, 1)), 500.0
    )
    along = mesh.X[[bottom[-1], top[-1]]]
    lines = sim.LineMuscles(
        ("line",), (sim.LineFibre(0, along),), sim.Peck(5.0, passive_fraction=1.0)
    )
    parts = (sim.Solid(muscles=crossed_muscles(mesh, sim.Blemker(300e3))), walls, lines)
    return sim.compile_scene(
        sim.Scene(mesh, parts, (sim.Fixed(bottom),), sim.RestRayleigh(19.0, 0.03))
    )


def drift(system, integrator, linear):
    """Largest distance between motions from rest positions that differ by rounding [m]."""
    drive = sim.Activation(np.array([0.0, 0.05]), np.array([[0.0, 0.0, 0.0], [0.6, 0.3, 0.2]]))
    rest, motions = system.rest_state(), []
    for sign in (0.0, 1.0, -1.0):
        q = rest.q.copy()
        bits = np.random.default_rng(1).choice([-1.0, 1.0], size=len(system.free))
        q.reshape(-1)[system.free] += sign * MOVED * bits
        motion, _ = sim.simulate(
            system,
            drive,
            duration=0.1,
            integrator=integrator,
            steps=sim.FixedStep(0.01),
            probes=(sim.Positions(), sim.Iterations()),
            initial=sim.State(0.0, q, rest.v),
            work=sim.Workspace(system, linear),
        )
        motions.append(motion)
    paths = [one["node_position"].values for one in motions]
    unstable = any(one[name].sum() > 0 for one in motions for name in ("indefinite", "shifts"))
    assert np.abs(paths[0][..., -1] - paths[0][..., 0]).max() > 1e-3
    return max(np.abs(path - paths[0]).max() for path in paths[1:]), unstable


@pytest.mark.parametrize("kind", [k for k in INTEGRATORS if k.stability != "conditional"])
def test_a_perturbation_of_rounding_size_does_not_grow(kind):
    iterates = hasattr(kind, "max_iterations")
    grown, _ = drift(block(), kind(**TIGHT) if iterates else kind(), "auto")
    assert grown < KNOWN * MOVED + (1e-11 if iterates else 0.0)


REPORTED = 1e-5
"""Difference of positions that a run must report as possible [m]: 0.1 % of the column's width."""


def column(stress):
    """A column held at both ends that buckles because transverse muscles thicken it."""
    mesh = grid((2, 2, 8), (0.01, 0.01, 0.04))
    n = mesh.n_elements
    across = np.tile([1.0, 0.0, 0.0], (n, 1))
    muscles = sim.Muscles(
        ("across",), np.arange(n), np.zeros(n, dtype=np.int64), across, sim.Constant(stress)
    )
    ends = np.flatnonzero(np.isin(mesh.X[:, 2], [0.0, 0.04]))
    parts = (sim.Solid(muscles=muscles),)
    return sim.compile_scene(
        sim.Scene(mesh, parts, (sim.Fixed(ends),), sim.RestRayleigh(19.0, 0.005))
    )


def buckled(system, integrator, linear, seed=None, *probes):
    """Motion of a column, with its rest positions perturbed by rounding if a seed is given."""
    rest = system.rest_state()
    q = rest.q.copy()
    if seed is not None:
        bits = np.random.default_rng(seed).choice([-1.0, 1.0], size=len(system.free))
        q.reshape(-1)[system.free] += MOVED * bits
    return sim.simulate(
        system,
        sim.Activation(np.array([0.0, 0.05]), np.array([[0.0], [1.0]])),
        duration=0.25,
        integrator=integrator,
        steps=sim.FixedStep(0.01),
        probes=probes or (sim.Positions(),),
        initial=sim.State(0.0, q, rest.v),
        work=sim.Workspace(system, linear),
    )[0]


@pytest.mark.parametrize("linear", ["superlu", "gmres_superlu"])
@pytest.mark.parametrize("stress", [0.0, 1e4, 2e4, 5e4])
@pytest.mark.parametrize(
    "kind", [sim.LinearlyImplicitEuler, sim.LinearlyImplicitTrapezoidal, sim.Sdirk2]
)
def test_a_motion_that_depends_on_rounding_is_reported(kind, stress, linear):
    """The direction in which a symmetric column buckles depends on rounding and is reported."""
    system, positions, reported = column(stress), [], []
    for seed in (None, 1):
        try:
            motion = buckled(system, kind(), linear, seed)
        except sim.InvertedElement as error:
            reported.append(any("on rounding" in note for note in getattr(error, "__notes__", ())))
            continue
        positions.append(motion["node_position"].values)
        reported.append("unstable_from_s" in motion.attrs)
    apart = np.abs(positions[0] - positions[1]).max() if len(positions) == 2 else np.inf
    assert any(reported) or apart < REPORTED
    if stress == 0.0:
        assert not any(reported)


def test_the_direction_of_buckling_depends_on_rounding():
    """Two motions of the column differ by millimetres."""
    system = column(5e4)
    one, other = (buckled(system, sim.Sdirk2(), "superlu", seed) for seed in (1, 2))
    assert np.abs(one["node_position"] - other["node_position"]).max() > 1e-3
    assert 0.0 < one.attrs["unstable_from_s"] < one.attrs["unstable_until_s"] <= 0.25


@pytest.mark.parametrize(
    "kind, h", [(sim.LinearlyImplicitEuler, 0.01), (sim.LinearlyImplicitTrapezoidal, 0.001)]
)
def test_a_step_reports_the_concave_energy_of_its_motion(kind, h):
    """The forces of the step serve for the test, which otherwise evaluates them at both ends."""
    system, method = column(2e4), kind()
    work, state = sim.Workspace(system, "superlu"), system.rest_state()
    state = replace(state, q=state.q.copy())
    bits = np.random.default_rng(1).choice([-1.0, 1.0], size=len(system.free))
    state.q.reshape(-1)[system.free] += 1e-6 * bits
    control, seen = system.control(np.array([1.0])), set()
    for _ in range(round(0.15 / h)):
        new, report = method.step(system, state, control, h, work)
        assert report.concave == snapped(system, state, new, control)
        seen.add(report.concave)
        state = new
    assert seen == {True, False}
