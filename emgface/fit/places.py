"""Landmarks and surfaces of one person compared with each other: place, pose, expected shape.

Landmarks of the skin lie on a scan of the skin, and above an inner surface or bone. A motion of all of
them that reduces their squared distances from the scan, in units of the variance of a landmark, by more
than chance (chi-square with six degrees of freedom) shows that the scan was taken in another pose. The
spline through the landmarks predicts where a surface lies, with the standard deviation of
`emgface.fit.strays`; parts of a surface beyond the limit for landmarks are named by their place.
"""

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
import xarray as xr
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial.distance import cdist
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from emgface.errors import FitError
from emgface.fit.columns import THICKNESS_SPREAD, Columns
from emgface.fit.inputs import OFF
from emgface.fit.similarity import similarity
from emgface.fit.strays import CLICK, PROPORTION, STRAY, spread_of_spline
from emgface.fit.targets import LandmarkPoints, Target
from emgface.fit.triangulated import Floats, Surface

#: largest distance of landmarks from the skin without a doubt, in deviations
NEAR_SKIN: Final = 2.0
#: smallest distance of the landmarks from bone or an inner surface [m]
LANDMARK_TO_BONE: Final = 2e-3
DOUBT_CHANCE: Final = 1e-3  #: probability that landmarks of one pose are doubted [1]
#: area of a part of a surface, relative to the largest, that may be a layer [1]
LAYER_AREA_SHARE: Final = 0.1
LAYER: Final = 0.01  #: largest distance of a second layer from the first [m]
LANDMARK_HUBER: Final = 2.0  #: distance in deviations from which a landmark counts linearly
MISSED: Final = 5e-3
"""Distance of the fitted face from a landmark that is doubted, or five deviations of it [m].

The largest of 16 sound persons, with a noise of 0.8 mm, is 4.4 mm; that of faces with a named point 6 to
7 mm from its place is as large.
"""
LEFT: Final = 1.25
"""Distance of a fitted bone from its landmarks that is doubted, relative to their noise [1].

The root mean square of 16 fits of 8 sound jaws is at most 1.0, of the same with a surface moved by 4 mm
at least 1.46.
"""
OTHER_SURFACE: Final = {
    "inner": "bone, whose triangles face the tissue",
    "bone": "the inner surface of the tissue, whose triangles face the bone",
}
REGION: Final = 4  #: smallest number of nodes around a landmark over which a depth is judged
THINNEST: Final = 1e-4  #: depth of a surface that lies on the skin or outside [m]
LANDMARK_STEPS: Final = 5  #: number of steps to the motion of the landmarks
#: distance of a named point of a face from a scan that ends before it [m]
UNCOVERED_DISTANCE: Final = 0.01
#: number of points of a surface that are compared with the prediction
COMPARED_POINTS: Final = 3000


def check_landmarks_on(
    skin: Surface, points: LandmarkPoints, name: str, noise: float
) -> str | None:
    """Refuse landmarks that do not lie on the skin, with the evidence for the likely reason.

    Returns a doubt if they miss it by more than their noise explains, or lie on it after a motion.
    """
    near = skin.nearest(points.target)
    far = points.on_skin & (near.distance > OFF)
    many = float(np.median(near.distance[points.on_skin]))
    if far.any():
        listed = _beyond(points.names, np.where(far, near.distance, 0.0), OFF)
        raise FitError(
            f"{len(listed)} of {int(points.on_skin.sum())} landmarks lie off {name}: "
            f"{', '.join(listed[:4])} (median of all {1e3 * many:.3g} mm), expected at most "
            f"{1e3 * OFF:.0f} mm: "
            + (
                "check the unit, the spacing and the frame (LPS or RAS) of both files"
                if many > OFF
                else "check these landmarks, and whether the surface has a hole there or ends before "
                "them; if it does not, the spacing of its file, and whether it is flipped"
            )
        )
    miss = float(np.sqrt(np.mean(near.distance[points.on_skin] ** 2)))
    sigma = max(noise, CLICK)
    gain, size = motion_onto(skin, points.target[points.on_skin], sigma)
    if gain > chi2.isf(DOUBT_CHANCE, 6):
        return (
            f"the landmarks lie {1e3 * miss:.2g} mm rms from {name}, and fit it much better after a "
            f"common motion by about {1e3 * size:.2g} mm: check whether they are of the same scan and "
            "pose"
        )
    if miss <= (limit := NEAR_SKIN * sigma):
        return None
    return (
        f"the landmarks lie {1e3 * miss:.2g} mm rms from {name}, expected at most {1e3 * limit:.2g} mm "
        f"for a noise of {1e3 * noise:.2g} mm: check whether they are of the same scan and pose"
    )


