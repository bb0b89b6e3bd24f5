"""Shaded pictures of a body: cameras, light and a z-buffer in numpy.

The page has the same cameras, colours and light (`page/surface.js`), by WebGL.
"""

from collections.abc import Mapping
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from emgface.pictures.body import MOUTH, Body

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

VIEWS: Final[Mapping[str, tuple[float, float]]] = {
    "front": (0.0, 0.0),
    "left": (-90.0, 0.0),
    "right": (90.0, 0.0),
    "oblique": (-35.0, 5.0),
}
"""Yaw and pitch of the camera in degrees, by view."""
PICTURE_VIEWS: Final = ("front", "left", "oblique")  #: the three views shown in a picture

LIGHT: Final[Mapping[str, object]] = {
    "ambient": 0.50,
    "sky": 0.14,
    "key": 0.42,
    "key_from": (-0.34, 0.46, 0.82),
    "gloss": 0.10,
    "power": 22.0,
    "shadow": (0.10, -0.02, -0.08),
    "inside": 0.8,
}
"""Light in the frame of the camera (right, up, towards it). The brightness of a colour is
ambient + sky (1 + up) / 2 + key max(0, n·key_from); colours in the shadow are shifted by `shadow`, as
those of skin; gloss is a Blinn-Phong highlight. The colour of a back face, such as the far edge of the
skin seen from within, is its own in the light of its side with the weight `inside`, mixed with that of
the oral cavity."""

DISPLACEMENT: Final = (
    (0.955, 0.925, 0.855),
    (0.985, 0.740, 0.550),
    (0.925, 0.425, 0.400),
    (0.640, 0.190, 0.490),
    (0.300, 0.080, 0.440),
)
"""Colours from no displacement (light) to the largest (dark), suitable for colour-blind readers."""


class Window(NamedTuple):
    """Window in the plane of a picture: lower left and upper right corner [m]."""

    left: float
    bottom: float
    right: float
    top: float


def axes_of(view: tuple[float, float]) -> Floats:
    """Unit vectors (3, 3), in rows: right and up in the picture, and towards the camera."""
    a, b = np.radians(view)
    sa, ca, sb, cb = np.sin(a), np.cos(a), np.sin(b), np.cos(b)
    return np.array([[-ca, sa, 0.0], [-sa * sb, -ca * sb, cb], [sa * cb, ca * cb, sb]])


def project(points: NDArray[np.floating], view: tuple[float, float]) -> Floats:
    """Coordinates (n, 3) [m]: right and up in the picture, and towards the camera."""
    return np.asarray(points, dtype=np.float64) @ axes_of(view).T


def window_of(points: NDArray[np.floating], view: tuple[float, float], margin: float) -> Window:
    """Window around points, with a margin as a fraction of their extent."""
    flat = project(points, view)[:, :2]
    low, high = flat.min(axis=0), flat.max(axis=0)
    edge = margin * float((high - low).max())
    return Window(*(low - edge).tolist(), *(high + edge).tolist())


def normals(points: Floats, triangle: Indices) -> Floats:
    """Unit normals (n, 3) of points, the means of those of their triangles, weighted by area."""
    a, b, c = (points[triangle[:, k]] for k in range(3))
    own = np.cross(b - a, c - a)
    total = np.zeros_like(points)
    for corner in range(3):
        for axis in range(3):
            total[:, axis] += np.bincount(triangle[:, corner], own[:, axis], minlength=len(points))
    length = np.linalg.norm(total, axis=1, keepdims=True)
    return total / np.where(length > 0.0, length, 1.0)


def render(
    body: Body,
    position: NDArray[np.floating],
    view: tuple[float, float],
    window: Window,
    width: int,
    *,
    colour: Floats | None = None,
    finer: int = 2,
) -> NDArray[np.uint8]:
    """Draw a body by an orthographic camera, as sRGB and opacity (height, width, 4).

    `position` (n, 3) are the nodes of its skin [m], `view` the yaw and pitch of the camera
    [degrees], `window` the visible part of the plane and `width` the pixels across it, from which
    the height follows. `colour` (n, 3) is sRGB of the nodes of the skin, instead of that of the
    body; `finer` is the number of samples per pixel along both sides.
    """
    scale = finer * width / (window.right - window.left)
    height = max(1, round((window.top - window.bottom) * scale / finer))
    size = finer * height, finer * width
    points, triangle = body.points(position), body.triangle
    paint = body.colour if colour is None else body.coloured(colour)
    normal, seen = normals(points, triangle), project(points, view)
    on_screen = np.stack(
        [(seen[:, 0] - window.left) * scale, (window.top - seen[:, 1]) * scale], axis=1
    )
    pixel, face, weight = nearest_layer(on_screen, seen[:, 2], triangle, size)
    # Light is computed at the points, which are dense, and interpolated.
    turned = normal @ axes_of(view).T
    lit = shaded(paint, turned)[triangle]
    a, b, c = (on_screen[triangle[:, k]] for k in range(3))
    behind = _twice_the_area(a, b, c) >= 0.0
    back = shaded(paint, -turned)[triangle[behind]]
    lit[behind] = MOUTH + float(LIGHT["inside"]) * (back - MOUTH)  # pyright: ignore[reportArgumentType]
    own = (weight[:, :, None] * lit[face]).sum(axis=1)
    picture = np.zeros((size[0] * size[1], 4))
    picture[pixel, :3], picture[pixel, 3] = own, 1.0
    picture = picture.reshape(height, finer, width, finer, 4).mean(axis=(1, 3))
    picture[..., :3] /= np.maximum(picture[..., 3:], 1e-9)
    return np.round(255.0 * np.clip(picture, 0.0, 1.0)).astype(np.uint8)


