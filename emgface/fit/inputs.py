"""Landmarks and surfaces of a person compared with a face: pairs, sides, order, frame of the face."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
import xarray as xr
from scipy.interpolate import CubicSpline

from emgface.errors import FitError, listed
from emgface.face.landmarks import MIDLINE
from emgface.face.parts import OUTER
from emgface.face.template.calibrate import profiles_of_tips
from emgface.fit.family import Family
from emgface.fit.readers.landmarks import Landmarks, plain
from emgface.fit.readers.surfaces import Scan
from emgface.fit.similarity import Similarity, misfit, rigid_of, similarity
from emgface.fit.strays import CLICK, check_strays
from emgface.fit.strays import LEAST as ENOUGH
from emgface.fit.targets import LandmarkPoints, Sheet
from emgface.fit.triangulated import Floats, Surface

ORIGIN: Final = "fitted"  #: origin of a fitted model in its attributes
LEAST: Final = 4  #: smallest number of landmarks
FLAT: Final = 0.05  #: smallest extent of the landmarks across a plane, relative to the largest [1]
MIRRORED: Final = 0.6  #: ratio of the misfits of improper and proper map of a mirrored input [1]
SCALE: Final = (0.6, 1.6)  #: ratio of sizes of two people
USUAL_SCALE: Final = (0.75, 1.35)
"""Ratio of sizes beyond which a unit, or the spacing of the voxels of an image, is doubtful."""
OFF: Final = 0.012  #: distance of a landmark from the skin that is refused [m]
LOCAL: Final = (
    0.5  #: extent of the landmarks, relative to the face, below which they are doubted [1]
)
BESIDE: Final = 2.0  #: largest distance of landmarks from the skin without a doubt, in deviations
BENEATH: Final = 2e-3  #: smallest distance of the landmarks from bone or an inner surface [m]
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
    found = {str(name): position[node] for name, node in rows}
    if "face_marker_position" in face:
        rows = zip(face["face_marker"].values, face["face_marker_position"].values, strict=True)
        found |= {str(name): point for name, point in rows}
    if "lip_opening_node" in face:
        for lip, node in zip(face["lip"].values, face["lip_opening_node"].values, strict=True):
            found[f"stomion_{lip}"] = position[node]
    return found | {name: _tip(profile) for name, profile in _profiles(face).items()}


def _profiles(face: xr.Dataset) -> dict[str, Floats]:
    """Midline (n, 3) [m] of nose and of chin; of a generated face, that of its surfaces.

    The nodes of a coarse mesh may be 8 mm from the tip of the nose.
    """
    if family := Family.of(face):
        return profiles_of_tips(family.surfaces(family.start))
    if "lip_opening_node" not in face:
        return {}
    position = face["position"].values
    nodes = Sheet.of(face, OUTER).nodes
    middle = position[nodes[np.abs(position[nodes, 0]) < MIDLINE]]
    middle = middle[np.argsort(middle[:, 2])]
    mouth = position[face["lip_opening_node"].values, 2]
    away = 0.1 * float(np.ptp(position[nodes, 2]))
    parts = {
        "pronasale": middle[middle[:, 2] > mouth.max() + away],
        "pogonion": middle[middle[:, 2] < mouth.min() - away],
    }
    return {name: part for name, part in parts.items() if len(part)}


def _tip(profile: Floats) -> Floats:
    """Most anterior point of a curve through points (n, 3), by a cubic spline near the largest y."""
    k = int(np.argmax(profile[:, 1]))
    near = profile[max(0, k - 2) : k + 3]
    place = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(near, axis=0), axis=1)))
    if len(near) < 5 or not (np.diff(place) > 0.0).all():
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
    if len(names) < LEAST:
        raise FitError(
            f"{given.source}: {len(names)} of {len(given.names)} landmarks have a counterpart on the "
            f"{model}, expected at least {LEAST}: name them as on the {model} "
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
        if not values[2] > FLAT * values[0]:
            raise FitError(
                f"the landmarks {whose} lie nearly in one plane, expected landmarks at different "
                "depths: add some, for example at the tip of the nose, the chin and the temples"
            )
    motion = similarity(source, target)
    _check_side(source, target, motion, given.source)
    if not SCALE[0] <= motion.scale <= SCALE[1]:
        raise FitError(
            f"{given.source}: the landmarks are {motion.scale:.3g} times as far apart as those of the "
            f"{model}, expected {SCALE[0]} to {SCALE[1]}: check the unit"
        )
    if not USUAL_SCALE[0] <= motion.scale <= USUAL_SCALE[1]:
        notes.append(
            f"the landmarks are {motion.scale:.3g} times as far apart as those of the {model}, usually "
            f"{USUAL_SCALE[0]} to {USUAL_SCALE[1]}: check the unit, and the spacing of the voxels if "
            "they are from an image"
        )
    check_strays(names, source, target, given.source, noise)
    if len(names) < ENOUGH:
        notes.append(
            f"with {len(names)} landmarks, about half of the exchanges of two names remain undetected: "
            f"check the names, or place at least {ENOUGH}"
        )
    return Matched(tuple(names), source, target, motion, notes)


def pair_points(
    face: xr.Dataset, given: Landmarks, on_face: Landmarks | None, noise: float
) -> Paired:
    """Pair landmarks of a person with those of a face; errors as of `match`."""
    found = match(points_of_face(face), given, on_face, noise, "face")
    to_face, source = found.rigid, found.source
    size, whole = (
        float(np.linalg.norm(np.ptp(x, axis=0))) for x in (source, face["position"].values)
    )
    if size < LOCAL * whole:
        found.notes.append(
            f"the landmarks span {1e3 * size:.0f} mm of a face of {1e3 * whole:.0f} mm; beyond them its "
            "shape is extrapolated: add landmarks at its borders, for example nasion, chin and temples"
        )
    near = (skin := Sheet.of(face, OUTER).at(face["position"].values)).nearest(source)
    points = LandmarkPoints(
        found.names, source, to_face(found.target), skin.triangles[near.triangle], near.weights,
        source - near.foot, near.distance <= OFF,
    )  # fmt: skip
    return Paired(points, to_face, misfit(found.motion, source, found.target), found.notes)


def _check_side(source: Floats, target: Floats, motion: Similarity, name: str) -> None:
    """Refuse landmarks that only a reflection fits."""
    proper = misfit(motion, source, target)
    improper = misfit(similarity(source, target, mirrored=True), source, target)
    if improper < MIRRORED * proper:
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


def check_landmarks_on(
    skin: Surface, points: LandmarkPoints, name: str, noise: float
) -> str | None:
    """Refuse landmarks that do not lie on the skin, with the evidence for the likely reason.

    Returns a doubt if they miss it by more than their noise explains.
    """
    near = skin.nearest(points.target)
    far = points.on_skin & (near.distance > OFF)
    many = float(np.median(near.distance[points.on_skin]))
    if far.any():
        k = int(np.argmax(np.where(far, near.distance, 0.0)))
        raise FitError(
            f"landmark {points.names[k]} lies {1e3 * near.distance[k]:.3g} mm from {name} (median of "
            f"all {1e3 * many:.3g} mm), expected at most {1e3 * OFF:.0f} mm: "
            + (
                "check the unit and the frame (LPS or RAS) of both files"
                if many > OFF
                else "check this landmark, or whether the surface has a hole there"
            )
        )
    miss = float(np.sqrt(np.mean(near.distance[points.on_skin] ** 2)))
    if miss <= (limit := BESIDE * max(noise, CLICK)):
        return None
    return (
        f"the landmarks lie {1e3 * miss:.2g} mm rms from {name}, expected at most {1e3 * limit:.2g} mm "
        f"for a noise of {1e3 * noise:.2g} mm: check whether they are of the same scan and pose"
    )


def check_landmarks_off(surface: Surface, points: LandmarkPoints, name: str, kind: str) -> None:
    """Refuse an inner surface, or one of bone, on which the landmarks of the skin lie."""
    near = surface.nearest(points.target[points.on_skin])
    if len(near.distance) and (beneath := float(np.median(near.distance))) < BENEATH:
        raise FitError(
            f"the landmarks of the skin lie {1e3 * beneath:.2g} mm from {name} (median), which was "
            f"given as {kind}; expected at least {1e3 * BENEATH:.0f} mm of soft tissue between them: "
            "check whether this is the surface of the skin"
        )


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
            "face), expected outward triangles: repair the surface"
        )
    if float(np.median(cosine)) > 0.0:
        return surface, None
    return Surface(surface.points, surface.triangles[:, ::-1].copy()), (
        f"the triangles of {name} were turned, because their normals pointed inward"
    )