def motion_onto(skin: Surface, points: Floats, sigma: float) -> tuple[float, float]:
    """Reduction of the squared distances from a surface by a rigid motion, and its mean size [m].

    Squares are in units of `sigma` [m], and linear beyond `LANDMARK_HUBER`, so that one point
    decides little.
    """

    def away(x: Floats) -> tuple[Floats, Floats, float]:
        near = skin.nearest(x)
        n = skin.normals[near.triangle]
        d = np.einsum("ni,ni->n", x - near.foot, n) / sigma
        size = np.abs(d)
        loss = np.where(
            size < LANDMARK_HUBER, size**2, LANDMARK_HUBER * (2.0 * size - LANDMARK_HUBER)
        )
        return d, n, float(loss.sum())

    d, n, first = away(points)
    centre, now, best, kept = points.mean(axis=0), points, first, points
    reach = np.linalg.norm(points - centre, axis=1).max()
    for _ in range(LANDMARK_STEPS):
        A = np.column_stack([np.cross(now - centre, n) / reach, n])
        weight = np.sqrt(np.minimum(1.0, LANDMARK_HUBER / np.maximum(np.abs(d), 1e-12)))
        x = -sigma * np.linalg.lstsq(weight[:, None] * A, weight * d, rcond=1e-3)[0]
        turn = Rotation.from_rotvec(x[:3] / reach).as_matrix()
        now = (now - centre) @ turn.T + centre + x[3:]
        d, n, loss = away(now)
        if loss < best:
            best, kept = loss, now
    return first - best, float(np.linalg.norm(kept - points, axis=1).mean())


def check_landmarks_off(surface: Surface, points: LandmarkPoints, name: str, kind: str) -> None:
    """Refuse an inner surface, or one of bone, on which the landmarks of the skin lie."""
    near = surface.nearest(points.target[points.on_skin])
    if len(near.distance) and (beneath := float(np.median(near.distance))) < LANDMARK_TO_BONE:
        raise FitError(
            f"the landmarks of the skin lie {1e3 * beneath:.2g} mm from {name} (median), which was "
            f"given as {kind}; expected at least {1e3 * LANDMARK_TO_BONE:.0f} mm of soft tissue "
            "between them: check whether this is the surface of the skin"
        )


def second_layer(surface: Surface, name: str) -> str | None:
    """Doubt about a surface of which a large part lies over another one, facing the same way."""
    t, n = surface.triangles, len(surface.points)
    graph = coo_array((np.ones(t.size), (t.ravel(), np.roll(t, 1, axis=1).ravel())), shape=(n, n))
    part = connected_components(graph, directed=False)[1][t[:, 0]]
    area = np.bincount(part, surface.areas)
    first, *others = np.argsort(area)[::-1].tolist()
    largest = Surface(surface.points, t[part == first])
    for other in others:
        if area[other] < LAYER_AREA_SHARE * area[first]:
            break
        own = np.flatnonzero(part == other)
        near = largest.nearest(surface.points[t[own]].mean(axis=1))
        alike = np.einsum("ni,ni->n", surface.normals[own], largest.normals[near.triangle]) > 0.5
        if np.mean(alike & (near.distance < LAYER)) > 0.5:
            return (
                f"{name} has a second layer {1e3 * float(np.median(near.distance)):.2g} mm from the "
                "first, between which the fit cannot decide: remove one of them"
            )
    return None


def implausible_thickness(
    face: xr.Dataset, points: LandmarkPoints, skin: Surface, beneath: Target, name: str
) -> str | None:
    """Doubt about a surface beneath the skin whose depth is not that of persons somewhere.

    The depth under a node of the skin is that of the face, scaled by the similarity of the landmarks,
    with the deviation `THICKNESS_SPREAD` of its logarithm. The median over the nodes nearest to a
    landmark is judged by the limit for proportions: two surfaces of different persons may each be
    sound.
    """
    columns, source = Columns.from_face(face), face["position"].values
    motion = similarity(points.source, points.target)
    node, bottom = columns.skin, columns.inner
    expected = beneath.sheet.at(source).nearest(source[node]).distance * motion.scale
    over = skin.nearest(motion(source[node]))
    under = beneath.surface.nearest(over.foot)
    depth = np.einsum("ni,ni->n", over.foot - under.foot, skin.normals[over.triangle])
    depth = np.copysign(under.distance, depth)
    own = beneath.sheet.nodes if beneath.only is None else beneath.only
    use = np.isin(bottom, own) & ~skin.at_border(over) & ~beneath.surface.at_border(under)
    owner = cdist(points.source, source[node]).argmin(axis=0)
    worst, evidence = PROPORTION * THICKNESS_SPREAD, None
    for k in np.unique(owner[use]).tolist():
        here = use & (owner == k)
        if here.sum() < REGION:
            continue
        there, wanted = float(np.median(depth[here])), float(np.median(expected[here]))
        off = abs(np.log(max(there, THINNEST) / wanted))
        if off > worst:
            worst, evidence = off, (points.names[k], there, wanted)
    if evidence is None:
        return None
    landmark, there, wanted = evidence
    least, most = (1e3 * wanted * np.exp(s * PROPORTION * THICKNESS_SPREAD) for s in (-1.0, 1.0))
    return (
        f"{name} lies {1e3 * there:.1f} mm beneath the skin around landmark {landmark}, expected "
        f"{least:.1f} to {most:.1f} mm: check whether both surfaces are of the same person and pose"
    )


