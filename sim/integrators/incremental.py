"""The incremental potential of one implicit stage, and what it shares with that of an equilibrium."""

import numpy as np

from sim.integrators.by_secants import BySecants
from sim.integrators.newton import Point
from sim.integrators.workspace import Workspace
from sim.matrix import Matrix
from sim.state import Array, Control, Evaluation
from sim.system import System
from sim.vectors import dot


class PotentialOfMoves(BySecants):
    """A potential of displacements d of the free unknowns from a base, under one control.

    Parameters
    ----------
    system : System
    q : (n_nodes, 3) base positions [m].
    control : Control
    work : Workspace
        For its run times.
    """

    def __init__(self, system: System, q: Array, control: Control, work: Workspace) -> None:
        self.system = system
        self._q, self._control, self._work = q, control, work
        self._w0 = system.reduce(q)

    def positions(self, d: Array) -> Array:
        """Nodal positions (n_nodes, 3)."""
        return self.system.expand(self._w0 + d, self._q)

    def largest_step(self, d: Array, direction: Array) -> float:
        """Share of a move by `direction` from d, in (0, 1], that nothing stops."""
        if not self.system.stops:
            return 1.0
        ends = self.positions(d), self.positions(d + direction)
        return self.system.largest_step(*ends, self._control)

    def _evaluate(self, d: Array) -> Evaluation:
        """Forces and energy at d."""
        with self._work.timed("force"):
            return self.system.force(self.positions(d), self._control)


class IncrementalPotential(PotentialOfMoves):
    """phi(d) = 1/(2 s^2) |d - s v|^2_M + E(q + d) + 1/(2 s) d' D d, with the stage's step s.

    Its minimum solves M (w - v)/s = f(q + s w) - D w for the velocity w = d/s. Implicit Euler is one
    such stage from the state itself; trapezoidal and diagonally implicit Runge-Kutta stages are the
    same from another base (q, v).

    Parameters
    ----------
    system : System
    q, v : (n_nodes, 3) base positions [m] and velocities [m/s].
    control : Control
        At the instant of the stage.
    s : float
        Implicit part of the step [s].
    D : Matrix
        Damping, constant within the stage [N s/m].
    work : Workspace
        For its run times.
    """

    def __init__(
        self,
        system: System,
        q: Array,
        v: Array,
        control: Control,
        s: float,
        D: Matrix,
        work: Workspace,
    ) -> None:
        super().__init__(system, q, control, work)
        self.scale, self.shift = s * s, system.mass
        self._v, self._s, self._D = v, s, D
        self._v0 = system.reduce(v)
        self._momentum = self.shift * self._v0 / s

    def velocities(self, d: Array) -> Array:
        """Nodal velocities d/s (n_nodes, 3)."""
        return self.system.expand(d / self._s, self._v)

    def point(self, d: Array, here: Evaluation | None = None) -> Point:
        """Evaluate phi and its gradient; with det F <= 0 somewhere they mean nothing."""
        if here is None:
            here = self._evaluate(d)
        product = self._D.times(d)
        product /= self._s
        product += self.shift * d / self.scale
        g = product - self._momentum - self.system.reduce(here.f)
        phi = 0.5 * dot(d, product) - dot(self._momentum, d) + here.energy
        return Point(d, g, phi, here)

    def matrix(self, d: Array) -> Matrix:
        """s^2 times the second derivative at d, M + s D + s^2 K."""
        q = self.positions(d)
        K = self.system.tangent(q, self._control)[1]
        return self.system.implicit_matrix(q, K, self._D, self._s, self.scale)

    def start(self, state_q: Array, at_state: Evaluation | None = None) -> Point:
        """Begin at the inertial guess d = s v where it is feasible and better, else at the state."""
        here = self.point(self.system.reduce(state_q) - self._w0, at_state)
        guess = self._s * self._v0
        share = self.largest_step(here.d, guess - here.d)
        if share < 1.0:
            guess = here.d + share * (guess - here.d)
        if np.array_equal(guess, here.d):
            return here
        moved = self.point(guess)
        better = moved.here.smallest_J > 0.0 and moved.residual < here.residual
        return moved if better else here
