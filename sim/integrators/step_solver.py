"""Solutions with the matrices of linearly implicit steps, also under the constraints of a scene."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from typing import cast

import numpy as np

from sim.constraints.projection import Projection
from sim.constraints.union import Constraints
from sim.errors import NotConverged, SceneError, SingularSystem
from sim.integrators.factor import AnalysedSolver, NewtonFactor
from sim.linear import (
    SINGLE_PRECISION,
    Factor,
    LinearSolver,
    NotPositiveDefinite,
    ReusedFactor,
    linear_solver,
)
from sim.linear.contract import Matrix
from sim.linear.equations import Equations
from sim.linear.reused import Timed
from sim.linear.saddle import Saddle
from sim.state import Array, ControlAt, Evaluation, Line, Pose
from sim.system import System

SOLUTION_REFINED, SOLUTION_REFINEMENTS = 1e-11, 8
"""Relative residual of solutions with many right-hand sides, and largest number of refinements."""


@dataclass(frozen=True)
class Solution:
    """Solution of a linear system."""

    x: Array  #: (n_free,)
    #: numbers of solutions with a factor and of factorisations
    iterations: int = 1
    factorisations: int = 1
    definite: bool = True  #: True if the latest factorised matrix is positive definite
    #: solver for the same matrix or an approximation of it, and right-hand sides (n,) or (k, n), with
    #: the homogeneous equations of the solution
    roughly: Callable[[Array], Array] | None = None
    #: solution for another right-hand side (n,) with them, with the largest error of an iterative one
    again: Callable[[Array, float], "Solution"] | None = None
    alone: Callable[[Array], Array] | None = None  #: as `roughly`, without equations


@dataclass(frozen=True)
class StepEstimates:
    """Data for the error estimate of a step, and for the test of its stability."""

    line: Line  #: activation over the step
    D: Matrix  #: damping [N s/m]
    here: Evaluation  #: forces at the start under the control of the end
    estimated: bool  #: True if the method has an estimate of its error
    control: ControlAt | None  #: activation at all times


@dataclass(frozen=True)
class LinearStep:
    """The equation of one linearly implicit step."""

    A: Matrix  #: for the velocities
    rhs: Array  #: (n_free,) right-hand side [N s]
    moves: float  #: share of the new velocity in the motion
    missed: StepEstimates  #: what one linear solution leaves


class StepSolver:
    """Solver of systems with matrices that need not be positive definite.

    It shares its factor with Newton's method, whose updates are then discarded.
    """

    def __init__(self, solver: AnalysedSolver, newton: NewtonFactor, timed: Timed) -> None:
        self._solver, self._newton, self._timed = solver, newton, timed
        self._indefinite: LinearSolver | None = None
        self._before: tuple[float, float, Array] | None = None

    def solve(
        self, A: Matrix, rhs: Array, start: Array, error: float, under: Equations | None = None
    ) -> Solution:
        """Solve A x = rhs, or A x = rhs + G'mu with the equations G x = b.

        Raises NotReached if the iteration failed; A is of a form with products; SingularSystem if the
        matrix is singular or contains NaN.

        A is of the system or of its `form`; an iteration begins with `start` and leaves `error` at
        most, in the units of the solution.
        """
        linear = self._solver.linear
        if not isinstance(linear, ReusedFactor) or A.pattern is not self._solver.form_pattern:
            return self._directly(A, rhs, under)
        self._solver.analyse(A.pattern)
        linear = self._solver.linear
        assert isinstance(linear, ReusedFactor)  # with the same name and number of unknowns
        self._newton.superseded()
        if A.products:
            linear.factorise(A.values, A.times, A.to_factorise)
        else:
            linear.factorise(A.values)

        rests = None if under is None else under.homogeneous

        def solved(
            r: Array, error: float, start: Array | None, equations: Equations | None
        ) -> Solution:
            x = linear.solve(r, start, error, equations)
            counts = linear.iterations, linear.factorisations
            roughly = partial(linear.roughly, under=rests)
            return Solution(x, *counts, linear.definite, roughly, again, linear.roughly)

        def again(r: Array, error: float) -> Solution:
            return solved(r, error, None, rests)

        return solved(rhs, error, start, under)

    def _directly(self, A: Matrix, rhs: Array, under: Equations | None) -> Solution:
        """As `solve`, with a factor of the matrix itself."""
        solve, definite = self.factorised(A.values)
        if under is None:

            def directly(r: Array, _: float) -> Solution:
                return Solution(solve(r), 1, 0, definite)

            return Solution(solve(rhs), 1, 1 if definite else 2, definite, solve, directly, solve)
        columns, rests = solve(under.unit(len(rhs))), under.homogeneous

        def roughly(r: Array) -> Array:
            return rests.kept(solve(rests.without_forces(r)), columns)

        def refined(x: Array, r: Array) -> Array:
            for _ in range(SOLUTION_REFINEMENTS):
                more = roughly((r - A.times(x))[None])[0]
                x = x + more
                if np.abs(more).max() <= SOLUTION_REFINED * np.abs(x).max():
                    return x
            raise SingularSystem(
                "the linear solutions with constraints do not reach their accuracy"
            )

        def again(r: Array, _: float) -> Solution:
            return Solution(refined(np.zeros_like(r), r), 1, 0, definite)

        x = refined(under.solved(np.zeros_like(rhs), columns), rhs)
        return Solution(x, 1, 1 if definite else 2, definite, roughly, again, solve)

    def factorised(
        self, values: Array, exact: bool = False
    ) -> tuple[Callable[[Array], Array], bool]:
        """Solver for right-hand sides (n,) or (k, n), and whether the matrix is positive definite.

        Several at a time are solved much faster, in the precision of the factor, which is double if
        `exact`. Raises as `solve`.
        """
        self._newton.forget()
        solver = whole = self._double if exact else self._whole
        try:
            with self._timed("factorisation"):
                solver.factorise(values)
        except NotPositiveDefinite:
            if self._indefinite is None:
                self._indefinite = linear_solver(indefinite=True)
                self._indefinite.analyse(self._solver.pattern)
            solver = self._indefinite
            with self._timed("factorisation"):
                solver.factorise(values)

        def solve(rhs: Array) -> Array:
            with self._timed("solution"):
                one = rhs.ndim == 1
                return solver.solve(rhs) if one else cast(Factor, solver).approximate_many(rhs)

        return solve, solver is whole

    def many(self, A: Matrix, exact: bool = True) -> Callable[[Array], Array]:
        """Solver of A X = rhs for many right-hand sides (k, n), with one factor of A itself.

        Solutions are refined to `SOLUTION_REFINED`, for which a factor in double precision needs no
        further solutions; without `exact`, for few, it may be in single precision. It, or its solutions,
        raise SingularSystem.
        """
        _, definite = self.factorised(A.values, exact)
        whole = self._double if exact else self._whole
        solver = whole if definite else self._indefinite
        approximate = cast(Factor, solver).approximate_many

        def solve(rhs: Array) -> Array:
            with self._timed("solution"):
                x, size = approximate(rhs), np.abs(rhs).max(axis=1, initial=0.0)
                if not len(rhs):
                    return x
                hardest = int(np.argmax(size))
                left = rhs[hardest] - A.times(x[hardest])
                if np.abs(left).max(initial=0.0) <= SOLUTION_REFINED * size[hardest]:
                    return x  # a factor in double precision
                for _ in range(SOLUTION_REFINEMENTS):
                    left = rhs - np.array([A.times(row) for row in x])
                    if (np.abs(left).max(axis=1, initial=0.0) <= SOLUTION_REFINED * size).all():
                        return x
                    x = x + approximate(left)
            raise SingularSystem("solutions with many right-hand sides do not reach their accuracy")

        return solve

    @property
    def _whole(self) -> LinearSolver:
        """Direct solver of the system's own matrix, analysed when it is first needed."""
        if self._solver.form_pattern is self._solver.pattern:
            self._solver.analyse(self._solver.pattern)
            return self._solver.factor
        return self._own_matrix_solver

    @property
    def _double(self) -> LinearSolver:
        """Direct solver as `_whole`, whose factors are in double precision."""
        whole = self._whole
        return self._own_matrix_solver if whole.name in SINGLE_PRECISION else whole

    @cached_property
    def _own_matrix_solver(self) -> LinearSolver:
        whole = linear_solver()
        whole.analyse(self._solver.pattern)
        return whole

    def extrapolated(self, t: float, h: float, v: Array) -> Array:
        """Initial guess of the velocities at t + h from those at t.

        The latter are stored for the next step.
        """
        before, self._before = self._before, (t, t + h, v)
        if before is None or not math.isclose(before[1], t, rel_tol=1e-12, abs_tol=1e-12):
            return v
        return v + h / (before[1] - before[0]) * (v - before[2])

    def forget(self) -> None:
        """Discard the velocities of the latest step."""
        self._before = None