def other_side(kind: str, name: str) -> str | None:
    """Doubt about a surface beneath the skin whose triangles had to be turned."""
    if kind not in OTHER_SURFACE:
        return None
    return (
        f"the triangles of {name}, given as {kind}, face the other way, and were turned: check whether "
        f"it is {OTHER_SURFACE[kind]}"
    )


def left_landmarks(miss: Floats, noise: float) -> str | None:
    """Doubt about landmarks of bones that the map to their surfaces leaves behind by `miss` (n,) [m]."""
    rms = float(np.sqrt(np.mean(miss**2)))
    if not rms > LEFT * noise:
        return None
    return (
        f"the fitted bones miss the landmarks by {1e3 * rms:.2g} mm rms, expected at most "
        f"{1e3 * LEFT * noise:.2g} mm for a noise of {1e3 * noise:.2g} mm: check whether landmarks and "
        "surfaces are of the same person, pose and frame"
    )


def _beyond(names: Sequence[str], distance: Floats, limit: float) -> list[str]:
    """Names with their distances (n,) [m], the largest first, of points beyond a limit."""
    order = np.argsort(-np.nan_to_num(distance))
    return [f"{names[k]} {1e3 * distance[k]:.1f} mm" for k in order if distance[k] > limit]


def missed_landmarks(names: Sequence[str], miss: Floats, noise: float) -> str | None:
    """Doubt about a fitted surface that ends far from landmarks, `miss` (n,) [m], NaN beyond the skin.

    Surfaces decide across the skin and landmarks along it: where both belong to one face, the fitted
    place of a landmark is within a few standard deviations.
    """
    limit = max(MISSED, 5.0 * noise)
    far = _beyond(names, miss, limit)
    if not far:
        return None
    return (
        f"the fitted face misses {len(far)} of {int(np.isfinite(miss).sum())} landmarks by more than "
        f"{1e3 * limit:.1f} mm ({', '.join(far[:3])}): look at the report there, whether the landmark "
        "or the surface next to it is wrong (holes, folds, a second layer)"
    )


def uncovered_points(
    surface: Surface, points: Mapping[str, Floats], landmarks: Sequence[str], name: str
) -> str | None:
    """Doubt about named points of a fitted face (3,) [m] that neither a scan nor a landmark determines.

    Beyond the ends of a scan the face keeps the shape of the one that was fitted, moved along.
    """
    names = [point for point in points if point not in landmarks]
    if not names:
        return None
    distance = surface.nearest(np.array([points[point] for point in names])).distance
    far = _beyond(names, distance, UNCOVERED_DISTANCE)
    if not far:
        return None
    return (
        f"{name} ends before {len(far)} of the named points of the face, for which no landmark is given "
        f"({', '.join(far[:4])}): there the shape is not that of the person, and may be wrong by "
        "several millimetres; give landmarks there, or do not use that part"
    )


def unexpected_part(
    target: Target, spline: Floats, points: LandmarkPoints, noise: float, depth: float, name: str
) -> str | None:
    """Doubt about a surface that is far from the nodes (n_nodes, 3) of the spline [m].

    `depth` is the standard deviation of the depth of the surface under the skin [m]. Parts beyond the
    open edges of both, which a scan may have, are not judged.
    """
    at, distance = _apart(target, spline)
    if not len(at):
        return None
    expected = spread_of_spline(points.target, at, noise)
    z = distance / np.sqrt(expected**2 + max(noise, CLICK) ** 2 + depth**2)
    k = int(np.argmax(z))
    if z[k] <= STRAY:
        return None
    near = points.names[int(np.argmin(np.linalg.norm(points.target - at[k], axis=1)))]
    return (
        f"{name} has a part {1e3 * distance[k]:.0f} mm from the place that the landmarks suggest, "
        f"nearest to landmark {near} ({np.mean(z > STRAY):.1%} of it beyond {STRAY:g} standard "
        f"deviations, here {1e3 * distance[k] / z[k]:.2g} mm): look at the report whether the person "
        "has this shape; otherwise repair the surface"
    )


def _apart(target: Target, spline: Floats) -> tuple[Floats, Floats]:
    """Points of a surface (n, 3), or nodes that it attracts, and their distances (n,) [m]."""
    if target.only is not None:
        at = spline[target.only]
        near, other = target.surface.nearest(at), target.surface
    else:
        samples = target.surface.samples[0]
        at, other = samples[:: -(-len(samples) // COMPARED_POINTS)], target.sheet.at(spline)
        near = other.nearest(at)
    use = ~other.at_border(near)
    return at[use], near.distance[use]
