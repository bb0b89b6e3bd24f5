"""Import of the published reference face from its ANSYS files.

The files are those of the public repository `artisynth_models` (directory
`src/artisynth/models/face/geometry/refmodel`, and two atlas lists in its parent), read from a
checkout or from a folder `face_reference` with copies of them. Lengths are converted from
millimetres to metres.

Source: Nazari et al. 2010 and Stavness et al. 2013 (the face); Eskes et al. 2017 (its use).
"""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final, get_args

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from emgface.errors import FaceError
from emgface.face import landmarks
from emgface.face.ansys import MILLIMETRE, read_elements, read_nodes, solid_nodes
from emgface.face.artisynth_contact import BoneChoice, published_bones, published_lips
from emgface.face.artisynth_files import PublishedFiles
from emgface.face.artisynth_muscles import (
    OOM_FILES,
    OOP_FILES,
    LaoChoice,
    OomChoice,
    OopChoice,
    bundles_of,
    fibres_along,
    muscle_points,
)
from emgface.face.model import build_face
from emgface.face.parts import CENTRE, INNER, MANDIBLE, OUTER, SKULL
from emgface.face.quality import element_centres

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

MARKER_IDS: Final = (1997, 1645, 185, 4663, 6052, 6385, 228, 227, 4704, 4705)
"""Nodes proposed for the ten lip markers, in the order of `LIP_MARKERS`.

The publication does not specify them. The proposed nodes are on the vermilion border, which is the ring
of skin nodes at the largest curvature of the lip profile (ring 4 above, 3 below, counted from the mouth
opening), at the corners and at one and two thirds of the half width.
"""

LIP_OPENING_IDS: Final = (1076, 1096)  #: midline nodes of the upper and lower lip margin

MOUTH_CORNER_ID: Final = 1808  #: a node on the rim of the mouth opening (its left corner)

_FILES: Final = {
    "nodes": "newface.node",
    "elements": "newface.elem",
    "inner sheet": "atlas_internal.node",
    "outer sheet": "atlas_external.node",
    "mandible": "fixed_mandible.node",
    "skull": "fixed_skull_nose.node",
    "muscle points": "muscles.node",
}


