"""MKL PARDISO: Cholesky or LDLt factors of the upper triangle, also in single precision.

MKL is found through pypardiso.
"""

import ctypes
import importlib
import importlib.metadata
import os
import weakref
from collections.abc import Generator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import ThreadpoolController  # pyright: ignore[reportMissingTypeStubs]

from sim.errors import SceneError, SingularSystem
from sim.linear.contract import (
    NotPositiveDefinite,
    require_finite_matrix,
    require_finite_solution,
    symmetric_product,
)
from sim.pattern import Sparsity
from sim.state import Array

ACTIVE_MS = 200  #: time for which threads without work wait actively [ms]
NOTE = (
    "the linear solver used {} threads: the last digits of results differ between processes, and "
    "from those of one thread"
)

_count: ContextVar[int] = ContextVar("solver_threads", default=1)


def thread_count() -> int:
    """Threads of a factorisation or a solution that begins now in this thread of Python."""
    return _count.get()


@contextmanager
def solver_threads(count: int, solver: str) -> Generator[None]:
    """Factorise and solve with `count` threads in the calling thread, by PARDISO.

    With more than one, the threads wait actively, since a factorisation has hundreds of waits of some
    microseconds, and the order of sums is that in which the threads finish: results differ in the
    last digits between processes.

    Raises SceneError if `count` is not positive, or is larger than one for another `solver`.
    """
    if count < 1:
        raise SceneError(f"the number of solver threads is {count}, expected at least 1")
    if count > 1 and "pardiso" not in solver:
        raise SceneError(
            f"the linear solver {solver!r} has one thread, expected solver_threads = 1 instead of "
            f"{count}, or PARDISO"
        )
    token = _count.set(count)
    before = _blocktime(ACTIVE_MS) if count > 1 else None
    try:
        yield
    finally:
        _count.reset(token)
        if before is not None:
            _blocktime(before)


def _blocktime(milliseconds: int) -> int | None:
    """Set the time of active waiting of Intel's OpenMP; that before, or None if it is not loaded."""
    loaded: Any = ThreadpoolController()
    for dynamic in [library.dynlib for library in loaded.lib_controllers]:
        if hasattr(dynamic, "kmp_set_blocktime"):
            before = int(dynamic.kmp_get_blocktime())
            dynamic.kmp_set_blocktime(milliseconds)
            return before
    return None


SYMMETRIC_POSITIVE_DEFINITE, SYMMETRIC_INDEFINITE = 2, -2
MKL_PATH = "PYPARDISO_MKL_RT"  # where pypardiso looks first
ANALYSE, FACTORISE, SOLVE, RELEASE = 11, 22, 33, -1
# Branches of MKL's conditional numerical reproducibility.
AUTO, AVX2, STRICT = 2, 10, 0x10000
NOT_DEFINITE = -4

# Zero-based indices into iparm.
GIVEN, NESTED_DISSECTION, PIVOT_SHIFT, FACTOR_SIZE = 0, 1, 9, 17
BUNCH_KAUFMAN, NEGATIVE_PIVOTS, IPARM_SINGLE, FROM_ZERO = 20, 22, 27, 34


def pardiso_is_available() -> bool:
    """Test if pypardiso and its MKL can be loaded on this machine."""
    try:
        _wrapper()
    except (ImportError, OSError):
        return False
    return True


@cache
def _wrapper() -> tuple[Any, str]:
    """Module of pypardiso, and the path of its MKL."""
    with _pointed_to(_installed_mkl()):
        wrapper = importlib.import_module("pypardiso.pardiso_wrapper")
        mkl = wrapper.PyPardisoSolver().libmkl
        _fix_code_path(mkl)
        return wrapper, str(mkl._name)


def _fix_code_path(mkl: ctypes.CDLL) -> None:
    """Configure MKL for equal results in every process of a machine, on the same number of threads.

    Without a setting, the alignment of arrays in memory may select other kernels, and the last digits
    of solutions differ between processes. AVX2 with STRICT is the same branch on all processors of
    Intel; MKL refuses it on others, where AUTO is the branch of this processor. (The branch common to
    all processors has no vectors of four numbers, and takes twice as long.) MKL refuses any setting
    after it has computed in this process, or if MKL_CBWR is set.
    """
    if mkl.MKL_CBWR_Set(ctypes.c_int(AVX2 | STRICT)) != 0:
        mkl.MKL_CBWR_Set(ctypes.c_int(AUTO))


@contextmanager
def _on_threads(mkl: ctypes.CDLL, count: int) -> Generator[None]:
    """Set the number of threads of MKL in this thread: rounding depends on it."""
    before = mkl.MKL_Set_Num_Threads_Local(ctypes.c_int(count))
    try:
        yield
    finally:
        mkl.MKL_Set_Num_Threads_Local(ctypes.c_int(before))


def _installed_mkl() -> str | None:
    """Path of MKL in its package; None if it was installed otherwise and must be searched for."""
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
    """Skip the search of pypardiso for MKL in all installed files."""
    before = os.environ.get(MKL_PATH)
    if mkl is not None and before is None:
        os.environ[MKL_PATH] = mkl
    try:
        yield
    finally:
        if before is None:
            os.environ.pop(MKL_PATH, None)


