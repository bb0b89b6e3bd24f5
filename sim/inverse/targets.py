"""Targets of inverse tracking: measured functions of the positions, with wanted values over time."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.sparse import csr_array, vstack

from sim.checks import real_numbers
from sim.errors import SceneError
from sim.indices import indices
from sim.scene import Index
from sim.state import Array


class Target(Protocol):
    """Interface of targets.

    Attributes
    ----------
    size : float
        Unit of the residuals, in that of the target: a residual of one `size` counts 1.
    """

    @property
    def size(self) -> float:
        """Unit of the residuals."""
        ...

    def value(self, q: Array) -> Array:
        """Values (m,) at positions q (n_points, 3) [m]."""
        ...

    def slope(self, q: Array) -> csr_array:
        """Derivatives (m, 3 n_points) of the values by the positions."""
        ...

    def wanted(self, t: float) -> Array:
        """Wanted values (m,) at a time [s]; NaN where nothing is measured."""
        ...


def interpolated(time: Array, values: Array, t: float) -> Array:
    """Linear interpolation over the first dim, constant outside; NaN next to a missing sample."""
    i = int(np.clip(np.searchsorted(time, t, side="right") - 1, 0, len(time) - 1))
    j = min(i + 1, len(time) - 1)
    if i == j or t <= time[i]:
        return values[i].copy()
    s = (t - time[i]) / (time[j] - time[i])
    return (1.0 - s) * values[i] + s * values[j]


def check_target(name: str, time: Array, values: Array, size: float) -> None:
    """Raise SceneError for times that do not ascend, missing values, or a size that is not positive."""
    if len(time) == 0 or values.shape[:1] != time.shape or not (np.diff(time) > 0.0).all():
        raise SceneError(
            f"{name}: values of shape {values.shape} at {time.shape} times, expected ascending times "
            "and one row of values for each"
        )
    if not 0.0 < size < np.inf:
        raise SceneError(f"{name}: size = {size!r}, expected a positive number")


@dataclass(frozen=True, eq=False)
@real_numbers
class PointTarget:
    """Positions of nodes, or of points on bodies [m]; three points determine the pose of a body."""

    nodes: Index  #: (k,) point indices
    time: Array  #: (n,) ascending [s]
    position: Array  #: (n, k, 3) wanted positions [m], NaN where a marker is lost
    size: float = 1e-3  #: standard deviation of a coordinate [m], the unit of the residuals

    def __post_init__(self) -> None:
        check_target("PointTarget", self.time, self.position, self.size)
        object.__setattr__(self, "nodes", indices("PointTarget", "node", self.nodes, None))
        if self.position.shape[1:] != (len(self.nodes), 3):
            raise SceneError(
                f"PointTarget: positions of shape {self.position.shape}, expected (time, "
                f"{len(self.nodes)}, 3)"
            )

    def value(self, q: Array) -> Array:
        """Coordinates (3 k,) of the points."""
        return q[indices("PointTarget", "node", self.nodes, len(q))].ravel()

    def slope(self, q: Array) -> csr_array:
        """Unit vectors of the coordinates."""
        column = (3 * np.asarray(self.nodes)[:, None] + np.arange(3)).ravel()
        m = len(column)
        return csr_array((np.ones(m), (np.arange(m), column)), shape=(m, q.size))

    def wanted(self, t: float) -> Array:
        """Interpolated positions (3 k,)."""
        return interpolated(self.time, self.position, t).ravel()


@dataclass(frozen=True, eq=False)
class Together:
    """Several targets as one, in units of their sizes; its own size is 1."""

    parts: Sequence[Target]

    def value(self, q: Array) -> Array:
        """Values of all targets over their sizes."""
        return np.concatenate([np.zeros(0), *(part.value(q) / part.size for part in self.parts)])

    def slope(self, q: Array) -> csr_array:
        """Derivatives of all values."""
        none = csr_array((0, q.size))
        return csr_array(vstack([none, *(part.slope(q) / part.size for part in self.parts)]))

    def wanted(self, t: float) -> Array:
        """Wanted values of all targets."""
        return np.concatenate([np.zeros(0), *(part.wanted(t) / part.size for part in self.parts)])
