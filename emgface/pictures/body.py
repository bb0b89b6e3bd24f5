"""Drawn surface of a face: skin, lips, teeth and oral cavity."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from emgface.face.check import sheet_nodes
from emgface.face.parts import OUTER, SKULL, Arch, arches_of, facets_of, surface_names
from emgface.face.surface import boundary_faces, triangles
from emgface.pictures.subdivision import follow, refined, rim, strip
from emgface.pictures.suture import suture_colours

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

SKIN_PART, VERMILION_PART, LINING = 0, 1, 2  #: parts of the drawn tissue
PART_COLOURS: Final = {
    SKIN_PART: (0.905, 0.765, 0.680),
    VERMILION_PART: (0.760, 0.430, 0.415),
    LINING: (0.640, 0.330, 0.325),
}
"""Colour of each part, sRGB from 0 to 1."""
MOUTH: Final = (0.165, 0.062, 0.058)  #: colour of back faces
TEETH_COLOUR: Final = (0.880, 0.860, 0.805)
GUMS: Final = (0.640, 0.370, 0.365)
NOSTRIL: Final = (0.290, 0.150, 0.130)
CROWN: Final = 9.5e-3  #: height of the crowns of the teeth [m]; an arch is drawn as gums beyond it

DOWNWARD: Final = -0.45  #: largest vertical part of the normal of the base of the nose
MOST_NODES: Final = 4500
"""Largest number of nodes of the surface; more are merged along the shortest edges."""
REFINED_POINTS: Final = 5000  #: number of points up to which the surface is refined, at most twice


@dataclass(frozen=True, eq=False)
class Skin:
    """Facets of the tissue that are drawn."""

    node: Indices  #: (n,) index of each node in the face model
    #: (m, 4) corners as indices into `node`, counter-clockwise from outside; a triangle repeats its
    #: last
    facet: Indices
    part: Indices  #: (m,) SKIN, VERMILION or LINING


@dataclass(frozen=True, eq=False)
class Body:
    """Drawn surface, as a function of the nodes of a `Skin`."""

    n: int  #: number of nodes of the skin, which are the first points
    #: (k, 4) the next points: each is (9 b + 9 c - a - d) / 16 of four earlier points a, b, c, d
    rules: Indices
    teeth: Floats  #: (m, 3) the last points, those of the dental arches, which do not move [m]
    triangle: Indices  #: (t, 3) corners among all points, counter-clockwise from outside
    colour: Floats  #: (points, 3) sRGB from 0 to 1
    tissue: int  #: number of points of the tissue; later points are the oral cavity and the teeth

    def points(self, position: NDArray[np.floating]) -> Floats:
        """Positions of all points [m] from those of the nodes of the skin (n, 3)."""
        moved = follow(self.rules, np.asarray(position, dtype=np.float64))
        return np.concatenate([moved, self.teeth])

    def coloured(self, colour: NDArray[np.floating]) -> Floats:
        """Colours of all points, from those of the nodes of the skin (n, 3)."""
        colours = follow(self.rules, np.asarray(colour, dtype=np.float64))[: self.tissue]
        return np.concatenate([np.clip(colours, 0.0, 1.0), self.colour[self.tissue :]])


def skin_of(face: xr.Dataset, *, most: int = MOST_NODES) -> Skin:
    """Find the facets of a face that are visible from outside or through the mouth.

    These are skin, vermilion and lining of the lips if the face names them, otherwise the skin and
    the rims of the tissue. A surface with more than `most` nodes is simplified.
    """
    named = {name: facets_of(face, name) for name in surface_names(face)}
    parts = [(LINING if name.endswith("inner") else VERMILION_PART, f) for name, f in named.items()]
    known = {frozenset(row) for _, rows in parts for row in rows.tolist()}
    visible, of_skin = skin_faces(face)
    plain = of_skin if named else visible
    mine = np.array([frozenset(row) not in known for row in plain.tolist()], dtype=bool)
    parts.insert(0, (SKIN_PART, plain[mine]))
    facet = np.concatenate([rows for _, rows in parts]).astype(np.int64)
    part = np.repeat([p for p, _ in parts], [len(rows) for _, rows in parts])
    if len(np.unique(facet)) > most:
        facet, part = _thinned(face["position"].values, facet, part, most)
    node, index = np.unique(facet, return_inverse=True)
    return Skin(node, index.reshape(facet.shape).astype(np.int64), part)


def skin_faces(face: xr.Dataset) -> tuple[NDArray[np.integer], NDArray[np.integer]]:
    """Boundary faces (faces, 4) visible from outside, and those of the skin.

    The visible ones include the rims, but not the inner sheet.
    """
    faces, element = boundary_faces(face["connectivity"].values)
    skin = np.zeros(face.sizes["node"], dtype=bool)
    skin[sheet_nodes(face, OUTER)] = True
    of_skin = (face["layer"].values[element] == OUTER) & skin[faces].all(axis=1)
    return faces[skin[faces].any(axis=1) | of_skin], faces[of_skin]


def body_of(face: xr.Dataset, skin: Skin | None = None) -> Body:
    """Compute the drawn surface of a face, with its dental arches and its suture if it has them."""
    skin = skin_of(face) if skin is None else skin
    rest = face["position"].values[skin.node]
    body = make_body(rest, skin, arches_of(face))
    near, colour = suture_colours(face, body.points(rest)[: body.tissue])
    body.colour[: body.tissue][near] = colour
    return body


def make_body(rest: NDArray[np.floating], skin: Skin, arches: Sequence[Arch]) -> Body:
    """Compute the drawn surface of a skin, at `rest` (n, 3) [m], and of dental arches."""
    n, facet, part = len(rest), skin.facet, skin.part
    values = np.asarray(rest, dtype=np.float64)
    stages: list[Indices] = []
    while len(stages) < 4 and len(values) < REFINED_POINTS:
        new, facet, part = refined(facet, part, len(values))
        stages += new
        for rules in new:
            values = np.concatenate([values, follow(rules, values)[len(values) :]])
    tissue = len(values)
    dark = nostrils(values, facet, part)[:, None]
    coloured = (1.0 - dark) * _point_colours(facet, part, tissue) + dark * np.array(NOSTRIL)
    triangle, colour = [triangles(facet, values)], [coloured]
    loop = rim(facet, values)
    if len(loop) > 2:  # closed at the back, so that the oral cavity is dark
        cap, height = strip(len(loop)), values[loop, 2]
        # Not above the cheeks, where it would be visible from the front.
        cut = 0.5 * (height[np.argmin(values[loop, 1])] + height.max())
        stages.append(np.repeat(loop[:, None], 4, axis=1))
        triangle.append(tissue + cap[(height[cap] < cut).all(axis=1)])
        colour.append(np.tile(MOUTH, (len(loop), 1)))
    before = tissue + len(loop)
    for arch in arches:
        triangle.append(arch.triangles.astype(np.int64) + before)
        colour.append(_tooth_colours(arch.points[:, 2], arch.bone))
        before += len(arch.points)
    teeth = [arch.points for arch in arches]
    return Body(
        n,
        np.concatenate([*stages, np.empty((0, 4), dtype=np.int64)]),
        np.concatenate([*teeth, np.empty((0, 3))]),
        np.concatenate(triangle).astype(np.int64),
        np.concatenate(colour),
        tissue,
    )


def nostrils(position: Floats, facet: Indices, part: Indices) -> Floats:
    """Share (n,) of the colour of a nostril at points (n, 3) [m], 0 for a surface without a nose.

    Meshes of faces have closed nostrils. They are drawn as an ellipse on each half of the base of the
    nose, the facets of the skin above the upper lip that face downward; a quarter of the base in width
    and half of it in length. Nothing is drawn unless the base is on both sides of the mouth's middle
    and narrower than the mouth.
    """
    share, lips, skin = np.zeros(len(position)), part == VERMILION_PART, facet[part == SKIN_PART]
    if not lips.any() or not len(skin):
        return share
    red = position[facet[lips]].reshape(-1, 3)
    middle, mouth = red[:, 0].mean(), np.ptp(red[:, 0])
    across, along = (position[skin[:, k + 2]] - position[skin[:, k]] for k in (0, 1))
    normal = np.cross(across, along)
    size = np.maximum(np.linalg.norm(normal, axis=1), np.finfo(np.float64).tiny)
    centre = position[skin].mean(axis=1)
    base = (normal[:, 2] < DOWNWARD * size) & (centre[:, 2] > red[:, 2].max())
    base &= np.abs(centre[:, 0] - middle) < 0.5 * mouth
    for side in (-1.0, 1.0):
        own = base & (side * (centre[:, 0] - middle) > 0.0)
        if own.sum() < 4:
            return np.zeros(len(position))
        middle_of_base = np.average(centre[own], axis=0, weights=size[own])
        half = np.maximum(np.ptp(centre[own], axis=0) * (0.22, 0.27, 0.5), 1e-4)
        far = np.sqrt((((position - middle_of_base) / half) ** 2).sum(axis=1))
        share = np.maximum(share, np.clip((1.25 - far) / 0.5, 0.0, 1.0))
    return share


def _point_colours(facet: Indices, part: Indices, n: int) -> Floats:
    """Mean colour of the facets at each of n points."""
    colour, weight = np.zeros((n, 3)), np.zeros(n)
    own = np.array([PART_COLOURS[k] for k in range(3)])[part]
    for corner in range(4):
        np.add.at(colour, facet[:, corner], own)
        np.add.at(weight, facet[:, corner], 1.0)
    return colour / np.maximum(weight, 1.0)[:, None]


def _tooth_colours(height: Floats, bone: int) -> Floats:
    """Teeth near the incisal edge, the lowest of the upper arch and the highest of the lower."""
    above = height - height.min() if bone == SKULL else height.max() - height
    gum = np.clip((above - CROWN) / 1.5e-3, 0.0, 1.0)[:, None]
    return (1.0 - gum) * np.array(TEETH_COLOUR) + gum * np.array(GUMS)


def _thinned(position: Floats, facet: Indices, part: Indices, most: int) -> tuple[Indices, Indices]:
    """Triangles of a surface with fewer nodes, and the part of each."""
    corners = np.concatenate([facet[:, [0, 1, 2]], facet[:, [0, 2, 3]]])
    corners, kept = _proper(corners, np.concatenate([part, part]))
    corners, kept = _proper(merged(position, corners, most)[corners], kept)
    return corners[:, [0, 1, 2, 2]], kept


def _proper(corners: Indices, part: Indices) -> tuple[Indices, Indices]:
    """Triangles with three different corners, and the part of each."""
    a, b, c = corners.T
    left = (a != b) & (b != c) & (c != a)
    return corners[left], part[left]


def merged(position: Floats, corners: Indices, most: int) -> Indices:
    """Merge neighbouring nodes along the shortest edges until at most `most` remain.

    Only nodes that share an edge are merged, so that lips in contact remain separate. The result is
    the representative node of each.
    """
    whole = np.arange(len(position))
    excess = len(np.unique(corners)) - most
    while excess > 0:
        edges = np.sort(
            np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]])
        )
        edges = np.unique(edges, axis=0)
        length = np.linalg.norm(position[edges[:, 0]] - position[edges[:, 1]], axis=1)
        target = np.arange(len(position))
        touched = np.zeros(len(position), dtype=bool)
        count = 0
        for a, b in edges[np.argsort(length, kind="stable")]:
            if touched[a] or touched[b]:
                continue
            touched[[a, b]] = True
            target[b] = a
            count += 1
            if count == excess:
                break
        whole = target[whole]
        corners = target[corners]
        a, b, c = corners.T
        corners = corners[(a != b) & (b != c) & (c != a)]
        left = len(np.unique(corners)) - most
        if left >= excess:
            break
        excess = left
    return whole
