"""Parameters of laws: their units, and the check that they are finite numbers in their range."""

import math
from dataclasses import field, fields
from typing import Any

from sim.errors import SceneError


def require(law: object, name: str, value: float, *, at_least: float, strictly: bool) -> None:
    """Raise SceneError unless a parameter of a law is finite and above its lower bound.

    With `strictly`, the bound itself is refused.
    """
    fits = value > at_least if strictly else value >= at_least
    if not (math.isfinite(value) and fits):
        sign = ">" if strictly else ">="
        raise SceneError(
            f"{type(law).__name__}: {name} = {value!r}, expected a finite number {sign} {at_least:g}"
        )


def quantity(default: Any, unit: str) -> Any:
    """Field of a law with its SI unit, "1" for a number."""
    return field(default=default, metadata={"unit": unit})


def units(law: Any) -> dict[str, str]:
    """Unit of every parameter of a law, a class or an object."""
    return {f.name: f.metadata["unit"] for f in fields(law)}
