"""State, control, the report of a step, and the states at several outputs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np

from sim.errors import InvertedElement
from sim.pattern import Array


def _no_frames() -> Array:
    return np.zeros((0, 7))


def _no_twists() -> Array:
    return np.zeros((0, 6))


@dataclass(frozen=True)
class Pose:
    """Pose at one instant."""

    q: Array  #: (n_points, 3) positions of nodes and of points on bodies [m]
    #: (n_bodies, 7) centre of mass [m] and unit quaternion (scalar first) of every body
    frames: Array
    t: float  #: time [s]


@dataclass(frozen=True)
class State:
    """Complete state of a simulation, for copies, files and restarts."""

    t: float  #: time [s]
    q: Array  #: (n_points, 3) positions of nodes and of points on bodies [m]
    v: Array  #: (n_points, 3) their velocities [m/s]
    #: history variables by term; a term without an entry has always been at q
    memory: Mapping[str, Array] = field(default_factory=dict[str, Array])
    #: (n_bodies, 7) centre of mass [m] and unit quaternion (scalar first) of every body
    frames: Array = field(default_factory=_no_frames)
    #: (n_bodies, 6) velocity of the centre of mass [m/s] and angular velocity [rad/s], in space
    twists: Array = field(default_factory=_no_twists)

    @property
    def pose(self) -> Pose:
        """Positions and orientations."""
        return Pose(self.q, self.frames, self.t)


@dataclass(frozen=True)
class Control:
    """External inputs of the scene at one instant.

    Notes
    -----
    A Control is also a `ControlAt`, with this activation at all times.
    """

    activation: Array  #: (n_muscles,) in 0-1, in the order of `System.muscles`
    t: float = 0.0  #: time of the inputs [s], for prescribed motions (shells of a contact)

    def __call__(self, t: float) -> "Control":
        """Return the control at time t [s], with the same activation."""
        return replace(self, t=t)

    def at_ends(self, times: Sequence[float]) -> Array:
        """The same activation for every step."""
        return np.broadcast_to(self.activation, (len(times) - 1, len(self.activation))).copy()

    def chord(self, t: float, h: float) -> "Line":
        """The same activation over a step."""
        return Line(self.activation, 0.0 * self.activation, t, h)

    def moments(self, t: float, h: float, places: tuple[float, ...]) -> "Line":
        """The same activation over a step."""
        return self.chord(t, h)

    def misfit(self, line: "Line") -> tuple[Array, Array]:
        """Zeros, because the activation is constant."""
        return np.zeros_like(self.activation), np.zeros_like(self.activation)


@dataclass(frozen=True)
class Line:
    """Linear activation over one step; c = (time - t)/h."""

    #: (n_muscles,) of mean + rise (c - 1/2)
    mean: Array
    rise: Array
    #: start and length of the step [s]
    t: float
    h: float

    def at(self, c: float) -> Control:
        """Control at the position c of the step, limited to 0-1."""
        activation = np.clip(self.mean + (c - 0.5) * self.rise, 0.0, 1.0)
        return Control(activation, self.t + c * self.h)


class ControlAt(Protocol):
    """Control as a function of time, and its linear approximation over a step.

    Integrators evaluate the control of their stages on a line over the step, instead of the
    activation at these instants, so that changes of the activation between the instants are
    included.
    """

    def __call__(self, t: float) -> Control:
        """Return the control at an instant [s]."""
        ...

    def at_ends(self, times: Sequence[float]) -> Array:
        """Activations (n, n_muscles) at the ends of the `chord` lines of successive steps."""
        ...

    def chord(self, t: float, h: float) -> Line:
        """Line for a method of first order: mean, and slope reduced by the deviation from linearity."""
        ...

    def moments(self, t: float, h: float, places: tuple[float, ...]) -> Line:
        """Line with the mean and first moment, limited to 0-1 at relative times `places`."""
        ...

    def misfit(self, line: Line) -> tuple[Array, Array]:
        """Two measures of the difference m between activation and line, (n_muscles,) each [1].

        Its first moment, the integral of (1 - c) m over the relative time c of the step, and the
        integral of |P| over c, where P'' = m.
        """
        ...


@dataclass(frozen=True)
class Evaluation:
    """Forces and energy at one configuration."""

    #: (n_nodes, 3) sum of all forces of the terms [N], without inertia and Rayleigh damping
    f: Array
    energy: float  #: sum of the potentials of the terms [J]
    smallest_J: float  #: smallest det F over all Gauss points (inf if no term deforms)
    element: int  #: element in which it occurs, -1 if none


def require_upright(element: int, smallest_J: float, t: float) -> None:
    """Raise InvertedElement unless the smallest det F is positive (NaN is not)."""
    if not smallest_J > 0.0:
        raise InvertedElement(element, smallest_J, t)


@dataclass(frozen=True)
class Swing:
    """Energies of a step with one linear solution [J]."""

    kinetic: float = 0.0  #: at its end
    damped: float = 0.0  #: dissipated by the damping of the scene
    #: taken by the stress of tissue that turned: a second iteration would give it back
    lost: float = 0.0
    node: int = (
        -1
    )  #: node at which a second iteration would change the momentum most, -1 without loss

    @classmethod
    def united(cls, parts: "Sequence[Swing]") -> "Swing | None":
        """Sums, with the largest kinetic energy and the node of the largest loss; None of no parts."""
        if not parts:
            return None
        worst = max(parts, key=lambda part: part.lost)
        return cls(
            max(p.kinetic for p in parts), sum(p.damped for p in parts),
            sum(p.lost for p in parts), worst.node,
        )  # fmt: skip


@dataclass(frozen=True)
class StepReport:
    """Report of one accepted step."""

    h: float  #: step [s]; the smallest one if the interval was divided
    smallest_J: float  #: smallest det F at the end
    steps: int = 1  #: number of steps in the interval
    rejected: int = 0  #: number of rejected attempts
    #: numbers of linear solutions and numerical factorisations
    iterations: int = 1
    factorisations: int = 1
    #: largest nodal residual force at the end [N]; NaN for a method that does not iterate
    residual: float = float("nan")
    #: estimated iteration error of the largest nodal position [m], summed over the steps of an
    #: interval; NaN for a method that does not iterate
    increment: float = float("nan")
    line_search: float = 1.0  #: smallest accepted fraction of a Newton step
    shifts: int = 0  #: number of shifts that made the matrix positive definite
    indefinite: int = 0  #: number of steps solved with a matrix that is not positive definite
    #: True if the energy is concave along the step (`sim.snapping`); None if this was not tested
    concave: bool | None = None
    touching: int = 0  #: number of steps at whose end surfaces of contact constraints press
    #: estimated local error of the positions [m]; None if the method has no estimate
    local_error: Array | None = field(default=None, compare=False, repr=False)
    #: (2, n_points, 3) estimated errors of the positions [m] by the part of the activation that the line
    #: of the step misses: what decays with the damping, and what the inertia makes good within about a
    #: step; None if it was not estimated or nothing is missed
    input_error: Array | None = field(default=None, compare=False, repr=False)
    #: (2, n_points, 3) estimated errors of the positions [m] by rows of contact of the start of a stage:
    #: by their forces, which decays with the damping, and by gaps, which the next step closes; None if
    #: nothing presses or the method has no estimate
    contact_error: Array | None = field(default=None, compare=False, repr=False)
    #: energies of tissue that turns; None for a method that iterates, and with bodies or joints
    swing: Swing | None = field(default=None, compare=False)
    #: largest change of the velocity of a point in a step, times the step [m]; NaN if not computed
    jump: float = float("nan")
    #: sum of the estimated errors at the watched nodes over the interval [m]; NaN without error control
    error: float = float("nan")


def united(reports: Sequence[StepReport], rejected: int) -> StepReport:
    """Combine several reports, and add rejected attempts."""
    if len(reports) == 1 and rejected == 0:
        return reports[0]
    return StepReport(
        h=min(r.h for r in reports),
        smallest_J=min(r.smallest_J for r in reports),
        steps=sum(r.steps for r in reports),
        rejected=rejected + sum(r.rejected for r in reports),
        iterations=sum(r.iterations for r in reports),
        factorisations=sum(r.factorisations for r in reports),
        residual=max(r.residual for r in reports),
        increment=sum(r.increment for r in reports),
        line_search=min(r.line_search for r in reports),
        shifts=sum(r.shifts for r in reports),
        indefinite=sum(r.indefinite for r in reports),
        concave=_any([r.concave for r in reports]),
        jump=float(np.fmax.reduce([r.jump for r in reports])),
        touching=sum(r.touching for r in reports),
        local_error=_sum([r.local_error for r in reports]),
        input_error=_both([r.input_error for r in reports if r.input_error is not None]),
        contact_error=_of_contact(reports),
        swing=Swing.united([r.swing for r in reports if r.swing is not None]),
        error=sum(r.error for r in reports),
    )


def _of_contact(reports: Sequence[StepReport]) -> Array | None:
    """Errors by contact of several steps; None if one of them presses without an estimate."""
    errors = [r.contact_error for r in reports if r.touching or r.contact_error is not None]
    known = [error for error in errors if error is not None]
    return _both(known) if len(known) == len(errors) else None


def _any(known: list[bool | None]) -> bool | None:
    return None if None in known else any(known)


def _both(errors: list[Array]) -> Array | None:
    """Sum of the lasting errors of several steps, and the longest passing one of each point."""
    if not errors:
        return None
    both = np.array(errors)
    longest = np.linalg.norm(both[:, 1], axis=2).argmax(axis=0)
    return np.array([both[:, 0].sum(axis=0), both[longest, 1, np.arange(both.shape[2])]])


def _sum(errors: list[Array | None]) -> Array | None:
    known = [e for e in errors if e is not None]
    return np.sum(known, axis=0) if known and len(known) == len(errors) else None


@dataclass(frozen=True, eq=False)
class Outputs:
    """Successive states of a scene, along the first axis of every array.

    Arrays are as of `State`; reports are on the steps before each.
    """

    t: Array
    q: Array
    v: Array
    memory: Mapping[str, Array]
    frames: Array
    twists: Array
    reports: Sequence[StepReport]

    @classmethod
    def at_state(cls, state: State, report: StepReport) -> "Outputs":
        """One output."""
        memory = {name: x[None] for name, x in state.memory.items()}
        t, (q, v) = np.array([state.t]), (x[None] for x in (state.q, state.v))
        return cls(t, q, v, memory, state.frames[None], state.twists[None], (report,))

    def state(self, k: int) -> State:
        """State k."""
        memory = {name: x[k].copy() for name, x in self.memory.items()}
        q, v, frames, twists = (x[k].copy() for x in (self.q, self.v, self.frames, self.twists))
        return State(float(self.t[k]), q, v, memory, frames, twists)
