"""Planted faults: how many of 100 small changes of `emgface` and `analysis` the tests notice.

    python -m benchmarks planted [--faults 100] [--seed 0] [--first 0] [--files 4] [--seconds 400]

A fault changes one expression of a copy of the tree: a comparison becomes its neighbour (< and <=) or
opposite, a sum a difference, a product a quotient, ``and`` an ``or``; ``not`` or a sign is dropped, a
whole number is increased by one, two arguments are swapped. The tests that are run are those in the
`--files` files that are nearest to the module by imports and by name, without those marked slow. A
fault is ``caught`` if a test fails that passes without it, ``survived`` if all pass, ``unfinished``
after `--seconds`, ``untested`` if no test imports the module; ``ill-typed`` if no test fails in time and
pyright, where it is installed, refuses the module. Some survivors are no faults: a change of a
tolerance or of a line width alters no result that a test could expect.
"""

import ast
import random
import re
import shutil
import subprocess
import sys
import tempfile
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

import pandas as pd

from benchmarks.report import finish
from emgface.children import child_environment, python_command, search_path

ROOT = Path(__file__).parents[1]
PACKAGES = "emgface", "analysis"
COMPARED: dict[type[ast.cmpop], type[ast.cmpop]] = {
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq, ast.In: ast.NotIn, ast.NotIn: ast.In, ast.Is: ast.IsNot, ast.IsNot: ast.Is,
}  # fmt: skip
COMPUTED: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult,
}  # fmt: skip


@dataclass(frozen=True)
class Fault:
    """Replacement of the text between two places, in bytes, of a module."""

    module: Path  #: below the root
    line: int
    start: int
    end: int
    before: str
    after: str

    def apply(self, root: Path) -> None:
        """Change the module in a copy of the tree."""
        path = root / self.module
        text = path.read_bytes()
        path.write_bytes(text[: self.start] + self.after.encode() + text[self.end :])


def changed(node: ast.AST) -> ast.expr | None:
    """The expression with one fault, or None if none of the kinds applies."""
    match node:
        case ast.Compare(left, [op], right):
            return ast.Compare(left, [COMPARED[type(op)]()], right)
        case ast.BinOp(left, op, right) if type(op) in COMPUTED:
            return ast.BinOp(left, COMPUTED[type(op)](), right)
        case ast.BoolOp(op, values):
            return ast.BoolOp(ast.Or() if isinstance(op, ast.And) else ast.And(), values)
        case ast.UnaryOp(ast.Not() | ast.USub(), operand):
            return operand
        case ast.Constant(int() as value) if not isinstance(value, bool):
            return ast.Constant(value + 1)
        case ast.Call(function, [a, b, *rest], keywords) if not {type(a), type(b)} & {ast.Starred}:
            if ast.dump(a) != ast.dump(b):
                return ast.Call(function, [b, a, *rest], keywords)
    return None


def expressions(node: ast.AST) -> Iterator[ast.expr]:
    """Expressions that compute: neither texts and messages nor types and type checking."""
    for name, value in ast.iter_fields(node):
        if name in ("annotation", "returns", "decorator_list", "exc", "msg"):
            continue
        for child in value if isinstance(value, list) else [value]:
            if not isinstance(child, ast.AST) or isinstance(child, ast.JoinedStr):
                continue
            if isinstance(child, ast.If) and "TYPE_CHECKING" in ast.dump(child.test):
                continue
            if isinstance(child, ast.expr):
                yield child
            yield from expressions(child)


def faults_of(path: Path) -> Iterator[Fault]:
    """All faults of a module."""
    raw = path.read_bytes()
    starts = [0, *(match.end() for match in re.finditer(rb"\n", raw))]
    for node in expressions(ast.parse(raw)):
        other = changed(node)
        if other is None or node.end_lineno is None or node.end_col_offset is None:
            continue
        start = starts[node.lineno - 1] + node.col_offset
        end = starts[node.end_lineno - 1] + node.end_col_offset
        before, after = raw[start:end].decode(), f"({ast.unparse(other)})"
        yield Fault(path.relative_to(ROOT), node.lineno, start, end, before, after)


def drawn(count: int, seed: int) -> list[Fault]:
    """Faults drawn at random, at most one of a module."""
    groups = [
        list(faults_of(path)) for name in PACKAGES for path in sorted((ROOT / name).rglob("*.py"))
    ]
    draw = random.Random(seed)
    left, faults = [many for many in groups if many], list[Fault]()
    while left and len(faults) < count:
        many = draw.choices(left, [len(each) for each in left])[0]
        left.remove(many)
        faults.append(draw.choice(many))
    return faults


