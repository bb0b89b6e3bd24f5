"""Population to which a test applies, and the least sample for estimates about it."""

from typing import Final, Literal

Scope = Literal["instructions", "these instructions"]
"""Scope: instructions in general, sampled by those of the study, or these instructions only."""

LEAST_VOLUNTEERS: Final = 5
"""Least number of volunteers for intervals.

The least number at which every kind of interval covers its nominal 0.95 within two Monte Carlo
errors: ``docs/statistics/intervals.md``.
"""

LEAST_INSTRUCTIONS: Final = 4
"""Least number of instructions for intervals about instructions in general.

Two and three leave one and two degrees of freedom; the same table has coverages down to 0.92.
"""


def too_few_volunteers(n: int) -> str:
    """Reason for which n volunteers give no interval; empty if they do."""
    if n >= LEAST_VOLUNTEERS:
        return ""
    return f"no interval, which requires {LEAST_VOLUNTEERS} or more volunteers"


def told_scope(scope: Scope, instructions: int) -> str:
    """Describe the scope of a result.

    Parameters
    ----------
    scope : {"instructions", "these instructions"}
        Population represented by the instructions of the study.
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