CLOSES, SLACK_ROUNDING = 0.5, 1e-12
"""Largest share of the violations that a projection may leave, and rounding of positions [m]."""


class ConstraintSolver:
    """Saddle systems A x + G' y = r, G x = gamma, and projection of positions.

    Factors of saddle systems are reused if the solver of steps reuses its own. `multipliers` (m,) of
    the latest constrained step are the initial values of the next one.
    """

    def __init__(self, system: System, linear: Factor | ReusedFactor, timed: Timed) -> None:
        self._system, self._timed, self._linear = system, timed, linear
        self._saddle: Saddle | None = None
        self._projection: Projection | None = None
        self.multipliers: Array | None = None

    def take(self, system: System) -> None:
        """Solve for another form of the system, whose sparsity may differ."""
        if system.constraints is not self._system.constraints:
            self._system, self._saddle, self._projection = system, None, None

    @property
    def saddle(self) -> Saddle:
        """Solver with the constraints of the scene, analysed at the first use."""
        if self._saddle is None:
            linear, system = self._linear, self._system
            # rows of joints and of contact with bodies are solved for with the matrix itself
            whole = system.kinematics.matrix_varies or system.rows is not None
            factor = (
                type(linear.factor)() if isinstance(linear, ReusedFactor) and not whole else None
            )
            self._saddle = Saddle(system.pattern, self._constraints, factor, self._timed)
        return self._saddle

    @property
    def projection(self) -> Projection:
        """Projection of positions to the constraints, analysed at the first use."""
        if self._projection is None:
            self._projection = Projection(self._constraints, self._system.kinematics.mass)
        return self._projection

    def solve(self, A: Matrix, rhs: Array, pose: Pose, start: Array, error: float) -> Solution:
        """Velocities x of A x + G'y = rhs, G x = -drift with G at a pose; arguments as of `StepSolver`.

        Raises SingularSystem if the constraints contradict each other or depend on each other.
        """
        saddle, conditions = self.saddle, self._constraints
        saddle.factorise(A.values, conditions.evaluate(pose)[1])

        def solved(
            r: Array, gamma: Array, start: Array, error: float, *, correction: bool = False
        ) -> Solution:
            x, _ = saddle.solve(r, gamma, start, error, correction=correction)
            definite = saddle.definite is not False
            counts = saddle.iterations, saddle.factorisations
            return Solution(x, *counts, definite, saddle.roughly, again, saddle.roughly)

        def again(r: Array, error: float) -> Solution:
            return solved(r, np.zeros(conditions.n), np.zeros(len(r)), error, correction=True)

        return solved(rhs, -conditions.drift(pose, pose.t), start, error)

    def projected(self, start: Pose, pose: Pose) -> Pose:
        """Pose projected to the constraints along their derivative at the start of a step.

        The displacement has the smallest norm of the mass among those that joints allow. Raises
        NotConverged if the constraints are not satisfied better afterwards.
        """
        conditions, kinematics, joints = (
            self._constraints,
            self._system.kinematics,
            self._system.rows,
        )
        _, G = conditions.evaluate(start)
        c, _ = conditions.evaluate(pose)
        inverse = None
        if joints is not None:
            inverse = joints.inverse_under_rows(pose)
        elif kinematics.matrix_varies:
            inverse = partial(kinematics.solve_mass, pose=pose)
        with self._timed("solution"):
            back = self.projection.displacement(G, c, inverse)
        closed = kinematics.advance(pose, back, pose.t)
        left, _ = conditions.evaluate(closed)
        rounding = SLACK_ROUNDING * np.asarray(abs(conditions.matrix(G)).sum(axis=1)).ravel()
        if not (np.abs(left) <= CLOSES * float(np.abs(c).max(initial=0.0)) + rounding).all():
            raise NotConverged(
                (),
                pose.t,
                f"the projection leaves constraints violated by {np.abs(left).max():.2g}",
            )
        return closed

    @property
    def _constraints(self) -> Constraints:
        if self._system.constraints is None:
            raise SceneError("the scene has no constraints, expected at least one")
        return self._system.constraints

    def forget(self) -> None:
        """Discard the multipliers and older factors."""
        self.multipliers = None
        if self._saddle is not None:
            self._saddle.start_over()
        if self._projection is not None:
            self._projection.start_over()
