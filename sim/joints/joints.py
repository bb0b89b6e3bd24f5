"""Joints of two bodies, points on surfaces, and limits."""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from sim._kernels.joints import ALIGNED, ANGLE, CURVE, TRAVEL, TURN
from sim.checks import real_numbers
from sim.errors import SceneError
from sim.indices import index
from sim.joints.contract import Array, Joint, Row, unit_axes

_AXES = "xyz"
_PAIRS = ((1, 2), (0, 2), (0, 1))
"""Axes of A and B that remain perpendicular if the rotation about x, y, z is locked."""


@dataclass(frozen=True, eq=False)
@real_numbers
class _Located:
    """Two bodies with frames that coincide at rest."""

    name: str
    #: bodies; None is space
    a: str | None
    b: str | None
    origin: tuple[float, float, float] | Array  #: (3,) of the joint at rest [m]
    #: (3,) third axis of the joint: the axis of rotation or translation, or the normal
    axis: tuple[float, float, float] | Array = (0.0, 0.0, 1.0)

    def _row(self, direction: str, **more: Any) -> Row:
        """Row of a direction between the frames."""
        place = np.asarray(self.origin, dtype=np.float64), unit_axes(np.asarray(self.axis))
        return Row(f"{self.name} {direction}", self.a, self.b, *place, **more)


@dataclass(frozen=True, eq=False)
@real_numbers
class _BodyJoint(_Located):
    """Joint that locks directions between two bodies.

    Raises SceneError if the axis is zero, or a number is negative.
    """

    compliance: float = 0.0  #: of every row [m/N, 1/(N m)]; 0 is rigid
    damping_time: float = 0.0  #: relaxation time of a compliant row [s]
    travels: ClassVar[tuple[int, ...]] = ()
    turns: ClassVar[tuple[int, ...]] = ()

    def __post_init__(self) -> None:
        if not (self.compliance >= 0.0 and self.damping_time >= 0.0):
            raise SceneError(
                f"joint {self.name}: compliance {self.compliance!r} and damping time "
                f"{self.damping_time!r}, expected numbers >= 0"
            )
        unit_axes(np.asarray(self.axis))

    def rows(self) -> tuple[Row, ...]:
        """One row per locked direction."""
        soft = {"compliance": self.compliance, "damping_time": self.damping_time}
        moves = [self._row(f"travel {_AXES[i]}", i=i, **soft) for i in self.travels]
        turns = [
            self._row(f"turn {_AXES[k]}", kind=ALIGNED, i=_PAIRS[k][0], j=_PAIRS[k][1], **soft)
            for k in self.turns
        ]
        return *moves, *turns


class Spherical(_BodyJoint):
    """Common point; all rotations free."""

    travels = (0, 1, 2)


class Revolute(_BodyJoint):
    """Hinge about the axis."""

    travels, turns = (0, 1, 2), (0, 1)


class Cylindrical(_BodyJoint):
    """Translation along and rotation about the axis."""

    travels, turns = (0, 1), (0, 1)


class Prismatic(_BodyJoint):
    """Translation along the axis without rotation."""

    travels, turns = (0, 1), (0, 1, 2)


class Planar(_BodyJoint):
    """Motion within the plane perpendicular to the axis, and rotation about the axis."""

    travels, turns = (2,), (0, 1)


class Weld(_BodyJoint):
    """No relative motion; its reactions are the internal forces of a section."""

    travels, turns = (0, 1, 2), (0, 1, 2)


@dataclass(frozen=True, eq=False)
@real_numbers
class Bushing(_Located):
    """Springs and dampers along and about three axes, f = -k x - d dx/dt and m = -k theta - d dtheta/dt.

    x is the displacement of a point of b in the axes of a, theta the rotation vector of b in a, both
    relative to rest. The force acts at the point of b.

    Attributes
    ----------
    name, a, b, origin, axis : as of joints; the axis is the third.
    stiffness : (6,) along [N/m] and about [N m/rad] the three axes; 0 for a direction without spring.
    damping : (6,) [N s/m], [N m s/rad]; 0 where the stiffness is 0.

    Raises
    ------
    SceneError
        A number is negative or not finite, or a direction has damping without stiffness.

    Notes
    -----
    The rows have the compliance 1/k and are implicit, so that a stiff bushing does not limit the step.
    """

    stiffness: tuple[float, ...] = (0.0,) * 6
    damping: tuple[float, ...] = (0.0,) * 6

    def __post_init__(self) -> None:
        k, d = np.asarray(self.stiffness, float), np.asarray(self.damping, float)
        good = k.shape == (6,) and d.shape == (6,) and bool(np.isfinite([k, d]).all())
        if not (good and (k >= 0.0).all() and (d >= 0.0).all() and not d[k == 0.0].any()):
            raise SceneError(
                f"bushing {self.name}: stiffness {self.stiffness!r} and damping {self.damping!r}, "
                "expected six numbers >= 0 each, and damping only where there is stiffness"
            )
        unit_axes(np.asarray(self.axis))

    def rows(self) -> tuple[Row, ...]:
        """One compliant row per direction with stiffness."""
        return tuple(
            self._row(
                f"{'travel' if i < 3 else 'turn'} {_AXES[i % 3]}",
                kind=TRAVEL if i < 3 else TURN,
                i=i % 3,
                compliance=1.0 / k,
                damping_time=self.damping[i] / k,
            )
            for i, k in enumerate(self.stiffness)
            if k > 0.0
        )


