"""Surfaces of the lips and of the lining of the mouth, as triangles over the nodes of a face.

A face may contain closed surfaces of its lips, as the published one does; otherwise they are
derived from its elements. The lips taper towards the corners of the mouth, where their tissue is
one.
"""

from typing import Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.spatial import KDTree

from emgface.errors import FaceError
from emgface.face.check import sheet_nodes
from emgface.face.closed import check_closed
from emgface.face.lip_shape import lip_rim
from emgface.face.parts import FREE, LIPS, OUTER, arches_of
from emgface.face.surface import boundary_faces, element_faces, faces_among, triangles

Integers = NDArray[np.int64]

#: default extent of the surface of a lip along the skin from its margin [m]
LIP_EXTENT: Final = 14e-3
NEAR_TEETH: Final = 15e-3  #: distance from a point of an arch below which facets may touch it [m]


def lip_surface(face: xr.Dataset, lip: str) -> Integers:
    """Closed surface of the "upper" or "lower" lip: nodes (m, 3), counter-clockwise from outside.

    A part of it passes through the tissue and closes the surface (`exposed`). If the face contains
    no surface, that of the elements beneath the facets of the skin within `LIP_EXTENT` of the margin is
    used, counted in rings of facets around the mouth, with no more rings from the margin than
    facets from the corner, so that the lips share no nodes. Raises FaceError if the lip is unknown,
    the face has no mouth, or the surface is not closed.
    """
    if lip not in LIPS:
        raise FaceError(f"unknown lip {lip!r}, expected {' or '.join(LIPS)}")
    if "lip_triangle" in face:
        mine = face["lip_of_triangle"].values == LIPS.index(lip)
        nodes = face["lip_triangle"].values[mine].astype(np.int64)
    else:
        nodes = _from_elements(face, lip)
    try:
        check_closed(face["position"].values, nodes, f"the {lip} lip")
    except FaceError as error:
        if "stress_free_position" not in face:
            raise
        raise FaceError(
            f"the {lip} lip of a treated face has no closed surface ({error}); a wound of some layers "
            "leaves a pocket beneath its suture: switch contact off (--no-contact, or contact.method = "
            "'none'), or excise all layers"
        ) from error
    return nodes


def exposed(face: xr.Dataset, surface: Integers) -> NDArray[np.bool_]:
    """Mask (m,) of the triangles on the boundary of the tissue of a face."""
    faces, _ = boundary_faces(face["connectivity"].values)
    corners = {key for row in np.sort(faces, axis=1).tolist() for key in _thirds(row)}
    return np.array(
        [tuple(row) in corners for row in np.sort(surface, axis=1).tolist()], dtype=bool
    )


def lining(face: xr.Dataset) -> Integers:
    """Surface (m, 3) of lips and cheeks that may touch the teeth, outward and open.

    It consists of the inner side within `NEAR_TEETH` of an arch, except facets with fixed nodes
    only, and of the exposed surfaces of the lips. Raises FaceError if the face has no arches, or as
    `lip_surface`.
    """
    arches = arches_of(face)
    if not arches:
        raise FaceError(
            "the face has no teeth, expected dental arches: import it from a folder that contains "
            "mandible.obj and maxilla.obj, generate one, or leave contact.between out"
        )
    position = face["position"].values
    skin = np.zeros(len(position), dtype=bool)
    skin[sheet_nodes(face, OUTER)] = True
    faces, _ = boundary_faces(face["connectivity"].values)
    faces = faces[~skin[faces].all(axis=1) & (face["fixed"].values[faces] == FREE).any(axis=1)]
    tree = KDTree(np.concatenate([arch.points for arch in arches]))
    near = tree.query(position[faces].mean(axis=1))[0] < NEAR_TEETH
    lips = [lip_surface(face, lip) for lip in LIPS]
    parts = [triangles(faces[near], position), *(lip[exposed(face, lip)] for lip in lips)]
    return _without_folds(_without_overlap(parts))


def _without_overlap(parts: list[Integers]) -> Integers:
    """Combine triangulations of one surface; where diagonals differ, the last one is used."""
    kept: list[Integers] = []
    taken: set[tuple[int, int]] = set()
    for part in reversed(parts):
        # a directed edge belongs to one triangle
        runs = [{(a, b), (b, c), (c, a)} for a, b, c in part.tolist()]
        free = np.array([not (run & taken) for run in runs], dtype=bool)
        kept.append(part[free])
        taken.update(edge for run, ok in zip(runs, free, strict=True) if ok for edge in run)
    return np.concatenate(kept)


def _thirds(row: list[int]) -> list[tuple[int, ...]]:
    """Triangles, by sorted nodes, that may cut a facet given by its four sorted nodes."""
    nodes = sorted(set(row))
    if len(nodes) == 3:
        return [tuple(nodes)]
    return [tuple(nodes[:k] + nodes[k + 1 :]) for k in range(4)]


