"""Every further Python process is started by `emgface.children`, and does not search its folder."""

import ast
import subprocess
from pathlib import Path

import pytest

from emgface.children import child_environment, python_command, search_path

PACKAGES = ("emgface", "sim", "analysis", "benchmarks", "studies", "notebooks", "docs")
HOME = Path("emgface/children.py")
STARTERS = ("ProcessPoolExecutor", "Pool", "Process", "LocalCluster", "get_context")


def names_in(path: Path) -> list[tuple[int, str]]:
    """Lines of a file that name this interpreter, or start processes of `multiprocessing`."""
    names: list[tuple[int, str]] = []
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Attribute) and node.attr in ("executable", "fork", "forkpty"):
            names.append((node.lineno, node.attr))
        if isinstance(node, ast.List) and node.elts:
            word = getattr(node.elts[0], "value", None)
            if isinstance(word, str) and word in ("python", "python3"):
                names.append((node.lineno, word))
        if isinstance(node, ast.Call):
            called = (
                node.func.attr
                if isinstance(node.func, ast.Attribute)
                else getattr(node.func, "id", "")
            )
            if called in STARTERS:
                names.append((node.lineno, called))
    return names


def guarded(path: Path) -> set[int]:
    """Lines within a block ``with safe_children(...)``."""
    lines: set[int] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.With) and any(
            isinstance(item.context_expr, ast.Call)
            and getattr(item.context_expr.func, "id", "") == "safe_children"
            for item in node.items
        ):
            lines |= set(range(node.lineno, (node.end_lineno or node.lineno) + 1))
    return lines


WITHOUT_START = {
    ("emgface/run/runner.py", "get_context"),  # used by guarded calls
    ("benchmarks/jaw_posterior.py", "Pool"),  # not of `multiprocessing`
}
"""Names that start nothing."""


@pytest.mark.parametrize("package", PACKAGES)
def test_no_other_place_starts_a_python_process(root: Path, package: str) -> None:
    for path in sorted((root / package).glob("**/*.py")):
        here = path.relative_to(root)
        if here == HOME:
            continue
        for line, name in names_in(path):
            allowed = line in guarded(path) or (str(here), name) in WITHOUT_START
            assert allowed, f"{here}:{line} ({name}): use emgface.children"


def test_a_child_imports_nothing_from_the_folder_in_which_it_starts(tmp_path: Path) -> None:
    for name in ("numpy", "multiprocessing", "json", "ezc3d", "emgface"):
        (tmp_path / f"{name}.py").write_text("raise SystemExit('code of the folder ran')\n")
    code = "import numpy, multiprocessing, json, emgface; print(emgface.__name__)"
    done = subprocess.run(
        python_command("-c", code), env=child_environment(), cwd=tmp_path,
        capture_output=True, text=True,
    )  # fmt: skip
    assert (done.returncode, done.stdout.strip()) == (0, "emgface"), done.stderr


def test_the_current_folder_is_not_searched(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for entry in ("", ".", "relative", str(tmp_path)):
        monkeypatch.syspath_prepend(entry)
    monkeypatch.setenv("PYTHONSTARTUP", "x.py")
    assert not {"", ".", "relative", str(tmp_path)} & set(search_path())
    assert "PYTHONSTARTUP" not in child_environment()
