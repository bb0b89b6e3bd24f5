"""Incremental potential of one implicit stage, and base class shared with equilibria."""

from dataclasses import replace

import numpy as np

from sim.integrators.by_secants import BySecants
from sim.integrators.newton import Point
from sim.integrators.workspace import Workspace
from sim.matrix import Matrix
from sim.state import Array, Control, Evaluation, Pose
from sim.system import System
from sim.vectors import dot


class PotentialOfMoves(BySecants):
    """A potential of motions d (n,) of the coordinates from a base, under one control.

    Parameters
    ----------
    system : System
    base : Pose
        Where motions start.
    control : Control
    work : Workspace
        For its run times.
    """

    def __init__(self, system: System, base: Pose, control: Control, work: Workspace) -> None:
        self.system = system
        self.base, self._control, self._work = base, control, work

    def pose(self, d: Array) -> Pose:
        """Pose after a motion, at the time of the control."""
        return self.system.kinematics.advance(self.base, d, self._control.t)

    def positions(self, d: Array) -> Array:
        """Positions of all points (n_points, 3)."""
        return self.pose(d).q

    def coordinates(self, q: Array) -> Array:
        """Motion d (n,) to positions q (n_points, 3) in the frames of the base."""
        return self.system.kinematics.between(self.base, replace(self.base, q=q))

    def largest_step(self, d: Array, direction: Array) -> float:
        """Largest feasible fraction in (0, 1] of a displacement by `direction` from d."""
        if not self.system.stops:
            return 1.0
        ends = self.positions(d), self.positions(d + direction)
        return self.system.largest_step(*ends, self._control)

    def _evaluate(self, pose: Pose) -> Evaluation:
        """Forces and energy at a pose."""
        with self._work.timed("force"):
            return self.system.force(pose.q, self._control)


class IncrementalPotential(PotentialOfMoves):
    """phi(d) = 1/(2 s^2) |d - s v|^2_M + E(q + d) + 1/(2 s) d' D d, with the stage's step s.

    Its minimum solves M (w - v)/s = f(q + s w) - D w for the velocity w = d/s. Implicit Euler is one
    such stage from the state itself; trapezoidal and diagonally implicit Runge-Kutta stages are the
    same from another base (q, v).

    Parameters
    ----------
    system : System
    base : Pose
        Where the stage starts.
    u : inertial velocities there.
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
        base: Pose,
        u: Array,
        control: Control,
        s: float,
        D: Matrix,
        work: Workspace,
    ) -> None:
        super().__init__(system, base, control, work)
        self.scale, self.shift = s * s, system.mass
        self._s, self._D, self._u = s, D, u
        self._momentum = system.kinematics.momentum(u, base) / s

    def velocities(self, d: Array) -> Array:
        """Independent velocities d/s (n,)."""
        return d / self._s

    def point(self, d: Array, here: Evaluation | None = None) -> Point:
        """Evaluate phi and its gradient, which are undefined if det F <= 0 somewhere."""
        pose = self.pose(d)
        if here is None:
            here = self._evaluate(pose)
        product = self._D.times(d)
        product /= self._s
        product += self.shift * d / self.scale
        g = product - self._momentum - self.system.kinematics.generalised_force(here.f, pose)
        phi = 0.5 * dot(d, product) - dot(self._momentum, d) + here.energy
        return Point(d, g, phi, here)

    def matrix(self, d: Array) -> Matrix:
        """s^2 times the second derivative at d, M + s D + s^2 K."""
        pose = self.pose(d)
        here, K = self.system.tangent(pose.q, self._control)
        return self.system.implicit_matrix(pose, here, K, self._D, self._s, self.scale)

    def start(self, state_q: Array, at_state: Evaluation | None = None) -> Point:
        """Start at the inertial guess d = s v if it is feasible and better, otherwise at the state."""
        here = self.point(self.coordinates(state_q), at_state)
        guess = self._s * self._u
        share = self.largest_step(here.d, guess - here.d)
        if share < 1.0:
            guess = here.d + share * (guess - here.d)
        if np.array_equal(guess, here.d):
            return here
        moved = self.point(guess)
        better = moved.here.smallest_J > 0.0 and moved.residual < here.residual
        return moved if better else here
