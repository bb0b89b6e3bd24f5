"""Targets that are functions of several points: a separation along a direction, and an area."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from sim.checks import real_numbers
from sim.errors import SceneError
from sim.indices import indices
from sim.inverse.targets import check_target, interpolated
from sim.scene import Index
from sim.state import Array


@dataclass(frozen=True, eq=False)
@real_numbers
class SeparationTarget:
    """Signed distance of two groups of points along a direction, such as the opening of lips [m].

    s = d . (mean of the upper points - mean of the lower points), negative where they have passed
    each other.
    """

    upper: Index  #: (k,) point indices
    lower: Index  #: (m,) point indices
    time: Array  #: (n,) ascending [s]
    separation: Array  #: (n,) wanted [m], NaN where it is not measured
    direction: tuple[float, float, float] = (0.0, 0.0, 1.0)  #: unit vector from lower to upper
    size: float = 1e-3  #: standard deviation [m], the unit of the residual

    def __post_init__(self) -> None:
        check_target("SeparationTarget", self.time, self.separation, self.size)
        for name in ("upper", "lower"):
            node = indices("SeparationTarget", "node", getattr(self, name), None)
            object.__setattr__(self, name, node)
        _check_direction("SeparationTarget", self.direction)
        if not len(self.upper) or not len(self.lower):
            raise SceneError(
                "SeparationTarget: a group has no points, expected at least one in each"
            )

    def value(self, q: Array) -> Array:
        """Separation (1,)."""
        upper, lower = (
            indices("SeparationTarget", "node", group, len(q)) for group in (self.upper, self.lower)
        )
        gap = q[upper].mean(axis=0) - q[lower].mean(axis=0)
        return np.array([gap @ np.array(self.direction)])

    def slope(self, q: Array) -> csr_array:
        """Direction over the number of points, of opposite sign in both groups."""
        out = np.zeros(q.shape)
        np.add.at(out, self.upper, np.array(self.direction) / len(self.upper))
        np.add.at(out, self.lower, -np.array(self.direction) / len(self.lower))
        return csr_array(out.reshape(1, -1))

    def wanted(self, t: float) -> Array:
        """Interpolated separation (1,)."""
        return interpolated(self.time, self.separation[:, None], t)


@dataclass(frozen=True, eq=False)
@real_numbers
class AreaTarget:
    """Signed area of a closed polygon of points, projected along a direction, such as a mouth [m^2].

    A = n/2 . sum of x_i x x_{i+1}, positive if the points are counterclockwise seen against n. Parts
    of the polygon that are turned over, such as lips that overlap, count negatively.
    """

    nodes: Index  #: (k,) point indices in order
    time: Array  #: (n,) ascending [s]
    area: Array  #: (n,) wanted [m^2], NaN where it is not measured
    direction: tuple[float, float, float] = (0.0, 1.0, 0.0)  #: unit vector n towards the observer
    size: float = 1e-5  #: standard deviation [m^2], the unit of the residual

    def __post_init__(self) -> None:
        check_target("AreaTarget", self.time, self.area, self.size)
        object.__setattr__(self, "nodes", indices("AreaTarget", "node", self.nodes, None))
        _check_direction("AreaTarget", self.direction)
        if len(self.nodes) < 3:
            raise SceneError(f"AreaTarget: {len(self.nodes)} points, expected at least 3")

    def value(self, q: Array) -> Array:
        """Area (1,)."""
        x = q[indices("AreaTarget", "node", self.nodes, len(q))]
        x = x - x.mean(axis=0)
        twice = np.cross(x, np.roll(x, -1, axis=0)).sum(axis=0)
        return np.array([0.5 * twice @ np.array(self.direction)])

    def slope(self, q: Array) -> csr_array:
        """Derivatives (x_{i+1} - x_{i-1}) x n / 2."""
        x, out = q[self.nodes], np.zeros(q.shape)
        across = np.roll(x, -1, axis=0) - np.roll(x, 1, axis=0)
        np.add.at(out, self.nodes, 0.5 * np.cross(across, np.array(self.direction)))
        return csr_array(out.reshape(1, -1))

    def wanted(self, t: float) -> Array:
        """Interpolated area (1,)."""
        return interpolated(self.time, self.area[:, None], t)


def _check_direction(name: str, direction: tuple[float, float, float]) -> None:
    length = float(np.linalg.norm(direction))
    if not abs(length - 1.0) < 1e-9:
        raise SceneError(f"{name}: direction of length {length:.6g}, expected a unit vector")