def import_artisynth(
    folder: str | os.PathLike[str],
    *,
    radius: float = 5e-3,
    oop: OopChoice = "oldoop",
    oom: OomChoice = "active",
    lao_fibres: LaoChoice = "both",
    marker_ring_offset: int = 0,
    bones: BoneChoice = "whole",
) -> xr.Dataset:
    """Read the reference face as a face_model, with the origin "published geometry, imported".

    `folder` is a checkout of `artisynth_models`, its `refmodel` folder, or a folder (or the parent
    of a folder `face_reference`) with copies of the files. Elements belong to a muscle if their
    centre is nearer than `radius` [m] to its fibres: 5 mm in Eskes et al. 2017, 3 mm in the
    demonstration distributed with the model. Directions interpolate the segments of both sides
    together, as in the published simulator.

    The elements of orbicularis oris peripheralis (`oop`) are the manual set of 322 of the
    demonstration ("oldoop"), the 408 activated in ANSYS ("active"), the full block of 420
    ("block"), or by radius ("radius"); those of orbicularis oris marginalis (`oom`) the manual set
    of 466 after mirroring ("active"), or by radius. Manual sets are split into left and right by
    the x of the element centre. `lao_fibres` includes "both" fibres of levator anguli oris, or the
    "lateral" one only, as in a later grouping. `marker_ring_offset` moves the proposed lip markers
    by rings of skin nodes away from the mouth opening, to measure the influence of their choice.
    `bones` are "whole" shells of teeth and alveolar processes, or the open "patch" opposite the
    lips; shells and surfaces of the lips, required by contact, are read if their files are present.

    Raises FaceError if a file is absent (with the folders searched), damaged, or inconsistent with
    the others, an option is unknown, or the face fails `emgface.face.validity.check_face`.
    """
    options = {"oop": oop, "oom": oom, "lao_fibres": lao_fibres}
    _check_options(**options, bones=bones)
    files = PublishedFiles(Path(folder))
    nodes = read_nodes(files[_FILES["nodes"]])
    position = nodes.position * MILLIMETRE
    index = {int(node): k for k, node in enumerate(nodes.id)}
    elements = read_elements(path := files[_FILES["elements"]])
    connectivity = _indices(solid_nodes(elements, path), index, path)
    centres = element_centres(position, connectivity)
    inner, outer, mandible, skull = (
        _selection(files[_FILES[what]], index)
        for what in ("inner sheet", "outer sheet", "mandible", "skull")
    )
    layer = _layers(connectivity, inner, outer, elements.id, len(position))
    fixed = _fixed(nodes.id, mandible, skull)
    points = muscle_points(files[_FILES["muscle points"]], position, connectivity)
    fibres = fibres_along(points, lao_fibres)
    by_hand = {
        "OOP": None if oop == "radius" else files[OOP_FILES[oop]],
        "OOM": None if oom == "radius" else files[OOM_FILES[oom]],
    }
    bundles = bundles_of(fibres, by_hand, centres, elements.id, radius)
    markers = _named(MARKER_IDS, index, "lip marker")
    corner = _named((MOUTH_CORNER_ID,), index, "mouth corner")[0]
    ring = (position, connectivity, outer, corner)
    return build_face(
        position=position,
        connectivity=connectivity,
        layer=layer,
        fixed=fixed,
        fibres=fibres,
        bundles=bundles,
        marker_node=landmarks.shift_rings(*ring, markers, marker_ring_offset),
        face_marker_position=landmarks.face_markers(position, fixed, inner, outer),
        lip_opening_node=_named(LIP_OPENING_IDS, index, "lip margin"),
        arches=published_bones(files, bones),
        lips=published_lips(files, index, position),
        name="reference face",
        origin="published geometry, imported",
        source="Nazari et al. 2010, Stavness et al. 2013; artisynth_models, refmodel",
        node_id=nodes.id,
        element_id=elements.id,
        attrs={
            "muscle_radius": radius,
            **options,
            "marker_ring_offset": marker_ring_offset,
            "marker_choice": "proposed: the publication does not specify the nodes",
            "source_digest": files.digest(),
        },
    )


def _check_options(**given: str) -> None:
    kinds = {"oop": OopChoice, "oom": OomChoice, "lao_fibres": LaoChoice, "bones": BoneChoice}
    for name, value in given.items():
        known = get_args(kinds[name])
        if value not in known:
            raise FaceError(f"{name} is {value!r}, expected one of {', '.join(known)}")


def _fixed(node_id: Integers, mandible: Integers, skull: Integers) -> NDArray[np.int8]:
    fixed = np.zeros(len(node_id), dtype=np.int8)
    fixed[mandible] = MANDIBLE
    if fixed[skull].any():
        node = node_id[skull[fixed[skull] > 0][0]]
        raise FaceError(f"node {node} is fixed to mandible and skull, expected one of them")
    fixed[skull] = SKULL
    return fixed


def _named(ids: Sequence[int], index: Mapping[int, int], what: str) -> Integers:
    for node in ids:
        if node not in index:
            raise FaceError(
                f"node {node} ({what}) is not in the mesh: expected the published reference face"
            )
    return np.array([index[node] for node in ids], dtype=np.int64)


def _selection(path: Path, index: Mapping[int, int]) -> Integers:
    """Node indices of a list whose coordinates repeat those of the mesh."""
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
    """Layer: inner or outer if an element has nodes of that surface, otherwise centre."""
    on_inner, on_outer = np.zeros(n_nodes + 1, dtype=bool), np.zeros(n_nodes + 1, dtype=bool)
    on_inner[inner], on_outer[outer] = True, True
    # Index -1 of wedges refers to the last, unused entry.
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
