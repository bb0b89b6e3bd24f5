"""Python examples of the documentation: their functions exist and accept the arguments."""

import ast
import builtins
import inspect
import re
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
EXAMPLES = [
    pytest.param(text, id=f"{path.relative_to(ROOT)} {number}")
    for path in sorted([ROOT / "README.md", *(ROOT / "docs").rglob("*.md")])
    if "generated" not in path.parts
    for number, text in enumerate(
        re.findall(r"^```python\n(.*?)^```", path.read_text(), re.M | re.S)
    )
]


def imported(tree: ast.Module) -> dict[str, Any]:
    """Objects that an example imports."""
    names: dict[str, Any] = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for name in node.names:
                names[name.asname or name.name] = import_module(name.name)
        if isinstance(node, ast.ImportFrom) and node.module:
            for name in node.names:
                module = import_module(node.module)
                names[name.asname or name.name] = getattr(module, name.name)
    return names


def calls(tree: ast.Module) -> Iterator[tuple[ast.Call, list[str]]]:
    """Calls of functions by a dotted name, and the parts of the name."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and re.fullmatch(r"[\w.]+", ast.unparse(node.func)):
            yield node, ast.unparse(node.func).split(".")


@pytest.mark.parametrize("example", EXAMPLES)
def test_functions_of_examples_accept_their_arguments(example: str) -> None:
    tree = ast.parse(example)
    known = imported(tree)
    for call, (first, *rest) in calls(tree):
        if not rest and not hasattr(builtins, first) and not first.startswith("My"):
            assert first in known, f"{first} is called, but not imported"
        if first not in known:
            continue  # a method of a result
        function = known[first]
        for part in rest:
            function = getattr(function, part)
        if any(isinstance(argument, ast.Starred) for argument in call.args):
            continue
        if function.__module__.split(".")[0] in ("emgface", "sim", "analysis"):
            names = {keyword.arg: None for keyword in call.keywords if keyword.arg}
            inspect.signature(function).bind_partial(*call.args, **names)
