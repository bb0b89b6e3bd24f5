"""Linear solvers behind one contract: analyse a pattern once, factorise often, solve more often."""

import platform
from collections.abc import Callable

from sim.errors import SceneError
from sim.linear.contract import LinearSolver, NotPositiveDefinite
from sim.linear.pardiso import Pardiso, PardisoLDLt, pardiso_is_available
from sim.linear.superlu import PivotingSuperLU, SuperLU

LINEAR_SOLVERS: dict[str, Callable[[], LinearSolver]] = {
    "pardiso": Pardiso,
    "pardiso_ldlt": PardisoLDLt,
    "superlu": SuperLU,
    "superlu_pivoting": PivotingSuperLU,
}
"""Every linear solver; the tests walk this table."""

INDEFINITE = {"pardiso": "pardiso_ldlt", "superlu": "superlu_pivoting"}
"""The member of each family that serves matrices that are not positive definite."""


def linear_solver(name: str = "auto", *, indefinite: bool = False) -> LinearSolver:
    """Return a fresh solver by name; "auto" is PARDISO where it can be loaded, else SuperLU.

    Parameters
    ----------
    name : str
        A key of `LINEAR_SOLVERS`, or "auto".
    indefinite : bool
        Whether "auto" must serve matrices that are not positive definite.

    Raises
    ------
    SceneError
        The name is unknown, or PARDISO was asked for and is not installed.
    """
    if name == "auto":
        family = "pardiso" if pardiso_is_available() else "superlu"
        name = INDEFINITE[family] if indefinite else family
    if name not in LINEAR_SOLVERS:
        raise SceneError(
            f"unknown linear solver {name!r}, expected 'auto' or one of {[*LINEAR_SOLVERS]}"
        )
    if name.startswith("pardiso") and not pardiso_is_available():
        raise SceneError(
            f"pardiso is not available on this {platform.machine()} machine: install pypardiso or "
            "use 'superlu'"
        )
    return LINEAR_SOLVERS[name]()


__all__ = [
    "LINEAR_SOLVERS",
    "LinearSolver",
    "NotPositiveDefinite",
    "PivotingSuperLU",
    "Pardiso",
    "PardisoLDLt",
    "SuperLU",
    "linear_solver",
    "pardiso_is_available",
]
