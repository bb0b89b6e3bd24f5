"""Incremental potential of one implicit stage, and base class shared with equilibria."""

import math
from dataclasses import dataclass, replace

import numpy as np

from sim.integrators.newton import Point, Potential
from sim.integrators.workspace import Workspace
from sim.matrix import Matrix
from sim.state import Array, Control, Evaluation, Pose
from sim.step_matrices import implicit_matrix
from sim.system import System
from sim.vectors import dot


class PotentialOfMoves(Potential):
    """A potential of motions d (n,) of the coordinates from a base, under one control.

    `duration` is the time in which motions take place, infinite for an equilibrium [s].
    """

    def __init__(self, system: System, base: Pose, control: Control, work: Workspace) -> None:
        self.system = system
        self.base, self._control, self._work = base, control, work
        self.duration = math.inf

    def pose(self, d: Array) -> Pose:
        """Pose after a motion, at the time of the control."""
        return self.system.kinematics.advance(self.base, d, self._control.t)

    def coordinates(self, pose: Pose) -> Array:
        """Motion d (n,) from the base to a pose."""
        return self.system.kinematics.between(self.base, pose)

    def at(self, point: Point) -> Point:
        """Return the point itself, whose potential is exact."""
        return point

    def _evaluate(self, pose: Pose) -> Evaluation:
        """Forces and energy at a pose."""
        with self._work.timed("force"):
            return self.system.force(pose.q, self._control)


@dataclass(frozen=True)
class Stage:
    """One implicit stage, equation (1) of docs/step.md."""

    t: float  #: instant of the stage [s]
    base: Pose  #: pose at the start of the stage
    u: Array  #: inertial velocities there
    s: float  #: implicit part of the step [s]
    control: Control
    D: Matrix  #: damping [N s/m]


class IncrementalPotential(PotentialOfMoves):
    """phi(d) = 1/(2 s^2) |d - s v|^2_M + E(q + d) + 1/(2 s) d' D d, equation (2) of docs/step.md.

    Its minimum solves M (w - v)/s = f(q + s w) - D w for the velocity w = d/s. Implicit Euler is
    one such stage from the state itself; trapezoidal and diagonally implicit Runge-Kutta stages are
    the same from another base (q, v).
    """

    def __init__(self, system: System, stage: Stage, work: Workspace) -> None:
        super().__init__(system, stage.base, stage.control, work)
        self._s, self._D, self._u = stage.s, stage.D, stage.u
        self.scale, self.shift, self.duration = self._s * self._s, system.mass, self._s
        self._momentum = system.kinematics.momentum(stage.u, stage.base) / self._s
        if self._D.offset is not None:
            self._momentum = self._momentum - self._D.offset

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
        return implicit_matrix(self.system, pose, here, K, self._D, self._s, self.scale)

    def inertial_guess(self) -> Array:
        """Motion d = s v of the stage without forces."""
        return self._s * self._u

    def start(self, state: Pose, at_state: Evaluation | None = None) -> Point:
        """Inertial guess if it is feasible and its potential is lower, otherwise the state."""
        here = self.point(self.coordinates(state), at_state)
        guess = self.inertial_guess()
        if np.array_equal(guess, here.d):
            return here
        moved = self.point(guess)
        better = moved.here.smallest_J > 0.0 and moved.residual < here.residual
        return moved if better else here


class VaryingInertia(IncrementalPotential):
    """The same stage with R, and therefore the mass, depending on the pose.

    Forces of inertia, m (u(w) - u)/s in the coordinates of the end, and of damping then have no
    potential. Between two iterates they are those of the quadratic d' (M/s^2 + D/s) d/2 - c . d,
    with the mass M at the last iterate and c such that its gradient there is exact. A line search
    therefore decreases a potential, and the iteration ends with the exact residual equal to zero.
    """

    def __init__(self, system: System, stage: Stage, work: Workspace) -> None:
        super().__init__(system, stage, work)
        self._at, self._pull = stage.base, np.zeros(system.pattern.n)

    def point(self, d: Array, here: Evaluation | None = None) -> Point:
        """Evaluate the model of the potential, and its exact gradient."""
        kinematics, pose = self.system.kinematics, self.pose(d)
        if here is None:
            here = self._evaluate(pose)
        force = self._resistance(d, pose) - kinematics.generalised_force(here.f, pose)
        return Point(d, kinematics.gradient(force, d), self._phi(d, here), here)

    def _resistance(self, d: Array, pose: Pose) -> Array:
        """Forces of inertia and damping."""
        kinematics, w = self.system.kinematics, d / self._s
        u = kinematics.inertial(w, pose) - self._u
        return kinematics.momentum(u, pose) / self._s + self._D.force(w)

    def _quadratic(self, d: Array) -> Array:
        mass = self.system.kinematics.apply_mass(d, self._at) / self.scale
        return mass + self._D.times(d) / self._s

    def _phi(self, d: Array, here: Evaluation) -> float:
        return 0.5 * dot(d, self._quadratic(d)) - dot(self._pull, d) + here.energy

    def direction(self, point: Point, work: Workspace) -> tuple[Point, Array]:
        """As of `Potential`, with the quadratic of this iterate."""
        return super().direction(self.at(point), work)

    def at(self, point: Point) -> Point:
        """Point with the quadratic of this iterate."""
        kinematics, d = self.system.kinematics, point.d
        self._at = self.pose(d)
        exact = kinematics.gradient(self._resistance(d, self._at), d)
        self._pull = self._quadratic(d) - exact
        return replace(point, phi=self._phi(d, point.here))

    def inertial_guess(self) -> Array:
        """Motion of the momentum of the base."""
        kinematics, base = self.system.kinematics, self.base
        u = self._u - kinematics.inertial(np.zeros(self.system.pattern.n), base)
        return self._s * kinematics.solve_mass(kinematics.momentum(u, base), base)