def _from_elements(face: xr.Dataset, lip: str) -> Integers:
    position, connectivity = face["position"].values, face["connectivity"].values
    chosen = _lip_columns(face, lip)
    faces, _ = boundary_faces(connectivity[chosen])
    return _without_folds(triangles(faces, position))


def _without_folds(corners: Integers) -> Integers:
    """Leave out pairs of opposite triangles on the same nodes, which enclose nothing.

    They occur where two facets of a suture share three of their four nodes, next to a pair that is
    attached to bone and therefore stays apart.
    """
    order = np.argsort(corners, axis=1)
    odd = np.linalg.det(np.eye(3)[order]) < 0.0
    nodes, group = np.unique(np.sort(corners, axis=1), axis=0, return_inverse=True)
    group = group.reshape(-1)
    ways = [np.bincount(group[which], minlength=len(nodes)) for which in (odd, ~odd)]
    folded = (ways[0] == 1) & (ways[1] == 1)
    return corners[~folded[group]]


def _lip_columns(face: xr.Dataset, lip: str) -> Integers:
    """Elements of one lip: columns from skin to lining, by rings of skin facets from its margin."""
    position, connectivity = face["position"].values, face["connectivity"].values
    faces, owner = faces_among(connectivity, sheet_nodes(face, OUTER))
    here = face["layer"].values[owner] == OUTER
    faces, owner = faces[here], owner[here]
    by_edge: dict[tuple[int, int], list[int]] = {}
    for k, row in enumerate(faces.tolist()):
        for a, b in zip(row, row[1:] + row[:1], strict=True):
            if a != b:
                by_edge.setdefault((min(a, b), max(a, b)), []).append(k)

    rim = lip_rim(face)
    place: dict[int, tuple[str, int]] = {}  # lip and edges from the nearer corner
    for name, margin in (("upper", rim.upper), ("lower", rim.lower)):
        edges = list(zip(margin[:-1].tolist(), margin[1:].tolist(), strict=True))
        for k, (a, b) in enumerate(edges):
            for facet in by_edge[min(a, b), max(a, b)]:
                place.setdefault(facet, (name, min(k, len(edges) - 1 - k)))
    facets: list[int] = []
    ring, level, margins = list(place), 0, position[np.union1d(rim.upper, rim.lower)]
    tree = KDTree(margins)
    while ring:
        reach = tree.query(position[faces[ring]].mean(axis=1))[0]
        if float(np.median(reach)) > LIP_EXTENT:
            break
        facets += [facet for facet in ring if place[facet][0] == lip and place[facet][1] > level]
        further: list[int] = []
        for facet in ring:
            row = faces[facet].tolist()
            for a, b in zip(row, row[1:] + row[:1], strict=True):
                for other in by_edge.get((min(a, b), max(a, b)), ()):
                    if other not in place:
                        place[other] = place[facet]
                        further.append(other)
        ring, level = further, level + 1
    if not facets:
        raise FaceError(
            f"the {lip} lip has no facets of skin between the corners of the mouth, expected a mesh "
            "with at least four along its margin"
        )
    facets = _without_pinches(facets, faces.tolist())
    return _columns(connectivity, face["layer"].values, owner[facets])


def _without_pinches(facets: list[int], faces: list[list[int]]) -> list[int]:
    """Leave out facets that touch those before them in a single node.

    The columns beneath them would share an edge only, along which the surface is not closed.
    """
    while True:
        at: dict[int, list[int]] = {}
        for k in facets:
            for node in set(faces[k]):
                at.setdefault(node, []).append(k)
        dropped: set[int] = set()
        for own in at.values():
            joined = {own[0]}
            while more := [
                k
                for k in own
                if k not in joined and any(len({*faces[k]} & {*faces[j]}) > 1 for j in joined)
            ]:
                joined.update(more)
            dropped.update(set(own) - joined)
        if not dropped:
            return facets
        facets = [k for k in facets if k not in dropped]


def _columns(connectivity: Integers, layer: Integers, top: Integers) -> Integers:
    """Elements of the outer layer and those beneath them, layer by layer."""
    faces, owner = element_faces(connectivity)
    by_face: dict[tuple[int, ...], list[int]] = {}
    for row, element in zip(faces.tolist(), owner.tolist(), strict=True):
        by_face.setdefault(tuple(sorted(set(row))), []).append(element)
    beneath: dict[int, set[int]] = {}
    for pair in by_face.values():
        if len(pair) == 2 and layer[pair[0]] != layer[pair[1]]:
            low, high = sorted(pair, key=lambda e: int(layer[e]))
            beneath.setdefault(high, set()).add(low)
    chosen, last = set(top.tolist()), set(top.tolist())
    while last:
        last = {low for high in last for low in beneath.get(high, ())}
        chosen |= last
    return np.array(sorted(chosen), dtype=np.int64)
