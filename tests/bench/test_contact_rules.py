"""Published rules of contact on a block inside a plate, and input made symmetric."""

import numpy as np
import pytest

import sim
from benchmarks.contact_rules import MIRROR, asymmetric_triangles, partners, symmetric_pairing
from benchmarks.published_contact import PublishedContact, Rules
from tests.bodies import grid
from tests.contact.scenes import box, two_bodies

SIZE, DEPTH, H = 0.01, 5e-4, 5e-3
NONE = np.zeros(0)


def published(up: float = 0.0, **rules) -> PublishedContact:
    """A block with hard volumes whose lower nodes lie inside a plate, under a vertical gravity."""
    mesh = grid((2, 2, 2), (SIZE, SIZE, SIZE))
    plate = box([-0.1, -0.1, DEPTH - 0.05], [0.1, 0.1, DEPTH], "plate")
    solid = sim.Solid((sim.Material(bulk=sim.QuadraticBulk(0.0)),))
    system = sim.compile_scene(
        sim.Scene(
            mesh,
            (solid, sim.ElementVolume(25e3), sim.Gravity((0.0, 0.0, up))),
            (),
            sim.Rayleigh(19.0, 0.055),
            (sim.HardElementVolume(),),
        )
    )
    pairing = sim.Pairing(sim.boundary_surface(mesh), plate)
    return PublishedContact(system, (pairing,), Rules(**rules))


def test_a_correction_moves_nodes_out_and_gives_no_velocity() -> None:
    """All but the tolerance in one step, with the volume of every element."""
    contact = published(released=False)  # without load the sign of the forces is rounding
    start = contact.system.rest_state()
    end = contact.step(start, NONE, H)
    low = start.q[:, 2] == 0.0
    np.testing.assert_allclose(end.q[low, 2], DEPTH - Rules.tolerance, rtol=0, atol=1e-9)
    np.testing.assert_allclose(end.v, 0.0, rtol=0, atol=1e-9)
    conditions = contact.system.constraints
    assert conditions is not None
    change, _ = conditions.evaluate(end.pose)
    # of second order in the strain, where it would be of first order without the condition
    strain, volume = DEPTH / (0.5 * SIZE), (0.5 * SIZE) ** 3
    assert np.abs(change).max() < strain**2 * volume


def test_a_row_that_pulls_holds_for_one_step_and_is_released() -> None:
    """Gravity directed upwards: held, free in the step after, and still free once outside."""
    contact, state, steps = published(up=9.81), None, []
    state = contact.system.rest_state()
    for _ in range(4):
        state = contact.step(state, NONE, H)
        steps.append(state.v[:, 2].mean())
    held = published(up=9.81, released=False)
    still = held.step(held.step(held.system.rest_state(), NONE, H), NONE, H)
    assert contact.counts[0] == 0 and held.counts[0] == 9
    low = held.system.scene.mesh.X[:, 2] == 0.0
    np.testing.assert_allclose(still.v[low, 2], 0.0, rtol=0, atol=1e-9)
    assert steps[1] - steps[0] == pytest.approx(9.81 * H, rel=0.2)


def test_symmetric_surfaces_are_their_own_mirror_images() -> None:
    """Also if every facet is divided by the same diagonal."""
    mesh, a, b = two_bodies(
        grid((2, 2, 1), (0.02, 0.02, 0.01)), grid((4, 2, 1), (0.02, 0.02, 0.01)), [0, 0, 0.011]
    )
    X = mesh.X - [0.01, 0.0, 0.0]
    pairing = symmetric_pairing(sim.Pairing(a, b), X)
    mirror = partners(X)
    np.testing.assert_allclose(X[mirror], X * MIRROR, rtol=0, atol=1e-12)
    for surface, before in zip(pairing.surfaces, (a, b), strict=True):
        assert isinstance(surface, sim.NodeSurface)
        assert surface.closed and len(surface.triangles) == len(before.triangles)
        assert asymmetric_triangles(before.triangles, X) > 0
        assert asymmetric_triangles(surface.triangles, X) == 0
