"""Implicit Euler solved to a tolerance: Newton on the incremental potential."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from sim.errors import NotConverged
from sim.integrators.contract import Workspace, require_upright, symmetric_product
from sim.state import Array, Control, Evaluation, State, StepReport
from sim.system import System

ARMIJO = 1e-4
MAX_HALVINGS = 40


@dataclass(frozen=True)
class ConvergedEuler:
    """The minimiser of the incremental potential of one implicit Euler step.

    phi(q) = 1/(2 h^2) |q - q0 - h v0|^2_M + E(q) + 1/(2 h) (q - q0)' D0 (q - q0),

    with D0 the damping matrix at the start of the step. Newton's method with a line search that keeps
    det F > 0 at every Gauss point and phi decreasing; the factor is kept while the iteration still
    contracts, and the matrix is shifted by multiples of M when it is not positive definite.

    Attributes
    ----------
    tolerance : float
        Largest estimated error of a nodal position left by the iteration [m].
    residual_tolerance : float
        Largest nodal residual force [N].
    max_iterations : int
    keep_factor : float
        The factor is kept while an iteration shrinks the residual by at least this factor.

    Notes
    -----
    First order. Source of the incremental potential: the variational form of implicit Euler, Martin et
    al. 2011; the damping is lagged so that the step has a potential.
    """

    tolerance: float = 1e-6
    residual_tolerance: float = 1e-4
    max_iterations: int = 60
    keep_factor: float = 0.5
    order: ClassVar[int] = 1

    def step(
        self, system: System, state: State, control: Control, h: float, work: Workspace
    ) -> tuple[State, StepReport]:
        """Advance by h.

        Raises
        ------
        InvertedElement
            det F <= 0 at the start of the step.
        NotConverged
            The tolerances were not met, or no step length lowers the potential.
        SingularSystem
            The matrix could not be factorised.
        """
        with work.timed("tangent"):
            here, K, D = system.tangent(state.q, control)
        require_upright(here.element, here.smallest_J, state.t)
        problem = _Incremental(system, state, h, D)
        t1, d = state.t + h, np.zeros(system.pattern.n)
        inertia_and_damping = np.zeros_like(d)
        g = problem.gradient(d, inertia_and_damping, here)
        phi = problem.potential(d, inertia_and_damping, here)

        residuals = [float(np.abs(g).max())]
        factorisations = shifts = 0
        shortest, contraction, last = 1.0, 1.0, np.inf
        fresh = False
        for iteration in range(1, self.max_iterations + 1):
            if iteration == 1 or contraction > self.keep_factor:
                if iteration > 1:
                    with work.timed("tangent"):
                        _, K, _ = system.tangent(problem.positions(d), control)
                more = work.factorise(problem.matrix(K), system.mass, system.pattern.diagonal)
                factorisations, shifts, fresh = factorisations + 1 + more, shifts + more, True
            direction = work.solve(-h * h * g)
            found = self._search(problem, control, d, direction, phi, g, work)
            if found is None:
                if fresh:
                    raise NotConverged(tuple(residuals), t1, "no step length lowers the potential")
                contraction = 1.0
                continue
            length, d, inertia_and_damping, here, phi = found
            fresh = False
            g = problem.gradient(d, inertia_and_damping, here)
            residuals.append(float(np.abs(g).max()))
            moved = length * float(np.abs(direction).max())
            shortest = min(shortest, length)
            contraction = residuals[-1] / residuals[-2] if residuals[-2] > 0.0 else 0.0
            if length < 1.0:
                contraction = 1.0
            # what a linearly converging iteration leaves after a move, from the last two moves
            theta = min(moved / last, 0.99) if np.isfinite(last) and last > 0.0 else 0.5
            left, last = moved * theta / (1.0 - theta), moved
            if left <= self.tolerance and residuals[-1] <= self.residual_tolerance:
                q1 = problem.positions(d)
                new = State(t1, q1, system.expand(d / h, state.v), state.memory)
                return new, StepReport(
                    h=h,
                    smallest_J=here.smallest_J,
                    iterations=iteration,
                    factorisations=factorisations,
                    residual=residuals[-1],
                    increment=left,
                    line_search=shortest,
                    shifts=shifts,
                )
        raise NotConverged(tuple(residuals), t1, f"limit of {self.max_iterations} iterations")

    def _search(
        self,
        problem: "_Incremental",
        control: Control,
        d: Array,
        direction: Array,
        phi: float,
        g: Array,
        work: Workspace,
    ) -> tuple[float, Array, Array, Evaluation, float] | None:
        """Largest tried length with det F > 0 and sufficient decrease, or None."""
        slope = float(g @ direction)
        if not slope < 0.0:
            return None
        # phi is a difference of large sums: below this, its change is rounding
        rounding = 1e-13 * max(abs(phi), problem.energy_scale)
        length = 1.0
        for _ in range(MAX_HALVINGS):
            trial = d + length * direction
            with work.timed("force"):
                here = problem.system.force(problem.positions(trial), control)
            if here.smallest_J > 0.0:
                product = problem.inertia_and_damping(trial)
                value = problem.potential(trial, product, here)
                if value <= phi + ARMIJO * length * slope + rounding:
                    return length, trial, product, here, value
            length *= 0.5
        return None


class _Incremental:
    """The incremental potential of one step as a function of the displacement d = q - q0 (free)."""

    def __init__(self, system: System, state: State, h: float, D: Array) -> None:
        self.system, self._q0, self._h, self._D = system, state.q, h, D
        self._mass, self._v0 = system.mass, system.reduce(state.v)
        self.energy_scale = float(0.5 * (self._mass @ self._v0**2))

    def positions(self, d: Array) -> Array:
        """Nodal positions (n_nodes, 3)."""
        return self.system.expand(self.system.reduce(self._q0) + d, self._q0)

    def inertia_and_damping(self, d: Array) -> Array:
        """(M/h^2 + D0/h) d."""
        product = symmetric_product(self.system, self._D, d)
        product /= self._h
        product += self._mass * d / self._h**2
        return product

    def potential(self, d: Array, product: Array, here: Evaluation) -> float:
        """Return phi up to a constant, given the product of `inertia_and_damping`."""
        return float(0.5 * (d @ product) - (self._mass * self._v0) @ d / self._h) + here.energy

    def gradient(self, d: Array, product: Array, here: Evaluation) -> Array:
        """Return d phi/dq [N], likewise."""
        return product - self._mass * self._v0 / self._h - self.system.reduce(here.f)

    def matrix(self, K: Array) -> Array:
        """h^2 times the second derivative, M + h D0 + h^2 K."""
        A = self._h * self._D
        A += self._h**2 * K
        A[self.system.pattern.diagonal] += self._mass
        return A
