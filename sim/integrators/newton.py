"""Newton's method with line search on a potential, with a factor reused over many steps.

The potential of an implicit stage is (2) of docs/step.md.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Generic, TypeVar

import numpy as np

from sim.checks import real_numbers, require
from sim.dense import dot
from sim.errors import NotConverged
from sim.integrators.workspace import Workspace
from sim.linear import NotPositiveDefinite
from sim.linear.contract import Matrix
from sim.state import Array, Control, Evaluation, Pose
from sim.system import System, implicit_matrix

ARMIJO = 1e-4
MAX_HALVINGS = 40

T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class Point:
    """A trial configuration."""

    d: Array  #: (n_free,) displacement since the start of the step [m]
    pose: Pose  #: after it
    g: Array  #: (n_free,) gradient of the potential, the residual force [N]
    phi: float  #: potential, up to a constant [J]
    here: Evaluation

    @property
    def residual(self) -> float:
        """Largest component of the residual [N]."""
        return float(np.abs(self.g).max())


class Potential(ABC):
    """Potential of motions d (n_free,) from a base, with directions by quasi-Newton updates."""

    system: System
    base: Pose
    scale: float  #: factor of `matrix` on the second derivative
    #: (n_free,) positive diagonal, multiples of which make the matrix positive definite
    shift: Array
    patience = 1  #: number of iterations after which a factor may be renewed for slow convergence
    #: factor on `Tolerances.keep_factor` in the criterion of slow convergence, smaller if an iteration
    #: is expensive
    refactor_ratio = 1.0

    @abstractmethod
    def point(self, d: Array) -> Point:
        """Evaluate potential and gradient, which are undefined if det F <= 0 somewhere."""

    @abstractmethod
    def matrix(self, point: Point) -> Matrix:
        """Scale times the second derivative at a point, or the part of it that is factorised."""

    def direction(self, point: Point, work: Workspace) -> tuple[Point, Array]:
        """Current iterate, and descent direction -H g with the quasi-Newton inverse H."""
        return point, work.newton.secants.direction(
            point.g, lambda r: work.newton.solve(self.scale * r)
        )

    def accepted(self, start: Point, end: Point, length: float, work: Workspace) -> Point:
        """End of a step of this fraction of a direction, which updates the quasi-Newton history."""
        work.newton.secants.learn(end.d - start.d, end.g - start.g)
        return end

    def refused(self, work: Workspace) -> bool:
        """Test for retrying without a new factor after a direction without descent."""
        return False


@dataclass(frozen=True)
@real_numbers
class Tolerances:
    """Tolerances of the iteration, and criteria for a new factor."""

    tolerance: float = 1e-6  #: largest estimated remaining error of a nodal position [m]
    residual_tolerance: float = 2e-5  #: largest nodal residual force [N]
    max_iterations: int = 80
    #: the factor is renewed if an iteration reduces the residual by a smaller factor
    keep_factor: float = 0.6

    def __post_init__(self) -> None:
        for name in ("tolerance", "residual_tolerance", "keep_factor"):
            require(self, name, getattr(self, name), above=0.0)
        require(self, "max_iterations", self.max_iterations, least=1.0)

    def met(self, left: float, residual: float) -> bool:
        """Test if an estimated error of the positions and a residual are below their tolerances."""
        return left <= self.tolerance and residual <= self.residual_tolerance


def error_left(moved: float, last: float) -> float:
    """Remaining error of a linearly converging iteration, from its last two steps.

    The rate is the ratio of the two steps, or a half for the first step (last infinite).
    """
    theta = min(moved / last, 0.99) if last < np.inf else 0.5
    return moved * theta / (1.0 - theta)


def next_error(size: float, last: float) -> float:
    """Error of a linearly converging iteration before its next step, from that and the last step."""
    return size / (1.0 - min(size / last, 0.99))


@dataclass(frozen=True)
class Iteration:
    """Report of the iteration, with the fields of `sim.state.StepReport`."""

    iterations: int
    factorisations: int
    residual: float
    increment: float
    line_search: float
    shifts: int

    def joined(self, other: "Iteration") -> "Iteration":
        """Combined report of two iterations: sums of counts, maxima of other values."""
        return Iteration(
            self.iterations + other.iterations,
            self.factorisations + other.factorisations,
            max(self.residual, other.residual),
            max(self.increment, other.increment),
            min(self.line_search, other.line_search),
            self.shifts + other.shifts,
        )


@dataclass(frozen=True, eq=False)
class Trial(Generic[T]):
    """A point at a length of a direction, compared with the start of a line search."""

    end: T
    smallest_J: float
    change: float  #: of the merit function [J]
    slope: float | None  #: of the merit function along the direction [J]; None if it has none
    halves: bool = False  #: True if the residual has fallen to half


def line_search(
    trial: Callable[[float], Trial[T]],
    slope: float,
    rounding: float,
    longest: float = 1.0,
    negligible: float = 0.0,
) -> tuple[float, T] | None:
    """Longest tried length with det F > 0 everywhere and sufficient decrease, and its end, or None.

    The merit function has the `slope` [J] along the direction at the start, and its changes are known
    to `rounding` [J]. Where a change may be rounding, the slope decides: it must have fallen (the
    approximate Wolfe condition, Hager and Zhang 2005, SIAM J. Optim. 16, 170-192), unless the slope
    itself, the expected change, is below rounding. A direction of ascent beyond it has no length.
    If a change of less than `negligible` is expected, half the residual is sufficient.
    """
    length = longest
    for _ in range(0 if slope > rounding else MAX_HALVINGS):
        now = trial(length)
        if now.smallest_J > 0.0:
            if slope < 0.0 and now.change <= ARMIJO * length * slope:
                return length, now.end
            falls = now.slope is not None and abs(now.slope) <= 0.9 * abs(slope)
            if now.change <= rounding and (falls or abs(slope) <= rounding):
                return length, now.end
            if -slope <= negligible and now.halves:
                return length, now.end
        length *= 0.5
    return None


def rounding_of(*sums: float) -> float:
    """Rounding [J] of a difference of such sums."""
    return 1e-8 * sum(abs(part) for part in sums)


def minimise(
    potential: Potential,
    point: Point,
    work: Workspace,
    key: tuple[str, float],
    tolerances: Tolerances,
    until: float,
) -> tuple[Point, Iteration]:
    """Minimum of a potential from a feasible start.

    Raises NotConverged if the tolerances were not met, no step length lowers the potential, or its
    matrix cannot be shifted to be definite; SingularSystem if the matrix could not be factorised.

    The start has det F > 0. A factor with the same key, of integrator and step, is reused; `until` is
    the end of the step [s] for messages.
    """
    factorisations = shifts = age = 0

    def renew() -> None:
        nonlocal factorisations, shifts, age
        with work.timed("tangent"):
            A = potential.matrix(point)
        try:
            more = work.newton.factorise(A, potential.shift, key)
        except NotPositiveDefinite as error:
            reason = "the matrix remains indefinite for any shift"
            raise NotConverged(tuple(residuals), until, reason) from error
        factorisations, shifts, age = factorisations + 1 + more, shifts + more, 0

    def account(iteration: int, left: float) -> Iteration:
        return Iteration(iteration, factorisations, point.residual, left, shortest, shifts)

    negligible = tolerances.tolerance * tolerances.residual_tolerance
    residuals, last, shortest = [point.residual], np.inf, 1.0
    made_here, ahead = not work.newton.belongs_to(key), None
    if made_here:
        renew()
    for iteration in range(1, tolerances.max_iterations + 1):
        start, direction = ahead or potential.direction(point, work)
        ahead, size = None, float(np.abs(direction).max())

        def trial(length: float, start: Point = start, way: Array = direction) -> Trial[Point]:
            end = potential.point(start.d + length * way)
            halves = end.residual <= 0.5 * start.residual
            change, slope = end.phi - start.phi, dot(end.g, way)
            return Trial(end, end.here.smallest_J, change, slope, halves)

        slope, rounding = dot(start.g, direction), rounding_of(start.phi, start.here.energy)
        trial_end = line_search(trial, slope, rounding, negligible=negligible)
        contraction, age = np.inf, age + 1
        if trial_end is None:
            if potential.refused(work):
                continue
            if made_here:
                if tolerances.met(size, point.residual):
                    # No decrease is possible because the residual is due to rounding, as in a step
                    # at rest.
                    return point, account(iteration, size)
                raise NotConverged(tuple(residuals), until, "no step lowers the potential")
        else:
            length, end = trial_end
            point = potential.accepted(start, end, length, work)
            residuals.append(point.residual)
            if length == 1.0:
                contraction = residuals[-1] / residuals[-2]
            shortest = min(shortest, length)
            left, last = error_left(length * size, last), length * size
            if tolerances.met(left, point.residual):
                return point, account(iteration, left)
            if length == 1.0 and point.residual <= tolerances.residual_tolerance:
                # The next direction, which is required in any case, is a sharper estimate.
                ahead = potential.direction(point, work)
                left = next_error(float(np.abs(ahead[1]).max()), size)
                if tolerances.met(left, point.residual):
                    return point, account(iteration, left)
        slow = (
            contraction > potential.refactor_ratio * tolerances.keep_factor
            and age >= potential.patience
        )
        made_here = trial_end is None or slow
        if made_here:
            renew()
            ahead = None
    raise NotConverged(tuple(residuals), until, f"limit of {tolerances.max_iterations} iterations")


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
        return Point(d, pose, g, phi, here)

    def matrix(self, point: Point) -> Matrix:
        """s^2 times the second derivative at a point, M + s D + s^2 K."""
        pose = point.pose
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
        return Point(d, pose, kinematics.gradient(force, d), self._phi(d, here), here)

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
        self._at = point.pose
        exact = kinematics.gradient(self._resistance(d, self._at), d)
        self._pull = self._quadratic(d) - exact
        return replace(point, phi=self._phi(d, point.here))

    def inertial_guess(self) -> Array:
        """Motion of the momentum of the base."""
        kinematics, base = self.system.kinematics, self.base
        u = self._u - kinematics.inertial(np.zeros(self.system.pattern.n), base)
        return self._s * kinematics.solve_mass(kinematics.momentum(u, base), base)
