"""Checks of a face: schema, references, elements and muscles."""

import numpy as np
import xarray as xr

from emgface.errors import FaceError
from emgface.face.lip_shape import lip_opening
from emgface.face.quality import element_quality
from emgface.schema.validation import validate


def check_face(ds: xr.Dataset) -> xr.Dataset:
    """Check a face against its schema and the requirements of the mechanics, and return it.

    Raises SchemaError or UnitsError if names, dims, units or ranges differ from the schema, and
    FaceError if an element refers to a node that does not exist, has an invalid number of nodes, or
    is inverted at a quadrature point or corner; a node belongs to no element; a muscle has no
    element or one twice; a marker or lip-opening node is fixed; or that of the upper lip is below
    that of the lower.
    """
    _check_indices(ds)
    ds = validate(ds, "face_model")
    _check_elements(ds)
    _check_muscles(ds)
    fixed = ds["fixed"].values
    for variable, dim in (("marker_node", "marker"), ("lip_opening_node", "lip")):
        if variable not in ds:
            continue
        for label, node in zip(ds[dim].values, ds[variable].values, strict=True):
            if fixed[node]:
                raise FaceError(
                    f"{dim} {label} is at node {ds['node_id'].values[node]}, which is fixed: "
                    "expected a free node, choose another"
                )
    _check_lips(ds)
    return ds


def _check_lips(ds: xr.Dataset) -> None:
    """Refuse exchanged upper and lower lips, whose opening would have the wrong sign."""
    if "lip_opening_node" not in ds:
        return
    nodes = ds["lip_opening_node"].values
    opening = lip_opening(ds, ds["position"].values)
    if opening < 0.0:
        upper, lower = ds["node_id"].values[nodes]
        raise FaceError(
            f"lip_opening_node of the upper lip (node {upper}) lies {-1e3 * opening:.3g} mm "
            f"below that of the lower lip (node {lower}) at rest, expected the upper lip "
            "first and +z superior: exchange them, or rotate the face"
        )


def _check_indices(ds: xr.Dataset) -> None:
    """Check references between variables, with node ids of the source in messages."""
    needed = ("position", "node_id", "element_id", "connectivity", "marker_node", "bundle_index")
    if any(name not in ds for name in needed):
        return  # the schema check reports absent variables
    n = ds.sizes.get("node", 0)
    connectivity = ds["connectivity"].values
    if connectivity.ndim != 2 or connectivity.shape[1] != 8:
        return
    wedge = (connectivity[:, 6:] == -1).all(axis=1)
    bad = (connectivity >= n) | (connectivity < 0)
    bad[wedge, 6:] = False
    if bad.any():
        row, column = (int(k[0]) for k in np.nonzero(bad))
        raise FaceError(
            f"element {ds['element_id'].values[row]} refers to node index "
            f"{connectivity[row, column]}, expected 0 to {n - 1}"
            + (" (-1 only in the last two of a wedge)" if connectivity[row, column] < 0 else "")
        )
    for variable, dim in (("marker_node", "marker"), ("lip_opening_node", "lip")):
        if variable not in ds or dim not in ds.coords:
            continue
        for label, node in zip(ds[dim].values, ds[variable].values, strict=True):
            if not 0 <= node < n:
                raise FaceError(f"{dim} {label} refers to node index {node}, expected 0 to {n - 1}")


def _check_elements(ds: xr.Dataset) -> None:
    connectivity = ds["connectivity"].values
    used = np.zeros(ds.sizes["node"], dtype=bool)
    used[connectivity[connectivity >= 0]] = True
    if not used.all():
        node = int(np.flatnonzero(~used)[0])
        on_it = [
            str(label)
            for label, place in zip(ds["marker"].values, ds["marker_node"].values, strict=True)
            if place == node
        ]
        raise FaceError(
            f"node {ds['node_id'].values[node]} belongs to no element"
            + (f" (marker {on_it[0]} is at this node)" if on_it else "")
            + ": expected every node to be used, remove it"
        )
    smallest = element_quality(ds["position"].values, connectivity).smallest_det
    bad = np.flatnonzero(~(smallest > 0))
    if len(bad):
        worst = int(bad[np.argmin(smallest[bad])])
        others = f" ({len(bad)} such elements)" if len(bad) > 1 else ""
        raise FaceError(
            f"element {ds['element_id'].values[worst]} is inverted at rest{others}: its smallest "
            f"Jacobian determinant is {smallest[worst]:.3g} m3, expected a positive one; check its "
            "node order and positions"
        )


def _check_muscles(ds: xr.Dataset) -> None:
    owner, element = ds["bundle_muscle"].values, ds["bundle_index"].values
    for k, muscle in enumerate(ds["muscle"].values):
        mine = element[owner == k]
        if len(mine) == 0:
            raise FaceError(
                f"muscle {muscle} has no element: expected at least one, try a larger radius "
                "or check its fibres"
            )
        values, counts = np.unique(mine, return_counts=True)
        if (counts > 1).any():
            raise FaceError(
                f"muscle {muscle} lists element {ds['element_id'].values[values[counts > 1][0]]} "
                "twice, expected once"
            )