def imported(path: Path, known: set[str]) -> set[str]:
    """Modules of the tree that a file imports anywhere in its text, or names to import them later."""
    names = set[str]()
    for node in ast.walk(ast.parse(path.read_bytes())):
        if isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
        elif isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            names.add(node.value.partition(":")[0])
    return names & known


class Tests:
    """Files of tests by their distance from a module."""

    def __init__(self) -> None:
        """Read the imports of all packages and tests."""
        paths = [p for name in (*PACKAGES, "tests") for p in sorted((ROOT / name).rglob("*.py"))]
        self.names = {path: _name(path) for path in paths}
        known = set(self.names.values())
        self.importers: dict[str, set[str]] = {name: set() for name in known}
        for path, name in self.names.items():
            for other in imported(path, known) - {name}:
                self.importers[other].add(name)
            if path.name == "conftest.py":  # every test of its folder has its fixtures
                for test in path.parent.rglob("test_*.py"):
                    self.importers[name].add(_name(test))

    def nearest(self, module: Path, most: int) -> list[str]:
        """Files of tests that import a module, those over fewer modules and of like names first."""
        start = _name(ROOT / module)
        distance, left = {start: 0}, deque([start])
        while left:
            name = left.popleft()
            # Without importers it is loaded by its package, like a reader.
            importers = self.importers[name] or {name.rpartition(".")[0]} & self.importers.keys()
            for other in importers - distance.keys():
                distance[other] = distance[name] + 1
                left.append(other)
        words = set(re.findall(r"[a-z0-9]+", start.replace("_", ".")))

        def rank(name: str) -> tuple[int, int, str]:
            alike = len(words & set(re.findall(r"[a-z0-9]+", name.replace("_", "."))))
            return distance[name] - alike, distance[name], name

        tests = sorted((n for n in distance if n.rpartition(".")[2].startswith("test_")), key=rank)
        return [name.replace(".", "/") + ".py" for name in tests[:most]]


def _name(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def failed(root: Path, tests: list[str], seconds: float) -> str | None:
    """First test that fails in a tree, empty if all pass; None if they do not end in time."""
    command = python_command("-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", *tests)
    others = [folder for folder in search_path() if Path(folder) != ROOT]
    try:
        done = subprocess.run(
            command,
            cwd=root,
            env=child_environment([root, *others]),
            capture_output=True,
            text=True,
            timeout=seconds,
        )
    except subprocess.TimeoutExpired:
        return None
    if done.returncode in (0, 5):
        return ""
    named = re.findall(r"^(?:FAILED|ERROR) (\S+)", done.stdout, re.MULTILINE)
    return named[0] if named else f"exit status {done.returncode}"


def ill_typed(root: Path, module: Path) -> bool:
    """Return True if pyright reports an error in a module of a tree."""
    if find_spec("pyright") is None:
        return False
    python, *safe = python_command("-m", "pyright")
    command = [python, *safe, "--pythonpath", python, str(module)]
    done = subprocess.run(command, cwd=root, env=child_environment(), capture_output=True)
    return done.returncode == 1


def outcome(fault: Fault, copy: Path, tests: list[str], seconds: float) -> tuple[str, str]:
    """What the tests say of a fault, and the test that fails."""
    if not tests:
        return "untested", ""
    fault.apply(copy)
    try:
        test = failed(copy, tests, seconds)
        if not test and ill_typed(copy, fault.module):
            return "ill-typed", ""
    finally:
        shutil.copy2(ROOT / fault.module, copy / fault.module)
    if test is None:
        return "unfinished", ""
    if test and test.partition("::")[0] in tests and failed(copy, [test], seconds) != "":
        return "failing without it", test
    return ("caught", test) if test else ("survived", "")


def main(
    out: Path | None = None,
    faults: int = 100,
    seed: int = 0,
    first: int = 0,
    last: int | None = None,
    files: int = 4,
    seconds: float = 400.0,
) -> None:
    """Plant the faults from `first` to `last` one by one, and print what the tests say."""
    tests, rows = Tests(), list[dict[str, object]]()
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "tree"
        skipped = shutil.ignore_patterns(".git", "__pycache__", ".venv", "*.egg-info")
        shutil.copytree(ROOT, copy, ignore=skipped, symlinks=True)
        for k, fault in list(enumerate(drawn(faults, seed)))[first:last]:
            said, test = outcome(fault, copy, tests.nearest(fault.module, files), seconds)
            place = f"{fault.module}:{fault.line}"
            change = f"{_short(fault.before)} -> {_short(fault.after)}"
            rows.append({"fault": k, "place": place, "change": change, "said": said, "test": test})
            print(f"{k} {said}: {place}  {change}  {test}", file=sys.stderr, flush=True)
    finish("planted", pd.DataFrame(rows), out)


def _short(text: str) -> str:
    return " ".join(text.split())[:60]