class _Handle:
    """Instance of PARDISO with its arrays.

    The module pypardiso finds MKL and declares the routine; its own calls copy all indices each
    time, which takes longer than a solution in single precision.
    """

    def __init__(self, matrix_type: int, pattern: Sparsity, precision: type) -> None:
        solver = _new_solver(matrix_type)
        self._routine, self._pt, self.iparm = solver._mkl_pardiso, solver.pt, solver.iparm
        self._mkl = solver.libmkl
        self._pt_type, self._matrix_type, self._n = solver._pt_type[0], matrix_type, pattern.n
        self.iparm[GIVEN] = 1  # All entries of iparm are specified; zero entries are the defaults.
        self.iparm[NESTED_DISSECTION] = 2
        self.iparm[PIVOT_SHIFT] = 8
        self.iparm[FACTOR_SIZE] = -1
        self.iparm[BUNCH_KAUFMAN] = 1
        self.iparm[IPARM_SINGLE] = int(precision is np.float32)
        self.iparm[FROM_ZERO] = 1
        self._indptr = np.ascontiguousarray(pattern.indptr, dtype=np.int32)
        self._indices = np.ascontiguousarray(pattern.indices, dtype=np.int32)
        self._order = np.zeros(0, dtype=np.int32)
        self.values: NDArray[Any] = np.zeros(pattern.nnz, dtype=precision)
        self.values[pattern.diagonal] = 1.0
        self.rhs: NDArray[Any] = np.zeros(pattern.n, dtype=precision)
        self.x: NDArray[Any] = np.zeros(pattern.n, dtype=precision)

    def call(
        self, phase: int, rhs: NDArray[Any] | None = None, x: NDArray[Any] | None = None
    ) -> int:
        """Run a phase, with several right-hand sides (k, n) if given; returns PARDISO's error code."""
        b, into = (self.rhs, self.x) if rhs is None or x is None else (rhs, x)
        integer = ctypes.POINTER(ctypes.c_int32)
        error = ctypes.c_int32(0)

        def number(value: int) -> Any:
            return ctypes.byref(ctypes.c_int32(value))

        def data(array: NDArray[Any], kind: Any = ctypes.c_void_p) -> Any:
            return array.ctypes.data_as(kind)

        with _on_threads(self._mkl, thread_count()):
            self._routine(
                data(self._pt, ctypes.POINTER(self._pt_type)),
                number(1),  # factors kept
                number(1),  # which of them
                number(self._matrix_type),
                number(phase),
                number(self._n),
                data(self.values),
                data(self._indptr, integer),
                data(self._indices, integer),
                data(self._order, integer),
                number(b.size // self._n),  # right-hand sides
                data(self.iparm, integer),
                number(0),  # no messages
                data(b),
                data(into),
                ctypes.byref(error),
            )
        return error.value


class Pardiso:
    """PARDISO for symmetric positive definite matrices; one symbolic analysis per pattern.

    A factor in numpy.float32 has half the size, and its solutions six digits.
    """

    name = "pardiso"
    _matrix_type = SYMMETRIC_POSITIVE_DEFINITE

    def __init__(self, precision: type = np.float64) -> None:
        self._precision = precision
        self._factorised = False

    @property
    def solutions_per_factorisation(self) -> int:
        """As measured on one thread with the matrix of a face of 23 000 unknowns (AVX-512).

        The run time of steps of this face hardly depends on it between 6 and 13.
        """
        return 9 if self._precision is np.float32 else 12

    def analyse(self, pattern: Sparsity) -> None:
        """Order the unknowns and find the structure of the factor.

        Raises SingularSystem if PARDISO failed.
        """
        self._handle = _Handle(self._matrix_type, pattern, self._precision)
        self._call(ANALYSE)
        # MKL keeps the factor, which Python does not manage, until it is released.
        weakref.finalize(self, self._handle.call, RELEASE)

    def _call(self, phase: int) -> None:
        self._check(self._handle.call(phase), phase)

    @staticmethod
    def _check(code: int, phase: int) -> None:
        if code == NOT_DEFINITE:
            raise NotPositiveDefinite(
                "PARDISO met a non-positive pivot, expected a positive definite matrix"
            )
        if code != 0:
            raise SingularSystem(f"PARDISO failed in phase {phase} with its error {code}")

    def factorise(self, values: Array) -> None:
        """Cholesky factorisation.

        Raises NotPositiveDefinite if a pivot is not positive; SingularSystem if the matrix contains NaN,
        or PARDISO failed otherwise.
        """
        self._factorised = False
        require_finite_matrix(values)
        self._handle.values[:] = values
        self._call(FACTORISE)
        self._factorised = True

    @property
    def factor_bytes(self) -> int:
        """Size of the non-zeros of the factor [B], as counted by PARDISO."""
        return self._handle.values.itemsize * int(self._handle.iparm[FACTOR_SIZE])

    def solve(self, rhs: Array) -> Array:
        """Solve with the latest factor.

        Raises SingularSystem if there is no factor, or the solution is not finite.
        """
        self._require_factor()
        self._handle.rhs[:] = rhs
        self._call(SOLVE)
        x = self._handle.x.astype(np.float64)
        require_finite_solution(x)
        return x

    def approximate(self, rhs: Array) -> Array:
        """As `solve`."""
        return self.solve(rhs)

    def approximate_many(self, rhs: Array) -> Array:
        """As `solve`, for right-hand sides (k, n), much faster than separate solutions."""
        self._require_factor()
        handle = self._handle
        b = np.ascontiguousarray(rhs).astype(handle.values.dtype)
        x = np.zeros_like(b)
        self._check(handle.call(SOLVE, b, x), SOLVE)
        require_finite_solution(x)
        return x.astype(np.float64)

    def _require_factor(self) -> None:
        if not self._factorised:
            raise SingularSystem("there is no factor: the last factorisation failed")


class PardisoLDLt(Pardiso):
    """PARDISO for symmetric indefinite matrices, Bunch-Kaufman pivoting within supernodes."""

    name = "pardiso_ldlt"
    _matrix_type = SYMMETRIC_INDEFINITE

    @property
    def negative_pivots(self) -> int:
        """Number of negative eigenvalues of the latest factorised matrix."""
        return int(self._handle.iparm[NEGATIVE_PIVOTS])


RELATIVE_CORRECTION = 1e-14  # Relative correction at which the refinement ends.
ENOUGH = 1e-11  # Relative correction that is accepted if rounding ends the refinement earlier.
REFINEMENTS = 10
TRUSTED = 0.1  # Largest accepted error of a solution without refinement.


class SinglePardiso:
    """PARDISO's Cholesky factor in single precision: half the memory, half the time of a solution.

    `solve` refines iteratively, x <- x + L^-T L^-1 (b - A x) with the residual in double precision,
    to the accuracy of a factor in double precision; `approximate` does not refine. After a matrix
    that is too ill-conditioned for single precision, factors are computed in double precision.

    Source: Wilkinson's iterative refinement in mixed precision, Buttari et al. 2008, Using mixed
    precision for sparse matrix computations, ACM Trans. Math. Softw. 34(4), Algorithm 1; it converges
    while the condition number is well below 1e7.
    """

    name = "pardiso_single"

    def __init__(self) -> None:
        self._factor = self._single = Pardiso(np.float32)
        self._double: Pardiso | None = None
        self._is_single = True

    def analyse(self, pattern: Sparsity) -> None:
        """Order the unknowns and find the structure of the factor."""
        self._pattern = pattern
        self._factor.analyse(pattern)

    @property
    def solutions_per_factorisation(self) -> int:
        """That of the present precision."""
        return self._factor.solutions_per_factorisation

    @property
    def factor_bytes(self) -> int:
        """Size of the non-zeros of the factor [B], as PARDISO counts them."""
        return self._factor.factor_bytes

    def factorise(self, values: Array) -> None:
        """Cholesky factorisation.

        Raises NotPositiveDefinite if a pivot is not positive, in double precision either;
        SingularSystem if the matrix contains NaN, or PARDISO failed otherwise.
        """
        self._values = values
        try:
            self._factor.factorise(values)
        except NotPositiveDefinite:
            if not self._is_single:
                raise
            self._factorise_in_double()
            return
        if self._is_single and not self._serves():
            self._factorise_in_double()

    def _serves(self) -> bool:
        """Test if the factor recovers a constant vector from its product with the matrix."""
        one = np.ones(self._pattern.n)
        x = self._factor.approximate(symmetric_product(self._pattern, self._values, one))
        return float(np.abs(x - one).max()) <= TRUSTED

    def _factorise_in_double(self) -> None:
        if self._double is None:
            self._double = Pardiso()
            self._double.analyse(self._pattern)
        self._double.factorise(self._values)
        self._factor, self._is_single = self._double, False

    @property
    def in_double(self) -> bool:
        """True if single precision was insufficient, so that factors are in double precision."""
        return not self._is_single

    def start_over(self) -> None:
        """Reset the precision."""
        self._is_single, self._factor = True, self._single

    def approximate(self, rhs: Array) -> Array:
        """Solve without refinement, to about six digits over the condition number."""
        return self._factor.approximate(rhs)

    def approximate_many(self, rhs: Array) -> Array:
        """As `approximate`, for right-hand sides (k, n)."""
        return self._factor.approximate_many(rhs)

    def solve(self, rhs: Array) -> Array:
        """Solve to double precision.

        Raises SingularSystem if there is no factor, or the solution is not finite.
        """
        x = self._factor.approximate(rhs)
        if not self._is_single:
            return x
        last = np.inf
        for _ in range(REFINEMENTS):
            residual = rhs - symmetric_product(self._pattern, self._values, x)
            correction = self._factor.approximate(residual)
            x += correction
            size, moved = float(np.abs(x).max()), float(np.abs(correction).max())
            if moved <= RELATIVE_CORRECTION * size or (
                moved > 0.5 * last and moved <= ENOUGH * size
            ):
                return x
            if moved > 0.5 * last:
                break
            last = moved
        self._factorise_in_double()
        return self.solve(rhs)
