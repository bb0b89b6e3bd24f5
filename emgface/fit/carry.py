"""Muscles, attachments, markers and teeth carried from the source mesh to the fitted one.

Elements of muscles are kept as sets: after a change of size, a radius in millimetres would select
others. Directions follow the deformation gradient at the centres of their elements, and points inside
elements their shape functions. Teeth lie outside the tissue and follow a spline of the inner surface.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
import pandas as pd
import xarray as xr

import sim
from emgface.face.lip_shape import has_mouth, lip_rim
from emgface.face.parts import INNER, OUTER
from emgface.face.quality import is_wedge
from emgface.face.surface import boundary_faces, triangles
from emgface.fit.similarity import thin_plate
from emgface.fit.targets import Sheet
from emgface.fit.triangulated import Floats, Surface
from sim.elements import HEX8, WEDGE6

INSIDE_TOLERANCE: Final = 0.02  #: negative shape function of a point that counts as inside [1]
#: number of nodes of the inner surface that determine the spline of the teeth
CARRY_CONTROLS: Final = 500
ON_SKIN: Final = 5e-3  #: distance from the skin up to which a rigid point lies on it [m]
LISTED_STRAIN: Final = 0.05  #: change of a fibre against the affine prediction that is listed [1]


@dataclass(frozen=True)
class Carried:
    """Fitted face, not yet checked, and the lengths of its fibres."""

    face: xr.Dataset
    fibres: pd.DataFrame  #: muscle, length before, predicted, after [mm], change [1]


def carry(face: xr.Dataset, q: Floats) -> Carried:
    """Return the face with its nodes at q (n_nodes, 3) [m]."""
    source = face["position"].values
    carried = face.copy(deep=True)
    carried["position"].values[:] = q
    if "fibre_position" in face:
        carried["fibre_position"].values[:] = inside(face, face["fibre_position"].values, q)
    F = element_gradients(face, q)[face["bundle_index"].values]
    direction = np.einsum("eij,ej->ei", F, face["bundle_direction"].values)
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    carried["bundle_direction"].values[:] = direction
    if "face_marker_position" in face:
        carried["face_marker_position"].values[:] = rigid_points(
            face, face["face_marker_position"].values, q
        )
    if "arch_position" in face:
        nodes = Sheet.from_face(face, INNER).nodes
        nodes = nodes[:: max(1, len(nodes) // CARRY_CONTROLS)]
        spline = thin_plate(source[nodes], q[nodes], 0.5e-3)
        carried["arch_position"].values[:] = spline(face["arch_position"].values)
    if has_mouth(face):
        rim = lip_rim(face)
        corners = rim.upper[[0, -1]].astype(np.int32)
        carried["mouth_corner_node"] = ("mouth_corner", corners, {"units": "1"})
    return Carried(carried, _fibres(face, carried))


def inside(face: xr.Dataset, points: Floats, q: Floats) -> Floats:
    """Points (n, 3) in the mesh after the motion of its nodes to q; those outside follow its surface."""
    source = face["position"].values
    connectivity = face["connectivity"].values
    wedge = is_wedge(connectivity)
    blocks = {"hex8": connectivity[~wedge], "wedge6": connectivity[wedge, :6]}
    mesh = sim.mesh_from_arrays(source, **{k: v for k, v in blocks.items() if len(v)})
    faces, _ = boundary_faces(connectivity)
    outside = Surface(source, triangles(faces, source))
    result = np.empty_like(points)
    for k, point in enumerate(points):
        try:
            one = sim.embed(mesh, point[None], tolerance=INSIDE_TOLERANCE)
            result[k] = one.weights[0] @ q[one.nodes[0]]
        except sim.MeshError:
            result[k] = _with_surface(outside, point[None], q)[0]
    return result


def rigid_points(face: xr.Dataset, points: Floats, q: Floats) -> Floats:
    """Points (n, 3) on the skin after the motion of its nodes to q; those beyond follow a spline."""
    source, skin = face["position"].values, Sheet.from_face(face, OUTER)
    before = skin.at(source)
    result = _with_surface(before, points, q)
    beyond = before.nearest(points).distance > ON_SKIN
    if beyond.any():
        nodes = skin.nodes[:: max(1, len(skin.nodes) // CARRY_CONTROLS)]
        result[beyond] = thin_plate(source[nodes], q[nodes], 0.5e-3)(points[beyond])
    return result


def _with_surface(before: Surface, points: Floats, q: Floats) -> Floats:
    near = before.nearest(points)
    height = np.einsum("ni,ni->n", points - near.foot, before.normals[near.triangle])
    after = Surface(q, before.triangles)
    foot = np.einsum("nk,nki->ni", near.weights, q[before.triangles[near.triangle]])
    return foot + height[:, None] * after.normals[near.triangle]


def element_gradients(face: xr.Dataset, q: Floats) -> Floats:
    """Deformation gradient (elements, 3, 3) at the centre of every element."""
    source, connectivity = face["position"].values, face["connectivity"].values
    wedge = is_wedge(connectivity)
    F = np.empty((len(connectivity), 3, 3))
    for chosen, kind in ((~wedge, HEX8), (wedge, WEDGE6)):
        dN = kind.dN_corners.mean(axis=0)
        nodes = connectivity[chosen, : kind.n_nodes]
        before = np.einsum("eai,aj->eij", source[nodes], dN)
        after = np.einsum("eai,aj->eij", q[nodes], dN)
        F[chosen] = after @ np.linalg.inv(before)
    return F


def _fibres(before: xr.Dataset, after: xr.Dataset) -> pd.DataFrame:
    """Lengths of the fibres; the prediction is that of the affine map nearest to the motion."""
    if "fibre_position" not in before:
        return pd.DataFrame(columns=["muscle", "before", "predicted", "after", "change"])
    source, q = before["position"].values, after["position"].values
    matrix, *_ = np.linalg.lstsq(np.column_stack([source, np.ones(len(source))]), q, rcond=None)
    owner = before["fibre_of_point"].values
    names = [str(m) for m in before["muscle"].values]
    rows = []
    for k, muscle in enumerate(before["fibre_muscle"].values):
        own = before["fibre_position"].values[owner == k]
        lengths = [own, np.column_stack([own, np.ones(len(own))]) @ matrix,
                   after["fibre_position"].values[owner == k]]  # fmt: skip
        b, p, a = (1e3 * np.linalg.norm(np.diff(x, axis=0), axis=1).sum() for x in lengths)
        rows.append({"muscle": names[muscle], "before": b, "predicted": p, "after": a,
                     "change": a / p - 1.0})  # fmt: skip
    return pd.DataFrame(rows)
