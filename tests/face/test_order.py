"""The order in which a face lists its nodes, elements, facets and fibres does not change its motion."""

import numpy as np
import pytest
import xarray as xr

import emgface as ef
from emgface.face.validity import check_face

DRIVE = {"ZYG_L": 0.5, "OOP_L": 0.4, "OOP_R": 0.4}


def reordered(face: xr.Dataset, dim: str, **referring: tuple[str, ...]) -> xr.Dataset:
    """The face with the members of a dim in another order, and the indices that refer to it."""
    order = np.random.default_rng(4).permutation(face.sizes[dim])
    place = np.argsort(order).astype(np.int32)
    changed = face.isel({dim: order})
    for name in referring["by"]:
        own = changed[name].values
        changed[name] = changed[name].copy(data=np.where(own < 0, own, place[own]))
    return changed


def rolled(face: xr.Dataset) -> xr.Dataset:
    """Every hexahedron, facet and triangle begins with another of its corners."""
    corners = face["connectivity"].values
    turned = np.where(corners[:, -1:] < 0, corners, corners[:, [1, 2, 3, 0, 5, 6, 7, 4]])
    return face.assign(
        connectivity=face["connectivity"].copy(data=turned),
        facet_node=face["facet_node"].copy(data=np.roll(face["facet_node"].values, 1, axis=1)),
        arch_triangle=face["arch_triangle"].copy(
            data=np.roll(face["arch_triangle"].values, 1, axis=1)
        ),
    )


def elsewhere(face: xr.Dataset) -> xr.Dataset:
    """The face a metre away."""
    places = ("position", "fibre_position", "face_marker_position", "arch_position")
    to = np.array([1.0, -2.0, 0.5])
    return face.assign({name: face[name].copy(data=face[name].values + to) for name in places})


NODES = ("connectivity", "marker_node", "lip_opening_node", "facet_node")
ORDERS = {
    "nodes": lambda face: reordered(face, "node", by=NODES),
    "elements": lambda face: reordered(face, "element", by=("bundle_index",)),
    "fibres": lambda face: reordered(face, "fibre", by=("fibre_of_point",)),
    "elements of muscles": lambda face: reordered(face, "bundle_element", by=()),
    "facets": lambda face: reordered(face, "facet", by=()),
    "points of the arches": lambda face: reordered(face, "arch_point", by=("arch_triangle",)),
    "triangles of the arches": lambda face: reordered(face, "arch_facet", by=()),
    "corners": rolled,
    "place": elsewhere,
}


def motion_of(face: xr.Dataset) -> xr.Dataset:
    return ef.simulate(DRIVE, face, duration=0.06, accuracy="draft")


@pytest.fixture(scope="module")
def moved(coarse: xr.Dataset) -> xr.Dataset:
    motion = motion_of(coarse)
    path = motion["position"] - motion["position"].isel(time=0)
    assert float(abs(path).max()) > 3e-3 and int(motion.attrs.get("contacts", 1)) > 0
    return motion


@pytest.mark.parametrize("order", ORDERS)
def test_the_order_of_a_face_does_not_change_its_motion(order, coarse, moved) -> None:
    changed = check_face(ORDERS[order](coarse))
    assert not changed.identical(coarse)
    again = motion_of(changed)
    shift = again["position"].isel(time=0) - moved["position"].isel(time=0)
    away = again["position"] - shift - moved["position"]
    assert float(abs(away).max()) < 1e-8  # [m] a tenth of the tolerance of contact
    np.testing.assert_allclose(again["mouth_area"], moved["mouth_area"], rtol=1e-6)
