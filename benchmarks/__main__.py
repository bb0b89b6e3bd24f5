"""Run a measurement by its name: ``python -m benchmarks NAME [options]``."""

import ast
import sys
from importlib import import_module
from pathlib import Path

import typer

from emgface.cli.console import show_warnings_as_sentences
from emgface.errors import EmgfaceError

ARCHIVES: dict[str, dict[str, tuple[str, ...]]] = {
    "b11a4377": {
        "head": ("held", "led", "led_single", "published"),
        "intervals": (),
        "inverse": (),
        "inverse_checks": (),
        "inverse_coverage": (),
        "inverse_doubts": (),
        "inverse_gradients": (),
        "inverse_recorded": (),
        "jaw": ("posterior",),
        "pursed_lips": (),
        "recovery": (),
    },
    "9c2599bc": {
        "acoustics": ("checks", "folds", "head", "lips", "ranges", "stiffening"),
        "calibration": (),
        "contact_rules": (),
        "head": ("actions", "opening", "stability", "strong"),
        "head_impact": (),
        "jaw": ("causes", "chewing", "cost", "forces", "morsel", "pull"),
        "open_choices": (),
        "reduced_study": (),
        "scale": ("objects", "picture", "plan", "recordings", "thousand"),
        "step_time": (),
        "survival": (),
        "tongue": ("kink",),
        "tongue_limits": (),
    },
}
"""Commits with finished research, whose pages and figures are kept: archived measurements.

Of those that continue to exist, the archived values of ``--part``.
"""


def archived(words: list[str]) -> str:
    """Commit that contains the measurement of these words, empty for those that are here."""
    name, rest = words[0].replace("-", "_"), set(words[1:])
    for commit, measured in ARCHIVES.items():
        parts = measured.get(name)
        if parts is not None and (not parts or rest & set(parts)):
            return commit
    return ""


def measurements() -> dict[str, str]:
    """Names of the measurements and the first line of each module."""
    titles: dict[str, str] = {}
    folder = Path(__file__).parent
    for path in sorted([*folder.glob("[!_]*.py"), *folder.glob("*/__init__.py")]):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        if any(isinstance(node, ast.FunctionDef) and node.name == "main" for node in tree.body):
            name = path.parent.name if path.name == "__init__.py" else path.stem
            titles[name] = (ast.get_docstring(tree) or "").split("\n")[0]
    return titles


def run(arguments: list[str]) -> None:
    """Run the measurement that the first argument names, or list them all."""
    known = measurements()
    name = arguments[0].replace("-", "_") if arguments else ""
    if arguments and (commit := archived(arguments)):
        print(
            f"{name} is finished research, archived with its results: 'git checkout {commit}' and run "
            "the same command there",
            file=sys.stderr,
        )
        raise SystemExit(2)
    if name not in known:
        if name not in ("", "__help"):
            print(f"There is no measurement {arguments[0]!r}, expected one of:", file=sys.stderr)
        print("\n".join(f"{key:18s}{known[key]}" for key in known))
        raise SystemExit(0 if name in ("", "__help") else 2)
    show_warnings_as_sentences()
    module = import_module(f"benchmarks.{name}")
    app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
    app.command(help=module.__doc__)(module.main)
    try:
        app(arguments[1:], prog_name=f"python -m benchmarks {name}")
    except EmgfaceError as error:
        print(f"{type(error).__name__}: {error}", file=sys.stderr)
        raise SystemExit(2) from None


if __name__ == "__main__":
    run(sys.argv[1:])
