"""MKL PARDISO through pypardiso: Cholesky or LDLt factors of the upper triangle."""

import importlib
import importlib.metadata
import os
import weakref
from collections.abc import Generator
from contextlib import contextmanager
from functools import cache
from typing import Any

import numpy as np
from scipy.sparse import csr_array

from sim.errors import SingularSystem
from sim.linear.contract import NotPositiveDefinite
from sim.pattern import Sparsity
from sim.state import Array

SYMMETRIC_POSITIVE_DEFINITE, SYMMETRIC_INDEFINITE = 2, -2
MKL_PATH = "PYPARDISO_MKL_RT"  # where pypardiso looks first
ANALYSE, FACTORISE, SOLVE, RELEASE = 11, 22, 33, -1


def pardiso_is_available() -> bool:
    """Whether pypardiso and its MKL can be loaded on this machine."""
    try:
        _wrapper()
    except (ImportError, OSError):
        return False
    return True


@cache
def _wrapper() -> tuple[Any, str]:
    """Module of pypardiso, and the path of the MKL that it found."""
    with _pointed_to(_installed_mkl()):
        wrapper = importlib.import_module("pypardiso.pardiso_wrapper")
        return wrapper, str(wrapper.PyPardisoSolver().libmkl._name)


def _installed_mkl() -> str | None:
    """MKL as its package lists it; None where it came otherwise and must be searched for."""
    try:
        files = importlib.metadata.distribution("mkl").files or []
    except importlib.metadata.PackageNotFoundError:
        return None
    return next((str(f.locate()) for f in files if "mkl_rt" in f.name), None)


def _new_solver(matrix_type: int) -> Any:
    wrapper, path = _wrapper()
    with _pointed_to(path):
        return wrapper.PyPardisoSolver(mtype=matrix_type)


@contextmanager
def _pointed_to(mkl: str | None) -> Generator[None]:
    """Spare pypardiso the search for MKL through all installed files that it starts every time."""
    before = os.environ.get(MKL_PATH)
    if mkl is not None and before is None:
        os.environ[MKL_PATH] = mkl
    try:
        yield
    finally:
        if before is None:
            os.environ.pop(MKL_PATH, None)


class Pardiso:
    """PARDISO for symmetric positive definite matrices; one symbolic analysis per pattern."""

    name = "pardiso"
    _matrix_type = SYMMETRIC_POSITIVE_DEFINITE

    def __init__(self) -> None:
        self._solver: Any = _new_solver(self._matrix_type)
        self._factorised = False

    def _call(self, phase: int, rhs: Array) -> Array:
        self._solver.set_phase(phase)
        try:
            # solve() and factorize() of the wrapper copy and compare the whole matrix at every call
            return self._solver._call_pardiso(self._matrix, rhs)
        except _wrapper()[0].PyPardisoError as error:
            code = int(getattr(error, "value", 0))
            if code == -4:
                raise NotPositiveDefinite(
                    "PARDISO met a non-positive pivot, expected a positive definite matrix"
                ) from error
            raise SingularSystem(f"PARDISO failed in phase {phase}: {error}") from error

    def analyse(self, pattern: Sparsity) -> None:
        """Order the unknowns and find the structure of the factor."""
        self._matrix = csr_array(
            (np.zeros(pattern.nnz), pattern.indices, pattern.indptr), shape=(pattern.n, pattern.n)
        )
        self._matrix.data[pattern.diagonal] = 1.0
        self._none = np.zeros(pattern.n)
        self._call(ANALYSE, self._none)
        # MKL keeps the factor outside Python's sight until it is told to release it
        weakref.finalize(self, _release, self._solver, self._matrix, self._none)

    def factorise(self, values: Array) -> None:
        """Cholesky factorisation.

        Raises
        ------
        NotPositiveDefinite
            A pivot is not positive.
        SingularSystem
            The matrix holds NaN, or PARDISO failed otherwise.
        """
        self._factorised = False
        if not np.isfinite(values).all():
            raise SingularSystem("the matrix holds NaN or infinity, expected finite values")
        self._matrix.data[:] = values
        self._call(FACTORISE, self._none)
        self._factorised = True

    @property
    def factor_bytes(self) -> int:
        """Size of the non-zeros of the factor [B], as PARDISO counts them."""
        return 8 * int(self._solver.iparm[17])

    def solve(self, rhs: Array) -> Array:
        """Solve with the latest factor.

        Raises
        ------
        SingularSystem
            There is no factor, or the solution is not finite.
        """
        if not self._factorised:
            raise SingularSystem("no factor at hand: the last factorisation failed")
        x = self._call(SOLVE, np.ascontiguousarray(rhs))
        if not np.isfinite(x).all():
            raise SingularSystem("the solution holds NaN or infinity: the matrix is singular")
        return x


class PardisoLDLt(Pardiso):
    """PARDISO for symmetric indefinite matrices, Bunch-Kaufman pivoting within supernodes."""

    name = "pardiso_ldlt"
    _matrix_type = SYMMETRIC_INDEFINITE

    @property
    def negative_pivots(self) -> int:
        """Number of negative eigenvalues of the latest factorised matrix."""
        return int(self._solver.iparm[22])


def _release(solver: Any, matrix: csr_array, none: Array) -> None:
    solver.set_phase(RELEASE)
    solver._call_pardiso(matrix, none)
