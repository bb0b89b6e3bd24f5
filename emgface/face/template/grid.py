"""O-grid of the template: rays from the mouth slit, rings around it, three layers.

Rays are numbered around the mouth from the upper midline over the left corner, the lower midline
and the right corner; rings from the margin of the lips outwards; sheets from the inner surface to
the skin. Ray r and ray (R - r) mod R are mirror images.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from emgface.errors import FaceError
from emgface.face.template.outline import RING_CURVES

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

LAYER_COUNT: Final = 3
#: named numbers of elements
FACE_RESOLUTIONS: Final = {"coarse": 576, "medium": 2448, "fine": 6480}
RAYS_PER_STEP: Final = 24
"""Number of rays is a multiple of this, so that midlines, corners and markers lie on rays."""
MARKER_RAY: Final = {"paramedian": 1.0 / 6.0, "lateral": 0.5}
"""Rays q of the lip markers, at the peak of the Cupid's bow and midway to the corner."""
RINGS_OVER_RAYS: Final = 0.36
_SHARES: Final = np.array([0.18, 0.31, 0.28, 0.23])
"""Fraction of the rings between one curve of the outline and the next."""


@dataclass(frozen=True)
class Grid:
    """Numbers of rays and of rings between the curves of the outline."""

    rays: int
    rings: tuple[int, int, int, int]

    @property
    def n_rings(self) -> int:
        """Number of elements from the margin of the lips to the rim."""
        return sum(self.rings)

    @property
    def shape(self) -> tuple[int, int, int]:
        """Nodes over rays, rings and sheets."""
        return self.rays, self.n_rings + 1, LAYER_COUNT + 1

    @cached_property
    def s(self) -> Floats:
        """Ring coordinate of every ring of nodes, shape (n_rings + 1,)."""
        parts = [
            np.linspace(low, high, n, endpoint=False)
            for low, high, n in zip(RING_CURVES[:-1], RING_CURVES[1:], self.rings, strict=True)
        ]
        return np.concatenate([*parts, [1.0]])

    @cached_property
    def left_rays(self) -> tuple[Floats, Floats]:
        """Coordinates q and lip of the rays from the upper over the left to the lower midline."""
        quarter = self.rays // 4
        q = np.arange(quarter + 1) / quarter
        upper, lower = np.ones(quarter + 1), -np.ones(quarter)
        return np.concatenate([q, q[-2::-1]]), np.concatenate([upper, lower])

    @cached_property
    def index(self) -> Integers:
        """Node at (ray, ring, sheet)."""
        return np.arange(np.prod(self.shape)).reshape(self.shape)

    @cached_property
    def connectivity(self) -> Integers:
        """Elements (n, 8) in VTK order, rings within rays within layers."""
        here = self.index
        after = np.roll(here, -1, axis=0)
        # In front view the directions up, left (of the face) and down are clockwise.
        corners = (here[:, :-1], after[:, :-1], after[:, 1:], here[:, 1:])
        quads = np.stack(corners, axis=-1)
        rows = [
            np.concatenate([quads[:, :, k], quads[:, :, k + 1]], axis=-1).reshape(-1, 8)
            for k in range(LAYER_COUNT)
        ]
        return np.concatenate(rows)

    @cached_property
    def layer(self) -> Integers:
        """Layer of every element."""
        return np.repeat(np.arange(LAYER_COUNT), self.rays * self.n_rings)

    @cached_property
    def element_place(self) -> tuple[Integers, Integers]:
        """Ray and ring of every element."""
        ray, ring = np.divmod(np.arange(self.rays * self.n_rings), self.n_rings)
        return np.tile(ray, LAYER_COUNT), np.tile(ring, LAYER_COUNT)

    @cached_property
    def mirror_element(self) -> Integers:
        """Mirror image of each element."""
        ray, ring = self.element_place
        return (self.layer * self.rays + (self.rays - 1 - ray)) * self.n_rings + ring

    @cached_property
    def mirror_node(self) -> Integers:
        """Mirror image of each node."""
        return self.index[-np.arange(self.rays) % self.rays].reshape(-1)

    def unfold(self, left: Floats) -> Floats:
        """All rays from those of the left half, for values (left rays, ...) that are even in x."""
        return np.concatenate([left, left[-2:0:-1]])

    def positions(self, skin: Floats, inner: Floats, skin_share: Floats) -> Floats:
        """Node positions (nodes, 3) [m] from the two surfaces of the left half.

        `skin` and `inner` (left rays, rings, 3) [m] have x positive to the left, the result to the
        right; `skin_share` (left rays, rings) is the thickness of the outer layer relative to the
        total.
        """
        below = (1.0 - skin_share)[..., None]
        sheets = [inner, inner + 0.5 * below * (skin - inner), inner + below * (skin - inner), skin]
        left = np.stack(sheets, axis=2)
        left[[0, -1], ..., 0] = 0.0
        every = self.unfold(left)
        every[: len(left), ..., 0] *= -1.0
        return every.reshape(-1, 3)


def refined_grid(k: int) -> Grid:
    """Coarse grid with every edge of its surface divided into k: 24 k rays, 8 k rings.

    In contrast to the named resolutions, these grids are refined proportionally, for convergence
    studies. Raises FaceError if k is below 1.
    """
    if k < 1:
        raise FaceError(f"the refinement of the grid is {k}, expected a number >= 1")
    return Grid(RAYS_PER_STEP * k, (k, 3 * k, 2 * k, 2 * k))


def make_grid(resolution: str | int | Grid) -> Grid:
    """Return the grid for a name of `FACE_RESOLUTIONS` or an approximate number of elements.

    Raises FaceError if the name is unknown or the number below 400 or above 200 000.
    """
    if isinstance(resolution, Grid):
        return resolution
    if isinstance(resolution, str):
        if resolution not in FACE_RESOLUTIONS:
            raise FaceError(
                f"the resolution is {resolution!r}, expected one of {', '.join(FACE_RESOLUTIONS)} or a "
                "number of elements"
            )
        wanted = FACE_RESOLUTIONS[resolution]
    else:
        wanted = int(resolution)
    if not 400 <= wanted <= 200_000:
        raise FaceError(f"the resolution is {wanted} elements, expected 400 to 200000")
    columns = wanted / LAYER_COUNT
    steps = max(1, round(np.sqrt(columns / RINGS_OVER_RAYS) / RAYS_PER_STEP))
    rays = steps * RAYS_PER_STEP
    total = max(6, round(columns / rays))
    rings = np.maximum(1, np.floor(_SHARES * total)).astype(int)
    while rings.sum() < total:
        rings[np.argmax(_SHARES * total - rings)] += 1
    # A third of the perioral rings is a whole number at every resolution, so that orbicularis oris
    # has the same edges at every resolution.
    rings[1] = max(3, 3 * round(rings[1] / 3))
    while rings.sum() > total and rings[2:].max() > 1:
        rings[2 + np.argmax(rings[2:])] -= 1
    while rings.sum() < total:
        rings[2 + np.argmin(rings[2:])] += 1
    return Grid(rays, (int(rings[0]), int(rings[1]), int(rings[2]), int(rings[3])))
