"""Tongue of a person: carried by fitted bones and, if there is one, pulled to its surface by mechanics.

The smooth map of the bones moves the nodes; tissue of corner tetrahedra follows it in equilibrium, so
that no element inverts, and is then pulled to the nearest points of the surface as a face is. Nodes
that follow a bone stay with it. Fibres follow the elements and the bones, largest forces are kept.
"""

import json
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import pandas as pd
import xarray as xr

from emgface.anatomy.tongue.model import check_tongue
from emgface.errors import FitError
from emgface.face.surface import boundary_faces, triangles
from emgface.fit.bones import surfaces_of
from emgface.fit.carry import element_gradients
from emgface.fit.corners import Corners
from emgface.fit.deform import PULLS, TO_SPLINE, Progress, pull_to
from emgface.fit.inputs import ORIGIN, facing, frame_of_inputs, in_face_frame, provenance
from emgface.fit.measures import distances, quality_rows
from emgface.fit.mechanics import FINE_TOLERANCE, FitTissue
from emgface.fit.person import Given, scan_of
from emgface.fit.readers.surfaces import Scan
from emgface.fit.registration import MAP_CONTROLS, SmoothMap
from emgface.fit.similarity import Similarity, similarity
from emgface.fit.springs import Rows, at_nodes
from emgface.fit.targets import Sheet, Target, pulling
from emgface.fit.triangulated import Floats

WITH_BONE: Final = 100.0  #: stiffness of the springs of a node that follows a bone [N/m]
#: largest mean distance of the fitted tongue from its surface [m]
LARGEST_TONGUE_MISS: Final = 1e-3
BONES: Final = ("jaw", "hyoid", "skull")  #: bodies whose surfaces determine the map


@dataclass(frozen=True)
class FittedTongue:
    """Fitted tongue with the measures of its report."""

    tongue: xr.Dataset  #: checked tongue model
    source: xr.Dataset  #: tongue that was fitted
    target: Target | None  #: surface in the frame of the result
    distance: pd.DataFrame  #: distances of the surface before and after the pull [mm]
    quality: pd.DataFrame  #: quality of the elements before and after
    fibres: pd.DataFrame  #: lengths of the muscles [mm]
    notes: tuple[str, ...]


def fit_tongue(
    tongue: xr.Dataset,
    before: xr.Dataset,
    after: xr.Dataset,
    *,
    surface: Given | None = None,
    unit: str | None = None,
    name: str = "fitted tongue",
    progress: Progress | None = None,
) -> FittedTongue:
    """Fit a tongue to a person whose bones are fitted; errors as of `emgface.fit.bones.fit_jaw`.

    `before` is the jaw to which the tongue belongs, `after` the same jaw fitted to the person
    (`emgface.fit.bones.fit_jaw`); `surface` is the boundary of the person's tongue in the frame of
    the inputs of that fit.
    """
    check_tongue(tongue)
    _check_jaws(before, after)
    tell = progress or (lambda what, done, total: None)
    tell("bones", 0, 1 + len(PULLS))
    X, moved = tongue["position"].values, _map_of_bones(before, after)
    tissue = FitTissue.at_rest(
        Corners.from_elements(tongue["connectivity"].values.astype(np.int64)), moved.similarity(X)
    )
    attached = tongue["attachment_node"].values.astype(np.int64)
    stiffness = np.full(len(X), TO_SPLINE)
    stiffness[attached] = WITH_BONE
    q = tissue.settle(_springs(np.arange(len(X)), moved(X), stiffness), FINE_TOLERANCE)
    inputs: dict[str, Scan | None] = {}
    target, rows, notes = None, list[dict[str, Any]](), list[str]()
    if surface is not None:
        inputs["tongue"] = scan = scan_of(surface, unit, "tongue")
        target, notes = _target(tongue, q, scan, frame_of_inputs(after))
        rows.append({"stage": "with the bones", **distances(target, q)})
        with_bone = _springs(attached, moved(X[attached]), np.full(len(attached), WITH_BONE))
        tissue = FitTissue.at_rest(
            Corners.from_elements(tongue["connectivity"].values.astype(np.int64)), q
        )
        q = pull_to(
            tissue,
            lambda q, pull: pulling(q, [target], pull).joined(with_bone),
            lambda k: tell("fit to the surface", 1 + k, 1 + len(PULLS)),
        )
        rows.append({"stage": "fitted", **distances(target, q)})
        _check(rows[-1]["mean"], scan.source)
    fitted = _carried(tongue, q, moved)
    simulated = after.attrs["fit_of"] == "simulated"
    attributes = provenance(tongue, name, inputs, frame_of_inputs(after), simulated)
    fit_inputs = {"jaw": str(after.attrs["fit_inputs"]), **json.loads(attributes["fit_inputs"])}
    fitted = fitted.assign_attrs(attributes | {"fit_inputs": json.dumps(fit_inputs)})
    tell("fit to the surface", 1 + len(PULLS), 1 + len(PULLS))
    return FittedTongue(
        check_tongue(fitted), tongue, target,
        pd.DataFrame(rows, columns=["stage", "mean", "q95", "largest", "covered"]),
        quality_rows(tongue, fitted), _muscles(tongue, fitted), tuple(notes),
    )  # fmt: skip


