"""State, control, and the report of a step."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np

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
    """Complete state of a simulation, for copies, files and restarts.

    Attributes
    ----------
    t : float
        Time [s].
    q : (n_points, 3) positions of nodes and of points on bodies [m].
    v : (n_points, 3) their velocities [m/s].
    memory : mapping of str to array
        History variables by term; a term without an entry has always been at q.
    frames : (n_bodies, 7) centre of mass [m] and unit quaternion (scalar first) of every body.
    twists : (n_bodies, 6) velocity of the centre of mass [m/s] and angular velocity [rad/s], in
    space.
    """

    t: float
    q: Array
    v: Array
    memory: Mapping[str, Array] = field(default_factory=dict[str, Array])
    frames: Array = field(default_factory=_no_frames)
    twists: Array = field(default_factory=_no_twists)

    @property
    def pose(self) -> Pose:
        """Positions and orientations."""
        return Pose(self.q, self.frames, self.t)


@dataclass(frozen=True)
class Control:
    """External inputs of the scene at one instant.

    Attributes
    ----------
    activation : (n_muscles,) in 0-1, in the order of `System.muscles`.
    t : float
        Time of the inputs [s], for prescribed motions (shells of a contact).

    Notes
    -----
    A Control is also a `ControlAt`, with this activation at all times.
    """

    activation: Array
    t: float = 0.0

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


@dataclass(frozen=True)
class Line:
    """Linear activation over one step; c = (time - t)/h.

    Attributes
    ----------
    mean, rise : (n_muscles,) of mean + rise (c - 1/2).
    t, h : float
        Start and length of the step [s].
    """

    mean: Array
    rise: Array
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


@dataclass(frozen=True)
class Evaluation:
    """Forces and energy at one configuration."""

    #: (n_nodes, 3) sum of all forces of the terms [N], without inertia and Rayleigh damping
    f: Array
    energy: float  #: sum of the potentials of the terms [J]
    smallest_J: float  #: smallest det F over all Gauss points (inf if no term deforms)
    element: int  #: element in which it occurs, -1 if none


@dataclass(frozen=True)
class StepReport:
    """Report of one accepted step.

    Attributes
    ----------
    h : float
        Step [s]; the smallest one if the interval was divided.
    steps : int
        Number of steps in the interval.
    rejected : int
        Number of rejected attempts.
    iterations, factorisations : int
        Numbers of linear solutions and numerical factorisations.
    residual : float
        Largest nodal residual force at the end [N]; NaN for a method that does not iterate.
    increment : float
        Estimated iteration error of the largest nodal position [m], summed over the steps of an
        interval; NaN for a method that does not iterate.
    smallest_J : float
        Smallest det F at the end.
    line_search : float
        Smallest accepted fraction of a Newton step.
    shifts : int
        Number of shifts that made the matrix positive definite.
    indefinite : int
        Number of steps solved with a matrix that is not positive definite.
    local_error : (n_nodes, 3) or None
        Estimated local error of the positions [m]; None if the method has no estimate.
    error : float
        Sum of the estimated errors at the watched nodes over the interval [m]; NaN without error
        control.
    """

    h: float
    smallest_J: float
    steps: int = 1
    rejected: int = 0
    iterations: int = 1
    factorisations: int = 1
    residual: float = float("nan")
    increment: float = float("nan")
    line_search: float = 1.0
    shifts: int = 0
    indefinite: int = 0
    local_error: Array | None = field(default=None, compare=False, repr=False)
    error: float = float("nan")
