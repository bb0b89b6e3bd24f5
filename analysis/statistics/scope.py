"""The population a test speaks of, and the sample below which nothing is estimated about it."""

from typing import Final, Literal

Scope = Literal["instructions", "these instructions"]
"""Instructions in general, of which those of the study are a sample, or these ones alone."""

LEAST_VOLUNTEERS: Final = 5
"""Volunteers from which intervals are given.

The least number at which every kind of interval covers its nominal 0.95 within two Monte Carlo
errors: ``docs/statistics/intervals.md``.
"""

LEAST_INSTRUCTIONS: Final = 4
"""Instructions from which intervals are given of instructions in general.

Two and three leave one and two degrees of freedom; the same table has coverages down to 0.92.
"""


def too_few_volunteers(n: int) -> str:
    """Say why n volunteers give no interval; empty where they do."""
    if n >= LEAST_VOLUNTEERS:
        return ""
    return f"no interval: it needs {LEAST_VOLUNTEERS} or more volunteers"


def told_scope(scope: Scope, instructions: int) -> str:
    """Say in words what a result speaks of.

    Parameters
    ----------
    scope : {"instructions", "these instructions"}
        What the instructions of the study stand for.
    instructions : int
        Their number.

    Returns
    -------
    str
        For example "volunteers in general, these 6 instructions".
    """
    if scope == "instructions":
        return "volunteers and instructions in general"
    these = "this 1 instruction" if instructions == 1 else f"these {instructions} instructions"
    return f"volunteers in general, {these}"
