"""Solutions with the matrix of a linearly implicit step, and the Delassus matrix of its rows."""

from dataclasses import replace

import numpy as np
from scipy.sparse import csr_array

from sim.contact.compliance import Compliance
from sim.errors import SingularSystem
from sim.integrators.rows_of_step import dense
from sim.integrators.step_solver import Solution
from sim.integrators.workspace import Workspace
from sim.linear.equations import Equations
from sim.multibody import MOST
from sim.state import Array, Pose, State
from sim.step_matrices import LinearStep
from sim.system import System


class StepInverse:
    """Inverse of the matrix A of a step: dense in small scenes, by the solver of steps in others.

    The equation is that of the velocities without rows; `h` is the length of the step [s] and `error`
    the largest error of a velocity [m/s]. `inverse` (n, n) is None in large scenes, `found` the
    solution of the first right-hand side with the counts of all, and `guess` (n,) the velocities
    without rows in small scenes, extrapolated ones in others.
    """

    def __init__(
        self,
        system: System,
        state: State,
        equation: LinearStep,
        h: float,
        error: float,
        work: Workspace,
        start: Pose,
    ) -> None:
        self._system, self._equation, self._work = system, equation, work
        self._h, self._error, self._start = h, error, start
        self.inverse, self.found = self._dense()
        self.guess = self.found.x
        if self.inverse is None:
            w = system.kinematics.velocities(state)
            self.guess = work.steps.extrapolated(state.t, h, w)

    def begin(self, rhs: Array, under: Equations | None) -> Array:
        """First solution (n,) of a large scene, with its equations."""
        A, work = self._equation.A, self._work
        about = self._start, self.guess, self._error, under
        self.found = work.solve(self._system, A, rhs, *about)
        return self.found.x

    def _dense(self) -> tuple[Array | None, Solution]:
        """Inverse of the matrix of a small scene and the velocities without rows, else no solution."""
        A, rhs = self._equation.A, self._equation.rhs
        if len(rhs) > MOST or A.products or self._system.constraints is not None:
            return None, Solution(rhs)
        whole = dense(A.pattern, A.values)
        try:
            values = np.linalg.eigvalsh(whole)
            inverse = np.asarray(np.linalg.inv(whole), dtype=np.float64)
        except np.linalg.LinAlgError as error:
            raise SingularSystem("the matrix of the step is singular") from error
        return inverse, Solution(inverse @ rhs, definite=values[0] > 0.0)

    def exactly(self, r: Array) -> Array:
        """Solution (n,) for a further right-hand side, with G x = 0 for rigid rows in large scenes."""
        if self.inverse is not None:
            return np.asarray(self.inverse @ r)
        assert self.found.again is not None  # every solution of a step has it
        return self._count(self.found.again(r, self._error)).x

    def alone(self, r: Array) -> Array:
        """Solution for (n,) or (k, n) by the factor at hand, without rows."""
        if self.inverse is not None:
            return np.asarray(r @ self.inverse)
        assert self.found.alone is not None  # every solution of a step has it
        return self.found.alone(r)

    def roughly(self, r: Array) -> Array:
        """As `alone`, with G x = 0 for rigid rows in large scenes."""
        if self.inverse is not None:
            return self.alone(r)
        assert self.found.roughly is not None  # every solution of a step has it
        return self.found.roughly(r)

    def _count(self, more: Solution) -> Solution:
        found = self.found
        self.found = replace(
            found,
            iterations=found.iterations + more.iterations,
            factorisations=found.factorisations + more.factorisations,
            definite=found.definite and more.definite,
        )
        return more

    def compliance(self) -> Compliance:
        """Compliance of earlier matrices, whose new parts are those of the factor at hand."""
        return self._work.contact.compliance(self._h**2, lambda f: self._h**2 * self.alone(f))

    def delassus(self, G: csr_array) -> Array:
        """G A^-1 G' (m, m)."""
        if not G.shape[0]:
            return np.zeros((0, 0))
        if self.inverse is not None:
            product = np.asarray(G @ (G @ self.inverse).T)
        else:
            product = self.compliance().between(G, G) / self._h**2
        return 0.5 * (product + product.T)
