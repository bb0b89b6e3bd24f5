"""Checks of the arguments of the parts of a scene."""

import math

from sim.errors import SceneError


def require(
    part: object,
    name: str,
    value: float,
    *,
    least: float = -math.inf,
    above: float = -math.inf,
    below: float = math.inf,
) -> None:
    """Raise SceneError unless a number is finite, at least `least`, above `above` and below `below`."""
    if math.isfinite(value) and value >= least and above < value < below:
        return
    bounds = ((">=", least), (">", above), ("<", below))
    wanted = " and ".join(f"{sign} {bound:g}" for sign, bound in bounds if math.isfinite(bound))
    raise SceneError(
        f"{type(part).__name__}: {name} = {value!r}, expected a finite number {wanted}".rstrip()
    )