def _check_jaws(before: xr.Dataset, after: xr.Dataset) -> None:
    if after.attrs.get("origin") != ORIGIN or after.sizes["vertex"] != before.sizes["vertex"]:
        raise FitError(
            "the jaw is not fitted from the given one, expected the jaw before and after its fit: "
            "give both"
        )


def _target(
    tongue: xr.Dataset, q: Floats, scan: Scan, to_frame: Similarity
) -> tuple[Target, list[str]]:
    """Surface of the tongue in the frame of the result, with outward normals."""
    faces, _ = boundary_faces(tongue["connectivity"].values.astype(np.int64))
    own = triangles(faces, tongue["position"].values)
    sheet = Sheet(np.unique(own), own, ())
    aim = in_face_frame(scan, to_frame)
    aim, turned = facing(aim, sheet.at(q), sheet.nodes, 1.0, scan.source)
    return Target("tongue", sheet, aim, rim=True), [*scan.notes, *([turned] if turned else [])]


def _check(miss: float, source: str) -> None:
    if not miss <= 1e3 * LARGEST_TONGUE_MISS:
        raise FitError(
            f"the fitted tongue misses {source} by {miss:.3g} mm in the mean, expected at most "
            f"{1e3 * LARGEST_TONGUE_MISS:.3g} mm: check that it is the tongue of the person in the "
            "pose of the bones"
        )


def _muscles(before: xr.Dataset, after: xr.Dataset) -> pd.DataFrame:
    """Total lengths of the fibres of every muscle [mm]."""
    owner = before["fibre_of_point"].values
    same = owner[1:] == owner[:-1]
    lengths_by_stage = {
        "before": before["fibre_position"].values, "after": after["fibre_position"].values
    }  # fmt: skip
    names = [str(m) for m in before["muscle"].values]
    muscle = before["fibre_muscle"].values[owner[:-1]]
    table: dict[str, Any] = {"muscle": names}
    for stage, points in lengths_by_stage.items():
        length = np.where(same, np.linalg.norm(np.diff(points, axis=0), axis=1), 0.0)
        table[stage] = 1e3 * np.bincount(muscle, length, minlength=len(names))
    lengths = pd.DataFrame(table)
    return lengths.assign(change=lengths["after"] / lengths["before"] - 1.0)


def _map_of_bones(before: xr.Dataset, after: xr.Dataset) -> SmoothMap:
    """Smooth map of the surfaces of the bones around a tongue, which correspond vertex by vertex."""
    one, two = surfaces_of(before), surfaces_of(after)
    source, target = (
        np.concatenate([
            s[body].points[:: max(1, len(s[body].points) // MAP_CONTROLS)] for body in BONES if body in s
        ])
        for s in (one, two)
    )  # fmt: skip
    motion = similarity(source, target)
    return SmoothMap.through(motion, source, target, np.full(len(source), 0.3e-3))


def _springs(nodes: np.ndarray, target: Floats, stiffness: Floats) -> Rows:
    return at_nodes(nodes, target, stiffness[:, None, None] * np.eye(3))


def _carried(tongue: xr.Dataset, q: Floats, moved: SmoothMap) -> xr.Dataset:
    """Tongue with its nodes at q; points of fibres follow their node, or the bones and the tissue."""
    result = tongue.copy(deep=True)
    X = tongue["position"].values
    result["position"].values[:] = q
    points = moved(tongue["fibre_position"].values)
    pick = np.arange(0, len(X), max(1, len(X) // (2 * MAP_CONTROLS)))
    motion = similarity(X, q)
    inner = SmoothMap.through(motion, X[pick], q[pick], np.full(len(pick), 0.1e-3))
    in_tissue = np.ones(len(points), dtype=bool)
    if "fibre_body" in tongue:
        in_tissue = tongue["fibre_body"].values < 0
    points[in_tissue] = inner(tongue["fibre_position"].values[in_tissue])
    if "fibre_node" in tongue:
        node = tongue["fibre_node"].values
        points[node >= 0] = q[node[node >= 0]]
    result["fibre_position"].values[:] = points
    F = element_gradients(tongue, q)[tongue["bundle_index"].values]
    direction = np.einsum("eij,ej->ei", F, tongue["bundle_direction"].values)
    result["bundle_direction"].values[:] = direction / np.linalg.norm(
        direction, axis=1, keepdims=True
    )
    if "posture_displacement" in tongue:
        turned = tongue["posture_displacement"].values @ motion.rotation.T
        result["posture_displacement"].values[:] = motion.scale * turned
    return result
