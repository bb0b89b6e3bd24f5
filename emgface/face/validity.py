"""Checks of a face: schema, references, elements and muscles."""

import numpy as np
import xarray as xr

from emgface.anatomy.frame import check_frame
from emgface.anatomy.mesh_model import (
    check_elements,
    check_muscles,
    check_references,
    muscles_to_the_right,
)
from emgface.errors import FaceError
from emgface.face.lip_shape import lip_opening
from emgface.schema.validation import validate


def check_face(ds: xr.Dataset) -> xr.Dataset:
    """Check a face against its schema and the requirements of the mechanics, and return it.

    Raises SchemaError or UnitsError if names, dims, units or ranges differ from the schema, and
    FaceError if an element refers to a node that does not exist, has an invalid number of nodes, or
    is inverted at a quadrature point or corner; a node belongs to no element; a muscle has no
    element or one twice; a marker or lip-opening node is fixed; that of the upper lip is below
    that of the lower; or the face is turned or mirrored relative to its frame.
    """
    nodes = ("marker_node", "marker"), ("lip_opening_node", "lip")
    check_references(ds, nodes, FaceError)
    ds = validate(ds, "face_model")
    check_elements(ds, FaceError)
    check_muscles(ds, FaceError)
    fixed = ds["fixed"].values
    for variable, dim in nodes:
        if variable not in ds:
            continue
        for label, node in zip(ds[dim].values, ds[variable].values, strict=True):
            if fixed[node]:
                raise FaceError(
                    f"{dim} {label} is at node {ds['node_id'].values[node]}, which is fixed: "
                    "expected a free node, choose another"
                )
    _check_directions(ds)
    _check_lips(ds)
    return ds


def _check_directions(ds: xr.Dataset) -> None:
    """Refuse a face whose muscles and lips do not lie as the axes of its frame state."""
    labels = [str(label) for label in ds["marker"].values]
    places = ds["position"].values[ds["marker_node"].values]
    upper, lower = (
        places[[label.startswith(lip) for label in labels]] for lip in ("upper", "lower")
    )
    both = len(upper) > 0 and len(lower) > 0  # a treatment may have removed the markers of a lip
    directions = {
        "right": muscles_to_the_right(ds),
        "superior": np.mean(upper, axis=0) - np.mean(lower, axis=0) if both else None,
        "anterior": np.mean(places, axis=0) - ds["position"].values.mean(axis=0) if both else None,
    }
    check_frame("face", directions, FaceError)


def _check_lips(ds: xr.Dataset) -> None:
    """Refuse exchanged upper and lower lips, whose opening would have the wrong sign."""
    if "lip_opening_node" not in ds or "stress_free_position" in ds:
        return  # after a treatment, a lip may overlap the other, which its untreated face did not
    nodes = ds["lip_opening_node"].values
    opening = lip_opening(ds, ds["position"].values)
    if opening < 0.0:
        upper, lower = ds["node_id"].values[nodes]
        raise FaceError(
            f"lip_opening_node of the upper lip (node {upper}) lies {-1e3 * opening:.3g} mm "
            f"below that of the lower lip (node {lower}) at rest, expected the upper lip "
            "first and +z superior: exchange them, or rotate the face"
        )
