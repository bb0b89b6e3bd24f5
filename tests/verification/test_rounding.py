"""Rounding of the rest positions stays rounding of the motion, or the run says that it does not."""

import numpy as np
import pytest

import sim
from sim.integrators import INTEGRATORS
from tests.bodies import crossed_muscles, grid

MOVED = 1e-14
"""Perturbation of every free coordinate [m], a hundred units in the last place of a face."""

KNOWN = 1e3
"""Growth of a perturbation that counts as none: it may add up over steps and nodes."""

TIGHT = {"tolerance": 1e-12, "residual_tolerance": 1e-9}


def block():
    """Fibres as long as at rest, where the passive curve has its kink, and nodes on their walls."""
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
    """Largest distance between a motion and that from rest positions moved by rounding [m]."""
    drive = sim.Activation(np.array([0.0, 0.05]), np.array([[0.0, 0.0, 0.0], [0.6, 0.3, 0.2]]))
    rest, found = system.rest_state(), []
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
        found.append(motion)
    paths = [one["node_position"].values for one in found]
    unstable = any(one[name].sum() > 0 for one in found for name in ("indefinite", "shifts"))
    assert np.abs(paths[0][..., -1] - paths[0][..., 0]).max() > 1e-3
    return max(np.abs(path - paths[0]).max() for path in paths[1:]), unstable


@pytest.mark.parametrize("kind", [k for k in INTEGRATORS if k.stability != "conditional"])
def test_a_perturbation_of_rounding_size_does_not_grow(kind):
    iterates = hasattr(kind, "max_iterations")
    grown, _ = drift(block(), kind(**TIGHT) if iterates else kind(), "auto")
    assert grown < KNOWN * MOVED + (1e-11 if iterates else 0.0)
