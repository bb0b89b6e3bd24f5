"""Landmarks and surfaces of a person compared with a face: pairs, sides, order, frame of the face."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
import xarray as xr
from scipy.interpolate import CubicSpline

from emgface.errors import FitError, listed
from emgface.face.parts import OUTER
from emgface.face.template.calibrate import profiles_of_tips
from emgface.fit.family import Family
from emgface.fit.readers.landmarks import Landmarks, plain
from emgface.fit.readers.surfaces import Scan
from emgface.fit.similarity import Similarity, misfit, rigid_of, similarity
from emgface.fit.strays import (
    LEAST_JUDGED_LANDMARKS,
    check_sides,
    check_strays,
    unusual_proportions,
)
from emgface.fit.targets import LandmarkPoints, Sheet
from emgface.fit.triangulated import Floats, Surface

ORIGIN: Final = "fitted"  #: origin of a fitted model in its attributes
LEAST_LANDMARKS: Final = 4  #: smallest number of landmarks
#: smallest extent of the landmarks across a plane, relative to the largest [1]
LANDMARKS_FLAT: Final = 0.05
#: ratio of the misfits of improper and proper map of a mirrored input [1]
MIRRORED_MISFIT_RATIO: Final = 0.6
SIZE_RATIOS: Final = (0.6, 1.6)  #: ratio of sizes of two people
USUAL_SCALE: Final = (0.75, 1.35)
"""Ratio of sizes beyond which a unit, or the spacing of the voxels of an image, is doubtful."""
OFF: Final = 0.012  #: distance of a landmark from the skin that is refused [m]
#: extent of the landmarks, or of a scan, of a face below which they are doubted [1]
LOCAL: Final = 0.5
TIP: Final = 0.03  #: distance of the tip of a nose or chin within which its curve is followed [m]
HIDDEN: Final = 0.01  #: share of a surface beneath its outer layer from which that is left out [1]
BENEATH_DEPTHS: Final = (3e-3, 12e-3)
"""Depth under the outer layer at which triangles that face inward, and any, are beneath it [m]."""
DISAGREE: Final = 0.5  #: mean cosine of normals below which a surface is refused [1]


@dataclass(frozen=True, eq=False)
class Paired:
    """Landmarks on the source mesh, with targets in the frame of the face, and the rigid motion."""

    points: LandmarkPoints
    to_face: Similarity  #: rigid motion from the frame of the person to that of the face
    misfit: float  #: root mean square distance after the similarity [m]
    notes: list[str]


def points_of_face(face: xr.Dataset) -> dict[str, Floats]:
    """Named points of a face: lip and face markers, lip margins, tips of nose and chin [m]."""
    position = face["position"].values
    rows = zip(face["marker"].values, face["marker_node"].values, strict=True)
    points = {str(name): position[node] for name, node in rows}
    if "face_marker_position" in face:
        rows = zip(face["face_marker"].values, face["face_marker_position"].values, strict=True)
        points |= {str(name): point for name, point in rows}
    if "lip_opening_node" in face:
        for lip, node in zip(face["lip"].values, face["lip_opening_node"].values, strict=True):
            points[f"stomion_{lip}"] = position[node]
    return points | {name: _tip(profile) for name, profile in _profiles(face).items()}


def _profiles(face: xr.Dataset) -> dict[str, Floats]:
    """Midline (n, 3) [m] of nose and of chin; of a generated face, that of its surfaces.

    The nodes of a coarse mesh may be 8 mm from the tip of the nose.
    """
    if family := Family.from_face(face):
        return profiles_of_tips(family.surfaces(family.start))
    if "lip_opening_node" not in face:
        return {}
    position = face["position"].values
    mouth, nasion = position[face["lip_opening_node"].values], _point(face, "nasion")
    middle = _midline(Sheet.from_face(face, OUTER).at(position), mouth.mean(axis=0), nasion)
    z, low, high = middle[:, 2], mouth[:, 2].min(), mouth[:, 2].max()
    top = z.max() if nasion is None else nasion[2]  # a forehead may be anterior to the nose
    nose, chin = middle[z > high + 0.2 * (top - high)], middle[z < 0.5 * (low + z.min())]
    profiles = {"pronasale": _around_tip(nose, top), "pogonion": _around_tip(chin, low)}
    return {name: part for name, part in profiles.items() if len(part)}


def _around_tip(profile: Floats, top: float) -> Floats:
    """Points near the most anterior one below `top`, without the underside at the same height [m]."""
    below = profile[profile[:, 2] <= top]
    if not len(below):
        return below
    tip = below[np.argmax(below[:, 1])]
    return profile[np.linalg.norm(profile - tip, axis=1) < TIP]


def _midline(skin: Surface, mouth: Floats, nasion: Floats | None) -> Floats:
    """Points (n, 3) of the edges of a skin in the plane of mouth, nasion and the axis y, by z [m].

    A fitted or treated face is not symmetric, and has no nodes in the plane x = 0.
    """
    slope = 0.0 if nasion is None else (nasion[0] - mouth[0]) / (nasion[2] - mouth[2])
    x = skin.points[:, 0] - mouth[0] - slope * (skin.points[:, 2] - mouth[2])
    t = skin.triangles
    edges = np.unique(np.sort(np.concatenate([t[:, [0, 1]], t[:, [1, 2]], t[:, [2, 0]]])), axis=0)
    a, b = edges[(x[edges] < 0.0).sum(axis=1) == 1].T
    share = (x[a] / (x[a] - x[b]))[:, None]
    points = skin.points[a] + share * (skin.points[b] - skin.points[a])
    line = np.unique(np.round(points, 6), axis=0)  # once where several edges meet
    return line[np.argsort(line[:, 2])]


def _point(face: xr.Dataset, name: str) -> Floats | None:
    """Face marker of this name [m]; None if the face has none."""
    if "face_marker_position" not in face or name not in face["face_marker"].values:
        return None
    return face["face_marker_position"].sel(face_marker=name).values


def _tip(profile: Floats) -> Floats:
    """Most anterior point of a curve through points (n, 3), by a cubic spline near the largest y."""
    k = int(np.argmax(profile[:, 1]))
    near = profile[max(0, k - 2) : k + 3]
    place = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(near, axis=0), axis=1)))
    if len(near) < 4 or not (np.diff(place) > 0.0).all():
        return profile[k]
    curve = CubicSpline(place, near)(np.linspace(0.0, place[-1], 401))
    return np.asarray(curve[np.argmax(curve[:, 1])])


@dataclass(frozen=True, eq=False)
class Matched:
    """Landmarks (n, 3) on a model and on a person, paired by name, and their similarity [m]."""

    names: tuple[str, ...]
    source: Floats
    target: Floats
    motion: Similarity
    notes: list[str]

    @property
    def rigid(self) -> Similarity:
        """Rigid motion from the frame of the person to that of the model."""
        inverse = Similarity(1.0, self.motion.rotation.T, np.zeros(3))
        shift = self.source.mean(axis=0) - inverse(self.target.mean(axis=0)[None])[0]
        return Similarity(1.0, self.motion.rotation.T, shift)


def match(
    points: Mapping[str, Floats], given: Landmarks, also: Landmarks | None, noise: float, model: str
) -> Matched:
    """Pair landmarks of a person by name with points of a model, and check their geometry.

    `also` are places of the landmarks on the model [m], in addition to its own named `points`;
    `noise` is the standard deviation of a landmark [m]. Raises FitError if fewer than four have a
    counterpart, they lie in a plane, the input is mirrored, two are exchanged, or the others
    contradict one.
    """
    known = {plain(name): p for name, p in points.items()}
    if also is not None:
        known |= dict(zip(also.names, also.position, strict=True))
    names = [n for n in given.names if n in known]
    if len(names) < LEAST_LANDMARKS:
        raise FitError(
            f"{given.source}: {len(names)} of {len(given.names)} landmarks have a counterpart on the "
            f"{model}, expected at least {LEAST_LANDMARKS}: name them as on the {model} "
            f"({listed(sorted(known), 12)}), or state their places on the {model}"
        )
    notes = []
    if unknown := [n for n in given.names if n not in known]:
        notes.append(
            f"landmarks without a counterpart on the {model} were ignored: {listed(unknown)}"
        )
    at = np.array([given.names.index(n) for n in names])
    source, target = np.array([known[n] for n in names]), given.position[at]
    extents = np.linalg.svd(source - source.mean(axis=0), compute_uv=False)
    own = np.linalg.svd(target - target.mean(axis=0), compute_uv=False)
    for values, whose in ((extents, f"on the {model}"), (own, f"of {given.source}")):
        if not values[2] > LANDMARKS_FLAT * values[0]:
            raise FitError(
                f"the landmarks {whose} lie nearly in one plane, expected landmarks at different "
                "depths: add some, for example at the tip of the nose, the chin and the temples"
            )
    motion = similarity(source, target)
    _check_side(source, target, motion, given.source)
    check_sides(names, source, target, given.source)
    if not SIZE_RATIOS[0] <= motion.scale <= SIZE_RATIOS[1]:
        raise FitError(
            f"{given.source}: the landmarks are {motion.scale:.3g} times as far apart as those of the "
            f"{model}, expected {SIZE_RATIOS[0]} to {SIZE_RATIOS[1]}: check the unit"
        )
    if not USUAL_SCALE[0] <= motion.scale <= USUAL_SCALE[1]:
        notes.append(
            f"the landmarks are {motion.scale:.3g} times as far apart as those of the {model}, usually "
            f"{USUAL_SCALE[0]} to {USUAL_SCALE[1]}: check the unit, and the spacing of the voxels if "
            "they are from an image"
        )
    check_strays(names, source, target, given.source, noise)
    if doubt := unusual_proportions(source, target, motion.rotation, given.source, noise):
        notes.append(doubt)
    if len(names) < LEAST_JUDGED_LANDMARKS:
        notes.append(
            f"with {len(names)} landmarks, about half of the exchanges of two names remain undetected: "
            f"check the names, or place at least {LEAST_JUDGED_LANDMARKS}"
        )
    return Matched(tuple(names), source, target, motion, notes)


def pair_points(
    face: xr.Dataset, given: Landmarks, on_face: Landmarks | None, noise: float
) -> Paired:
    """Pair landmarks of a person with those of a face; errors as of `match`."""
    matched = match(points_of_face(face), given, on_face, noise, "face")
    to_face, source = matched.rigid, matched.source
    size, whole = (
        float(np.linalg.norm(np.ptp(x, axis=0))) for x in (source, face["position"].values)
    )
    if size < LOCAL * whole:
        matched.notes.append(
            f"the landmarks span {1e3 * size:.0f} mm of a face of {1e3 * whole:.0f} mm; beyond them its "
            "shape is extrapolated: add landmarks at its borders, for example nasion, chin and temples"
        )
    near = (skin := Sheet.from_face(face, OUTER).at(face["position"].values)).nearest(source)
    points = LandmarkPoints(
        matched.names, source, to_face(matched.target), skin.triangles[near.triangle], near.weights,
        source - near.foot, near.distance <= OFF,
    )  # fmt: skip
    return Paired(points, to_face, misfit(matched.motion, source, matched.target), matched.notes)


def _check_side(source: Floats, target: Floats, motion: Similarity, name: str) -> None:
    """Refuse landmarks that only a reflection fits."""
    proper = misfit(motion, source, target)
    improper = misfit(similarity(source, target, mirrored=True), source, target)
    if improper < MIRRORED_MISFIT_RATIO * proper:
        raise FitError(
            f"{name} is mirrored: a reflection fits the landmarks to {1e3 * improper:.3g} mm rms, the "
            f"best rotation only to {1e3 * proper:.3g} mm; expected a right-handed frame and left and "
            "right of the person: change the sign of one axis of all inputs, or exchange the names of "
            "the sides"
        )


def in_face_frame(scan: Scan, to_face: Similarity) -> Surface:
    """Surface of a scan in the frame of the face."""
    return Surface(to_face(scan.surface.points), scan.surface.triangles)


def frame_of_inputs(model: xr.Dataset) -> Similarity:
    """Rigid motion from the frame of the inputs to that of a fitted model; FitError if not fitted."""
    if "fit_frame" not in model.attrs:
        raise FitError(
            f"the model {model.attrs.get('name', '')!r} whose frame is used has no attribute fit_frame, "
            "expected one that was fitted to the same person: fit it first"
        )
    return rigid_of(np.array(json.loads(model.attrs["fit_frame"])))


def provenance(
    model: xr.Dataset,
    name: str,
    inputs: Mapping[str, Scan | Landmarks | None],
    frame: Similarity,
    simulated: bool,
) -> dict[str, str]:
    """Attributes of a fitted model: name, source, digests of the inputs, and its frame."""
    motion = np.column_stack([frame.rotation, frame.shift]).ravel()
    kind = "simulated person" if simulated else "person"
    return {
        "name": name,
        "origin": ORIGIN,
        "source": f"{model.attrs['name']} ({model.attrs['source']}), fitted to a {kind}",
        "fit_inputs": json.dumps(
            {key: f"{i.source} {i.digest}".strip() for key, i in inputs.items() if i is not None}
        ),
        "fit_of": "simulated" if simulated else "measured",
        "fit_frame": json.dumps([float(v) for v in motion]),
    }  # fmt: skip


def outer_layer(surface: Surface, sheet: Surface) -> tuple[Surface, float]:
    """Surface without the parts beneath its outer layer over a sheet, and their share of its area.

    The boundary of labelled tissue encloses it: it also has an inner side, a back, and walls of the
    airway. Depths are along the normal of the nearest triangle of the sheet. A surface with a share
    below `HIDDEN` is returned as it is, with the share 0.
    """
    centre = surface.points[surface.triangles].mean(axis=1)
    near = sheet.nearest(centre)
    n = sheet.normals[near.triangle]
    over = np.einsum("ti,ti->t", centre - near.foot, n)
    judged = ~sheet.at_border(near)
    top = np.full(len(sheet.triangles), -np.inf)
    np.maximum.at(top, near.triangle[judged], over[judged])
    depth = top[near.triangle] - over
    inward = np.einsum("ti,ti->t", surface.normals, n) < 0.0
    hidden = judged & ((depth > BENEATH_DEPTHS[1]) | (inward & (depth > BENEATH_DEPTHS[0])))
    share = float(surface.areas[hidden].sum() / surface.areas.sum())
    if share < HIDDEN:
        return surface, 0.0
    hidden |= ~judged & (
        over < -BENEATH_DEPTHS[1]
    )  # walls of an open mouth, whose lips are edges of the sheet
    return Surface(surface.points, surface.triangles[~hidden]), share


def facing(
    surface: Surface, sheet: Surface, nodes: np.ndarray, side: float, name: str
) -> tuple[Surface, str | None]:
    """Turn a surface whose normals oppose those of the tissue; FitError if they do neither."""
    near = surface.nearest(sheet.points[nodes])
    close = near.distance < 0.02
    if close.sum() < 0.2 * len(nodes):
        raise FitError(
            f"{name} is near only {close.mean():.0%} of the nodes it belongs to, expected a surface "
            "that covers at least 20 % of them: check the unit, the frame and the part"
        )
    cosine = side * np.einsum(
        "ni,ni->n", surface.normals[near.triangle[close]], sheet.point_normals[nodes[close]]
    )
    mean = float(np.mean(cosine))
    if abs(mean) < DISAGREE and abs(float(np.median(cosine))) < DISAGREE:
        raise FitError(
            f"{name} has no consistent outer side (mean cosine {mean:.2f} with the normals of the "
            "model), expected outward triangles: repair the surface"
        )
    if float(np.median(cosine)) > 0.0:
        return surface, None
    return Surface(surface.points, surface.triangles[:, ::-1].copy()), (
        f"the triangles of {name} were turned, because their normals pointed inward"
    )
