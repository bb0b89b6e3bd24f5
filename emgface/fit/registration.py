"""Registration of surfaces without correspondence: rigid or similar, and smooth.

The robust iteration of closest points minimises sum_k w_k (n_k . (R p_k + t - y_k))^2 over pairs whose
normals agree, with the weights of Huber of their distances. The smooth map adds to the similarity S a
random function whose increments over a distance h have the variance 2 `GROWTH` h and whose mean is
constant: x -> S x + psi(x), with psi estimated from points and their nearest points on the target.
Beyond the data psi tends to a constant, so that S alone extrapolates.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.interpolate import RBFInterpolator
from scipy.spatial.transform import Rotation

from emgface.errors import FitError
from emgface.fit.similarity import GROWTH, Similarity
from emgface.fit.triangulated import Floats, Nearest, Surface

CLOSEST_POINTS: Final = 1500  #: number of points of a surface in the iteration of closest points
MAP_CONTROLS: Final = 400  #: number of points of a surface that determine the smooth map
CLOSEST_POINT_ITERATIONS: Final = 100
SETTLED_MOTION: Final = 1e-7  #: motion of the last step [m]
#: standard deviations of the nearest points [m]
POINT_SPREADS: Final = (4e-3, 3e-3, 2e-3, 1.4e-3, 1e-3, 0.7e-3, 0.5e-3)

Map = Callable[[Floats], Floats]


def closest_points(
    moving: Surface,
    target: Surface,
    start: Similarity | None = None,
    *,
    scaled: bool = False,
) -> Similarity:
    """Motion of a surface onto another by the robust iteration of closest points; FitError if none.

    It is rigid, or a similarity if `scaled`. The motion from `start` to the result may be about 15
    degrees and 15 mm.
    """
    step = max(1, len(moving.points) // CLOSEST_POINTS)
    points, normals = moving.points[::step], moving.point_normals[::step]
    now = start or Similarity(1.0, np.eye(3), np.zeros(3))
    for _ in range(CLOSEST_POINT_ITERATIONS):
        p, n = now(points), normals @ now.rotation.T
        near = target.nearest(p, n)
        use = near.agrees & ~target.at_border(near)
        if use.sum() < 0.2 * len(points):
            raise FitError(
                f"{use.mean():.0%} of a surface are near the other with an agreeing normal, expected at "
                "least 20 %: check the unit, the frame, the side and the outer side"
            )
        p, foot, normal = p[use], near.foot[use], target.normals[near.triangle[use]]
        distance = np.einsum("ni,ni->n", foot - p, normal)
        width = 1.345 * max(1.4826 * float(np.median(np.abs(distance))), 1e-6)
        weight = np.sqrt(np.minimum(1.0, width / np.maximum(np.abs(distance), 1e-12)))
        centre = p.mean(axis=0)
        arm = p - centre
        columns = [np.cross(arm, normal), normal]
        if scaled:
            columns.append(np.einsum("ni,ni->n", arm, normal)[:, None])
        A = np.column_stack(columns)
        size = np.linalg.norm(arm, axis=1).max()
        unit = np.concatenate([np.full(3, size), np.ones(3), np.full(int(scaled), size)])
        x = np.linalg.lstsq(weight[:, None] * A / unit, weight * distance, rcond=None)[0] / unit
        turn = Rotation.from_rotvec(x[:3]).as_matrix()
        grow = 1.0 + (x[6] if scaled else 0.0)
        shift = centre + x[3:6] - grow * turn @ centre
        now = Similarity(grow * now.scale, turn @ now.rotation, grow * turn @ now.shift + shift)
        if np.abs(x * unit).max() < SETTLED_MOTION:
            break
    return now


@dataclass(frozen=True, eq=False)
class SmoothMap:
    """Map of points (n, 3): similarity and, if there are pairs, a smooth deviation from it."""

    similarity: Similarity
    deviation: RBFInterpolator | None = None

    @classmethod
    def through(
        cls, motion: Similarity, source: Floats, target: Floats, noise: Floats
    ) -> "SmoothMap":
        """Map of points (n, 3) to targets with standard deviations (n,) [m]."""
        deviation = RBFInterpolator(
            source, target - motion(source), kernel="linear", degree=0, smoothing=noise**2 / GROWTH
        )
        return cls(motion, deviation)

    def __call__(self, points: Floats) -> Floats:
        """Mapped points."""
        mapped = self.similarity(points)
        return mapped if self.deviation is None else mapped + self.deviation(points)

    def gradient(self, point: Floats, width: float = 5e-3) -> Floats:
        """Gradient (3, 3) at a point, by differences over `width` [m]."""
        ends = point + width * np.concatenate([np.eye(3), -np.eye(3)])
        mapped = self(ends)
        return np.asarray((mapped[:3] - mapped[3:]).T / (2.0 * width))


def smooth_map(
    motion: Similarity,
    pairs: Sequence[tuple[Surface, Surface]],
    marks: tuple[Floats, Floats, float] | None = None,
) -> SmoothMap:
    """Map of surfaces onto targets from a similarity, in rounds of nearest points.

    `marks` are landmarks (n, 3), their targets, and their standard deviation [m]. A point over a hole
    of its target, or several times as far from it as the others, is not paired.
    """
    mapping = SmoothMap(motion)
    for noise in POINT_SPREADS:
        source, target, spread = [], [], []
        for moving, aim in pairs:
            own = Surface(mapping(moving.points), moving.triangles)
            pick = np.arange(0, len(moving.points), max(1, len(moving.points) // MAP_CONTROLS))
            near = aim.nearest(own.points[pick], own.point_normals[pick])
            use = _paired(near, aim)
            source.append(moving.points[pick][use])
            target.append(near.foot[use])
            # in the other direction, so that no part of the target remains uncovered
            pick = np.arange(0, len(aim.points), max(1, len(aim.points) // MAP_CONTROLS))
            near = own.nearest(aim.points[pick], aim.point_normals[pick])
            back = _paired(near, own)
            corners = moving.points[own.triangles[near.triangle[back]]]
            source.append(np.einsum("nk,nki->ni", near.weights[back], corners))
            target.append(aim.points[pick][back])
            spread.append(np.full(int(use.sum() + back.sum()), noise))
        if marks is not None:
            source.append(marks[0])
            target.append(marks[1])
            spread.append(np.full(len(marks[0]), marks[2]))
        mapping = SmoothMap.through(
            motion, np.concatenate(source), np.concatenate(target), np.concatenate(spread)
        )
    return mapping


def _paired(near: Nearest, aim: Surface) -> np.ndarray:
    use = near.agrees & ~aim.at_border(near)
    if use.any():
        use &= near.distance <= 4.0 * np.median(near.distance[use]) + 0.5e-3
    return use
