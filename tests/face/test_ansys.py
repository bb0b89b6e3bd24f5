"""ANSYS lists: touching columns, degenerate wedges, id bases, cut and garbled lines."""

from pathlib import Path

import numpy as np
import pytest

from emgface.errors import FaceError
from emgface.face.ansys import read_elements, read_ids, read_nodes, solid_nodes


def node_line(node: int, *values: str) -> str:
    return f"{node:8d}" + "".join(
        f" {value:19s}" if value[0] != "-" else f"{value:20s}" for value in values
    )


FIRST = node_line(1, "0.000000000000", "67.09187970000", "-90.26723940000")
TOUCHING = "     124-0.5341773707000E-08 76.26900000000     -78.00000000000    "


def element_line(nodes: list[int], element: int, kind: int = 1) -> str:
    return "".join(f"{n:6d}" for n in [*nodes, 1, kind, 1, 0, 0]) + f"{element:6d}"


def write(folder: Path, name: str, *lines: str) -> Path:
    path = folder / name
    path.write_text("\n".join(lines) + "\n")
    return path


def test_node_id_touching_its_coordinate_is_kept(tmp_path: Path) -> None:
    nodes = read_nodes(write(tmp_path, "a.node", FIRST, TOUCHING))
    assert nodes.id.tolist() == [1, 124]
    np.testing.assert_array_equal(nodes.position[1], [-0.5341773707e-8, 76.269, -78.0])


def test_columns_that_touch_everywhere_are_cut_by_width(tmp_path: Path) -> None:
    wide = "12345678" + "-1.50000000000000000" + "02.00000000000000000" + "3" * 20
    assert len(wide) == 68
    nodes = read_nodes(write(tmp_path, "a.node", wide))
    assert nodes.id.tolist() == [12345678]
    np.testing.assert_allclose(nodes.position[0], [-1.5, 2.0, float("3" * 20)], rtol=1e-15)


def test_free_layout_with_tabs(tmp_path: Path) -> None:
    path = write(tmp_path, "a.node", "1\t0.1 -2e-3 3", "2 1 2 3", "30-1.5 2 3")
    nodes = read_nodes(path)
    assert nodes.id.tolist() == [1, 2, 30]
    np.testing.assert_array_equal(nodes.position[[0, 2]], [[0.1, -0.002, 3.0], [-1.5, 2.0, 3.0]])


def test_trimmed_blanks_are_accepted(tmp_path: Path) -> None:
    nodes = read_nodes(write(tmp_path, "a.node", FIRST, TOUCHING.rstrip()))
    assert len(nodes.id) == 2


@pytest.mark.parametrize(
    ("line", "what"),
    [
        (TOUCHING[:60], "lost digits"),
        (TOUCHING[:45], "three numbers"),
        (TOUCHING[:20], "three numbers"),
        (TOUCHING.replace("76.269", "76.x69"), "three numbers"),
        (TOUCHING + " 1", "at most 68"),
    ],
)
def test_bad_node_line_is_located(tmp_path: Path, line: str, what: str) -> None:
    path = write(tmp_path, "a.node", FIRST, line)
    with pytest.raises(FaceError, match=rf"a\.node, line 2: .*{what}"):
        read_nodes(path)


def test_exponent_cut_short_is_located(tmp_path: Path) -> None:
    line = node_line(2, "1.000000000000", "2.000000000000", "-0.5341773707000E-08")
    assert len(line) == 68
    with pytest.raises(FaceError, match="line 2: .*lost digits"):
        read_nodes(write(tmp_path, "a.node", FIRST, line[:-1]))
    with pytest.raises(FaceError, match="line 2: .*lost digits"):
        read_nodes(write(tmp_path, "a.node", FIRST, line[:-4]))


@pytest.mark.parametrize("line", ["2 1 2", "2 1 2 x", "two 1 2 3"])
def test_bad_free_line_is_located(tmp_path: Path, line: str) -> None:
    with pytest.raises(FaceError, match=r"a\.node, line 2: "):
        read_nodes(write(tmp_path, "a.node", "1 0 0 0", line))


def test_repeated_absent_and_empty_lists(tmp_path: Path) -> None:
    with pytest.raises(FaceError, match="node 1 occurs twice"):
        read_nodes(write(tmp_path, "a.node", FIRST, FIRST))
    with pytest.raises(FaceError, match="cannot be read"):
        read_nodes(tmp_path / "absent.node")
    with pytest.raises(FaceError, match="contains no nodes"):
        read_nodes(write(tmp_path, "b.node", ""))
    (tmp_path / "c.node").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(FaceError, match="not a text file"):
        read_nodes(tmp_path / "c.node")


def test_elements_with_touching_ids(tmp_path: Path) -> None:
    hexahedron = [114001, 114002, 114003, 114004, 114005, 114006, 114007, 114008]
    wedge = [1, 2, 3, 3, 4, 5, 6, 6]
    path = write(tmp_path, "a.elem", element_line(hexahedron, 7), element_line(wedge, 8, kind=2))
    elements = read_elements(path)
    assert elements.id.tolist() == [7, 8]
    assert elements.type.tolist() == [1, 2]
    nodes = solid_nodes(elements, path)
    assert nodes[0].tolist() == hexahedron
    assert nodes[1].tolist() == [1, 2, 3, 4, 5, 6, -1, -1]


@pytest.mark.parametrize(
    "nodes", [[1, 2, 3, 3, 4, 5, 6, 7], [1, 2, 0, 0, 0, 0, 0, 0], [1, 2, 3, 3, 1, 5, 6, 6]]
)
def test_other_degenerate_elements_are_refused(tmp_path: Path, nodes: list[int]) -> None:
    path = write(tmp_path, "a.elem", element_line(nodes, 31))
    with pytest.raises(FaceError, match=r"element 31 has nodes .* expected 8 distinct"):
        solid_nodes(read_elements(path), path)


@pytest.mark.parametrize("cut", [80, 78, 40])
def test_cut_element_line_is_located(tmp_path: Path, cut: int) -> None:
    line = element_line([1, 2, 3, 4, 5, 6, 7, 8], 100)
    path = write(tmp_path, "a.elem", line, element_line([9, 2, 3, 4, 5, 6, 7, 8], 101)[:cut])
    with pytest.raises(FaceError, match=r"a\.elem, line 2: .*truncated"):
        read_elements(path)


def test_garbled_element_line_is_located(tmp_path: Path) -> None:
    line = element_line([1, 2, 3, 4, 5, 6, 7, 8], 100)
    path = write(tmp_path, "a.elem", line, line.replace("     3", "  3.50"))
    with pytest.raises(FaceError, match=r"a\.elem, line 2: .*13 integers"):
        read_elements(path)


def test_id_base_is_stated(tmp_path: Path) -> None:
    path = write(tmp_path, "ids.txt", "1", "5", " 9 ")
    assert read_ids(path, base=1).tolist() == [1, 5, 9]
    assert read_ids(path, base=0).tolist() == [2, 6, 10]
    with pytest.raises(ValueError, match="expected 0 or 1"):
        read_ids(path, base=2)


@pytest.mark.parametrize("line", ["0", "x", "1 2", "1.5", "-3"])
def test_bad_id_is_located(tmp_path: Path, line: str) -> None:
    with pytest.raises(FaceError, match=r"ids\.txt, line 2: "):
        read_ids(write(tmp_path, "ids.txt", "4", line), base=1)
