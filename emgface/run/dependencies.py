"""Modules whose source determines a result: those of a stage, and what they import.

Imports are read from the text of the modules, also those within functions, so that no stage lists what
its modules need. A package that is named or imported counts with all its modules.
"""

import ast
import importlib.util
from functools import cache
from pathlib import Path
from typing import Final

FOLLOWED_PACKAGES: Final = ("emgface", "sim", "analysis")
"""Packages whose imports are followed; others count by their own source."""
WHOLE: Final = ("sim",)
"""Packages that count as a whole, and import none of the others."""
PASSIVE: Final = frozenset(
    {
        # Find the code of other packages, which enters the digest by itself.
        "emgface.plugins",
        # Names of failures, which are not stored.
        "emgface.errors",
        "analysis.errors",
        # Names that stand in the datasets themselves.
        "emgface.muscles",
        # Values, which enter the digest as parameters.
        "emgface.choices",
        "emgface.signals.parameters",
        "emgface.face.simulation_parameters",
        "emgface.face.accuracy",
        "emgface.face.contact_parameters",
        # Find and store inputs, whose digests are part of that of a result.
        *(f"emgface.run.{name}" for name in ("dependencies", "journal", "mechanics", "store")),
        *(
            f"emgface.study.{name}"
            for name in ("laboratory", "motions", "outcomes", "stage_code", "stages", "table")
        ),
        # Public names, of which no stage uses any.
        "emgface",
        "emgface._callable",
        "emgface.api",
    }
)
"""Modules on which no result depends, unless a stage names them."""


@cache
def reached(modules: tuple[str, ...], without: tuple[str, ...] = ()) -> tuple[str, ...]:
    """Names of modules and of all that they import, sorted, except those that begin with `without`."""
    waiting, visited = list(modules), set[str]()
    while waiting:
        name = waiting.pop()
        if name in visited or name.startswith(without):
            continue
        if any(one.startswith(f"{name}.") for one in without):
            waiting += _members(name)
            continue
        visited.add(name)
        if name.partition(".")[0] not in WHOLE:
            waiting += frozenset[str]().union(*map(_imports, _files(name))) - PASSIVE
    return tuple(sorted(visited))


@cache
def _place(name: str) -> Path:
    """Source of a module without its suffix, the folder of a package."""
    package, *inner = name.split(".")
    spec = importlib.util.find_spec(package)
    assert spec is not None and spec.origin is not None  # packages of `FOLLOWED_PACKAGES`
    return Path(spec.origin).parent.joinpath(*inner)


def _members(name: str) -> list[str]:
    """Modules and packages that a package contains."""
    inside = (path for path in _place(name).iterdir() if path.stem != "__init__")
    return [f"{name}.{path.stem}" for path in inside if _files(f"{name}.{path.stem}")]


@cache
def _files(name: str) -> tuple[Path, ...]:
    """Source of a module, for a package of all its modules; none of other packages."""
    if name.partition(".")[0] not in FOLLOWED_PACKAGES:
        return ()
    place = _place(name)
    if (place / "__init__.py").is_file():
        return tuple(sorted(place.rglob("*.py")))
    source = place.with_suffix(".py")
    return (source,) if source.is_file() else ()


@cache
def _imports(file: Path) -> frozenset[str]:
    """Modules of `FOLLOWED_PACKAGES` that the text of a module imports."""
    modules = set[str]()
    for node in ast.walk(ast.parse(file.read_bytes())):
        if isinstance(node, ast.Import):
            modules |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            inner = [f"{node.module}.{alias.name}" for alias in node.names]
            modules |= {name if _files(name) else node.module for name in inner}
    tops = {name: name.partition(".")[0] for name in modules}
    return frozenset(top if top in WHOLE else name for name, top in tops.items() if _files(name))
