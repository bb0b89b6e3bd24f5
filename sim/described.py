"""Short descriptions of objects, as text for a prompt and as HTML for a notebook."""

from collections.abc import Iterable, Mapping
from html import escape


class Described:
    """Base class of objects with short descriptions."""

    def facts(self) -> Mapping[str, str]:
        """Return name and text of every property."""
        return {}

    def __repr__(self) -> str:
        """Class and properties, one per line."""
        facts = self.facts()
        width = max(map(len, facts), default=0)
        lines = (f"  {name.ljust(width)}  {text}" for name, text in facts.items())
        return "\n".join(
            [f"<{type(self).__module__.partition('.')[0]}.{type(self).__name__}>", *lines]
        )

    def _repr_html_(self) -> str:
        """Table of the properties, for Jupyter."""
        row = "<tr><th style='text-align:left'>{}</th><td style='text-align:left'>{}</td></tr>"
        rows = "".join(row.format(escape(name), escape(v)) for name, v in self.facts().items())
        return f"<table><caption>{escape(type(self).__name__)}</caption>{rows}</table>"


def listed(things: Iterable[object]) -> str:
    """Names of the classes of some objects, with their numbers if more than one."""
    names = [type(thing).__name__ for thing in things]
    return ", ".join(
        name if names.count(name) == 1 else f"{names.count(name)} {name}"
        for name in dict.fromkeys(names)
    )
