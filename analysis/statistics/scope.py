"""Population of a test, and the least sample for inference about it."""

from typing import Final, Literal

Scope = Literal["instructions", "these instructions"]
"""Scope: instructions in general, sampled by those of the study, or these instructions only."""

LEAST_VOLUNTEERS: Final = 5
"""Least number of volunteers for intervals.

With this number, the coverage of all intervals is 0.95 within two Monte Carlo errors
(``docs/statistics/intervals.md``).
"""

LEAST_INSTRUCTIONS: Final = 4
"""Least number of instructions for intervals about instructions in general.

With two and three instructions there are one and two degrees of freedom, and coverages down to
0.92.
"""


def too_few_volunteers(n: int) -> str:
    """Reason for which n volunteers give no interval; empty if they do."""
    if n >= LEAST_VOLUNTEERS:
        return ""
    return f"no interval, which requires {LEAST_VOLUNTEERS} or more volunteers"


def told_scope(scope: Scope, instructions: int) -> str:
    """Describe the scope of a result, such as "volunteers in general, these 6 instructions"."""
    if scope == "instructions":
        return "volunteers and instructions in general"
    these = "this 1 instruction" if instructions == 1 else f"these {instructions} instructions"
    return f"volunteers in general, {these}"
