"""Linear solvers with a common interface: analysis, factorisation, solution."""

import platform
from collections.abc import Callable

import numpy as np

from sim.errors import SceneError
from sim.linear.contract import Factor, LinearSolver, NotPositiveDefinite, symmetric_product
from sim.linear.pardiso import Pardiso, PardisoLDLt, SinglePardiso, pardiso_is_available
from sim.linear.reused import NotReached, ReusedFactor
from sim.linear.superlu import PivotingSuperLU, SuperLU

FACTORS: dict[str, Callable[[], Factor]] = {
    "pardiso": Pardiso,
    "pardiso_ldlt": PardisoLDLt,
    "pardiso_single": SinglePardiso,
    "superlu": SuperLU,
    "superlu_pivoting": PivotingSuperLU,
}
"""All direct solvers."""


def _gmres_pardiso() -> ReusedFactor:
    return ReusedFactor(SinglePardiso(), lambda: PardisoLDLt(np.float32), PardisoLDLt)


def _gmres_superlu() -> ReusedFactor:
    return ReusedFactor(SuperLU(), PivotingSuperLU, PivotingSuperLU)


ITERATIVE_SOLVERS: dict[str, Callable[[], ReusedFactor]] = {
    "gmres_pardiso": _gmres_pardiso,
    "gmres_superlu": _gmres_superlu,
}
"""All iterative solvers: the iteration, and the direct solver of its preconditioner."""

LINEAR_SOLVERS: dict[str, Callable[[], Factor | ReusedFactor]] = {**FACTORS, **ITERATIVE_SOLVERS}
"""All linear solvers, which the tests include."""

INDEFINITE = {"pardiso": "pardiso_ldlt", "superlu": "superlu_pivoting"}
"""Solver of each family for matrices that are not positive definite."""

SINGLE_PRECISION = ("pardiso_single",)
"""Solvers whose factors are in single precision."""

LARGE_SYSTEM = (
    2000  #: number of unknowns above which the factor of a time step is reused in the next
)
MEDIUM = 1000  #: number of unknowns above which a factor of a time step is in single precision


def linear_solver(name: str = "auto", *, indefinite: bool = False) -> Factor | ReusedFactor:
    """Return a new solver by name; "auto" is PARDISO if it can be loaded, otherwise SuperLU.

    With `indefinite`, "auto" is a solver for matrices that are not positive definite. An unknown
    name, or PARDISO if it is not installed, raises `SceneError`.
    """
    if name == "auto":
        name = INDEFINITE[_family()] if indefinite else _family()
    if name not in LINEAR_SOLVERS:
        raise SceneError(
            f"unknown linear solver {name!r}, expected 'auto' or one of {[*LINEAR_SOLVERS]}"
        )
    if "pardiso" in name and not pardiso_is_available():
        raise SceneError(
            f"pardiso is not available on this {platform.machine()} machine: install pypardiso or "
            "use 'superlu'"
        )
    return LINEAR_SOLVERS[name]()


def solver_of_steps(name: str, n: int) -> Factor | ReusedFactor:
    """Solver for the matrices of successive time steps with n unknowns.

    "auto" reuses factors for large matrices, and is direct if a factor costs no more than a few
    products; PARDISO's factors of more than `MEDIUM` unknowns are in single precision, with
    refinement where a solution must be exact. Other names and errors are those of `linear_solver`.
    """
    if name == "auto" and n >= LARGE_SYSTEM:
        name = f"gmres_{_family()}"
    elif name == "auto" and n >= MEDIUM and pardiso_is_available():
        name = "pardiso_single"
    return linear_solver(name)


def _family() -> str:
    return "pardiso" if pardiso_is_available() else "superlu"


__all__ = [
    "FACTORS",
    "ITERATIVE_SOLVERS",
    "LINEAR_SOLVERS",
    "Factor",
    "LinearSolver",
    "NotPositiveDefinite",
    "NotReached",
    "Pardiso",
    "PardisoLDLt",
    "PivotingSuperLU",
    "ReusedFactor",
    "SINGLE_PRECISION",
    "SinglePardiso",
    "SuperLU",
    "linear_solver",
    "pardiso_is_available",
    "solver_of_steps",
    "symmetric_product",
]
