"""Solutions under the constraints of a scene, and their multipliers."""

from functools import partial

import numpy as np

from sim.constraints.projection import Projection
from sim.constraints.union import Constraints
from sim.errors import NotConverged, SceneError
from sim.integrators.step_solver import Solution
from sim.linear import Factor, ReusedFactor
from sim.linear.reused import Timed
from sim.linear.saddle import Saddle
from sim.matrix import Matrix
from sim.state import Array, Pose
from sim.system import System

CLOSES, ROUNDING = 0.5, 1e-12
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
        rounding = ROUNDING * np.asarray(abs(conditions.matrix(G)).sum(axis=1)).ravel()
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
