"""Opening of the mouth as air passes it: area between the lips in front view, and their protrusion."""

from dataclasses import dataclass
from typing import Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.spatial import KDTree

from emgface.face.lip_shape import lip_rim
from emgface.face.surface import boundary_faces, triangles
from sim import State, StepReport, System
from sim.probes import Variable
from sim.state import Control

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

LIP_WIDTH: Final = 14e-3
"""Distance from a margin within which a part of the surface at rest belongs to the lip [m]."""
#: number of positions across the mouth at which the opening is measured
OPENING_POSITIONS: Final = 101


@dataclass(frozen=True, eq=False)
class Mouth:
    """Surfaces of the lips of a face, between which air passes; also a probe of the opening."""

    #: (n, 2) edges of the surface: outer skin, red and lining within `LIP_WIDTH` of its margin
    upper: Integers
    lower: Integers  #: (n, 2) edges, likewise
    corners: Integers  #: (2,) nodes of the corners of the opening
    margins: Integers  #: (2,) nodes of the margins in the midline
    rest: Floats  #: (2, 3) positions of `margins` in the geometry of the face [m]

    @classmethod
    def from_face(cls, face: xr.Dataset) -> "Mouth":
        """Find the lips of a face.

        Raises FaceError if it has no mouth opening (`emgface.face.lip_shape.lip_rim`).
        """
        rim, position = lip_rim(face), face["position"].values
        faces, _ = boundary_faces(face["connectivity"].values)
        surface = triangles(faces, position)
        middle = position[surface].mean(axis=1)
        above, below = (
            KDTree(position[nodes]).query(middle)[0] for nodes in (rim.upper, rim.lower)
        )
        margins = np.asarray(face["lip_opening_node"].values, np.int64)
        return cls(
            _edges(surface[(above < LIP_WIDTH) & (above < below)]),
            _edges(surface[(below < LIP_WIDTH) & (below < above)]),
            rim.upper[[0, -1]],
            margins,
            position[margins],
        )

    def measure(self, position: Floats) -> tuple[float, float]:
        """Area through which one sees from the front [m^2], and protrusion [m] of the margins.

        The opening at a place across the mouth is the height of the lowest point of the upper lip
        above the highest point of the lower one, at any depth, or 0 where they overlap. It is smaller
        than that between the margins, behind which the lips approach each other. The protrusion is
        the mean anterior displacement of both margins in the midline from the geometry of the face.
        """
        ends = position[self.corners, 0]
        x = np.linspace(ends.min(), ends.max(), OPENING_POSITIONS)
        gap = -_highest(position, self.upper, x, -1.0) - _highest(position, self.lower, x, 1.0)
        gap = np.where(np.isfinite(gap), np.maximum(gap, 0.0), 0.0)
        area = float(gap.sum() * np.ptp(ends) / (OPENING_POSITIONS - 1))
        return area, float((position[self.margins] - self.rest)[:, 1].mean())

    def variables(self) -> tuple[Variable, ...]:
        """Name, unit and dims of the recorded variables."""
        return (Variable("mouth_area", "m2"), Variable("lip_protrusion", "m"))

    def record(
        self, system: System, state: State, control: Control, report: StepReport | None
    ) -> tuple[float, ...]:
        """Return area [m^2] and protrusion [m] of a state."""
        return self.measure(state.q)


def _edges(surface: Integers) -> Integers:
    pairs = np.concatenate([surface[:, [0, 1]], surface[:, [1, 2]], surface[:, [2, 0]]])
    return np.unique(np.sort(pairs, axis=1), axis=0).astype(np.int64)


def _highest(position: Floats, edge: Integers, x: Floats, sign: float) -> Floats:
    """Largest sign z of a surface at every x, which it reaches at an edge; -inf without one."""
    a, b = position[edge[:, 0]], position[edge[:, 1]]
    across = b[:, 0] - a[:, 0]
    share = (x - a[:, :1]) / np.where(across == 0.0, 1.0, across)[:, None]
    z = sign * (a[:, 2:] + share * (b[:, 2] - a[:, 2])[:, None])
    on = (share >= 0.0) & (share <= 1.0) & (across != 0.0)[:, None]
    return np.where(on, z, -np.inf).max(axis=0, initial=-np.inf)
