"""Messages name only options that the commands have which state them."""

import ast
import re
from pathlib import Path
from typing import Any

import typer

from emgface.cli import app

OPTION = re.compile(r"(?<![\w-])--[a-z][a-z-]*")

STATED_BY: dict[str, tuple[str, ...]] = {
    "emgface/signals/": ("activate", "simulate"),
    "emgface/face/event_error.py": ("simulate",),
    "emgface/inverse/": ("invert run",),
    "emgface/pictures/show.py": ("show",),
    "emgface/pictures/surface.py": ("simulate",),
    "emgface/api/views.py": ("show",),
    "emgface/recordings/describe.py": ("describe",),
    "emgface/recordings/bids/write.py": ("convert",),
    "emgface/study/": ("study run",),
    "emgface/run/": ("study run",),
    "emgface/run/retention.py": ("study gc",),
    "emgface/recordings/exclusions.py": ("check",),
}
"""Commands that state the messages of a module; the longest name counts."""
OTHER_PROGRAMS = {
    "--tls-ca-file",
    "--scheduler-file",
    "--nthreads",
    "--contact",
}  #: of dask and the benchmarks


def commands(command: Any, name: str = "") -> dict[str, set[str]]:
    """Options of every command by its name."""
    if hasattr(command, "commands"):
        lines: dict[str, set[str]] = {}
        for word, inner in command.commands.items():
            lines |= commands(inner, f"{name} {word}".strip())
        return lines
    return {name: {o for p in command.params for o in (*p.opts, *p.secondary_opts)}}


def messages(path: Path) -> list[tuple[int, str]]:
    """Texts of a module that are no docstrings, or of its data, and name an option."""
    if path.suffix != ".py":
        lines = enumerate(path.read_text(encoding="utf-8").splitlines(), 1)
        return [(number, line) for number, line in lines if OPTION.search(line)]
    tree = ast.parse(path.read_text(encoding="utf-8"))
    docs = {
        id(node.body[0].value)
        for node in ast.walk(tree)
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef)
        and node.body and isinstance(node.body[0], ast.Expr)
    }  # fmt: skip
    return [
        (node.lineno, node.value)
        for node in ast.walk(tree)
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
        and id(node) not in docs and OPTION.search(node.value)
    ]  # fmt: skip


def test_options_in_messages_exist_where_they_are_stated(root: Path) -> None:
    stored = commands(typer.main.get_command(app))
    every = set().union(*stored.values()) | {
        "--version",
        "--debug",
        "--help",
        "--install-completion",
    }
    wrong: list[str] = []
    for path in sorted(
        path for suffix in ("py", "toml", "csv") for path in (root / "emgface").rglob(f"*.{suffix}")
    ):
        name = path.relative_to(root).as_posix()
        if name == "emgface/cli/aliases.py":
            continue  # options of former commands
        known = [start for start in STATED_BY if name.startswith(start)]
        stated = STATED_BY[max(known, key=len)] if known else ()
        for line, text in messages(path):
            named = {word for word in stored if re.search(rf"\b{word}\b", text)}
            for option in set(OPTION.findall(text)) - OTHER_PROGRAMS:
                lacking = [c for c in stated if option not in stored[c]]
                elsewhere = any(option in stored[c] for c in named)
                if option not in every or (lacking and not elsewhere):
                    wrong.append(f"{name}:{line} {option} {lacking}")
    assert not wrong


def test_simulate_has_every_option_of_activate() -> None:
    """Because a recording is an input of both, and the messages of the signal chain name options."""
    stored = commands(typer.main.get_command(app))
    assert stored["activate"] - stored["simulate"] <= {"--plot", "--kind", "recording"}
