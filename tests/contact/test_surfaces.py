"""Contact surfaces: closed forms of a box, and located errors of invalid surfaces."""

import numpy as np
import pytest

import sim
from tests.bodies import grid, rotation, tetrahedra

TETRAHEDRON = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
CORNERS = np.vstack([np.zeros(3), np.eye(3)]) * 0.01


def enclosed(x, triangles):
    a, b, c = (x[triangles[:, i]] for i in range(3))
    return np.einsum("mi,mi->", a, np.cross(b, c)) / 6.0


@pytest.mark.parametrize(
    "mesh", [grid((2, 3, 1), wedges=(1,)), tetrahedra((2, 2, 1))], ids=["hex-wedge", "tet"]
)
def test_boundary_of_a_box_encloses_its_volume(mesh):
    surface = sim.boundary_surface(mesh, "box")
    surface.check(mesh)
    assert surface.closed
    # Euler: vertices - edges + faces = 2 for a sphere
    assert len(surface.nodes) - len(surface.edges) + len(surface.triangles) == 2
    np.testing.assert_allclose(enclosed(mesh.X, surface.triangles), 8e-6, rtol=1e-12)


def test_shells_follow_their_motion_and_refuse_an_invalid_one():
    R, s = rotation(3), np.array([0.1, -0.2, 0.3])
    shell = sim.RigidShell(CORNERS, TETRAHEDRON, motion=lambda t: (R, t * s))
    np.testing.assert_allclose(shell.at(2.0)[1], R @ CORNERS[1] + 2 * s, rtol=1e-14)
    np.testing.assert_array_equal(sim.RigidShell(CORNERS, TETRAHEDRON).at(1.0), CORNERS)
    for motion, text in (
        (lambda t: (2 * R, s), "not a rotation"),
        (lambda t: (np.diag([1.0, 1.0, -1.0]), s), "mirrors it"),
        (lambda t: (R, s * np.nan), "not a rotation"),
        (lambda t: (R, 0.0), "not a rotation"),
    ):
        with pytest.raises(sim.ContactFailure, match=text):
            sim.RigidShell(CORNERS, TETRAHEDRON, "jaw", motion).at(0.5)


BAD = {
    "contains a node twice": np.vstack([TETRAHEDRON, [1, 1, 2]]),
    "has the nodes of triangle 1": np.vstack([TETRAHEDRON, [3, 0, 1]]),
    "in the same direction": np.vstack([TETRAHEDRON[:3], [0, 2, 3]]),
    "expected whole numbers": TETRAHEDRON + 0.5,
    "have shape": TETRAHEDRON[:0],
    "refers to node 4, expected 0..3": np.vstack([TETRAHEDRON[:3], [2, 0, 4]]),
    "inside out": TETRAHEDRON[:, ::-1],
}


@pytest.mark.parametrize("text", BAD)
def test_invalid_triangles_are_refused_with_their_place(text):
    mesh = sim.mesh_from_arrays(CORNERS, tet4=[[0, 1, 2, 3]])
    with pytest.raises(sim.ContactFailure, match=text) as raised:
        sim.NodeSurface(BAD[text], "lip").check(mesh)
    assert raised.value.surface == "lip" and "lip" in str(raised.value)
    with pytest.raises(sim.ContactFailure, match=text):
        sim.RigidShell(CORNERS, BAD[text], "jaw")


def test_a_triangle_without_area_and_a_vertex_that_is_not_finite_are_refused():
    flat = CORNERS.copy()
    flat[3] = 0.5 * (flat[1] + flat[2])
    with pytest.raises(sim.ContactFailure, match="triangle 2 .* has no area") as raised:
        sim.RigidShell(flat, TETRAHEDRON)
    assert raised.value.triangle == 2
    flat[3] = np.nan
    with pytest.raises(sim.ContactFailure, match="vertex 3 .* not finite"):
        sim.RigidShell(flat, TETRAHEDRON)


def test_free_edges_of_an_open_surface_are_found():
    surface = sim.NodeSurface(TETRAHEDRON[:3], "patch")
    assert not surface.closed
    assert surface.open_edges.tolist() == [[0, 2], [0, 3], [2, 3]]
    assert sim.NodeSurface(TETRAHEDRON).closed


def test_pairings_find_common_nodes_and_refuse_two_rigid_surfaces():
    mesh = grid((2, 1, 1))
    whole = sim.boundary_surface(mesh).triangles
    left = sim.NodeSurface(whole[(mesh.X[whole, 0] < 0.011).all(axis=1)], "left")
    right = sim.NodeSurface(whole[(mesh.X[whole, 0] > 0.009).all(axis=1)], "right")
    pair = sim.Pairing(left, right)
    pair.check(mesh)
    assert set(pair.shared) == set(np.flatnonzero(np.isclose(mesh.X[:, 0], 0.01)))
    assert pair.name == "left on right" and not pair.itself
    alone = sim.Pairing(left)
    assert alone.itself and alone.surfaces == (left,) and len(alone.shared) == 0
    with pytest.raises(sim.ContactFailure, match="belongs to both surfaces"):
        sim.Pairing(left, sim.NodeSurface(whole, "all")).check(mesh)
    shell = sim.RigidShell(CORNERS, TETRAHEDRON)
    with pytest.raises(sim.SceneError, match="rigid shells only"):
        sim.Pairing(shell, shell)
