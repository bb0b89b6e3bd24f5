"""Checks of the arguments of the parts of a scene."""

import math

import numpy as np
from numpy.typing import ArrayLike

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


def require_index(part: str, of: str, index: ArrayLike, n: int) -> None:
    """Raise SceneError unless all indices of nodes, elements or others are in 0..n - 1."""
    found = np.asarray(index)
    if found.size and not (found.min() >= 0 and found.max() < n):
        bad = found.max() if found.max() >= n else found.min()
        raise SceneError(f"{part} refers to {of} {bad}, expected 0..{n - 1}")
