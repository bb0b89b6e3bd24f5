"""Muscles of the published reference face: fibres by points, elements by list or by distance."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from emgface.errors import FaceError
from emgface.face.ansys import MILLIMETRE, read_elements, read_ids, read_nodes
from emgface.face.bundles import elements_within, project_into_mesh, symmetric_directions
from emgface.face.parts import Bundle, Fibre
from emgface.muscles import MODELLED, SIDES

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

OopChoice = Literal["oldoop", "active", "block", "radius"]
OomChoice = Literal["active", "radius"]
LaoChoice = Literal["both", "lateral"]

OOP_FILES: Final = {
    "oldoop": "oop/oldoop_elements.txt",
    "active": "OOP_active_elements.elem",
    "block": "OOP_elements.txt",
}
OOM_FILES: Final = {"active": "OOM_active_elements.elem"}


def _run(first: int, last: int) -> tuple[int, ...]:
    return tuple(range(first, last + 1))


FIBRES_LEFT: Final[Mapping[str, tuple[tuple[int, ...], ...]]] = {
    "ZYG": (_run(114171, 114178),),
    "RIS": (_run(114161, 114166),),
    "LLSAN": (_run(114141, 114149), _run(114211, 114217)),
    "LAO": (_run(114151, 114156), _run(114221, 114226)),
    "BUC": (_run(114021, 114026), _run(114031, 114036)),
    "OOP": ((134227, *_run(114121, 114127), 114131), (*_run(114131, 114136), 134228)),
    "OOM": ((*_run(114101, 114107), 114111), _run(114111, 114117)),
    "DLI": (_run(114041, 114046), _run(114182, 114186)),
    "DAO": (_run(114011, 114017), _run(114201, 114205)),
    "MEN": (_run(114051, 114055), _run(114191, 114196)),
}
"""Points of `muscles.node` that form the fibres of the left side, in order.

The right side has the ids 134xxx for 114xxx; 134227 and 134228 lie on the midline and close the
ring of OOP on both sides.
"""

RIGHT_OFFSET: Final = 20000
MIDLINE_POINTS: Final = frozenset({134227, 134228})


def muscle_points(path: Path, position: Floats, connectivity: Integers) -> dict[int, Floats]:
    """Muscle points by id [m], projected onto the surface of the mesh if outside."""
    listed = read_nodes(path)
    place = {int(point): k for k, point in enumerate(listed.id)}
    left = {point for fibres in FIBRES_LEFT.values() for fibre in fibres for point in fibre}
    wanted = sorted(left | {_right(point) for point in left})
    for point in wanted:
        if point not in place:
            raise FaceError(f"{path}: muscle point {point} is absent, expected the published list")
    raw = listed.position[[place[point] for point in wanted]] * MILLIMETRE
    projected, _ = project_into_mesh(raw, position, connectivity)
    return dict(zip(wanted, projected, strict=True))


def _right(point: int) -> int:
    return point if point in MIDLINE_POINTS else point + RIGHT_OFFSET


def fibres_along(points: Mapping[int, Floats], lao_fibres: LaoChoice) -> list[Fibre]:
    """Fibres of both sides through the muscle points, by side and muscle."""
    result: list[Fibre] = []
    for side in SIDES:
        for muscle in MODELLED:
            groups = FIBRES_LEFT[muscle]
            if muscle == "LAO" and lao_fibres == "lateral":
                groups = groups[1:]
            for group in groups:
                ids = group if side == "L" else tuple(_right(point) for point in group)
                result.append(Fibre(f"{muscle}_{side}", np.array([points[k] for k in ids])))
    return result


def bundles_of(
    fibres: Sequence[Fibre],
    by_hand: Mapping[str, Path | None],
    centres: Floats,
    element_id: Integers,
    radius: float,
) -> list[Bundle]:
    """Elements and directions of every muscle, from a manual list if there is one."""
    mirror = _mirror_elements(centres)
    result: list[Bundle] = []
    for muscle in MODELLED:
        both = [f.position for f in fibres if f.muscle.rpartition("_")[0] == muscle]
        path = by_hand.get(muscle)
        chosen = None if path is None else _hand_made(path, element_id, mirror)
        for side in SIDES:
            name = f"{muscle}_{side}"
            if chosen is None:
                mine = [fibre.position for fibre in fibres if fibre.muscle == name]
                element = elements_within(centres, mine, radius)
            else:
                x = centres[chosen, 0]
                element = chosen[x < 0 if side == "L" else x >= 0]
            direction = symmetric_directions(centres[element], both)
            result.append(Bundle(name, element, direction))
    return result


def _hand_made(path: Path, element_id: Integers, mirror: Integers) -> Integers:
    """Elements of a manual set, completed by mirroring."""
    if path.suffix == ".elem":
        listed = read_elements(path)
        # Contact elements (types above 2) in the same file are not tissue.
        ids = listed.id[listed.type <= 2]
    else:
        ids = read_ids(path, base=1)
    place = {int(element): k for k, element in enumerate(element_id)}
    for element in ids:
        if int(element) not in place:
            raise FaceError(f"{path}: element {element} is not in the mesh, expected its ids")
    chosen = np.array([place[int(element)] for element in ids], dtype=np.int64)
    return np.union1d(chosen, mirror[chosen])


def _mirror_elements(centres: Floats) -> Integers:
    """Find the element whose centre is nearest to the mirrored centre of each element."""
    return np.asarray(KDTree(centres).query(centres * [-1.0, 1.0, 1.0])[1], dtype=np.int64)
