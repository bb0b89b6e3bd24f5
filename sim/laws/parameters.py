"""Check of the parameters of laws: finite numbers in their range."""

import math

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
