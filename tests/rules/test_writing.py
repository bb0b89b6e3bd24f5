"""Files are written by `emgface.files`: under a temporary name, and renamed when they are complete."""

import ast
from collections.abc import Iterator
from pathlib import Path

ATOMIC = {"replace_file", "new_folder", "_replace"}
"""Functions whose argument writes the temporary file; `_replace` of the store calls `replace_file`."""
METHODS = {
    "write_text", "write_bytes", "to_netcdf", "to_csv", "savefig", "savez", "savez_compressed",
    "WriteImage", "copy", "copy2", "copyfile", "move", "to_parquet", "to_json", "tofile", "savetxt",
    "dump", "NamedTemporaryFile", "fdopen",
}  # fmt: skip
"""Methods that write a file if they are given one."""

OTHERS = {
    "analysis/figures/style.py:encoded_figure": "to memory",
    "analysis/figures/style.py:save": "renames its own temporary file; analysis is below emgface",
    "emgface/api/views.py:_png": "to memory",
    "emgface/cli/pages.py:add": "to memory",
    "emgface/cli/pages.py:draw": "to memory",
    "emgface/fit/person.py:_repr_png_": "to memory",
    "emgface/fit/segment.py:write_labels": "to a temporary folder; the ending is the format",
    "emgface/recordings/describe.py:_checked": "to a temporary folder, from which it is read",
    "emgface/recordings/readers/_isolated.py:serve": "a pipe",
    "emgface/run/journal.py:__init__": "a journal, whose lines have checksums and are only appended",
    "emgface/view/server.py:redirect": "a temporary file for a browser",
}
"""Places that write in another way, or not a file, and why."""

TO_TEXT = {"to_csv", "to_json"}  # which return a text if they are not given a file


def writes(node: ast.AST) -> bool:
    """Return True for a call that writes a file."""
    if not isinstance(node, ast.Call):
        return False
    function = node.func
    name = function.attr if isinstance(function, ast.Attribute) else getattr(function, "id", "")
    if name in ("open", "Dataset", "ZipFile"):
        given = [*node.args[:2], *(k.value for k in node.keywords if k.arg == "mode")]
        modes = [a.value for a in given if isinstance(a, ast.Constant) and isinstance(a.value, str)]
        return any(len(mode) <= 3 and set(mode) & set("wax+") for mode in modes)
    if name in TO_TEXT and not node.args and not any(k.arg == "path_or_buf" for k in node.keywords):
        return False
    return isinstance(function, ast.Attribute) and name in METHODS and not _of_arrays(node)


def _of_arrays(node: ast.Call) -> bool:
    """Return True for methods of the same name that are given no file, such as ``array.copy()``."""
    name = node.func.attr  # type: ignore[union-attr]
    return name in ("copy", "dump", "move") and getattr(node.func.value, "id", "") != "shutil"  # type: ignore[union-attr]


def places(path: Path) -> Iterator[tuple[str, int]]:
    """Function and line of each call that writes a file outside of an argument of `ATOMIC`."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    passed: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and getattr(node.func, "id", "") in ATOMIC:
            passed |= {name.id for given in node.args for name in ast.walk(given)
                       if isinstance(name, ast.Name)}  # fmt: skip

    def visit(node: ast.AST, function: str, atomic: bool) -> Iterator[tuple[str, int]]:
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            function, atomic = node.name, atomic or node.name in passed
        if isinstance(node, ast.Call) and getattr(node.func, "id", "") in ATOMIC:
            atomic = True
        if writes(node) and not atomic:
            yield function, node.lineno  # type: ignore[attr-defined]
        for child in ast.iter_child_nodes(node):
            yield from visit(child, function, atomic)

    yield from visit(tree, "", False)


def test_files_are_written_by_one_function(root: Path) -> None:
    writers: dict[str, int] = {}
    for package in ("emgface", "analysis"):
        for path in sorted((root / package).glob("**/*.py")):
            name = path.relative_to(root).as_posix()
            if name != "emgface/files.py":
                writers |= {f"{name}:{function}": line for function, line in places(path)}
    new = {place: line for place, line in writers.items() if place not in OTHERS}
    assert not new, f"{new}: use emgface.files.replace_file, or state in OTHERS why not"
    assert set(OTHERS) <= set(writers), "OTHERS names places that no longer write"


def test_a_direct_write_is_found(tmp_path: Path) -> None:
    source = tmp_path / "a.py"
    lines = [
        "path.write_text('x')", "path.open('wb')", "open(path, 'w')", "frame.to_csv(path)",
        "figure.savefig(path)", "netCDF4.Dataset(path, 'w')", "shutil.copy2(a, b)",
    ]  # fmt: skip
    source.write_text("def f():\n" + "".join(f"    {line}\n" for line in lines))
    assert [line - 1 for _, line in places(source)] == list(range(1, len(lines) + 1))
    source.write_text("replace_file(path, lambda part: part.write_text('x'))\narray.copy()\n")
    assert list(places(source)) == []
