"""Refinement preserves volumes, fixed nodes, muscles and markers."""

import numpy as np

from benchmarks.refine import refine_face
from emgface.face.recipe import compose_scene
from emgface.face.simulation_parameters import SimulationParameters
from sim import compile_scene


def test_children_fill_their_parent_and_inherit_what_it_has(small_face):
    fine = refine_face(small_face)
    assert fine.sizes["element"] == 8 * small_face.sizes["element"]
    n = small_face.sizes["node"]
    np.testing.assert_array_equal(fine["position"][:n], small_face["position"])
    np.testing.assert_array_equal(fine["layer"].values[::8], small_face["layer"])
    np.testing.assert_array_equal(fine["marker_node"], small_face["marker_node"])
    masses = []
    for face in (small_face, fine):
        scene = compose_scene(face, SimulationParameters())
        volumes = scene.mesh.volumes()
        hexahedra = (face["connectivity"].values[:, -1] >= 0).sum()
        masses.append([volumes.sum(), volumes[:hexahedra].sum(), len(scene.mesh.X)])
        assert compile_scene(scene).node_mass.sum() > 0.0
    np.testing.assert_allclose(masses[1][:2], masses[0][:2], rtol=1e-12)
    # two cubes on each other, and a prism that shares a square with them
    assert masses[1][2] == 3 * 3 * 5 + 3 * 6 - 3 * 3
    for muscle in range(small_face.sizes["muscle"]):
        volume = [
            face["bundle_index"].values[face["bundle_muscle"].values == muscle]
            for face in (small_face, fine)
        ]
        np.testing.assert_array_equal(np.unique(volume[1] // 8), np.unique(volume[0]))
        assert len(volume[1]) == 8 * len(volume[0])


def test_new_nodes_are_fixed_where_all_their_corners_are(small_face):
    fine = refine_face(small_face)
    z = fine["position"].values[:, 2]
    low = small_face["position"].values[small_face["fixed"].values > 0][:, 2].max()
    np.testing.assert_array_equal(fine["fixed"].values > 0, z <= low + 1e-12)


def test_a_shared_face_has_shared_nodes(small_face):
    fine = refine_face(small_face)
    positions = np.round(fine["position"].values, 9)
    assert len(np.unique(positions, axis=0)) == len(positions)
