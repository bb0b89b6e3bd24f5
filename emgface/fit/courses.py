"""Courses of muscles from tractography: fibres, elements, directions and shares of a muscle replaced.

Streamlines are resampled to equal numbers of points by arc length, turned alike, and grouped (k-means);
the mean of each group is a fibre. The radius of the muscle is given, follows from its volume V (the
tubes around the fibres have this volume in the mesh), or from the bundle: points that fill a disc of
radius R evenly have the mean square distance R^2 / 2 from its axis, so that R = sqrt(2) times their rms
distance.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import xarray as xr
from scipy.cluster.vq import kmeans2
from scipy.optimize import brentq

from emgface.errors import FitError, listed
from emgface.face.bundles import distance_to_fibres, fibre_directions, project_into_mesh
from emgface.face.parts import fibres_of
from emgface.face.quality import element_centres, element_quality
from emgface.face.shares import shares_within
from emgface.face.validity import check_face
from emgface.fit.inputs import frame_of_inputs
from emgface.fit.readers.tracts import Tracts, tracts_of
from emgface.fit.triangulated import Floats

FIBRE_POINTS: Final = 15  #: points of a fibre
RADII: Final = (0.5e-3, 20e-3)  #: smallest and largest radius of a muscle of the face [m]
#: largest median distance of a bundle from the course that it replaces [m]
LARGEST_COURSE_DISTANCE: Final = 20e-3
OUTSIDE: Final = 0.5  #: share of points outside the tissue that is refused [1]
LEAST_MUSCLE_SHARE: Final = 0.02  #: smallest share of an element that belongs to the muscle [1]
SEED: Final = 0


@dataclass(frozen=True)
class Course:
    """Face with the new course of a muscle, and its measures."""

    face: xr.Dataset  #: checked face
    fibres: tuple[Floats, ...]  #: (POINTS, 3) [m]
    radius: float  #: [m]
    volume: float  #: of the muscle in the mesh [m3]
    away: float  #: median distance of the new fibres from the former ones [m]
    notes: tuple[str, ...]


def with_course(
    face: xr.Dataset,
    muscle: str,
    tracts: Any,
    *,
    fibres: int = 1,
    radius: float | None = None,
    volume: float | None = None,
) -> Course:
    """Replace the course of a muscle by the bundle of its tractography.

    `tracts` is a file (.trk, .tck) in the frame of the landmarks of the fitted face, or arrays (k, 3)
    [m] in the frame of the face. `fibres` is the number of fibres. `radius` [m] or `volume` [m3] is that
    of the muscle; without both, the spread of the bundle determines the radius. Raises FitError if the
    face has no such muscle, the bundle is mirrored or elsewhere, or the radius is not that of a muscle.
    """
    names = [str(m) for m in face["muscle"].values]
    if muscle not in names:
        raise FitError(f"the face has no muscle {muscle!r}, expected one of {', '.join(names)}")
    if radius is not None and volume is not None:
        raise FitError("radius and volume are both given, expected one of them")
    given = tracts_of(tracts)
    lines = [np.asarray(line) for line in given.lines]
    if given.digest:
        lines = [frame_of_inputs(face)(line) for line in lines]
    courses = mean_courses(lines, fibres)
    away = _check_place(face, muscle, lines, given.source)
    inside, outside = project_into_mesh(
        np.concatenate(courses), face["position"].values, face["connectivity"].values
    )
    if outside.mean() > OUTSIDE:
        raise FitError(
            f"{outside.mean():.0%} of the course of {given.source} lies outside the tissue, expected at "
            f"most {OUTSIDE:.0%}: check the frame and the muscle"
        )
    notes = [f"{int(outside.sum())} points of the course were moved to the surface of the tissue"]
    courses = [_apart(c) for c in np.split(inside, len(courses))]
    radius, size = _radius(face, courses, lines, radius, volume)
    replaced = _replaced(face, names.index(muscle), courses, radius)
    inputs = json.loads(str(face.attrs.get("fit_inputs", "{}")))
    inputs[f"course of {muscle}"] = f"{given.source} {given.digest}".strip()
    replaced.attrs["fit_inputs"] = json.dumps(inputs)
    return Course(
        check_face(replaced),
        tuple(courses),
        radius,
        size,
        away,
        tuple(notes if outside.any() else ()),
    )


def with_courses(
    face: xr.Dataset, courses: Mapping[str, Any], volumes: Mapping[str, float] | None = None
) -> tuple[xr.Dataset, list[str]]:
    """Replace the courses of several muscles; a sentence for each states what was found.

    `courses` are arguments `tracts` of `with_course` by muscle, `volumes` [m3] those of some of them.
    Raises FitError as `with_course` does, and for the volume of a muscle without a course.
    """
    volumes = volumes or {}
    if alone := [muscle for muscle in volumes if muscle not in courses]:
        raise FitError(
            f"a volume is given for {listed(alone)}, expected one of the muscles whose course is given: "
            "the volume determines the radius about a new course"
        )
    sentences: list[str] = []
    for muscle, tracts in courses.items():
        course = with_course(face, muscle, tracts, volume=volumes.get(muscle))
        face = course.face
        sentences.append(
            f"The course of {muscle} is that of its bundle, {1e3 * course.away:.1f} mm from the former "
            f"one (median); radius {1e3 * course.radius:.1f} mm, volume {1e6 * course.volume:.2f} cm3."
        )
        sentences += [f"{muscle}: {note}." for note in course.notes]
    return face, sentences


def mean_courses(lines: Sequence[Floats], fibres: int = 1) -> list[Floats]:
    """Means (`FIBRE_POINTS`, 3) of groups of streamlines, all in one direction."""
    if not 1 <= fibres <= len(lines):
        raise FitError(
            f"{fibres} fibres of {len(lines)} streamlines, expected 1 or more, but not more"
        )
    even = np.stack([_resampled(line) for line in lines])
    middle = even[np.argmax([np.ptp(line, axis=0).max() for line in even])]
    for _ in range(2):  # turned to the longest, then to the mean
        turned = ((even[:, ::-1] - middle) ** 2).sum((1, 2)) < ((even - middle) ** 2).sum((1, 2))
        even[turned] = even[turned][:, ::-1]
        middle = even.mean(axis=0)
    if fibres == 1:
        return [middle]
    flat = even.reshape(len(even), -1)
    _, group = kmeans2(flat, fibres, minit="++", rng=SEED)
    return [even[group == k].mean(axis=0) for k in range(fibres) if (group == k).any()]


def _resampled(line: Floats) -> Floats:
    """Points (`FIBRE_POINTS`, 3) at equal steps of arc length."""
    s = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    at = np.linspace(0.0, s[-1], FIBRE_POINTS)
    return np.stack([np.interp(at, s, line[:, k]) for k in range(3)], axis=1)


def _check_place(face: xr.Dataset, muscle: str, lines: Sequence[Floats], name: str) -> float:
    """Refuse a bundle nearer to the muscle of the other side, or far from its own."""
    points = np.concatenate([_resampled(line) for line in lines])
    own = fibres_of(face, muscle)
    if not own:
        return float("nan")
    away = float(np.median(distance_to_fibres(points, own)))
    mirror = points * np.array([-1.0, 1.0, 1.0])
    if (other := float(np.median(distance_to_fibres(mirror, own)))) < away:
        raise FitError(
            f"{name} is mirrored, or of the other side: it is {1e3 * away:.3g} mm from {muscle}, and "
            f"{1e3 * other:.3g} mm if left and right are exchanged; expected the side of the muscle: "
            "check the frame (LPS or RAS) and the name"
        )
    if away > LARGEST_COURSE_DISTANCE:
        raise FitError(
            f"{name} is {1e3 * away:.3g} mm from {muscle} of the face (median), expected at most "
            f"{1e3 * LARGEST_COURSE_DISTANCE:.0f} mm: check the frame, the unit and the muscle"
        )
    return away


def _radius(
    face: xr.Dataset,
    courses: Sequence[Floats],
    lines: Sequence[Floats],
    radius: float | None,
    volume: float | None,
) -> tuple[float, float]:
    """Radius of the muscle [m] and its volume in the mesh [m3]."""
    position, connectivity = face["position"].values, face["connectivity"].values
    sizes = element_quality(position, connectivity).volume

    def filled(r: float) -> float:
        return float((_shares(face, courses, r) * sizes).sum())

    if volume is not None:
        most = filled(RADII[1])
        if not filled(RADII[0]) < volume < most:
            raise FitError(
                f"the volume is {1e6 * volume:.4g} cm3, expected {1e6 * filled(RADII[0]):.3g} to "
                f"{1e6 * most:.3g} cm3 around this course: check the unit (m3) and the course"
            )
        radius = float(np.asarray(brentq(lambda r: filled(r) - volume, *RADII, xtol=1e-6)))
    elif radius is None:
        points = np.concatenate([_resampled(line) for line in lines])
        away = distance_to_fibres(points, courses)
        radius = float(np.sqrt(2.0 * np.mean(away**2)))
    if not RADII[0] <= radius <= RADII[1]:
        raise FitError(
            f"the radius of the muscle is {1e3 * radius:.3g} mm, expected {1e3 * RADII[0]:g} to "
            f"{1e3 * RADII[1]:g} mm: give the radius or the volume"
        )
    return radius, filled(radius)


def _shares(face: xr.Dataset, courses: Sequence[Floats], radius: float) -> Floats:
    """Share of every element within the radius of the courses; wedges count as hexahedra."""
    connectivity = face["connectivity"].values.astype(np.int64)
    wedge = connectivity[:, 6] < 0
    whole = connectivity.copy()
    whole[wedge] = connectivity[wedge][:, [0, 1, 2, 2, 3, 4, 5, 5]]
    return shares_within(face["position"].values, whole, courses, radius)


def _replaced(face: xr.Dataset, index: int, courses: Sequence[Floats], radius: float) -> xr.Dataset:
    """Face with the fibres and the elements of one muscle replaced."""
    share = _shares(face, courses, radius)
    element = np.flatnonzero(share > LEAST_MUSCLE_SHARE)
    if not len(element):
        raise FitError("no element lies within the radius of the course, expected some: check both")
    centres = element_centres(face["position"].values, face["connectivity"].values)
    direction = fibre_directions(centres[element], courses)
    other = face["bundle_muscle"].values != index
    kept = face["bundle_weight"].values[other] if "bundle_weight" in face else np.ones(other.sum())
    new = {
        "bundle_muscle": np.full(len(element), index), "bundle_index": element,
        "bundle_direction": direction, "bundle_weight": np.clip(share[element], 0.0, 1.0),
    }  # fmt: skip
    old = {
        name: face[name].values[other]
        for name in ("bundle_muscle", "bundle_index", "bundle_direction")
    } | {"bundle_weight": kept}
    replaced = _joined(face, "bundle_element", old, new)
    keep = face["fibre_muscle"].values != index
    number = np.cumsum(keep) - 1
    points = keep[face["fibre_of_point"].values]
    owner = number[face["fibre_of_point"].values[points]]
    count = int(keep.sum())
    replaced = _joined(
        replaced, "fibre", {"fibre_muscle": face["fibre_muscle"].values[keep]},
        {"fibre_muscle": np.full(len(courses), index)},
    )  # fmt: skip
    return _joined(
        replaced, "fibre_point",
        {"fibre_position": face["fibre_position"].values[points], "fibre_of_point": owner},
        {
            "fibre_position": np.concatenate(courses),
            "fibre_of_point": count + np.repeat(np.arange(len(courses)), [len(c) for c in courses]),
        },
    )  # fmt: skip


def _joined(face: xr.Dataset, dim: str, old: dict[str, Any], new: dict[str, Any]) -> xr.Dataset:
    """Face whose variables along a dimension are the old rows and the new ones."""
    attrs = {name: face[name].attrs if name in face else {"units": "1"} for name in old}
    kinds = {name: face[name].dtype if name in face else np.dtype(float) for name in old}
    rest = face.drop_dims(dim)
    return rest.assign({
        name: (
            (dim, "axis") if np.ndim(old[name]) == 2 else (dim,),
            np.concatenate([old[name], new[name]]).astype(kinds[name]), attrs[name],
        )
        for name in old
    })  # fmt: skip


def _apart(course: Floats) -> Floats:
    """Points of a course without those that were moved to one place."""
    keep = np.ones(len(course), dtype=bool)
    keep[1:] = np.linalg.norm(np.diff(course, axis=0), axis=1) > 1e-6
    return course[keep]


__all__ = ["Course", "Tracts", "mean_courses", "with_course", "with_courses"]
