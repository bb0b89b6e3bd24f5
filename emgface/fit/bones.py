"""Jaw of a person: bones moved to landmarks and surfaces; muscles, joints, masses and inertias follow.

One smooth map (`emgface.fit.registration`) moves all points. Axes of hinges follow its gradient F at
the joint as directions, normals of planes and curves as F^-T n; the coefficients of a curve in m^(1 - k)
grow with its (1 - k)-th power of the local scale. A body keeps its density: with the affine map A
nearest to the motion of its surface and the ratio r of volumes, its mass is r m and its second moment r
A M A' (M = tr(I)/2 - I). Largest forces of muscles are kept, because no input determines them.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import pandas as pd
import xarray as xr

from emgface.anatomy.jaw.model import check_jaw
from emgface.errors import FitError, listed
from emgface.fit.deform import LANDMARK_NOISE
from emgface.fit.inputs import Matched, facing, frame_of_inputs, in_face_frame, match, provenance
from emgface.fit.person import Given, Marks, scan_of
from emgface.fit.places import left_landmarks
from emgface.fit.readers.landmarks import landmarks_of
from emgface.fit.readers.surfaces import Scan
from emgface.fit.registration import SmoothMap, closest_points, smooth_map
from emgface.fit.similarity import Similarity
from emgface.fit.triangulated import Floats, Surface

#: largest mean distance of a fitted bone from its surface that is accepted [m]
LARGEST_BONE_MISS: Final = 1.5e-3
UNMOVED: Final = Similarity(1.0, np.eye(3), np.zeros(3))
POINT_VARIABLES: Final = (
    "point_position", "muscle_position", "spring_position", "joint_origin", "surface_position",
    "body_damped_at",
)  # fmt: skip


@dataclass(frozen=True)
class FittedBones:
    """Fitted jaw with the measures of its report."""

    jaw: xr.Dataset  #: checked jaw model
    distance: pd.DataFrame  #: distances of the surfaces before and after [mm], by body
    landmarks: pd.DataFrame  #: distance at the landmarks [mm]
    bodies: pd.DataFrame  #: mass before and after [g], ratio of volumes
    notes: tuple[str, ...]
    source: xr.Dataset  #: jaw that was fitted
    targets: Mapping[str, Surface]  #: surfaces in the frame of the result, by body
    crosses: Floats | None  #: landmarks of the person in the frame of the result [m]


def fit_jaw(
    jaw: xr.Dataset,
    *,
    landmarks: Marks | None = None,
    surfaces: Mapping[str, Given] | None = None,
    unit: str | None = None,
    on_jaw: Marks | None = None,
    frame: xr.Dataset | None = None,
    noise: float = LANDMARK_NOISE,
    name: str = "fitted jaw",
    simulated: bool = False,
) -> FittedBones:
    """Fit jaw, hyoid and larynx to a person.

    `surfaces` are of bodies by name ("jaw", "hyoid"); `landmarks` and places `on_jaw` as of a face.
    `frame` is the fitted face of the same person, whose motion from the inputs to its own frame is
    used; otherwise the landmarks determine the motion, and without them the inputs are in the frame of
    the jaw. Raises FitError if an input is unusable or missed, or the map folds.
    """
    check_jaw(jaw)
    own = surfaces_of(jaw)
    if unknown := [body for body in surfaces or {} if body not in own]:
        raise FitError(
            f"the jaw has no surface of {listed(unknown)}, expected some of {listed(own)}: name the "
            "surface by its body"
        )
    scans = {
        body: scan_of(given, unit, body, 0.5 * float(np.ptp(own[body].points, axis=0).max()))
        for body, given in (surfaces or {}).items()
    }
    marks = None if landmarks is None else landmarks_of(landmarks, unit)
    if marks is None and not scans:
        raise FitError("no landmarks and no surface are given, expected at least one of them")
    also = None if on_jaw is None else landmarks_of(on_jaw)
    matched = None if marks is None else match(points_of_jaw(jaw), marks, also, noise, "jaw")
    if frame is not None:
        to_frame = frame_of_inputs(frame)
    else:
        to_frame = UNMOVED if matched is None else matched.rigid
    notes = [note for scan in scans.values() for note in scan.notes]
    targets: dict[str, Surface] = {}
    first = _of_landmarks(matched, to_frame)
    for body, scan in scans.items():
        place = Surface(first(own[body].points), own[body].triangles)
        nodes = np.arange(len(place.points))
        aim = in_face_frame(scan, to_frame)
        targets[body], turned = facing(aim, place, nodes, 1.0, scan.source)
        notes.extend([turned] if turned else [])
    motion = first if matched is not None else _of_largest(own, targets)
    aims = None if matched is None else (matched.source, to_frame(matched.target), noise)
    pairs = [(own[body], target) for body, target in targets.items()]
    moved = smooth_map(motion, pairs, aims) if pairs or aims is not None else SmoothMap(motion)
    fitted = moved_jaw(jaw, moved)
    inputs = {"landmarks": marks, **scans}
    fitted = fitted.assign_attrs(provenance(jaw, name, inputs, to_frame, simulated))
    distance = _distances(own, fitted, targets, motion)
    _check(distance, scans)
    errors = _landmarks(matched, aims, moved)
    if matched is not None:
        notes += matched.notes
        left = left_landmarks(1e-3 * errors["error"].to_numpy(), noise)
        notes += [left] if left else []
    return FittedBones(
        check_jaw(fitted), distance, errors, _bodies(jaw, fitted), tuple(notes), jaw, targets,
        None if aims is None else aims[1],
    )  # fmt: skip


def points_of_jaw(jaw: xr.Dataset) -> dict[str, Floats]:
    """Named points of a jaw, such as lower_incisor and condyle_L [m]."""
    names = [str(name) for name in jaw["point"].values]
    return dict(zip(names, jaw["point_position"].values, strict=True))


def surfaces_of(jaw: xr.Dataset) -> dict[str, Surface]:
    """Surfaces of the bodies that have one, by name."""
    if "surface_position" not in jaw:
        return {}
    position, triangle = jaw["surface_position"].values, jaw["surface_triangle"].values
    owner = jaw["surface_body"].values[triangle[:, 0]]
    surfaces: dict[str, Surface] = {}
    for k, body in enumerate(jaw["body"].values):
        used, corner = np.unique(triangle[owner == k], return_inverse=True)
        if len(used):
            surfaces[str(body)] = Surface(position[used], corner.reshape(-1, 3).astype(np.int64))
    return surfaces


def _of_landmarks(matched: Matched | None, to_frame: Similarity) -> Similarity:
    """Similarity of the landmarks in the frame of the result, none without landmarks."""
    if matched is None:
        return UNMOVED
    motion = matched.motion
    return Similarity(
        motion.scale, to_frame.rotation @ motion.rotation,
        to_frame.rotation @ motion.shift + to_frame.shift,
    )  # fmt: skip


def _of_largest(own: Mapping[str, Surface], targets: Mapping[str, Surface]) -> Similarity:
    """Similarity of the largest bone and its surface."""
    body = max(targets, key=lambda name: own[name].areas.sum())
    start = closest_points(own[body], targets[body])
    return closest_points(own[body], targets[body], start, scaled=True)


def moved_jaw(jaw: xr.Dataset, moved: SmoothMap) -> xr.Dataset:
    """Jaw whose points follow a map, with the axes, lengths, masses and inertias that belong to it."""
    result = jaw.copy(deep=True)
    for name in POINT_VARIABLES:
        if name in jaw:
            values = jaw[name].values
            result[name].values[:] = moved(values.reshape(-1, 3)).reshape(values.shape)
    _joints(jaw, result, moved)
    before, after = (
        np.linalg.norm(np.diff(d["spring_position"].values, axis=1)[:, 0], axis=1)
        for d in (jaw, result)
    )
    result["spring_rest_length"].values[:] *= after / np.where(before > 0.0, before, 1.0)
    _masses(jaw, result, moved)
    return result


def _joints(jaw: xr.Dataset, after: xr.Dataset, moved: SmoothMap) -> None:
    for k, origin in enumerate(jaw["joint_origin"].values):
        F = moved.gradient(origin)
        size = np.linalg.det(F)
        if not size > 0.0:
            raise FitError(
                f"the map folds at the joint {jaw['joint'].values[k]}, expected a positive "
                "determinant: check landmarks and surfaces"
            )
        scale = size ** (1.0 / 3.0)
        hinge = jaw["joint_kind"].values[k] == 2
        along = F if hinge else np.linalg.inv(F).T
        normal = along @ jaw["joint_normal"].values[k]
        normal /= np.linalg.norm(normal)
        forward = F @ jaw["joint_forward"].values[k]
        if not hinge:
            forward -= (forward @ normal) * normal
        after["joint_normal"].values[k] = normal
        after["joint_forward"].values[k] = forward / np.linalg.norm(forward)
        powers = scale ** (1.0 - np.arange(jaw.sizes["power"]))
        after["joint_curve"].values[k] = jaw["joint_curve"].values[k] * powers
        after["joint_length"].values[k] = jaw["joint_length"].values[k] * scale


def _masses(jaw: xr.Dataset, carried: xr.Dataset, moved: SmoothMap) -> None:
    before, after = surfaces_of(jaw), surfaces_of(carried)
    for k, body in enumerate(jaw["body"].values):
        centre = jaw["body_centre"].values[k]
        if str(body) in before:
            one, two = before[str(body)].points, after[str(body)].points
            A = np.linalg.lstsq(one - one.mean(axis=0), two - two.mean(axis=0), rcond=None)[0].T
            ratio = surface_volume(after[str(body)]) / surface_volume(before[str(body)])
        else:
            A = moved.gradient(centre)
            ratio = float(np.linalg.det(A))
        if not ratio > 0.0:
            raise FitError(
                f"the body {body} has {ratio:.3g} of its volume, expected a positive share: check "
                "landmarks and surfaces"
            )
        inertia = jaw["body_inertia"].values[k]
        second = ratio * A @ (0.5 * np.trace(inertia) * np.eye(3) - inertia) @ A.T
        carried["body_inertia"].values[k] = np.trace(second) * np.eye(3) - second
        carried["body_mass"].values[k] = ratio * jaw["body_mass"].values[k]
        if jaw["body_mass"].values[k] > 0.0:
            carried["body_centre"].values[k] = moved(centre[None])[0]


def surface_volume(surface: Surface) -> float:
    """Volume of a closed surface, or of the cone from the centre of an open one [m3]."""
    corners = (surface.points - surface.points.mean(axis=0))[surface.triangles]
    return float(np.linalg.det(corners).sum() / 6.0)


def _distances(
    own: Mapping[str, Surface],
    fitted: xr.Dataset,
    targets: Mapping[str, Surface],
    motion: Similarity,
) -> pd.DataFrame:
    rows: list[dict[str, Any]] = []
    after = surfaces_of(fitted)
    for body, target in targets.items():
        start = Surface(motion(own[body].points), own[body].triangles)
        for stage, surface in (("similarity", start), ("fitted", after[body])):
            there, back = (
                one.nearest(points)
                for one, points in ((target, surface.samples[0]), (surface, target.samples[0]))
            )
            use = ~target.at_border(there)
            one, two = 1e3 * there.distance[use], 1e3 * back.distance
            rows.append({
                "body": body, "stage": stage, "mean": 0.5 * float(one.mean() + two.mean()),
                "q95": float(np.quantile(np.concatenate([one, two]), 0.95)),
            })  # fmt: skip
    return pd.DataFrame(rows, columns=["body", "stage", "mean", "q95"])


def _check(distance: pd.DataFrame, scans: Mapping[str, Scan]) -> None:
    for row in distance[distance["stage"] == "fitted"].to_dict("records"):
        if not row["mean"] <= 1e3 * LARGEST_BONE_MISS:
            raise FitError(
                f"the fitted {row['body']} misses {scans[row['body']].source} by {row['mean']:.3g} mm "
                f"in the mean, expected at most {1e3 * LARGEST_BONE_MISS:.3g} mm: check the unit, "
                "frame and bone, or give landmarks"
            )


def _landmarks(
    matched: Matched | None, aims: tuple[Floats, Floats, float] | None, moved: SmoothMap
) -> pd.DataFrame:
    if matched is None or aims is None:
        return pd.DataFrame(columns=["landmark", "error"])
    miss = 1e3 * np.linalg.norm(moved(aims[0]) - aims[1], axis=1)
    return pd.DataFrame({"landmark": matched.names, "error": miss})


def _bodies(before: xr.Dataset, after: xr.Dataset) -> pd.DataFrame:
    table = {
        "body": [str(body) for body in before["body"].values],
        "mass before": 1e3 * before["body_mass"].values,
        "mass after": 1e3 * after["body_mass"].values,
    }
    return pd.DataFrame(table)
