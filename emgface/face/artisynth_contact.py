"""Bones and lips of the published reference face as surfaces for contact.

There are two formats: Wavefront OBJ with lines `v x y z` and `f a b c` (millimetres, indices
counted from 1), and lists `f a b c` of triangles over the nodes of the face (ids, counted from 1).
"""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from emgface.errors import FaceError
from emgface.face.ansys import MILLIMETRE, ansys_lines, garbled
from emgface.face.artisynth_files import PublishedFiles
from emgface.face.closed import check_closed
from emgface.face.parts import LIPS, MANDIBLE, SKULL, Arch

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

BoneChoice = Literal["whole", "patch"]

BONE_FILES: Final[Mapping[str, tuple[str, str]]] = {
    "whole": ("maxilla.obj", "mandible.obj"),
    "patch": ("maxilla_lipcontact.obj", "mandible_lipcontact.obj"),
}
LIP_FILES: Final = ("upperlip_filled.smesh", "lowerlip_filled.smesh")

_LISTED = re.compile(r"\[?\s*f\s+(\d+)\s+(\d+)\s+(\d+)\s*\]?")


def published_bones(files: PublishedFiles, choice: BoneChoice) -> list[Arch]:
    """Teeth and alveolar processes of maxilla and mandible; none if the files are absent.

    `choice` is "whole" for closed shells, or "patch" for their open parts opposite the lips. Raises
    FaceError if one of the two files is absent, a file is damaged, or a whole shell is not closed.
    """
    paths = files.optional_files(BONE_FILES[choice])
    if paths is None:
        return []
    arches: list[Arch] = []
    for bone, path in zip((SKULL, MANDIBLE), paths, strict=True):
        points, triangles = read_obj(path)
        if choice == "whole":
            check_closed(points, triangles, str(path))
        arches.append(Arch(bone, points * MILLIMETRE, triangles))
    return arches


def published_lips(
    files: PublishedFiles, index: Mapping[int, int], position: Floats
) -> dict[str, Integers]:
    """Closed surfaces of the lips over the nodes of the face; none if the files are absent.

    `index` maps node ids to indices. The result contains node indices (m, 3) of outward triangles
    by lip. Raises FaceError if one of the two files is absent, damaged, contains an unknown node,
    or is not closed.
    """
    paths = files.optional_files(LIP_FILES)
    if paths is None:
        return {}
    lips: dict[str, Integers] = {}
    for lip, path in zip(LIPS, paths, strict=True):
        triangles = read_triangles(path)
        for node in triangles.ravel().tolist():
            if node not in index:
                raise FaceError(f"{path}: node {node} is not in the mesh, expected one of its ids")
        lips[lip] = np.array([[index[node] for node in row] for row in triangles.tolist()])
        check_closed(position, lips[lip], str(path))
    return lips


def read_obj(path: Path) -> tuple[Floats, Integers]:
    """Vertices (n, 3) in the unit of the file, and triangles (m, 3) from 0, of an OBJ file.

    Raises FaceError if a vertex is not three numbers, a face is not a triangle of existing
    vertices, or there are none.
    """
    points: list[list[float]] = []
    triangles: list[list[int]] = []
    at: list[tuple[int, str]] = []
    for number, line in ansys_lines(path):
        kind, *rest = line.split()
        try:
            if kind == "v":
                x, y, z = map(float, rest)
                points.append([x, y, z])
            elif kind == "f":
                a, b, c = (int(corner.partition("/")[0]) - 1 for corner in rest)
                triangles.append([a, b, c])
                at.append((number, line))
        except ValueError as error:
            expected = "three numbers" if kind == "v" else "three vertices counted from 1"
            raise garbled(path, number, line, expected) from error
    for row, (number, line) in zip(triangles, at, strict=True):
        if not 0 <= min(row) <= max(row) < len(points):
            raise garbled(path, number, line, f"vertices from 1 to {len(points)}")
    if not triangles:
        raise FaceError(f"{path} contains no faces: expected lines 'f a b c'")
    return np.array(points), np.array(triangles, dtype=np.int64)


def read_triangles(path: Path) -> Integers:
    """Node ids (m, 3) of a list of triangles over the nodes of a mesh.

    Raises FaceError if a line is not `f a b c`, or there are none.
    """
    triangles: list[tuple[int, ...]] = []
    for number, line in ansys_lines(path):
        match = _LISTED.fullmatch(line.strip())
        if match is not None:
            triangles.append(tuple(int(node) for node in match.groups()))
        elif line.strip() not in ("[", "]"):
            raise garbled(path, number, line, "'f' and three node ids")
    if not triangles:
        raise FaceError(f"{path} contains no triangles: expected lines 'f a b c'")
    return np.array(triangles, dtype=np.int64)