@dataclass(frozen=True, eq=False)
@real_numbers
class Limit(_Located):
    """Smallest and largest angle about, or translation along, the axis of a joint.

    Attributes
    ----------
    name, a, b, origin, axis : as of joints.

    Raises
    ------
    SceneError
        lower is not below upper; angles differ by a turn or more; a single angle is pi or more away from
        rest, so that it could be passed from both sides.

    Notes
    -----
    An angle is measured within half a turn of the middle of both bounds, or of rest with one bound. A
    body that passes beyond both ends is pushed back to the nearer one.
    """

    #: of the motion of b relative to a since rest [rad or m]
    lower: float = -np.inf
    upper: float = np.inf
    travel: bool = False  #: True if the translation is limited, otherwise the angle

    def __post_init__(self) -> None:
        if not self.lower < self.upper:
            raise SceneError(f"limit {self.name}: {self.lower!r} is not below {self.upper!r}")
        finite = [x for x in (self.lower, self.upper) if np.isfinite(x)]
        if not self.travel and len(finite) == 1 and not abs(finite[0]) < np.pi:
            raise SceneError(
                f"limit {self.name}: the angle {finite[0]!r} rad is half a turn or more from rest, "
                "expected less for a single bound: give both bounds"
            )
        if not self.travel and len(finite) == 2 and not finite[1] - finite[0] < 2.0 * np.pi:
            raise SceneError(
                f"limit {self.name}: {self.lower!r} to {self.upper!r} rad are a turn or more, expected "
                "less, since orientations do not count turns"
            )

    def rows(self) -> tuple[Row, ...]:
        """One inequality per finite bound."""
        kind, bounds = TRAVEL if self.travel else ANGLE, ((self.lower, 1.0), (self.upper, -1.0))
        middle, about = 0.5 * (self.lower + self.upper), np.zeros(6)
        if not self.travel and np.isfinite(middle):
            about[0] = middle
        return tuple(
            self._row(
                "lower" if sign > 0.0 else "upper",
                kind=kind,
                i=2,
                sign=sign,
                offset=bound,
                curve=about,
                unilateral=True,
            )
            for bound, sign in bounds
            if np.isfinite(bound)
        )


@dataclass(frozen=True, eq=False)
@real_numbers
class PointOnPlane:
    """A point remains in a plane of a body, or on the side of its normal."""

    name: str
    point: int  #: node or point
    body: str | None  #: body of the plane; None is space
    #: (3,) at rest [m], [1]
    origin: tuple[float, float, float] | Array
    normal: tuple[float, float, float] | Array
    unilateral: bool = False
    #: as of joints
    compliance: float = 0.0
    damping_time: float = 0.0

    def __post_init__(self) -> None:
        point = index(f"joint {self.name}", "point", self.point, None)
        object.__setattr__(self, "point", point)

    def rows(self) -> tuple[Row, ...]:
        """One row."""
        return (
            Row(
                self.name,
                self.body,
                None,
                np.asarray(self.origin, dtype=np.float64),
                unit_axes(np.asarray(self.normal)),
                i=2,
                point=self.point,
                unilateral=self.unilateral,
                compliance=self.compliance,
                damping_time=self.damping_time,
            ),
        )


@dataclass(frozen=True, eq=False)
@real_numbers
class PointOnCurve:
    """A point remains on the cylindrical surface z = f(x) in axes of a body, or above it.

    Notes
    -----
    The value of the row is the height above the curve, not the distance along the normal; the force of
    the row acts accordingly. Source: condylar guidance as strips of a cubic, Hannam et al. 2008,
    J. Biomech. 41, 1069.
    """

    name: str
    point: int
    body: str | None
    origin: tuple[float, float, float] | Array  #: (3,) of the curve at rest [m]
    #: (3,) directions of z and x
    normal: tuple[float, float, float] | Array
    forward: tuple[float, float, float] | Array
    coefficients: NDArray[np.float64]  #: (4,) of f = sum_k coefficients_k x^k [m^(1 - k)]
    reach: tuple[float, float]  #: (2,) first and last x of the polynomial [m]; f is linear beyond
    unilateral: bool = False  #: True if the point may leave the surface to the side of z

    def __post_init__(self) -> None:
        point = index(f"joint {self.name}", "point", self.point, None)
        object.__setattr__(self, "point", point)

    def rows(self) -> tuple[Row, ...]:
        """One row."""
        return (
            Row(
                self.name,
                self.body,
                None,
                np.asarray(self.origin, dtype=np.float64),
                unit_axes(np.asarray(self.normal), np.asarray(self.forward)),
                kind=CURVE,
                point=self.point,
                curve=np.array([*self.reach, *self.coefficients], dtype=np.float64),
                unilateral=self.unilateral,
            ),
        )


JOINTS: tuple[type[Joint], ...] = (
    Spherical,
    Revolute,
    Cylindrical,
    Prismatic,
    Planar,
    Weld,
    Bushing,
    Limit,
    PointOnPlane,
    PointOnCurve,
)
"""All joints, which the tests include."""
