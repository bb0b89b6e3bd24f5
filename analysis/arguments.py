"""Checks of the arguments of tests and alignments: numbers, counts, switches and seeds."""

import math
from typing import cast

import numpy as np

from analysis.errors import StatisticsError

Refused = type[Exception]


def number(name: str, value: object, *, error: Refused = StatisticsError) -> float:
    """Return a real number; raise the given error for True, a text, a list, and NaN."""
    if isinstance(value, bool) or not isinstance(value, (int, float, np.integer, np.floating)):
        raise error(f"{name} is {ascii(value)[:60]}, expected a number")
    real = float(cast("float", value))
    if math.isnan(real):
        raise error(f"{name} is NaN, expected a number")
    return real


def count(name: str, value: object, *, least: int, error: Refused = StatisticsError) -> int:
    """Return a whole number of at least `least`; raise the given error for another value."""
    real = number(name, value, error=error)
    if not (np.isfinite(real) and real == round(real) and real >= least):
        raise error(f"{name} is {value!r}, expected a whole number of at least {least}")
    return int(real)


def magnitude(
    name: str, value: object, *, zero: bool = False, error: Refused = StatisticsError
) -> float:
    """Return a finite number above 0, or from 0; raise the given error for another value."""
    real = number(name, value, error=error)
    if not (np.isfinite(real) and (real > 0.0 or (zero and real == 0.0))):
        raise error(f"{name} is {value!r}, expected a finite number {'>= 0' if zero else '> 0'}")
    return real


def yes_or_no(name: str, value: object, *, error: Refused = StatisticsError) -> bool:
    """Return True or False; raise the given error for a text or number, which Python takes for True."""
    if not isinstance(value, (bool, np.bool_)):
        raise error(f"{name} is {ascii(value)[:60]}, expected True or False")
    return bool(cast("object", value))


def generator(seed: object) -> np.random.Generator:
    """Return the generator of random numbers of a seed; StatisticsError unless it is whole and >= 0."""
    return np.random.default_rng(count("the seed", seed, least=0))
