"""Readers of ANSYS node lists, element lists and id lists.

The lists have fixed columns, which may not be separated by blanks (a negative coordinate of full
width follows its node id directly). Lines are therefore split by column.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from emgface.errors import FaceError
from emgface.texts import read_text

MILLIMETRE = 1e-3  #: unit of length of the published files [m]

ID_WIDTH, COORDINATE_WIDTH = 8, 20
NODE_LINE_WIDTH = ID_WIDTH + 3 * COORDINATE_WIDTH
FIELD_WIDTH, ELEMENT_FIELDS = 6, 13

_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[EeDd][-+]?\d+)?"
_FREE_NODE = re.compile(rf"\s*(\d+)(?=[\s+-])\s*({_NUMBER})\s+({_NUMBER})\s+({_NUMBER})\s*")
_REAL = re.compile(rf"\s*({_NUMBER})\s*")
_INTEGER = re.compile(r"\s*([-+]?\d+)\s*")


@dataclass(frozen=True)
class NodeList:
    """Nodes of one file: `id` (n,) and `position` (n, 3) in the unit of the file."""

    id: NDArray[np.int64]
    position: NDArray[np.float64]


@dataclass(frozen=True)
class ElementList:
    """Elements of one file: `id` (n,), `node_id` (n, 8) with 0 for unused, `type` (n,)."""

    id: NDArray[np.int64]
    node_id: NDArray[np.int64]
    type: NDArray[np.int64]


def read_nodes(path: Path) -> NodeList:
    """Read a node list: id, x, y, z per line, in the unit of the file.

    A file whose first line is 8 + 3 x 20 characters wide is read by column; a shorter line may lack
    trailing blanks but no digits. Any other file is read by a pattern of numbers separated by
    blanks or, before x, by its sign. Raises FaceError, with file and line, if a line is truncated
    or contains anything but numbers, or an id occurs twice.
    """
    ids: list[int] = []
    rows: list[tuple[float, float, float]] = []
    digits: int | None = None
    by_column = False
    for number, line in ansys_lines(path):
        if digits is None:
            by_column = len(line) == NODE_LINE_WIDTH
            digits = _digits(line[-COORDINATE_WIDTH:])
        if by_column:
            node, row = _node_by_column(path, number, line, digits)
        else:
            match = _FREE_NODE.fullmatch(line)
            if match is None:
                raise garbled(path, number, line, "a node id and three coordinates")
            node, row = int(match[1]), (_real(match[2]), _real(match[3]), _real(match[4]))
        ids.append(node)
        rows.append(row)
    if not ids:
        raise FaceError(f"{path} contains no nodes: expected one 'id x y z' per line")
    array = np.array(ids, dtype=np.int64)
    _reject_repeats(path, array, "node")
    return NodeList(array, np.array(rows, dtype=np.float64))


def read_elements(path: Path) -> ElementList:
    """Read an element list: 13 integers of 6 columns each, then the element id.

    Columns 1-8 are node ids (0 = unused), column 10 is the element type; links and contact elements
    are included. Raises FaceError if a line is truncated or contains anything but integers, or an
    id occurs twice.
    """
    ids: list[int] = []
    nodes: list[list[int]] = []
    types: list[int] = []
    width: int | None = None
    for number, line in ansys_lines(path):
        width = len(line) if width is None else width
        if len(line) < width:
            raise FaceError(
                f"{path}, line {number}: {len(line)} characters, expected {width} like the first "
                "line; the file is probably truncated"
            )
        fields = [line[k * FIELD_WIDTH : (k + 1) * FIELD_WIDTH] for k in range(ELEMENT_FIELDS)]
        fields.append(line[ELEMENT_FIELDS * FIELD_WIDTH :])
        values = [_INTEGER.fullmatch(field) for field in fields]
        if any(value is None for value in values):
            raise garbled(path, number, line, "13 integers of 6 columns each and an element id")
        integers = [int(value[1]) for value in values if value is not None]
        ids.append(integers[13])
        nodes.append(integers[:8])
        types.append(integers[9])
    if not ids:
        raise FaceError(f"{path} contains no elements: expected one element per line")
    array = np.array(ids, dtype=np.int64)
    _reject_repeats(path, array, "element")
    return ElementList(array, np.array(nodes, dtype=np.int64), np.array(types, dtype=np.int64))


def solid_nodes(elements: ElementList, path: Path) -> NDArray[np.int64]:
    """Node ids of hexahedra and wedges in VTK order, shape (n, 8).

    A wedge is written as the degenerate hexahedron I J K K M N O O; its six nodes are I J K M N O,
    followed by -1, -1. Raises FaceError for any other element.
    """
    node = elements.node_id
    result = node.copy()
    wedge = (node[:, 2] == node[:, 3]) & (node[:, 6] == node[:, 7])
    result[wedge] = np.column_stack(
        [node[wedge][:, [0, 1, 2, 4, 5, 6]], np.full((int(wedge.sum()), 2), -1)]
    )
    ordered = np.sort(result, axis=1)
    same = ordered[:, 1:] == ordered[:, :-1]
    same &= ordered[:, 1:] != -1
    bad = same.any(axis=1) | (node <= 0).any(axis=1)
    if bad.any():
        k = int(np.flatnonzero(bad)[0])
        raise FaceError(
            f"{path}: element {elements.id[k]} has nodes {node[k].tolist()}, expected 8 distinct "
            "nodes or a wedge written I J K K M N O O"
        )
    return result


def read_ids(path: Path, *, base: int) -> NDArray[np.int64]:
    """Read a list of ids, one per line, and return them counted from 1.

    `base` is 0 if the file contains positions counted from 0, and 1 if it contains ids. Raises
    FaceError if a line is not one integer of that base, or an id occurs twice.
    """
    if base not in (0, 1):
        raise ValueError(f"base is {base}, expected 0 or 1")
    ids: list[int] = []
    for number, line in ansys_lines(path):
        match = _INTEGER.fullmatch(line)
        if match is None or int(match[1]) < base:
            raise garbled(path, number, line, f"one integer not below {base}")
        ids.append(int(match[1]) + 1 - base)
    if not ids:
        raise FaceError(f"{path} contains no ids: expected one integer per line")
    array = np.array(ids, dtype=np.int64)
    _reject_repeats(path, array, "entry")
    return array


def _node_by_column(
    path: Path, number: int, line: str, digits: int
) -> tuple[int, tuple[float, float, float]]:
    node = _INTEGER.fullmatch(line[:ID_WIDTH])
    edges = [ID_WIDTH + k * COORDINATE_WIDTH for k in range(4)]
    reals = [_REAL.fullmatch(line[a:b]) for a, b in zip(edges[:-1], edges[1:], strict=True)]
    if node is None or reals[0] is None or reals[1] is None or reals[2] is None:
        raise garbled(path, number, line, "an id of 8 and three numbers of 20 columns")
    if len(line) > NODE_LINE_WIDTH:
        raise garbled(path, number, line, f"at most {NODE_LINE_WIDTH} characters")
    if len(line) < NODE_LINE_WIDTH and _digits(reals[2][1]) != digits:
        raise FaceError(
            f"{path}, line {number}: the last coordinate {reals[2][1]} has lost digits, expected "
            f"{digits} of them; the file is probably truncated"
        )
    return int(node[1]), (_real(reals[0][1]), _real(reals[1][1]), _real(reals[2][1]))


def _digits(text: str) -> int:
    """Count the digits of a mantissa; -1 if its exponent is truncated."""
    mantissa, letter, exponent = text.strip().upper().replace("D", "E").partition("E")
    if letter and len(exponent.strip("+-")) < 2:
        return -1
    # A number with an exponent has one digit less, because of its leading zero.
    return sum(c.isdigit() for c in mantissa) - (1 if letter else 0)


def _real(text: str) -> float:
    # Fortran writes double-precision exponents with D.
    return float(text.replace("D", "E").replace("d", "e"))


def ansys_lines(path: Path) -> Iterator[tuple[int, str]]:
    """Lines of a text file that are not blank, with numbers; FaceError if it cannot be read."""
    try:
        text = read_text(path, "ascii")
    except OSError as error:
        raise FaceError(f"{path} cannot be read ({error.strerror}): check the path") from error
    except UnicodeDecodeError as error:
        raise FaceError(
            f"{path} is not a text file (byte {error.start} is not ASCII): check the file"
        ) from error
    for number, line in enumerate(text.splitlines(), start=1):
        if line.strip():
            yield number, line


def _reject_repeats(path: Path, ids: NDArray[np.int64], kind: str) -> None:
    values, counts = np.unique(ids, return_counts=True)
    if (counts > 1).any():
        raise FaceError(f"{path}: {kind} {values[counts > 1][0]} occurs twice, expected each once")


def garbled(path: Path, number: int, line: str, expected: str) -> FaceError:
    """Error for a line with unexpected contents."""
    shown = line if len(line) <= 40 else line[:37] + "..."
    return FaceError(f"{path}, line {number}: found {shown!r}, expected {expected}")
