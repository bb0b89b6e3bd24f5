"""Solver memory of a simulation, kept between steps."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from sim.contact.compliance import Compliance
from sim.errors import SceneError
from sim.integrators.bodies_alone import BodiesAlone
from sim.integrators.clock import PhaseClock
from sim.integrators.inverse_secants import InverseSecants
from sim.integrators.secant import SecantMemory
from sim.linear import (
    Factor,
    LinearSolver,
    NotPositiveDefinite,
    ReusedFactor,
    linear_solver,
    solver_of_steps,
)
from sim.linear.conjugate_gradients import conjugate_gradients
from sim.linear.saddle import Saddle
from sim.matrix import Matrix
from sim.pattern import Index, Sparsity
from sim.state import Array, State
from sim.system import System

MOST = 1000
"""Largest number of active vertices for the Schur complement, whose compliance takes 0.2 GB."""

DIRECTION_SHARE, DIRECTION_SOLUTIONS = 0.1, 12
"""Tolerance of a direction, and largest number of solutions."""


@dataclass(frozen=True)
class Solution:
    """Solution of a linear system.

    Attributes
    ----------
    x : (n_free,)
    iterations, factorisations : int
        Numbers of solutions with a factor and of factorisations.
    definite : bool
        True if the latest factorised matrix is positive definite.
    roughly : callable or None
        Solver for the same matrix or an approximation of it.
    """

    x: Array
    iterations: int = 1
    factorisations: int = 1
    definite: bool = True
    roughly: Callable[[Array], Array] | None = None


class Workspace:
    """Solver memory of one simulation: the analysed linear solver, its latest factor, run times.

    An older factor, quasi-Newton updates and initial guesses change results within the tolerance of an
    iteration. A simulation therefore starts with those stored in its initial state (`arrays`,
    `restore`), and never with those of another simulation.

    Parameters
    ----------
    system : System
    linear : str
        Name of the linear solver, or "auto".

    Attributes
    ----------
    linear : Factor or ReusedFactor
        Solves with the matrix of a step.
    factor : Factor
        Makes the factors, for it and for iterations of other kinds.
    timed, seconds, calls
        `PhaseClock` of all phases.
    """

    def __init__(self, system: System, linear: str = "auto") -> None:
        clock = PhaseClock()
        self.timed, self.seconds, self.calls = clock.timed, clock.seconds, clock.calls
        self._name = linear
        self._take_solver(system.pattern.n)
        self._system, self._form = system, self.form(system)
        self._pattern = system.pattern
        self._factored: Sparsity | None = None
        if self._form.contact is None:
            # with a contact the first step tells which form serves
            self._analyse(self._form.pattern)
        self._beside: Matrix | None = None
        self._made_of: Array | None = None
        self._compliance: Compliance | None = None
        self._compliance_by: int | None = None
        self._indefinite: LinearSolver | None = None
        self._saddle: Saddle | None = None
        self._columns: tuple[Array | None, Array] | None = None
        self.bodies = BodiesAlone.of(system)
        """Fused steps, of a scene that holds bodies alone."""
        self.factor_of: tuple[str, float] | None = None
        """Integrator and step of the latest factor."""
        self.factor_number = 0
        """Counter of factors."""
        self.secants = SecantMemory()
        self.inverse_secants = InverseSecants()
        self.multipliers: Array | None = None
        """Multipliers of the latest constrained step, where the next one starts."""
        self.velocities: tuple[float, float, Array] | None = None
        """Start and end of the latest linearly implicit step, and the velocities at its start."""
        self.contact_stiffness: tuple[tuple[str, float], Array] | None = None
        """Integrator and step, and the diagonal of their stiffness that penalties of contact follow."""

    def factorise(self, A: Matrix, shift: Array, max_shifts: int = 12) -> int:
        """Factorise; while the matrix is not positive definite, add growing multiples of a diagonal.

        Added to the matrix of a time step, multiples of the mass act as a shorter step would. Returns
        the number of shifts.

        Raises
        ------
        NotPositiveDefinite
            Not even the largest shift helped.
        """
        self._analyse(A.pattern)
        values, tau = A.to_factorise(), 0.0
        shifted = values
        self._forget()
        self._made_of = None
        for shifts in range(max_shifts + 1):
            try:
                with self.timed("factorisation"):
                    self.factor.factorise(shifted)
            except NotPositiveDefinite:
                if shifts == max_shifts:
                    raise
                tau = 4.0**shifts
                shifted = values.copy()
                shifted[A.pattern.diagonal] += tau * shift
                continue
            self._made_of = shifted
            if A.products:
                own = A.values.copy()
                own[A.pattern.diagonal] += tau * shift
                self._beside = replace(A, values=own)
            return shifts
        raise AssertionError("unreachable: the loop returns or raises")

    def arrays(self) -> dict[str, Array]:
        """Arrays that affect later results, for a bitwise identical restart by `restore`.

        Matrices are kept, not their factors, which the same solver makes of them again.
        """
        parts: dict[str, dict[str, Array]] = {
            "solver": {"name": _codes(self.linear.name), "of": self._fits()},
            "step": {},
        }
        forms = [form.pattern is self._factored for form in self._forms()]
        parts["solver"]["form"] = np.array([float(forms.index(True)) if any(forms) else -1.0])
        parts["solver"]["double"] = np.array([float(getattr(self.factor, "in_double", False))])
        if isinstance(self.linear, ReusedFactor):
            parts["reused"] = self.linear.arrays()
        if self.factor_of is not None and self._made_of is not None:
            by, h = self.factor_of
            parts["factor"] = {"by": _codes(by), "h": np.array([h]), "values": self._made_of}
            parts["secants"] = self.secants.arrays()
            parts["inverse_secants"] = self.inverse_secants.arrays()
            if self._beside is not None:
                parts["beside"] = self._beside.arrays()
        if self._compliance is not None:
            of_factor = np.array([float(self._compliance_by == self.factor_number)])
            parts["compliance"] = self._compliance.arrays() | {"of_factor": of_factor}
        if self.multipliers is not None:
            parts["step"]["multipliers"] = self.multipliers
        if self.velocities is not None:
            t0, t1, v = self.velocities
            parts["step"] |= {"velocity_times": np.array([t0, t1]), "velocities": v}
        if self.contact_stiffness is not None:
            (by, h), diagonal = self.contact_stiffness
            parts["stiffness"] = {"by": _codes(by), "h": np.array([h]), "diagonal": diagonal}
        return {f"{part}.{name}": a for part, kept in parts.items() for name, a in kept.items()}

    def restore(self, arrays: Mapping[str, Array]) -> None:
        """Restore the state from `arrays`; those of another solver or pattern are ignored."""

        def part(name: str) -> dict[str, Array]:
            start = f"{name}."
            return {k.removeprefix(start): a for k, a in arrays.items() if k.startswith(start)}

        solver = part("solver")
        fits = solver and np.array_equal(solver["name"], _codes(self.linear.name))
        if not (fits and np.array_equal(solver["of"], self._fits())):
            arrays, solver = {}, {"form": np.array([-1.0]), "double": np.zeros(1)}
        form = int(solver["form"][0])
        if form >= 0:
            self._analyse(self._forms()[form].pattern)
        self._forget()
        self._made_of = None
        start_over = getattr(self.factor, "start_over", None)
        if start_over is not None and self._factored is not None:
            start_over(bool(solver["double"][0]))
        if isinstance(self.linear, ReusedFactor) and self._factored is not None:
            self.linear.restore(part("reused"))
        factor, step, stiffness = part("factor"), part("step"), part("stiffness")
        if factor:
            self._made_of = factor["values"]
            self.factor.factorise(self._made_of)
            self.factor_of = _text(factor["by"]), float(factor["h"][0])
            if beside := part("beside"):
                assert self._factored is not None  # a factor was made for it
                self._beside = Matrix.of_arrays(self._factored, beside)
        self.secants.restore(part("secants"))
        self.inverse_secants.restore(part("inverse_secants"))
        self._compliance, self._compliance_by = None, None
        if compliance := part("compliance"):
            self._compliance = Compliance(self._pattern.n, self.factor.approximate_many)
            self._compliance.restore(compliance)
            if compliance["of_factor"][0]:
                self._compliance_by = self.factor_number
        self.multipliers = step.get("multipliers")
        self.velocities = None
        if "velocities" in step:
            t0, t1 = step["velocity_times"].tolist()
            self.velocities = t0, t1, step["velocities"]
        self.contact_stiffness = None
        if stiffness:
            by = _text(stiffness["by"]), float(stiffness["h"][0])
            self.contact_stiffness = by, stiffness["diagonal"]

    def _forms(self) -> list[System]:
        """Forms of the system for which the solver may have been analysed."""
        forms = [self._form]
        if self._form is not self._system:
            forms.append(self._system)
        if self._form.contact is not None and self._form.apart is not None:
            forms.append(self._form.apart)
        return forms

    def _fits(self) -> Array:
        """Numbers of unknowns and entries to which the arrays belong."""
        return np.array([self._pattern.n, self._pattern.nnz], dtype=np.float64)

    def form(self, system: System, state: State | None = None) -> System:
        """Return the system in the form required by the solver: with products, or fully assembled.

        With the `state` where a step begins also without places for the rows of a contact, if they are
        solved for apart; a factor of another form is dropped.
        """
        form = system
        if isinstance(self.linear, ReusedFactor) and system.sparse is not None:
            form = system.sparse
        contact = form.contact
        if state is None or contact is None:
            return form
        if len(contact.pushing(state)) <= MOST and form.apart is not None:
            form = form.apart
        if form.pattern is not self._factored:
            self._forget()
        return form

    def prepare(self, state: State) -> None:
        """Prepare a converged step from a state, which the first step would otherwise do."""
        self._analyse(self.form(self._system, state).pattern)

    def _take_solver(self, n: int) -> None:
        self.linear = solver_of_steps(self._name, n)
        if isinstance(self.linear, ReusedFactor):
            self.linear.timed = self.timed
            self.factor: Factor = self.linear.factor
        else:
            self.factor = self.linear

    def _analyse(self, pattern: Sparsity) -> None:
        """Set the solver for a sparsity, unless it is already set."""
        if pattern is self._factored:
            return
        if self._factored is not None:
            self._take_solver(pattern.n)
        self.linear.analyse(pattern)
        self._factored = pattern

    def solve_any(self, A: Matrix, rhs: Array, start: Array, error: float) -> Solution:
        """Solve with a matrix that need not be positive definite.

        Parameters
        ----------
        A : Matrix
            Of the system, or of its `form`.
        rhs : (n_free,)
        start : (n_free,) where an iterative solver begins.
        error : float
            Largest error that it leaves, in the units of the solution.

        Raises
        ------
        NotReached
            The iteration failed; A is of a form with products.
        SingularSystem
            The matrix is singular or holds NaN.
        """
        if isinstance(self.linear, ReusedFactor) and A.pattern is self._form.pattern:
            self._analyse(A.pattern)
            self.factor_of = None
            self.secants.clear()
            if A.products:
                self.linear.factorise(A.values, A.times, A.to_factorise)
            else:
                self.linear.factorise(A.values)
            x = self.linear.solve(rhs, start, error)
            done = self.linear
            counts = done.iterations, done.factorisations
            return Solution(x, *counts, done.definite, done.roughly)
        solve, definite = self.solver_of(A.values)
        return Solution(solve(rhs), 1, 1 if definite else 2, definite, solve)

    def columns(self, of: Index, solve: Callable[[Array], Array]) -> Array:
        """Solutions (k, n) for unit vectors as `Solution.roughly` gives them, kept with a factor."""
        made_of = self.linear.factored if isinstance(self.linear, ReusedFactor) else None
        if self._columns is None or made_of is None or self._columns[0] is not made_of:
            unit = np.zeros((len(of), self._pattern.n))
            unit[np.arange(len(of)), of] = 1.0
            self._columns = made_of, np.array([solve(e) for e in unit])
        return self._columns[1]

    def extrapolated(self, t: float, h: float, v: Array) -> Array:
        """Initial guess of the velocities at t + h from those at t.

        Remembers them for the next step.
        """
        before, self.velocities = self.velocities, (t, t + h, v)
        if before is None or not math.isclose(before[1], t, rel_tol=1e-12, abs_tol=1e-12):
            return v
        return v + h / (before[1] - before[0]) * (v - before[2])

    def _forget(self) -> None:
        """Discard the data of the latest factor."""
        self.factor_of = None
        self.factor_number += 1
        self.secants.clear()
        self.inverse_secants.clear()
        self._beside = None
        if isinstance(self.linear, ReusedFactor):
            self.linear.forget()

    def solver_of(self, values: Array) -> tuple[Callable[[Array], Array], bool]:
        """Solver for several right-hand sides of a matrix that need not be positive definite.

        Tells whether it is. Raises as `solve_any`.
        """
        self._forget()
        solver = whole = self._whole
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

        return solve, solver is whole

    @property
    def _whole(self) -> LinearSolver:
        """Direct solver of the system's own matrix, analysed when it is first needed."""
        if self._form.pattern is self._pattern:
            self._analyse(self._pattern)
            return self.factor
        return self._beside_products

    @cached_property
    def _beside_products(self) -> LinearSolver:
        whole = linear_solver()
        whole.analyse(self._pattern)
        return whole

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
        self.factorise_constrained(A, G)
        with self.timed("solution"):
            return self.saddle.solve(r, gamma)

    @property
    def saddle(self) -> Saddle:
        """Solver of the system with the conditions of the scene, analysed at the first use."""
        if self._saddle is None:
            if self._system.constraints is None:
                raise SceneError("the scene has no constraints, expected at least one")
            self._saddle = Saddle(self._system.point_pattern, self._system.constraints)
        return self._saddle

    def has_factor_for(self, integrator: str, h: float) -> bool:
        """Test if the latest factor belongs to this integrator and step, up to rounding of h."""
        return alike(self.factor_of, integrator, h)

    def compliance(self, scale: float) -> Compliance:
        """Compliance of the tissue of the latest factor, or of earlier ones.

        Without products; new parts come from the latest factor, of `scale` times the stiffness, in its
        own precision.
        """

        def solve_many(rhs: Array) -> Array:
            with self.timed("solution"):
                return scale * self.factor.approximate_many(rhs)

        if self._compliance is None:
            self._compliance = Compliance(self._pattern.n, solve_many)
            self._compliance_by = self.factor_number
        self._compliance.solve_many = solve_many
        return self._compliance

    def forget_compliance(self) -> bool:
        """Discard the compliance if it is not of the latest factor; return True if discarded."""
        if self._compliance_by == self.factor_number:
            return False
        self._compliance, self._compliance_by = None, None
        return True

    def solve(self, rhs: Array) -> Array:
        """Solve with the latest factor, in its own precision; with products roughly.

        A direction for Newton's method needs no more.
        """
        with self.timed("solution"):
            if self._beside is None:
                return self.factor.approximate(rhs)
            times, precondition = self._beside.times, self.factor.approximate
            return conjugate_gradients(
                times, precondition, rhs, DIRECTION_SHARE, DIRECTION_SOLUTIONS
            )


def _codes(name: str) -> Array:
    return np.frombuffer(name.encode(), dtype=np.uint8).astype(np.float64)


def _text(codes: Array) -> str:
    return codes.astype(np.uint8).tobytes().decode()


def alike(made: tuple[str, float] | None, integrator: str, h: float) -> bool:
    """Test if an object belongs to this integrator and step, up to rounding of h."""
    return made is not None and made[0] == integrator and math.isclose(made[1], h, rel_tol=1e-9)
