"""Columns of a layered face: the stack of elements and nodes beneath every facet of the skin.

A face is cut in its skin, and every cut continues through the thickness along the columns, as a
scalpel held across the lip.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from emgface.errors import TreatmentError
from emgface.face.check import sheet_nodes
from emgface.face.parts import OUTER
from emgface.face.quality import is_wedge
from emgface.face.surface import element_faces, faces_among

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

#: the node across the element from every node of a face, by type and index within the element
_ACROSS_HEX: Final = {
    frozenset(face): dict(zip(face, other, strict=True)) | dict(zip(other, face, strict=True))
    for face, other in (
        ((0, 1, 2, 3), (4, 5, 6, 7)),
        ((0, 1, 5, 4), (3, 2, 6, 7)),
        ((1, 2, 6, 5), (0, 3, 7, 4)),
    )
    for face, other in ((face, other), (other, face))
}
_ACROSS_WEDGE: Final = {
    frozenset((0, 1, 2)): {0: 3, 1: 4, 2: 5},
    frozenset((3, 4, 5)): {3: 0, 4: 1, 5: 2},
}


@dataclass(frozen=True, eq=False)
class TissueColumns:
    """Columns of elements beneath the facets of the skin.

    `corner` (columns, 4) are the nodes of the facets, counter-clockwise from outside, with -1 in the
    last place of a triangle. `element` (columns, layers) are the elements from the skin inwards, and
    `stack` maps every node of the skin to its nodes (layers + 1) from the skin inwards.
    """

    corner: Integers
    element: Integers
    stack: dict[int, tuple[int, ...]]

    @property
    def layers(self) -> int:
        """Number of elements of every column."""
        return self.element.shape[1]

    def nodes(self, column: int) -> list[int]:
        """Nodes of the facet of a column, three or four."""
        return [int(n) for n in self.corner[column] if n >= 0]


def columns_of(face: xr.Dataset, near: NDArray[np.bool_] | None = None) -> TissueColumns:
    """Find the columns of a face, or only those whose nodes of the skin are all in `near` (nodes,).

    Raises TreatmentError if the elements there are not layered: a facet of the skin is the side of a
    wedge, columns have different numbers of layers, or a node of the skin has two stacks.
    """
    connectivity = face["connectivity"].values.astype(np.int64)
    faces, owner = faces_among(connectivity, sheet_nodes(face, OUTER))
    mine = face["layer"].values[owner] == OUTER
    if near is not None:
        mine &= near[faces].all(axis=1)
    faces, owner = faces[mine], owner[mine]
    every, owners = element_faces(connectivity)
    sharing: dict[frozenset[int], list[int]] = {}
    for row, element in zip(every.tolist(), owners.tolist(), strict=True):
        sharing.setdefault(frozenset(row), []).append(element)
    wedge = is_wedge(connectivity)
    corners: list[list[int]] = []
    elements: list[list[int]] = []
    stack: dict[int, tuple[int, ...]] = {}
    for row, top in zip(faces.tolist(), owner.tolist(), strict=True):
        nodes = list(dict.fromkeys(row))
        lines, own = _down(nodes, top, connectivity, wedge, sharing)
        for node, line in zip(nodes, lines, strict=True):
            if stack.setdefault(node, line) != line:
                raise _not_layered(face, top, "its nodes belong to two stacks")
        corners.append(nodes + [-1] * (4 - len(nodes)))
        elements.append(own)
    if len({len(own) for own in elements}) > 1:
        raise _not_layered(face, int(owner[0]), "columns have different numbers of layers")
    if not elements:
        raise TreatmentError(
            "off the skin", "the face has no skin there, expected a place on the skin of the lips"
        )
    return TissueColumns(np.array(corners), np.array(elements), stack)


def _down(
    nodes: list[int],
    top: int,
    connectivity: Integers,
    wedge: NDArray[np.bool_],
    sharing: dict[frozenset[int], list[int]],
) -> tuple[list[tuple[int, ...]], list[int]]:
    """Stacks of nodes and elements beneath a facet."""
    lines, own, here, element = [[n] for n in nodes], [top], nodes, top
    while True:
        local = connectivity[element].tolist()
        place = {n: k for k, n in enumerate(local) if n >= 0}
        key = frozenset(place[n] for n in here)
        across = (_ACROSS_WEDGE if wedge[element] else _ACROSS_HEX).get(key)
        if across is None:
            raise TreatmentError(
                "not layered",
                "the skin is the side of a wedge, expected a face in layers of hexahedra and wedges "
                "whose triangles lie in the skin: generate the face, or import the published one",
            )
        here = [local[across[place[n]]] for n in here]
        for line, node in zip(lines, here, strict=True):
            line.append(node)
        beneath = [e for e in sharing[frozenset(here)] if e != element]
        if not beneath:
            return [tuple(line) for line in lines], own
        element = beneath[0]
        own.append(element)


def _not_layered(face: xr.Dataset, element: int, why: str) -> TreatmentError:
    return TreatmentError(
        "not layered",
        f"the face is not layered at element {face['element_id'].values[element]}: {why}, expected "
        "columns of equal height beneath the skin: excise elsewhere, or generate the face",
    )


@dataclass(frozen=True, eq=False)
class Chart:
    """Plane in which an excision is drawn: origin (3,) [m], and unit vectors along, down and out.

    `along` follows the margin of the lip to the subject's right, `down` points from the margin into
    the lip, and `out` is normal to the skin.
    """

    origin: Floats
    along: Floats
    down: Floats
    out: Floats

    def flat(self, points: Floats) -> Floats:
        """Coordinates (n, 2) along and down [m] of points (n, 3)."""
        away = points - self.origin
        return np.stack([away @ self.along, away @ self.down], axis=-1)
