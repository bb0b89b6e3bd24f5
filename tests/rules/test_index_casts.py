"""Arrays of indices that a caller passes are checked by `sim.indices`, nowhere cast to integers.

A cast turns a mask into the nodes 0 and 1 and a fraction into a whole number, without a word.
"""

import ast
from pathlib import Path

import numpy as np
import pytest

from emgface.errors import FaceError, FitError
from emgface.face.landmarks import ring_of_nodes, shift_rings
from emgface.face.surface import boundary_faces, triangles
from emgface.fit.readers.surfaces import surface_of
from tests.bodies import grid

ROOT = Path(__file__).parents[2]
WHOLE = {"int", "int8", "int16", "int32", "int64", "intp", "uint8", "uint32"}
MAKES = {"asarray", "array", "ascontiguousarray", "asanyarray"}


def _whole(node: ast.expr | None) -> bool:
    return (isinstance(node, ast.Attribute) and node.attr in WHOLE) or (
        isinstance(node, ast.Name) and node.id in WHOLE
    )


def cast_parameters(source: str) -> list[tuple[int, str]]:
    """Line and name of every parameter of a function that is itself cast to integers."""
    casts = list[tuple[int, str]]()
    for function in ast.walk(ast.parse(source)):
        if not isinstance(function, ast.FunctionDef | ast.AsyncFunctionDef):
            continue
        a = function.args
        given = {p.arg for p in (*a.posonlyargs, *a.args, *a.kwonlyargs)}
        for call in ast.walk(function):
            if not (isinstance(call, ast.Call) and isinstance(call.func, ast.Attribute)):
                continue
            types = [*call.args, *(k.value for k in call.keywords if k.arg == "dtype")]
            if call.func.attr == "astype":
                array, types = call.func.value, call.args
            elif call.func.attr in MAKES and call.args:
                array, types = call.args[0], types[1:]
            else:
                continue
            if isinstance(array, ast.Name) and array.id in given and any(map(_whole, types)):
                casts.append((call.lineno, array.id))
    return casts


#: parameters that are no indices, or indices that the package computes
OTHERS = {
    ("emgface/recordings/fillers.py", "zero"),
    ("emgface/recordings/fillers.py", "mask"),
    ("emgface/recordings/fillers.py", "equal"),
    ("emgface/recordings/verdicts.py", "mask"),
    ("emgface/face/model.py", "bones"),
    ("emgface/anatomy/jaw/model.py", "values"),
    ("emgface/anatomy/jaw/picture.py", "fibre"),
    ("emgface/pictures/vtk.py", "connectivity"),
    ("emgface/pictures/vtk.py", "ends"),
    ("sim/joints/compiled.py", "values"),
}


@pytest.mark.parametrize("package", ["emgface", "analysis", "sim"])
def test_no_parameter_is_cast_to_integers(package):
    casts = list[str]()
    for path in sorted((ROOT / package).rglob("*.py")):
        name = path.relative_to(ROOT).as_posix()
        if name == "sim/indices.py" or "_kernels" in name:
            continue
        for line, parameter in cast_parameters(path.read_text(encoding="utf-8")):
            if (name, parameter) not in OTHERS:
                casts.append(f"{name}:{line} {parameter}")
    assert not casts, f"check these with sim.indices: {casts}"


def test_the_rule_finds_casts():
    source = "def f(nodes, mask, h):\n    a = np.asarray(nodes, dtype=np.int64)\n"
    source += "    b = np.asarray(mask, int), np.round(h).astype(int)\n"
    source += "    return a, b, h.astype(np.int64)\n"
    assert [name for _, name in cast_parameters(source)] == ["nodes", "mask", "h"]


MESH = grid((3, 1, 3))
HEX = MESH.blocks[0].nodes
FRONT = np.flatnonzero(MESH.X[:, 1] == 0.0)


def moved(nodes):
    """Nodes of a sheet moved by one ring from its border; a call that casts moves nodes 0 and 1."""
    return shift_rings(MESH.X, HEX, FRONT, int(FRONT[0]), nodes, 1)


def test_nodes_of_landmarks_may_be_numbers_or_a_mask():
    border = FRONT[ring_of_nodes(MESH.X, HEX, FRONT, int(FRONT[0]))[FRONT] == 0][:2]
    mask = np.zeros(len(MESH.X), dtype=bool)
    mask[border] = True
    np.testing.assert_array_equal(moved(mask), moved(border))
    np.testing.assert_array_equal(moved(border.astype(float)), moved(border))
    sheet = np.zeros(len(MESH.X), dtype=bool)
    sheet[FRONT] = True
    rings = [ring_of_nodes(MESH.X, HEX, given, int(FRONT[0])) for given in (sheet, FRONT)]
    np.testing.assert_array_equal(*rings)


@pytest.mark.parametrize(
    "wrong", [[0.5], [-1], [len(MESH.X)], np.zeros(3, dtype=bool), [np.nan], ["a"]], ids=str
)
def test_what_are_no_nodes_is_refused(wrong):
    with pytest.raises(FaceError, match="markers of the mouth"):
        moved(np.asarray(wrong))


def test_faces_and_triangles_with_fractions_or_masks_are_refused():
    faces, _ = boundary_faces(HEX)
    with pytest.raises(FaceError, match="no whole number"):
        triangles(faces + 0.5, MESH.X)
    with pytest.raises(FaceError, match="refers to node"):
        triangles(np.where(faces == faces.max(), len(MESH.X), faces), MESH.X)
    with pytest.raises(FaceError, match="true and false"):
        boundary_faces(HEX > 3)
    with pytest.raises(FitError, match="no whole number"):
        surface_of(MESH.X, triangles(faces, MESH.X) + 0.25)
    with pytest.raises(FitError, match="true and false"):
        surface_of(MESH.X, triangles(faces, MESH.X) > 3)
