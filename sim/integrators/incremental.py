"""The incremental potential of one implicit Euler step, and the line search on it."""

from dataclasses import dataclass

import numpy as np

from sim.integrators.contract import Workspace, symmetric_product
from sim.state import Array, Control, Evaluation, State
from sim.system import System

ARMIJO = 1e-4
MAX_HALVINGS = 40


@dataclass(frozen=True, eq=False)
class Point:
    """A trial configuration.

    Attributes
    ----------
    d : (n_free,) displacement since the start of the step [m].
    g : (n_free,) gradient of the potential, the residual force [N].
    phi : float
        Potential, up to a constant [J].
    here : Evaluation
    """

    d: Array
    g: Array
    phi: float
    here: Evaluation

    @property
    def residual(self) -> float:
        """Largest component of the residual [N]."""
        return float(np.abs(self.g).max())


class IncrementalPotential:
    """phi(d) = 1/(2 h^2) |d - h v0|^2_M + E(q0 + d) + 1/(2 h) d' D0 d.

    Parameters
    ----------
    system, state, control, h
        Of the step.
    D : (pattern.nnz,) damping at the start of the step.
    work : Workspace
        For its run times.
    """

    def __init__(
        self, system: System, state: State, control: Control, h: float, D: Array, work: Workspace
    ) -> None:
        self.system, self.h = system, h
        self._state, self._control, self._D, self._work = state, control, D, work
        self._mass, self._w0 = system.mass, system.reduce(state.q)
        self.v0 = system.reduce(state.v)
        self._momentum = self._mass * self.v0 / h

    def positions(self, d: Array) -> Array:
        """Nodal positions (n_nodes, 3)."""
        return self.system.expand(self._w0 + d, self._state.q)

    def point(self, d: Array, here: Evaluation | None = None) -> Point:
        """Evaluate phi and its gradient; with det F <= 0 somewhere they mean nothing."""
        if here is None:
            with self._work.timed("force"):
                here = self.system.force(self.positions(d), self._control)
        product = symmetric_product(self.system, self._D, d)
        product /= self.h
        product += self._mass * d / self.h**2
        g = product - self._momentum - self.system.reduce(here.f)
        phi = 0.5 * float(d @ product) - float(self._momentum @ d) + here.energy
        return Point(d, g, phi, here)

    def matrix(self, d: Array) -> Array:
        """h^2 times the second derivative at d, M + h D0 + h^2 K."""
        K = self.system.tangent(self.positions(d), self._control)[1]
        A = self.h * self._D + self.h**2 * K
        A[self.system.pattern.diagonal] += self._mass
        return A

    def search(self, start: Point, direction: Array) -> tuple[float, Point] | None:
        """Longest tried step with det F > 0 everywhere and sufficient decrease.

        Returns
        -------
        (length, point), or None if the direction does not descend or no length serves.
        """
        slope = float(start.g @ direction)
        if not slope < 0.0:
            return None
        # phi is a difference of large sums: below this its change is rounding, and the
        # residual decides instead
        rounding = 1e-13 * (abs(start.phi) + abs(start.here.energy))
        length = 1.0
        for _ in range(MAX_HALVINGS):
            trial = self.point(start.d + length * direction)
            if trial.here.smallest_J > 0.0:
                change = trial.phi - start.phi
                if change <= ARMIJO * length * slope:
                    return length, trial
                if change <= rounding and trial.residual < start.residual:
                    return length, trial
            length *= 0.5
        return None
