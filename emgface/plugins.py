"""Readers, laws and strategies of other installed packages, found by their entry points.

A package names its part under ``[project.entry-points."emgface.readers"]`` (also ``emgface.laws`` and
``emgface.strategies``). The names are read when one is first looked up, and a part is imported when it
is first used. docs/extend.md describes what each kind of part must be.
"""

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Any, Final

from emgface.errors import ConfigurationError

ENTRY_POINT_GROUPS: Final = {
    "reader": "emgface.readers",
    "law": "emgface.laws",
    "strategy": "emgface.strategies",
}
"""Group of entry points of every kind of part."""
_NAME: Final = re.compile(r"[a-z][a-z0-9_]*")
_TAKEN: Final = {"strategy": ("inverse", "assisted", "true")}  #: names with a meaning in a study


@dataclass(frozen=True)
class Plugin:
    """Part of other packages with one name; it is an error if there are several."""

    kind: str
    name: str
    entries: Sequence[EntryPoint]

    @property
    def packages(self) -> str:
        """Names of the packages that provide the part, with their versions."""
        distributions = [entry.dist for entry in self.entries]
        return " and ".join(
            f"{one.name} {one.version}" if one else "a package" for one in distributions
        )

    def load(self) -> Any:
        """Import the part.

        Raises ConfigurationError if several packages provide it, its name is no identifier in lower
        case, or it cannot be imported.
        """
        what = f"the {self.kind} {self.name!r} of {self.packages}"
        if len(self.entries) > 1:
            raise ConfigurationError(
                f"{what} exists more than once, expected one: uninstall all but one of these packages"
            )
        if not _NAME.fullmatch(self.name):
            raise ConfigurationError(
                f"{what} cannot be used, expected a name of lower-case letters, digits and "
                "underscores: rename the entry point"
            )
        try:
            return self.entries[0].load()
        except Exception as error:
            text = " ".join(f"{type(error).__name__}: {error}".split())
            raise ConfigurationError(
                f"{what} cannot be imported ({text}), expected {self.entries[0].value}: reinstall or "
                "uninstall the package"
            ) from error

    def version(self) -> str:
        """Digest of the source of the packages that provide the part, which import nothing of it."""
        from emgface.run.digest import code_version

        return code_version(tuple(sorted({e.module.partition(".")[0] for e in self.entries})))


@cache
def plugins(kind: str) -> Mapping[str, Plugin]:
    """Parts of a kind that other packages provide, by name; none of them is imported.

    An entry point that two folders of the search path contain, for example of an installed package
    and of its source, counts once.
    """
    entries: dict[str, dict[str, EntryPoint]] = {}
    for entry in sorted(
        entry_points(group=ENTRY_POINT_GROUPS[kind]), key=lambda one: (one.name, one.value)
    ):
        package = entry.dist.name if entry.dist else ""
        entries.setdefault(entry.name, {}).setdefault(f"{package}={entry.value}", entry)
    return {name: Plugin(kind, name, tuple(many.values())) for name, many in entries.items()}


def require_name(kind: str, name: str, own: Collection[str]) -> str:
    """Return the name of a part of this package or of another one, without importing it.

    `own` are the names of this package. Raises ConfigurationError if the name is unknown, with the
    nearest one, or if another package uses a name of this package.
    """
    from emgface.schema.rules import nearest

    others = plugins(kind)
    if name in others and name in (*own, *_TAKEN.get(kind, ())):
        raise ConfigurationError(
            f"the {kind} {name!r} of {others[name].packages} has the name of one of emgface, expected "
            "another name: rename the entry point or uninstall the package"
        )
    if name not in own and name not in others:
        known = [*own, *others]
        near = nearest(str(name), known, cutoff=0.4)
        meant = f" (did you mean '{near}'?)" if near else ""
        raise ConfigurationError(
            f"unknown {kind} '{name}'{meant}, expected one of {', '.join(known)}"
        )
    return name


def names_schema(own: Collection[str]) -> dict[str, Any]:
    """JSON Schema of a name: one of this package, or a text that names a part of another one."""
    return {"anyOf": [{"enum": list(own), "type": "string"}, {"type": "string"}]}


def versions(parameters: Any) -> dict[str, str]:
    """Digests of the source of the laws and strategies that parameters name, by kind and name.

    They belong to what determines a result, as the source of this package does.
    """
    known = {name: plugin for kind in ("law", "strategy") for name, plugin in plugins(kind).items()}
    if not known:
        return {}
    named = sorted(known.keys() & set(_texts(parameters)))
    return {f"{known[name].kind} {name}": known[name].version() for name in named}


def _texts(value: Any) -> Iterator[str]:
    if isinstance(value, str):
        yield value
    elif isinstance(value, Mapping):
        for one in value.values():
            yield from _texts(one)
    elif isinstance(value, list | tuple):
        for one in value:
            yield from _texts(one)
