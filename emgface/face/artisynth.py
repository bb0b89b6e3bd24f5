"""Import of the published reference face from its ANSYS files.

The files are those of the public repository `artisynth_models` (directory
`src/artisynth/models/face/geometry/refmodel`, with two atlas lists one folder up), read either from
a checkout or from a folder `face_reference` that holds copies of them. Lengths are in millimetres
there and in metres from here on.

Source: Nazari et al. 2010 and Stavness et al. 2013 (the face); Eskes et al. 2017 (its use).
"""

import hashlib
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final, Literal, get_args

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.spatial import KDTree

from emgface.errors import FaceError
from emgface.face import landmarks
from emgface.face.ansys import read_elements, read_ids, read_nodes, solid_nodes
from emgface.face.bundles import elements_within, project_into_mesh, symmetric_directions
from emgface.face.model import build_face
from emgface.face.parts import CENTRE, INNER, MANDIBLE, OUTER, SKULL, Bundle, Fibre
from emgface.face.quality import element_centres
from emgface.muscles import MODELLED, SIDES

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

MILLIMETRE: Final = 1e-3

OopChoice = Literal["oldoop", "active", "block", "radius"]
OomChoice = Literal["active", "radius"]
LaoChoice = Literal["both", "lateral"]


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

MARKER_IDS: Final = (1997, 1645, 185, 4663, 6052, 6385, 228, 227, 4704, 4705)
"""Nodes proposed for the ten lip markers, in the order of `LIP_MARKERS`.

The publication does not name them. The proposal takes the vermilion border as the ring of skin
nodes where the lip profile turns (ring 4 above, 3 below, counted from the mouth opening) at the
corners and at one and two thirds of the half width.
"""

LIP_OPENING_IDS: Final = (1076, 1096)
"""Midline nodes of the upper and lower lip margin."""

MOUTH_CORNER_ID: Final = 1808
"""A node on the rim of the mouth opening (its left corner)."""

_FILES: Final = {
    "nodes": "newface.node",
    "elements": "newface.elem",
    "inner sheet": "atlas_internal.node",
    "outer sheet": "atlas_external.node",
    "mandible": "fixed_mandible.node",
    "skull": "fixed_skull_nose.node",
    "muscle points": "muscles.node",
}
_OOP_FILES: Final = {
    "oldoop": "oop/oldoop_elements.txt",
    "active": "OOP_active_elements.elem",
    "block": "OOP_elements.txt",
}
_OOM_FILES: Final = {"active": "OOM_active_elements.elem"}

_PLACES: Final = (
    ".",
    "face_reference",
    "src/artisynth/models/face/geometry/refmodel",
    "src/artisynth/models/face/geometry",
    "face/geometry/refmodel",
    "face/geometry",
)


def import_artisynth(
    folder: str | os.PathLike[str],
    *,
    radius: float = 5e-3,
    oop: OopChoice = "oldoop",
    oom: OomChoice = "active",
    lao_fibres: LaoChoice = "both",
    marker_ring_offset: int = 0,
) -> xr.Dataset:
    """Read the reference face and make a face_model of it.

    Parameters
    ----------
    folder : path-like
        A checkout of `artisynth_models`, its `refmodel` folder, or a folder (or the parent of a
        folder `face_reference`) that holds copies of the files.
    radius : float
        Elements whose centre lies nearer than this to a muscle's fibres belong to it [m]; 5 mm in
        Eskes et al. 2017, 3 mm in the demonstration that ships with the model.
    oop : {"oldoop", "active", "block", "radius"}
        Elements of orbicularis oris peripheralis: the hand-made set of 322 of the demonstration,
        the 408 activated in ANSYS, the full block of 420, or by radius.
    oom : {"active", "radius"}
        Elements of orbicularis oris marginalis: the hand-made set (466 once mirrored) or by
        radius. Hand-made sets are split into left and right by the x of the element centre.
    lao_fibres : {"both", "lateral"}
        Both fibres of levator anguli oris, or the lateral one alone, as a later grouping has it.
    marker_ring_offset : int
        Moves the proposed lip markers this many rings of skin nodes away from the mouth opening
        (negative: towards it), to see what their choice changes.

    Returns
    -------
    xarray.Dataset
        Of schema face_model, origin "published geometry, imported".

    Raises
    ------
    FaceError
        A file is absent (the message says where it was sought), garbled, or does not fit the
        others; or the face fails `emgface.face.validity.check_face`.

    Notes
    -----
    Directions interpolate the segments of both sides together, as the published simulator does.
    """
    _check_choice("oop", oop, get_args(OopChoice))
    _check_choice("oom", oom, get_args(OomChoice))
    _check_choice("lao_fibres", lao_fibres, get_args(LaoChoice))
    files = _Files(Path(folder))

    nodes = read_nodes(files[_FILES["nodes"]])
    position = nodes.position * MILLIMETRE
    index = {int(node): k for k, node in enumerate(nodes.id)}

    path = files[_FILES["elements"]]
    elements = read_elements(path)
    connectivity = _indices(solid_nodes(elements, path), index, path)
    centres = element_centres(position, connectivity)

    inner, outer, mandible, skull = (
        _selection(files[_FILES[what]], index)
        for what in ("inner sheet", "outer sheet", "mandible", "skull")
    )
    layer = _layers(connectivity, inner, outer, elements.id, len(position))
    fixed = np.zeros(len(position), dtype=np.int8)
    fixed[mandible] = MANDIBLE
    if fixed[skull].any():
        node = nodes.id[skull[fixed[skull] > 0][0]]
        raise FaceError(f"node {node} is fixed to mandible and skull, expected one of them")
    fixed[skull] = SKULL

    points = _muscle_points(files[_FILES["muscle points"]], position, connectivity)
    fibres = _fibres(points, lao_fibres)
    by_hand = {
        "OOP": None if oop == "radius" else files[_OOP_FILES[oop]],
        "OOM": None if oom == "radius" else files[_OOM_FILES[oom]],
    }
    bundles = _bundles(fibres, by_hand, centres, elements.id, radius)

    proposed = _named(MARKER_IDS, index, "lip marker")
    corner = _named((MOUTH_CORNER_ID,), index, "mouth corner")[0]
    markers = landmarks.shift_rings(
        position, connectivity, outer, corner, proposed, marker_ring_offset
    )
    return build_face(
        position=position,
        connectivity=connectivity,
        layer=layer,
        fixed=fixed,
        fibres=fibres,
        bundles=bundles,
        marker_node=markers,
        face_marker_position=landmarks.face_markers(position, fixed, inner, outer),
        lip_opening_node=_named(LIP_OPENING_IDS, index, "lip margin"),
        name="reference face",
        origin="published geometry, imported",
        source="Nazari et al. 2010, Stavness et al. 2013; artisynth_models, refmodel",
        node_id=nodes.id,
        element_id=elements.id,
        attrs={
            "muscle_radius": radius,
            "oop": oop,
            "oom": oom,
            "lao_fibres": lao_fibres,
            "marker_ring_offset": marker_ring_offset,
            "marker_choice": "proposed: the publication does not name the nodes",
            "source_digest": files.digest(),
        },
    )


