"""Names from data become paths by `named_file` and `result_file` only."""

import ast
import re
from pathlib import Path

import pytest

from emgface.errors import DataError, StoreError
from emgface.files import (
    LONGEST_FILE_NAME,
    different_names,
    named_file,
    new_files,
    plain_files,
    result_file,
)

HOSTILE = [
    "../../escaped/V1", "..", ".", "/etc/passwd", "a/b", "a\\b", "C:\\x", "\x00", "a\nb", "~", "$HOME",
    "con", "NUL.txt", " ", "...", ".hidden", "x.", "a*b?", "\u202e", "-rf", "`x`", "<b>", "a:b",
    "e\u0301",
]  # fmt: skip

INTERNAL = {
    "emgface/anatomy/head/published.py": "names of the published files, declared in the module",
    "emgface/anatomy/head/sweep.py": "digest",
    "emgface/anatomy/jaw/laws.py": "no path: a quotient",
    "emgface/anatomy/jaw/published_files.py": "names in a published model, which are only read",
    "emgface/anatomy/jaw/template/build.py": "no path: a quotient",
    "emgface/anatomy/tongue/published.py": "names of the published files, declared in the module",
    "emgface/study/outcomes.py": "digest",
    "emgface/face/waypoints.py": "the time of a state, a number",
    "emgface/view/curves.py": "names of muscles, checked",
    "emgface/volunteers/simulate.py": "S01 and so on, and one of the known instructions",
    "emgface/api/faces.py": "digest",
    "emgface/cli/inverse.py": "the file of the user",
    "emgface/cli/study.py": "names of the demonstration",
    "emgface/files.py": "the functions themselves",
    "emgface/inverse/calibrate_many.py": "digest",
    "emgface/inverse/kept.py": "a file that exists",
    "emgface/inverse/many.py": "the file of the user",
    "emgface/pictures/vtk.py": "numbers of frames",
    "emgface/recordings/bids/write.py": "labels that `file_name` has checked",
    "emgface/recordings/inventory.py": "files that exist",
    "emgface/schema/validation.py": "names of kinds, checked against the declared ones",
    "emgface/run/journal.py": "date, host and process",
    "emgface/run/retention.py": "digest",
    "emgface/report/study_tables.py": "names of tables",
    "emgface/run/store.py": "process and random digits",
}
"""Modules that compose the name of a file, and of what."""


def composed(path: Path) -> list[int]:
    """Lines that compose the name of a file from a formatted text."""
    lines: list[int] = []
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        joined = None
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Div):
            joined = node.right
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            if node.func.attr in ("with_name", "joinpath", "with_stem") and node.args:
                joined = node.args[0]
        if isinstance(joined, ast.JoinedStr | ast.BinOp) and not _numeric(joined):
            lines.append(node.lineno)
    return lines


def _numeric(node: ast.JoinedStr | ast.BinOp) -> bool:
    if isinstance(node, ast.JoinedStr):
        return not any(isinstance(part, ast.FormattedValue) for part in node.values)
    texts = [n for n in ast.walk(node) if isinstance(n, ast.Constant) and isinstance(n.value, str)]
    return not (isinstance(node.op, ast.Add | ast.Mod) and texts)


def test_no_other_module_makes_a_path_from_a_formatted_name(root: Path) -> None:
    lines_by_module = {
        path.relative_to(root).as_posix(): composed(path)
        for path in sorted((root / "emgface").glob("**/*.py"))
    }
    new = {name: lines for name, lines in lines_by_module.items() if lines and name not in INTERNAL}
    assert not new, f"{new}: use emgface.files.named_file, or state in INTERNAL what the name is of"


@pytest.mark.parametrize("name", HOSTILE)
def test_a_named_file_lies_directly_in_its_folder(name: str, tmp_path: Path) -> None:
    try:
        path = named_file(tmp_path, name, "A", "1", suffix=".nc")
    except DataError:
        return
    assert path.parent == tmp_path and path.resolve().parent == tmp_path.resolve()
    assert re.fullmatch(r"[^./\\:\x00-\x1f][^/\\:*?<>|\x00-\x1f]*", path.name), path.name
    path.write_text("x")
    assert path in list(tmp_path.iterdir())


def test_names_that_are_usual_are_kept(tmp_path: Path) -> None:
    assert named_file(tmp_path, "V01", "", "A", 1, suffix=".nc").name == "V01_A_1.nc"
    assert (
        named_file(tmp_path, "Zo\u00eb", "stim/left", suffix=".nc").name == "Zo\u00eb_stim-left.nc"
    )
    assert named_file(tmp_path, "con", suffix=".nc").name == "con-.nc"
    for texts in (["", " "], ["x" * LONGEST_FILE_NAME]):
        with pytest.raises(DataError, match="cannot be the name of a file"):
            named_file(tmp_path, *texts, suffix=".nc")


@pytest.mark.parametrize("stage", ["..", "../x", "/etc", "", "a/b", "a b", ".", "\x00"])
def test_stages_and_digests_are_checked(stage: str, tmp_path: Path) -> None:
    for given in ((stage, "0ab"), ("skin", stage)):
        with pytest.raises(StoreError, match="expected a name and hexadecimal digits"):
            result_file(tmp_path, *given)
    assert result_file(tmp_path, "skin", "0ab") == tmp_path / "skin" / "0ab.nc"


def test_links_are_neither_followed_nor_replaced(tmp_path: Path) -> None:
    inside, outside = tmp_path / "inside", tmp_path / "outside"
    for folder in (inside, outside):
        folder.mkdir()
        (folder / "a.txt").write_text("own")
    (inside / "folder").symlink_to(outside)
    (inside / "link.txt").symlink_to(outside / "a.txt")
    assert list(plain_files(inside)) == [inside / "a.txt"]
    assert list(plain_files(inside / "folder")) == []
    for replace in (False, True):
        with pytest.raises(DataError, match=r"link\.txt of .* exist"):
            new_files({inside / "link.txt": 0}, replace=replace)
    with pytest.raises(DataError, match=r"a\.txt"):
        new_files({inside / "a.txt": 0}, replace=False)
    new_files({inside / "a.txt": 0}, replace=True)


def test_two_origins_of_one_name_are_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"second and first would both be written as v\.nc"):
        different_names([(tmp_path / "V.nc", "first"), (tmp_path / "v.nc", "second")])
