"""Linear solvers behind one contract: analyse a pattern once, factorise often, solve more often."""

import platform
from collections.abc import Callable

from sim.errors import SceneError
from sim.linear.contract import LinearSolver, NotPositiveDefinite
from sim.linear.pardiso import Pardiso, pardiso_is_available
from sim.linear.superlu import SuperLU

LINEAR_SOLVERS: dict[str, Callable[[], LinearSolver]] = {"pardiso": Pardiso, "superlu": SuperLU}
"""Every linear solver; the tests walk this table."""


def linear_solver(name: str = "auto") -> LinearSolver:
    """Return a fresh solver by name; "auto" is PARDISO where it can be loaded, else SuperLU.

    Raises
    ------
    SceneError
        The name is unknown, or PARDISO was asked for and is not installed.
    """
    if name == "auto":
        name = "pardiso" if pardiso_is_available() else "superlu"
    if name not in LINEAR_SOLVERS:
        raise SceneError(
            f"unknown linear solver {name!r}, expected 'auto' or one of {[*LINEAR_SOLVERS]}"
        )
    if name == "pardiso" and not pardiso_is_available():
        raise SceneError(
            f"pardiso is not available on this {platform.machine()} machine: install pypardiso or "
            "use 'superlu'"
        )
    return LINEAR_SOLVERS[name]()


__all__ = [
    "LINEAR_SOLVERS",
    "LinearSolver",
    "NotPositiveDefinite",
    "Pardiso",
    "SuperLU",
    "linear_solver",
    "pardiso_is_available",
]