def shaded(colour: Floats, normal: Floats) -> Floats:
    """Light colours (n, 3) of a surface with normals in the frame of the camera, by `LIGHT`."""
    ambient, sky, key, gloss, power = (
        float(LIGHT[name])  # pyright: ignore[reportArgumentType]
        for name in ("ambient", "sky", "key", "gloss", "power")
    )
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    n = normal / np.where(length > 0.0, length, 1.0)
    source = np.array(LIGHT["key_from"], dtype=np.float64)
    source /= np.linalg.norm(source)
    direct = np.maximum(0.0, n @ source)
    bright = ambient + sky * 0.5 * (1.0 + n[:, 1]) + key * direct
    half = source + [0.0, 0.0, 1.0]
    half /= np.linalg.norm(half)
    shine = gloss * np.maximum(0.0, n @ half) ** power
    warm = 1.0 + np.array(LIGHT["shadow"]) * (1.0 - direct)[:, None]
    return np.clip(colour * warm * bright[:, None] + shine[:, None], 0.0, 1.0)


def nearest_layer(
    points: Floats, depth: Floats, triangle: Indices, size: tuple[int, int]
) -> tuple[Indices, Indices, Floats]:
    """Find the triangle nearest to the camera in every covered pixel.

    `points` (n, 2) are positions from the left and from the top [pixels], `depth` (n,) is towards
    the camera, and `size` is height and width [pixels]. Returns the pixels (row times width plus
    column), their triangles, and the barycentric coordinates (pixels, 3) of the centres of the
    pixels.
    """
    height, width = size
    corner = points[triangle]
    low, high = corner[..., 1].min(axis=1), corner[..., 1].max(axis=1)
    first = np.clip(np.ceil(low - 0.5), 0, height).astype(np.int64)
    last = np.clip(np.ceil(high - 0.5), 0, height).astype(np.int64)
    owner, row = _ranges(first, last)
    y = row + 0.5
    # Pixels of a row between two edges; half-open intervals assign each pixel to one triangle.
    left, right = np.full(len(row), np.inf), np.full(len(row), -np.inf)
    mine = corner[owner]
    for k in range(3):
        p, q = mine[:, k], mine[:, (k + 1) % 3]
        crossed = (p[:, 1] <= y) != (q[:, 1] <= y)
        step = np.where(crossed, q[:, 1] - p[:, 1], 1.0)
        x = p[:, 0] + (y - p[:, 1]) / step * (q[:, 0] - p[:, 0])
        left = np.where(crossed, np.minimum(left, x), left)
        right = np.where(crossed, np.maximum(right, x), right)
    hit = right > left
    first = np.clip(np.ceil(np.where(hit, left, 0.0) - 0.5), 0, width).astype(np.int64)
    last = np.clip(np.ceil(np.where(hit, right, 0.0) - 0.5), 0, width).astype(np.int64)
    line, column = _ranges(first, last)
    owner, pixel = owner[line], row[line] * width + column
    a, b, c = (corner[:, k] for k in range(3))
    ab, ac = b - a, c - a
    area = _twice_the_area(a, b, c)
    area = np.where(area != 0.0, area, 1.0)[:, None]
    # Weights of b and c, and therefore the depth, are linear in the picture.
    slope_b = np.stack([ac[:, 1], -ac[:, 0]], axis=1) / area
    slope_c = np.stack([-ab[:, 1], ab[:, 0]], axis=1) / area
    da, db, dc = (depth[triangle[:, k]] for k in range(3))
    slope = slope_b * (db - da)[:, None] + slope_c * (dc - da)[:, None]
    offset = da - (slope * a).sum(axis=1)
    x, y = column + 0.5, y[line]
    far = offset[owner] + slope[owner, 0] * x + slope[owner, 1] * y
    closest = np.full(height * width, -np.inf)
    np.maximum.at(closest, pixel, far)
    best = np.flatnonzero(far == closest[pixel])
    front = np.full(height * width, -1)
    front[pixel[best]] = best  # one of those that are equally near
    chosen = front[front >= 0]
    owner = owner[chosen]
    place = np.stack([x[chosen], y[chosen]], axis=1) - a[owner]
    wb, wc = ((slope[owner] * place).sum(axis=1) for slope in (slope_b, slope_c))
    return pixel[chosen], owner, np.stack([1.0 - wb - wc, wb, wc], axis=1)


def _twice_the_area(a: Floats, b: Floats, c: Floats) -> Floats:
    """Signed area, negative for counter-clockwise corners with rows counted downwards."""
    return (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])


def _ranges(first: Indices, last: Indices) -> tuple[Indices, Indices]:
    """All integers from first to last, each with the index of its range."""
    count = np.maximum(last - first, 0)
    owner = np.repeat(np.arange(len(first)), count)
    offset = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    return owner, first[owner] + offset
