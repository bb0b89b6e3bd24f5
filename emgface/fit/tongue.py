"""Tongue of a person: carried by fitted bones and, if there is one, pulled to its surface by mechanics.

The smooth map of the bones moves the nodes; tissue of corner tetrahedra follows it in equilibrium, so
that no element inverts, and is then pulled to the nearest points of the surface as a face is. Nodes
that follow a bone stay with it. Fibres follow the elements and the bones, largest forces are kept.
"""

import json
from dataclasses import replace
from typing import Final

import numpy as np
import xarray as xr

from emgface.errors import FitError
from emgface.face.surface import boundary_faces, triangles
from emgface.fit.bones import surfaces_of
from emgface.fit.carry import element_gradients
from emgface.fit.corners import Corners
from emgface.fit.deform import PULLS, TO_SPLINE
from emgface.fit.inputs import facing, in_face_frame
from emgface.fit.mechanics import FINE, FitTissue
from emgface.fit.person import Given, scan_of
from emgface.fit.registration import CONTROLS, SmoothMap
from emgface.fit.similarity import rigid_of, similarity
from emgface.fit.springs import Rows, at_nodes
from emgface.fit.targets import Sheet, Target, pulling
from emgface.fit.triangulated import Floats, Surface
from emgface.schema.validation import validate

WITH_BONE: Final = 100.0  #: stiffness of the springs of a node that follows a bone [N/m]
MISSES: Final = 1e-3  #: largest mean distance of the fitted tongue from its surface [m]
BONES: Final = ("jaw", "hyoid", "skull")  #: bodies whose surfaces determine the map


def fit_tongue(
    tongue: xr.Dataset,
    before: xr.Dataset,
    after: xr.Dataset,
    *,
    surface: Given | None = None,
    unit: str | None = None,
    name: str = "fitted tongue",
) -> xr.Dataset:
    """Fit a tongue to a person whose bones are fitted; errors as of `emgface.fit.bones.fit_jaw`.

    `before` is the jaw to which the tongue belongs, `after` the same jaw fitted to the person
    (`emgface.fit.bones.fit_jaw`); `surface` is the boundary of the person's tongue in the frame of
    the inputs of that fit.
    """
    validate(tongue, "tongue_model")
    if after.attrs.get("origin") != "fitted" or after.sizes["vertex"] != before.sizes["vertex"]:
        raise FitError(
            "the jaw is not fitted from the given one, expected the jaw before and after"
        )
    X, moved = tongue["position"].values, _map_of_bones(before, after)
    corners = Corners.of(tongue["connectivity"].values.astype(np.int64))
    tissue = FitTissue.at_rest(corners, moved.similarity(X))
    held = tongue["attachment_node"].values.astype(np.int64)
    stiffness = np.full(len(X), TO_SPLINE)
    stiffness[held] = WITH_BONE
    guide = _springs(np.arange(len(X)), moved(X), stiffness)
    q = tissue.settle(guide, FINE)
    inputs: dict[str, str] = {"jaw": str(after.attrs["fit_inputs"])}
    if surface is not None:
        scan = scan_of(surface, unit)
        q = _pulled(
            tongue, corners, q, in_face_frame(scan, _frame(after)), scan.source, held, moved
        )
        inputs["tongue"] = f"{scan.source} {scan.digest}".strip()
    found = _carried(tongue, q, moved)
    kept = {key: after.attrs[key] for key in ("fit_of", "fit_frame")}
    source = f"{tongue.attrs['name']} ({tongue.attrs['source']}), fitted to a person"
    found = found.assign_attrs(
        {
            **kept,
            "name": name,
            "origin": "fitted",
            "source": source,
            "fit_inputs": json.dumps(inputs),
        }
    )
    return validate(found, "tongue_model")


def _frame(after: xr.Dataset):
    return rigid_of(np.array(json.loads(after.attrs["fit_frame"])))


def _map_of_bones(before: xr.Dataset, after: xr.Dataset) -> SmoothMap:
    """Smooth map of the surfaces of the bones around a tongue, which correspond vertex by vertex."""
    one, two = surfaces_of(before), surfaces_of(after)
    source, target = (
        np.concatenate([
            s[body].points[:: max(1, len(s[body].points) // CONTROLS)] for body in BONES if body in s
        ])
        for s in (one, two)
    )  # fmt: skip
    motion = similarity(source, target)
    return SmoothMap.through(motion, source, target, np.full(len(source), 0.3e-3))


def _springs(nodes: np.ndarray, target: Floats, stiffness: Floats) -> Rows:
    return at_nodes(nodes, target, stiffness[:, None, None] * np.eye(3))


def _pulled(
    tongue: xr.Dataset,
    corners: Corners,
    q: Floats,
    aim: Surface,
    source: str,
    held: np.ndarray,
    moved: SmoothMap,
) -> Floats:
    """Nodes in equilibrium with springs to a surface; FitError if they miss it."""
    faces, _ = boundary_faces(tongue["connectivity"].values.astype(np.int64))
    own = triangles(faces, tongue["position"].values)
    sheet = Sheet(np.unique(own), own, ())
    aim, _ = facing(aim, sheet.at(q), sheet.nodes, 1.0, source)
    target = Target("tongue", sheet, aim)
    with_bone = _springs(
        held, moved(tongue["position"].values[held]), np.full(len(held), WITH_BONE)
    )
    tissue = FitTissue.at_rest(corners, q)
    for k, pull in enumerate(PULLS):
        rows = pulling(tissue.q, [target], replace(pull, seed=k)).joined(with_bone)
        tissue.settle(rows, *((FINE,) if k >= len(PULLS) - 2 else ()))
    from emgface.fit.measures import distances

    miss = distances(target, tissue.q)["mean"]
    if not miss <= 1e3 * MISSES:
        raise FitError(
            f"the fitted tongue misses {source} by {miss:.3g} mm in the mean, expected at most "
            f"{1e3 * MISSES:.3g} mm: check that it is the tongue of the person in the pose of the bones"
        )
    return tissue.q


def _carried(tongue: xr.Dataset, q: Floats, moved: SmoothMap) -> xr.Dataset:
    """Tongue with its nodes at q; points of fibres follow their node, or the bones and the tissue."""
    found = tongue.copy(deep=True)
    X = tongue["position"].values
    found["position"].values[:] = q
    points = moved(tongue["fibre_position"].values)
    pick = np.arange(0, len(X), max(1, len(X) // (2 * CONTROLS)))
    motion = similarity(X, q)
    inner = SmoothMap.through(motion, X[pick], q[pick], np.full(len(pick), 0.1e-3))
    in_tissue = np.ones(len(points), dtype=bool)
    if "fibre_body" in tongue:
        in_tissue = tongue["fibre_body"].values < 0
    points[in_tissue] = inner(tongue["fibre_position"].values[in_tissue])
    if "fibre_node" in tongue:
        node = tongue["fibre_node"].values
        points[node >= 0] = q[node[node >= 0]]
    found["fibre_position"].values[:] = points
    F = element_gradients(tongue, q)[tongue["bundle_index"].values]
    direction = np.einsum("eij,ej->ei", F, tongue["bundle_direction"].values)
    found["bundle_direction"].values[:] = direction / np.linalg.norm(
        direction, axis=1, keepdims=True
    )
    if "posture_displacement" in tongue:
        turned = tongue["posture_displacement"].values @ motion.rotation.T
        found["posture_displacement"].values[:] = motion.scale * turned
    return found