class _Files:
    """Finds files of the model in the layouts known, and remembers which were used."""

    def __init__(self, folder: Path) -> None:
        if not folder.is_dir():
            raise FaceError(
                f"no folder {folder}: expected a checkout of artisynth_models or its files"
            )
        self._places = [folder / place for place in _PLACES]
        if folder.resolve().name == "refmodel":
            self._places.append(folder.resolve().parent)
        self._used: dict[str, Path] = {}

    def __getitem__(self, name: str) -> Path:
        for place in self._places:
            if (place / name).is_file():
                self._used[name] = place / name
                return place / name
        sought = ", ".join(str(place) for place in self._places if place.is_dir())
        raise FaceError(
            f"{name} of the reference face not found, looked in {sought}: give a complete "
            "checkout of artisynth_models or the folder that holds face_reference"
        )

    def digest(self) -> str:
        """SHA-256 over names and contents of the files used."""
        total = hashlib.sha256()
        for name in sorted(self._used):
            total.update(name.encode())
            total.update(hashlib.sha256(self._used[name].read_bytes()).digest())
        return total.hexdigest()


def _check_choice(name: str, value: object, known: Sequence[str]) -> None:
    if value not in known:
        raise FaceError(f"{name} is {value!r}, expected one of {', '.join(known)}")


def _named(ids: Sequence[int], index: Mapping[int, int], what: str) -> Integers:
    for node in ids:
        if node not in index:
            raise FaceError(
                f"node {node} ({what}) is not in the mesh: expected the published reference face"
            )
    return np.array([index[node] for node in ids], dtype=np.int64)


def _selection(path: Path, index: Mapping[int, int]) -> Integers:
    """Node indices of a list whose coordinates only repeat those of the mesh."""
    ids = read_nodes(path).id
    for node in ids:
        if int(node) not in index:
            raise FaceError(f"{path}: node {node} is not in the mesh, expected one of its ids")
    return np.array([index[int(node)] for node in ids], dtype=np.int64)


def _indices(node_id: Integers, index: Mapping[int, int], path: Path) -> Integers:
    unknown = sorted({int(node) for node in node_id.ravel() if node > 0} - index.keys())
    if unknown:
        raise FaceError(f"{path}: node {unknown[0]} is not in the node list, expected its ids")
    table = np.full(max(index) + 1, -1, dtype=np.int64)
    table[list(index)] = list(index.values())
    return np.where(node_id > 0, table[np.maximum(node_id, 0)], -1)


def _layers(
    connectivity: Integers, inner: Integers, outer: Integers, element_id: Integers, n_nodes: int
) -> NDArray[np.int8]:
    """Inner if an element has nodes of the inner sheet, outer if of the outer, else centre."""
    on_inner, on_outer = np.zeros(n_nodes + 1, dtype=bool), np.zeros(n_nodes + 1, dtype=bool)
    on_inner[inner], on_outer[outer] = True, True
    # Index -1 of wedges picks the last, unused entry.
    touches_inner = on_inner[connectivity].any(axis=1)
    touches_outer = on_outer[connectivity].any(axis=1)
    if (touches_inner & touches_outer).any():
        k = int(np.flatnonzero(touches_inner & touches_outer)[0])
        raise FaceError(
            f"element {element_id[k]} has nodes of the inner and of the outer sheet, expected "
            "three layers of elements between them"
        )
    layer = np.full(len(connectivity), CENTRE, dtype=np.int8)
    layer[touches_inner], layer[touches_outer] = INNER, OUTER
    return layer


def _muscle_points(path: Path, position: Floats, connectivity: Integers) -> dict[int, Floats]:
    """Muscle points by id [m], those outside the mesh moved to its surface."""
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


def _fibres(points: Mapping[int, Floats], lao_fibres: LaoChoice) -> list[Fibre]:
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


def _bundles(
    fibres: Sequence[Fibre],
    by_hand: Mapping[str, Path | None],
    centres: Floats,
    element_id: Integers,
    radius: float,
) -> list[Bundle]:
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
    """Elements of a hand-made set, closed under mirroring."""
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
