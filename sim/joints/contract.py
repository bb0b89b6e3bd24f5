"""Joints as rows: equations or inequalities between two frames, or a frame and a point."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from sim._kernels.joints import TRAVEL
from sim.errors import SceneError
from sim.pattern import Array


def _no_curve() -> Array:
    return np.zeros(6)


@dataclass(frozen=True, eq=False)
class Row:
    """One row c = 0, or c >= 0; fields as of `sim._kernels.joints.RowTable`."""

    name: str  #: joint and direction, for messages
    #: bodies of the two frames, None for space
    body_a: str | None
    body_b: str | None
    #: (3,), (3, 3) of both frames at rest, in space [m]; axes are columns
    origin: Array
    axes: Array
    kind: int = TRAVEL
    i: int = 0
    j: int = 0
    point: int = -1
    sign: float = 1.0
    offset: float = 0.0
    curve: Array = field(default_factory=_no_curve)
    unilateral: bool = False  #: True for c >= 0
    #: of c + damping_time dc/dt = -compliance times the force [m/N or 1/(N m)]
    compliance: float = 0.0
    damping_time: float = 0.0  #: [s]


REACTIONS = "joints"  #: name of the forces of rows in the memory of a state


class Joint(Protocol):
    """A declared joint."""

    @property
    def name(self) -> str:
        """Name, unique within the scene."""
        ...

    def rows(self) -> tuple[Row, ...]:
        """Rows of the joint."""
        ...


def number_of(name: str | None, bodies: Mapping[str, int], row: str) -> int:
    """Number of a body, -1 for space; raises `SceneError` for an unknown name."""
    if name is None:
        return -1
    if name not in bodies:
        raise SceneError(f"joint row {row} refers to body {name!r}, expected one of {list(bodies)}")
    return bodies[name]


def unit_axes(third: Array, first: Array | None = None) -> Array:
    """Orthonormal axes (3, 3), columns, with a given third one and the first close to another direction.

    Raises `SceneError` if a direction is zero, or both are parallel.
    """
    z = np.asarray(third, dtype=np.float64)
    size = float(np.linalg.norm(z))
    guess = np.eye(3)[int(np.argmin(np.abs(z)))] if first is None else np.asarray(first, float)
    x = guess - (guess @ z) * z / size**2 if size > 0.0 else np.zeros(3)
    if not float(np.linalg.norm(x)) > 1e-9 * float(np.linalg.norm(guess)):
        raise SceneError(f"axes along {third!r} and {first!r}: expected two directions that differ")
    z, x = z / size, x / np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1)
