"""A face with every element divided into eight, for studies of convergence and of growth."""

import itertools
from typing import Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from emgface.face.quality import is_wedge
from emgface.face.validity import check_face
from sim.elements import ELEMENT_TYPES

Integers = NDArray[np.int64]

CHILDREN: Final = 8
_KEPT: Final = {
    "node", "axis", "element", "element_node", "bundle_element", "fibre", "fibre_point", "muscle",
    "marker", "face_marker", "lip",
}  # fmt: skip


def _hexahedron() -> tuple[list[tuple[int, ...]], list[list[int]]]:
    """Parents of the points, as indices of the corners, and points of the eight children."""
    corners = [
        tuple(corner) for corner in (ELEMENT_TYPES["hex8"].corners > 0.0).astype(int).tolist()
    ]
    points = {
        site: tuple(
            i
            for i, c in enumerate(corners)
            if all(2 * a == s or s == 1 for a, s in zip(c, site, strict=True))
        )
        for site in itertools.product(range(3), repeat=3)
    }
    place = {site: i for i, site in enumerate(points)}
    children = [
        [place[x + a, y + b, z + c] for a, b, c in corners]
        for z, y, x in itertools.product(range(2), repeat=3)
    ]
    return list(points.values()), children


def _wedge() -> tuple[list[tuple[int, ...]], list[list[int]]]:
    triangle = [(0,), (1,), (2,), (0, 1), (1, 2), (0, 2)]
    points: list[tuple[int, ...]] = []
    for level in range(3):
        for corners in triangle:
            bottom, top = corners, tuple(c + 3 for c in corners)
            points.append((bottom, (*bottom, *top), top)[level])
    parts = [(0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5)]
    children = [
        [6 * level + i for i in part] + [6 * (level + 1) + i for i in part]
        for level in range(2)
        for part in parts
    ]
    return points, children


def refine_face(face: xr.Dataset) -> xr.Dataset:
    """Divide every hexahedron into eight hexahedra and every wedge into eight wedges.

    New nodes lie at the means of the corners of their edge, face or element, so that the shape of
    the mesh is unchanged; they are fixed if all those corners are. The children 8 e to 8 e + 7 of
    element e inherit its layer and its muscles with their directions and shares. Markers stay at
    their nodes. Errors are those of `emgface.face.validity.check_face`.
    """
    connectivity = face["connectivity"].values.astype(np.int64)
    wedge = is_wedge(connectivity)
    n_nodes, n_elements = face.sizes["node"], face.sizes["element"]
    parents: list[Integers] = []  # of every point: its corners, padded by repeating the first
    rows: list[tuple[Integers, list[list[int]], int]] = []
    for mask, (points, children) in ((~wedge, _hexahedron()), (wedge, _wedge())):
        own = connectivity[mask]
        corner_sets = [np.sort(own[:, corners], axis=1) for corners in points]
        padded = [
            np.concatenate([c, np.full((len(c), 8 - c.shape[1]), -1)], axis=1) for c in corner_sets
        ]
        parents.append(np.stack(padded, axis=1).reshape(-1, 8))
        rows.append((np.flatnonzero(mask), children, len(points)))
    # A point with one parent is that corner; corners keep their order and precede the new nodes.
    unique, inverse = np.unique(np.concatenate(parents), axis=0, return_inverse=True)
    single = unique[:, 1] < 0
    number = np.where(single, unique[:, 0], n_nodes - 1 + np.cumsum(~single))
    number = number[inverse.reshape(-1)]
    new = unique[~single]

    refined = np.full((CHILDREN * n_elements, 8), -1)
    first = 0
    for elements, children, n_points in rows:
        count = len(elements)
        local = number[first : first + count * n_points].reshape(count, n_points)
        for child, nodes in enumerate(children):
            refined[CHILDREN * elements + child, : len(nodes)] = local[:, nodes]
        first += count * n_points

    weight = (new >= 0) / (new >= 0).sum(axis=1, keepdims=True)
    position = face["position"].values
    added = (weight[:, :, None] * position[np.maximum(new, 0)]).sum(axis=1)
    fixed = face["fixed"].values
    fixed_by = np.where(new >= 0, fixed[np.maximum(new, 0)], 99)
    fixed_added = np.where(
        (fixed_by > 0).all(axis=1), np.where(new >= 0, fixed_by, 0).max(axis=1), 0
    )

    out = face.drop_vars([str(n) for n, v in face.variables.items() if not set(v.dims) <= _KEPT])
    out = out.drop_dims(["node", "element", "bundle_element"])
    for name in map(str, face.data_vars):
        variable = face[name]
        if not set(variable.dims) <= _KEPT:
            continue
        per_element = "element" in variable.dims and name not in ("connectivity", "element_id")
        if per_element or "bundle_element" in variable.dims:
            out[name] = (variable.dims, np.repeat(variable.values, CHILDREN, axis=0))
    n_all = n_nodes + len(new)
    child = np.tile(np.arange(CHILDREN), face.sizes["bundle_element"])
    bundle = CHILDREN * np.repeat(face["bundle_index"].values, CHILDREN) + child
    ids = np.arange(len(new)) + face["node_id"].values.max() + 1
    out["bundle_index"] = ("bundle_element", bundle.astype(np.int32))
    out["position"] = (("node", "axis"), np.concatenate([position, added]))
    out["node_id"] = ("node", np.concatenate([face["node_id"].values, ids]).astype(np.int32))
    out["fixed"] = ("node", np.concatenate([fixed, fixed_added]).astype(np.int8))
    out["connectivity"] = (("element", "element_node"), refined.astype(np.int32))
    out["element_id"] = ("element", np.arange(1, len(refined) + 1, dtype=np.int32))
    for name in map(str, out.data_vars):
        out[name].attrs = face[name].attrs
    out.attrs = face.attrs | {"name": f"{face.attrs['name']}, each element divided into eight"}
    assert out.sizes["node"] == n_all
    return check_face(out)
