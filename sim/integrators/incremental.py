"""The incremental potential of one implicit Euler step."""

import numpy as np

from sim.integrators.contract import Workspace, symmetric_product
from sim.integrators.newton import Point
from sim.state import Array, Control, Evaluation, State
from sim.system import System
from sim.vectors import dot


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
        self.system, self.h, self.scale, self.shift = system, h, h * h, system.mass
        self._state, self._control, self._D, self._work = state, control, D, work
        self._w0 = system.reduce(state.q)
        self._v0 = system.reduce(state.v)
        self._momentum = self.shift * self._v0 / h

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
        product += self.shift * d / self.h**2
        g = product - self._momentum - self.system.reduce(here.f)
        phi = 0.5 * dot(d, product) - dot(self._momentum, d) + here.energy
        return Point(d, g, phi, here)

    def matrix(self, d: Array) -> Array:
        """h^2 times the second derivative at d, M + h D0 + h^2 K."""
        K = self.system.tangent(self.positions(d), self._control)[1]
        A = self.h * self._D + self.h**2 * K
        A[self.system.pattern.diagonal] += self.shift
        return A

    def start(self, at_rest: Evaluation) -> Point:
        """Begin at the inertial guess d = h v0 where it is feasible and better, else at d = 0."""
        here = self.point(np.zeros_like(self._v0), at_rest)
        guess = self.h * self._v0
        if not guess.any():
            return here
        moved = self.point(guess)
        better = moved.here.smallest_J > 0.0 and moved.residual < here.residual
        return moved if better else here
