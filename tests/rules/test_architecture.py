"""Rules of the code that can be tested automatically."""

import ast
from functools import cache
from pathlib import Path

import pytest

from sim._kernels import options

PACKAGES = ("emgface", "sim", "analysis")
MAY_IMPORT = {"emgface": {"emgface", "sim", "analysis"}, "sim": {"sim"}, "analysis": {"analysis"}}


def modules(root: Path, package: str) -> list[Path]:
    return sorted((root / package).glob("**/*.py"))


@cache
def found_in(path: Path) -> tuple[set[str], set[str | None]]:
    """Imported packages, and names of keyword arguments."""
    names, keywords = set[str](), set[str | None]()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
            names.add(node.module.split(".")[0])
        elif isinstance(node, ast.keyword):
            keywords.add(node.arg)
    return names, keywords


@pytest.mark.parametrize("package", PACKAGES)
def test_imports_have_one_direction(root, package):
    paths = modules(root, package)
    assert paths
    for path in paths:
        foreign = found_in(path)[0] & set(PACKAGES) - MAY_IMPORT[package]
        assert not foreign, f"{path.relative_to(root)} imports {sorted(foreign)}"


def test_numba_is_used_in_kernel_files_only(root):
    for package in PACKAGES:
        for path in modules(root, package):
            if "numba" in found_in(path)[0]:
                assert "_kernels" in str(path.relative_to(root)), path


def test_kernels_are_compiled_by_one_set_of_options_and_never_in_parallel_by_numba(root):
    """A parallel kernel differs between the process that compiles it and those that load it."""
    for package in PACKAGES:
        for path in modules(root, package):
            assert not found_in(path)[1] & {"fastmath", "parallel"}, path


def test_kernels_do_not_assume_finite_values():
    """All flags of `fastmath` would assume that no number is NaN or infinite."""
    one = [options.inner, options.kernel, options.kernel_and_inner]
    one += [options.allocating, options.bare_kernel]
    for decorator in one:
        flags = decorator(lambda x: x).targetoptions["fastmath"]
        assert set(flags) == {"contract", "reassoc", "nsz", "arcp"}


def test_there_is_no_module_for_miscellaneous_functions(root):
    names = {path.stem for package in PACKAGES for path in modules(root, package)}
    assert not names & {"utils", "util", "helpers", "misc", "common"}


def imported_modules(path: Path, known: set[str]) -> set[str]:
    """Modules that a module imports anywhere, also in functions and for types alone."""
    names_imported = set[str]()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names = [f"{node.module}.{alias.name}" for alias in node.names]
            names_imported |= {name if name in known else node.module for name in names}
        elif isinstance(node, ast.Import):
            names_imported |= {alias.name for alias in node.names}
    return names_imported & known


def circle_in(graph: dict[str, set[str]]) -> list[str]:
    """Modules of a circle of imports, or of what leads into one; empty if there is none."""
    left = {name: set(others) for name, others in graph.items()}
    while free := {name for name, others in left.items() if not others}:
        left = {name: others - free for name, others in left.items() if name not in free}
    return sorted(left)


@pytest.mark.parametrize("package", ["emgface", "analysis"])
def test_no_module_imports_itself_through_others(root, package):
    paths = {
        ".".join(path.relative_to(root).with_suffix("").parts).removesuffix(".__init__"): path
        for path in modules(root, package)
    }
    del paths[package]  # the names for users, which are imported when they are used
    graph = {name: imported_modules(path, set(paths)) - {name} for name, path in paths.items()}
    assert not circle_in(graph)


def test_a_circle_is_found():
    assert circle_in({"a": {"b"}, "b": {"c"}, "c": {"b"}, "d": set()}) == ["a", "b", "c"]
    assert not circle_in({"a": {"b", "c"}, "b": {"c"}, "c": set()})
