"""The contract of an integrator, and the memory that it may keep between steps."""

import math
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from typing import ClassVar, Protocol, runtime_checkable

import numpy as np

from sim._kernels import scatter
from sim.errors import InvertedElement, SceneError
from sim.integrators.secant import SecantMemory
from sim.linear import LinearSolver, NotPositiveDefinite, linear_solver
from sim.linear.saddle import Saddle
from sim.state import Array, ControlAt, State, StepReport
from sim.system import System


class Workspace:
    """Solver memory of one simulation: the analysed linear solver, its latest factor, run times.

    Nothing here changes a result beyond the tolerance of the iteration that uses it.

    Parameters
    ----------
    system : System
    linear : str
        Name of the linear solver, or "auto".
    """

    def __init__(self, system: System, linear: str = "auto") -> None:
        self.linear: LinearSolver = linear_solver(linear)
        self.linear.analyse(system.pattern)
        self._pattern = system.pattern
        self._system = system
        self._indefinite: LinearSolver | None = None
        self._saddle: Saddle | None = None
        self.factor_of: tuple[type, float] | None = None
        """Integrator and step that the latest factor was made for, set by one that reuses factors."""
        self.secants = SecantMemory()
        self.level = 0
        """Halvings of the latest step of an error control, where the next interval starts."""
        self.multipliers: Array | None = None
        """Multipliers of the latest constrained step, where the next one starts."""
        self.contact_stiffness: tuple[tuple[type, float], Array] | None = None
        """Integrator and step, and the diagonal of their stiffness that penalties of contact follow."""
        self.seconds: dict[str, float] = {}
        self.calls: dict[str, int] = {}

    @contextmanager
    def timed(self, phase: str) -> Generator[None]:
        """Add the wall time of a block to a phase."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[phase] = self.seconds.get(phase, 0.0) + time.perf_counter() - start
            self.calls[phase] = self.calls.get(phase, 0) + 1

    def factorise(self, values: Array, shift: Array, max_shifts: int = 12) -> int:
        """Factorise; while the matrix is not positive definite, add growing multiples of a diagonal.

        Added to the matrix of a time step, multiples of the mass act as a shorter step would. Returns
        the number of shifts.

        Raises
        ------
        NotPositiveDefinite
            Not even the largest shift helped.
        """
        shifted, tau = values, 1.0
        self.factor_of = None
        self.secants.clear()
        for shifts in range(max_shifts + 1):
            try:
                with self.timed("factorisation"):
                    self.linear.factorise(shifted)
                return shifts
            except NotPositiveDefinite:
                if shifts == max_shifts:
                    raise
                shifted = values.copy()
                shifted[self._pattern.diagonal] += tau * shift
                tau *= 4.0
        raise AssertionError("unreachable: the loop returns or raises")

    def solve_any(self, values: Array, rhs: Array) -> tuple[Array, bool]:
        """Solve with a matrix that need not be positive definite; tells whether it is.

        Raises
        ------
        SingularSystem
            The matrix is singular or holds NaN.
        """
        self.factor_of = None
        self.secants.clear()
        try:
            with self.timed("factorisation"):
                self.linear.factorise(values)
            return self.solve(rhs), True
        except NotPositiveDefinite:
            if self._indefinite is None:
                self._indefinite = linear_solver(indefinite=True)
                self._indefinite.analyse(self._pattern)
            with self.timed("factorisation"):
                self._indefinite.factorise(values)
            with self.timed("solution"):
                return self._indefinite.solve(rhs), False

    def solver_of(self, values: Array) -> tuple[Callable[[Array], Array], bool]:
        """Solver for several right-hand sides of a matrix that need not be positive definite.

        Tells whether it is. Raises as `solve_any`.
        """
        self.factor_of = None
        self.secants.clear()
        solver = self.linear
        try:
            with self.timed("factorisation"):
                solver.factorise(values)
        except NotPositiveDefinite:
            if self._indefinite is None:
                self._indefinite = linear_solver(indefinite=True)
                self._indefinite.analyse(self._pattern)
            solver = self._indefinite
            with self.timed("factorisation"):
                solver.factorise(values)

        def solve(rhs: Array) -> Array:
            with self.timed("solution"):
                return solver.solve(rhs)

        return solve, solver is self.linear

    def factorise_constrained(self, A: Array, G: Array) -> None:
        """Factorise the matrix of `solve_constrained`, for several solutions with `saddle`."""
        with self.timed("factorisation"):
            self.saddle.factorise(A, G)

    def solve_constrained(self, A: Array, G: Array, r: Array, gamma: Array) -> tuple[Array, Array]:
        """Solve A x + G' y = r, G x = gamma for x and the multipliers y.

        Raises
        ------
        SingularSystem
            The matrix is singular or holds NaN.
        """
        with self.timed("factorisation"):
            self.saddle.factorise(A, G)
        with self.timed("solution"):
            return self.saddle.solve(r, gamma)

    @property
    def saddle(self) -> Saddle:
        """Solver of the system with the conditions of the scene, analysed at the first use."""
        if self._saddle is None:
            if self._system.constraints is None:
                raise SceneError("the scene has no constraints, expected some to solve with")
            self._saddle = Saddle(self._pattern, self._system.constraints)
        return self._saddle

    def has_factor_for(self, integrator: type, h: float) -> bool:
        """Whether the latest factor belongs to this integrator and step, but for rounding of h."""
        made = self.factor_of
        return made is not None and made[0] is integrator and math.isclose(made[1], h, rel_tol=1e-9)

    def solve(self, rhs: Array) -> Array:
        """Solve with the latest factor."""
        with self.timed("solution"):
            return self.linear.solve(rhs)


class Integrator(Protocol):
    """Advances a state by one step."""

    def step(
        self, system: System, state: State, control: ControlAt, h: float, work: Workspace
    ) -> tuple[State, StepReport]:
        """State at t + h under a control, asked at the instants of the stages, and how it went.

        Raises
        ------
        InvertedElement, NotConverged, SingularSystem
            The step failed; the given state is untouched.
        """
        ...


@runtime_checkable
class TimeIntegrator(Integrator, Protocol):
    """An integrator that approaches the motion with a declared order as h falls.

    Attributes
    ----------
    order : int
        The error of the positions at a given time falls with h to this power.
    stability : str
        "L-stable" (fast modes die), "A-stable" (fast modes may ring) or "conditional" (h bounded).
    """

    order: ClassVar[int]
    stability: ClassVar[str]


def symmetric_product(system: System, values: Array, x: Array) -> Array:
    """A x (n_free,) for the symmetric matrix with these values on the system's pattern."""
    out = np.empty_like(x)
    scatter.symmetric_product(system.pattern.indptr, system.pattern.indices, values, x, out)
    return out


def require_upright(element: int, smallest_J: float, t: float) -> None:
    """Raise InvertedElement unless the smallest det F is positive (NaN is not)."""
    if not smallest_J > 0.0:
        raise InvertedElement(element, smallest_J, t)
