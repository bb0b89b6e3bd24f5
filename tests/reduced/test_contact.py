"""Contact of reduced models compared with full order and with a force balance."""

import numpy as np
import pytest

import sim
from sim.reduced import FusedEuler, ReducedContact, ReducedMarkers, near_vertices, reduce_system
from tests.reduced.scenes import STEP, block, drive
from tests.reduced.test_reduced import whole_basis

LEVEL = -4e-4  #: height of the plate below the block [m]


def plate() -> sim.RigidShell:
    """Plate below the free end of the block, facing up."""
    corners = np.array([[0.0, -1e-2], [3e-2, -1e-2], [3e-2, 2e-2], [0.0, 2e-2]])
    vertices = np.c_[corners, np.full(4, LEVEL)]
    return sim.RigidShell(vertices, np.array([[0, 1, 2], [0, 2, 3]]), "plate")


def touching() -> sim.System:
    """The block above the plate."""
    scene = block().scene
    pairing = sim.Pairing(sim.boundary_surface(scene.mesh, "block"), plate())
    terms = (*scene.terms, sim.ConstraintContact((pairing,)))
    return sim.compile_scene(sim.Scene(scene.mesh, terms, scene.reductions, scene.damping))


def lowest(motion):
    """Height of the lowest node in every output [m]."""
    return motion[..., 2].min(axis=1)


def moved(system, integrator, activation, probes, duration=0.6):
    return sim.simulate(
        system,
        activation,
        duration=duration,
        integrator=integrator,
        steps=sim.FixedStep(STEP),
        probes=probes,
    )[0]


@pytest.fixture(scope="module")
def whole():
    """Block over the plate at full order and with a whole basis, and its motion at full order."""
    dry, wet = block(), touching()
    modes = whole_basis(dry)
    model = reduce_system(dry, dry.mesh.X, modes, modes.shape[1])
    activation = drive(0.02, 0.0)
    full = moved(wet, sim.LinearlyImplicitEuler(), activation, (sim.Positions(),))
    expected = full.node_position.transpose("time", "node", "axis").values
    return dry, wet, modes, model, activation, expected


def test_a_whole_basis_touches_as_full_order(whole):
    dry, wet, modes, model, activation, expected = whole
    contact = ReducedContact(wet.contact, dry.mesh.X, modes)
    nodes = ReducedMarkers(dry.mesh.X, modes, [str(n) for n in range(dry.mesh.n_nodes)])
    motion = moved(model.system, FusedEuler(contact), activation, (nodes,))
    position = motion.position.transpose("time", "marker", "axis").values
    assert lowest(expected).min() == pytest.approx(LEVEL, abs=2e-6)
    assert lowest(position).min() == pytest.approx(LEVEL, abs=5e-6)
    assert np.abs(position - expected).max() < 0.02 * np.abs(expected - dry.mesh.X).max()
    free = moved(model.system, FusedEuler(), activation, (nodes,))
    assert lowest(free.position.transpose("time", "marker", "axis").values).min() < 2.0 * LEVEL


def test_points_far_from_faces_may_be_left_out(whole):
    dry, wet, modes, model, activation, expected = whole
    contact_vertices = near_vertices(wet.contact, expected[::10], 5e-4)
    contact = ReducedContact(wet.contact, dry.mesh.X, modes, contact_vertices)
    assert 0 < len(contact.contact_vertices) < 0.5 * len(wet.contact.node_of_vertex)
    nodes = ReducedMarkers(dry.mesh.X, modes, [str(n) for n in range(dry.mesh.n_nodes)])
    motion = moved(model.system, FusedEuler(contact), activation, (nodes,), 0.2)
    assert lowest(motion.position.transpose("time", "marker", "axis").values).min() > 1.02 * LEVEL


def test_friction_is_refused():
    scene = block().scene
    pairing = sim.Pairing(sim.boundary_surface(scene.mesh, "block"), plate())
    rough = sim.ConstraintContact((pairing,), friction=0.3)
    system = sim.compile_scene(
        sim.Scene(scene.mesh, (*scene.terms, rough), scene.reductions, scene.damping)
    )
    with pytest.raises(sim.SceneError, match="has friction, which is not supported"):
        ReducedContact(system.contact, scene.mesh.X, whole_basis(block()))
