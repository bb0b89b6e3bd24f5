"""Cutting of a surface of quadrilaterals and triangles along line segments in a plane.

The cells are those of the skin in a chart. Vertices near a segment are moved onto it along an edge,
so that no slivers arise. A vertex of a curved surface that moves along a chord flattens it; the stacks
of the moved vertices become thicker or thinner by lengths that restore the volume. The cells are then
divided along the segments into convex pieces, whose common edges agree. Every vertex carries its stack
of positions through the thickness.
"""

from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from emgface.errors import FaceError
from emgface.face.quality import element_quality

Floats = NDArray[np.float64]
Point = tuple[float, float]

ON: Final = 1e-9  #: distance from a segment below which a vertex is on it [m]
PROBED: Final = 1e-6  #: length by which a stack is moved to find the change of the volume [m]
SECANTS: Final = 3  #: steps to the volume
#: share of its area that a cell keeps at least when a vertex is moved [1]
LEAST_CELL_AREA_SHARE: Final = 0.15


class Degenerate(FaceError):
    """Elements at the cut are not valid for one choice of moved nodes."""


@dataclass(eq=False)
class CutSurface:
    """Cells of a surface, vertices with coordinates in the chart and stacks, and parents.

    `flat` are the coordinates [m] and `stack` the positions (layers + 1, 3) [m] of every vertex. A
    vertex that was added has as its parents the original vertices of the edge or cell it lies on.
    `cells` are lists of vertices counter-clockwise, and `owner` is the original cell of each.
    """

    flat: list[Floats]
    stack: list[Floats]
    cells: list[list[int]]
    owner: list[int]
    parents: dict[int, frozenset[int]] = field(default_factory=dict[int, frozenset[int]])

    def add(self, weights: dict[int, float], parents: frozenset[int] | None = None) -> int:
        """Add a vertex as the weighted sum of others, and return its number."""
        self.flat.append(np.sum([w * self.flat[v] for v, w in weights.items()], axis=0))
        self.stack.append(np.sum([w * self.stack[v] for v, w in weights.items()], axis=0))
        new = len(self.flat) - 1
        origins = [self.parents.get(v, frozenset((v,))) for v in weights]
        self.parents[new] = parents or frozenset[int]().union(*origins)
        return new

    def move(self, vertex: int, weights: dict[int, float]) -> None:
        """Move a vertex to the weighted sum of others and itself."""
        flat = np.sum([w * self.flat[v] for v, w in weights.items()], axis=0)
        self.stack[vertex] = np.sum([w * self.stack[v] for v, w in weights.items()], axis=0)
        self.flat[vertex] = flat

    def volume(self) -> float:
        """Volume beneath all cells, which have three or four vertices [m^3]."""
        sheets = len(self.stack[0])
        rows = [
            [v * sheets + layer + k for k in (1, 0) for v in cell]
            for cell in self.cells
            for layer in range(sheets - 1)
        ]
        padded = np.array([row + [-1] * (8 - len(row)) for row in rows])
        return float(element_quality(np.concatenate(self.stack), padded).volume.sum())

    def area(self, cell: list[int]) -> float:
        """Signed area of a polygon in the chart [m^2]."""
        x = np.array([self.flat[v] for v in cell])
        y = np.roll(x, -1, axis=0)
        return 0.5 * float(np.sum(x[:, 0] * y[:, 1] - x[:, 1] * y[:, 0]))

    def edges(self) -> dict[tuple[int, int], int]:
        """Number of cells of every edge, its smaller vertex first."""
        count: dict[tuple[int, int], int] = {}
        for cell in self.cells:
            for a, b in zip(cell, cell[1:] + cell[:1], strict=True):
                key = (min(a, b), max(a, b))
                count[key] = count.get(key, 0) + 1
        return count


def cut_by_plane(
    surface: CutSurface,
    corners: list[Point],
    segments: list[tuple[Point, Point]],
    *,
    snap: float,
    still: frozenset[int] = frozenset(),
    restores: bool = True,
) -> None:
    """Divide the cells of a surface along segments, whose corners inside it become vertices.

    Vertices closer to a segment than the fraction `snap` of an edge are moved onto it, except those
    that stay `still`; with `restores`, the volume remains that of the whole cells. Raises Degenerate if
    a corner cannot be made a vertex, because the mesh is too coarse there.
    """
    rim = {v for edge, n in surface.edges().items() if n == 1 for v in edge}
    locked: set[int] = set(still)
    volume, before = surface.volume(), [stack.copy() for stack in surface.stack]
    for corner in corners:
        _snap_corner(surface, np.array(corner), rim, locked)
    ends = [(np.array(a), np.array(b)) for a, b in segments]
    _warp(surface, ends, rim, locked, snap)
    moved = [
        v for v, (a, b) in enumerate(zip(before, surface.stack, strict=True)) if (a != b).any()
    ]
    if restores:
        _restore_volume(surface, moved, volume)
    _split(surface, ends)


def _restore_volume(surface: CutSurface, moved: list[int], volume: float) -> None:
    """Move the outer ends of the stacks of moved vertices along them, to a volume of all cells.

    Lengths are proportional to the change of the volume by each, so that their sum of squares is the
    least to first order; inner ends, which lie on teeth and bone, are not moved.
    """
    if not moved:
        return
    start = [surface.stack[v].copy() for v in moved]
    share = np.linspace(1.0, 0.0, len(start[0]))[:, None]
    out = [one[0] - one[-1] for one in start]
    ways = [share * way / max(float(np.linalg.norm(way)), 1e-12) for way in out]

    def moved_by(lengths: Floats) -> float:
        for v, one, way, length in zip(moved, start, ways, lengths, strict=True):
            surface.stack[v] = one + length * way
        return surface.volume() - volume

    lost = moved_by(np.zeros(len(moved)))
    slope = np.array([(moved_by(PROBED * unit) - lost) / PROBED for unit in np.eye(len(moved))])
    steepest = float(slope @ slope)
    if steepest == 0.0:
        return
    low, scale = 0.0, 1.0
    at = {low: lost, scale: moved_by(-lost / steepest * slope)}
    for _ in range(SECANTS):  # the volume is a cubic of the lengths
        if at[scale] == at[low]:
            break
        low, scale = scale, scale - at[scale] * (scale - low) / (at[scale] - at[low])
        at[scale] = moved_by(-scale * lost / steepest * slope)


def _snap_corner(surface: CutSurface, at: Floats, rim: set[int], locked: set[int]) -> None:
    """Move the nearest vertex of the cell that contains a corner onto it."""
    here = containing(surface, at)
    if here is None:
        return
    around = _around(surface)
    cell = surface.cells[here]
    nearest = sorted(
        cell, key=lambda v: (round(float(np.linalg.norm(surface.flat[v] - at)), 12), v)
    )
    for vertex in nearest:
        if vertex in locked or vertex in rim:
            continue
        weights = inverse_bilinear(np.array([surface.flat[v] for v in cell]), at)
        if _moved(surface, vertex, dict(zip(cell, weights.tolist(), strict=True)), around):
            locked.add(vertex)
            return
    raise Degenerate(
        "the corners of the excision are closer to each other or to the edge of the mesh than its "
        "nodes, expected at least one node for each: use a finer face (emgface build face "
        "--resolution), method = 'elements', or a larger excision"
    )


def _around(surface: CutSurface) -> dict[int, list[int]]:
    """Cells at every vertex."""
    cells: dict[int, list[int]] = {}
    for k, cell in enumerate(surface.cells):
        for v in cell:
            cells.setdefault(v, []).append(k)
    return cells


def _moved(
    surface: CutSurface, vertex: int, weights: dict[int, float], around: dict[int, list[int]]
) -> bool:
    """Move a vertex unless a cell would lose most of its area or become concave."""
    before = surface.flat[vertex], surface.stack[vertex]
    old = [surface.area(surface.cells[k]) for k in around[vertex]]
    surface.move(vertex, weights)
    good = all(
        surface.area(surface.cells[k]) > LEAST_CELL_AREA_SHARE * a
        and _convex(surface, surface.cells[k])
        for k, a in zip(around[vertex], old, strict=True)
    )
    if not good:
        surface.flat[vertex], surface.stack[vertex] = before
    return good


def _convex(surface: CutSurface, cell: list[int]) -> bool:
    x = np.array([surface.flat[v] for v in cell])
    a, b = x - np.roll(x, 1, axis=0), np.roll(x, -1, axis=0) - x
    return bool((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0] > -1e-12).all())


def containing(surface: CutSurface, at: Floats) -> int | None:
    """Return the first cell that contains a point of the chart (2,), or None."""
    for k, cell in enumerate(surface.cells):
        x = np.array([surface.flat[v] for v in cell])
        side = np.roll(x, -1, axis=0) - x
        if (side[:, 0] * (at[1] - x[:, 1]) - side[:, 1] * (at[0] - x[:, 0]) >= 0.0).all():
            return k
    return None


def inverse_bilinear(corners: Floats, at: Floats) -> Floats:
    """Shape functions of a quadrilateral or triangle (k, 2) at a point of its plane, shape (k,)."""
    if len(corners) == 3:
        solved = np.linalg.solve(np.vstack([corners.T, np.ones(3)]), np.append(at, 1.0))
        return np.asarray(solved, dtype=np.float64)
    xi = np.zeros(2)
    signs = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    for _ in range(30):
        one, two = 1.0 + signs[:, 0] * xi[0], 1.0 + signs[:, 1] * xi[1]
        N = 0.25 * one * two
        slope = 0.25 * np.stack([signs[:, 0] * two, signs[:, 1] * one])
        move = np.linalg.lstsq((slope @ corners).T, at - N @ corners)[0]
        xi = xi + np.clip(move, -1.0, 1.0)
        if np.abs(move).max() < 1e-14:
            break
    return 0.25 * (1.0 + signs[:, 0] * xi[0]) * (1.0 + signs[:, 1] * xi[1])


def _crossings(
    surface: CutSurface, segment: tuple[Floats, Floats], edges: NDArray[np.int64]
) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    """Place on every edge (n, 2), place on the segment, and mask of the edges crossed inside."""
    a, b = segment
    x = np.array(surface.flat)
    normal = np.array([a[1] - b[1], b[0] - a[0]]) / np.linalg.norm(b - a)
    away = (x - a) @ normal
    away[np.abs(away) < ON] = 0.0
    first, last = away[edges[:, 0]], away[edges[:, 1]]
    crossed = first * last < 0.0
    t = np.where(crossed, first / np.where(crossed, first - last, 1.0), 0.0)
    at = x[edges[:, 0]] + t[:, None] * (x[edges[:, 1]] - x[edges[:, 0]])
    u = (at - a) @ (b - a) / ((b - a) @ (b - a))
    return t, u, crossed & (u > 0.0) & (u < 1.0)


def _warp(
    surface: CutSurface,
    segments: list[tuple[Floats, Floats]],
    rim: set[int],
    locked: set[int],
    snap: float,
) -> None:
    """Move vertices near a segment onto it, the nearest first."""
    counted = surface.edges()
    edges = np.array(sorted(counted), dtype=np.int64)
    outer = np.array([counted[a, b] == 1 for a, b in edges.tolist()])
    around = _around(surface)
    refused: set[tuple[int, int]] = set()
    for v, point in enumerate(surface.flat):
        if any(on_segment(point, s) for s in segments):
            locked.add(v)
    while True:
        best: tuple[float, int, int, int, float] | None = None
        for segment in segments:
            t, _, inside = _crossings(surface, segment, edges)
            for k in np.flatnonzero(inside & (np.minimum(t, 1.0 - t) < snap)):
                near, far = edges[k] if t[k] < 0.5 else edges[k][::-1]
                share = float(min(t[k], 1.0 - t[k]))
                if near in locked or (near, far) in refused or (near in rim and not outer[k]):
                    continue
                length = float(np.linalg.norm(surface.flat[near] - surface.flat[far]))
                candidate = (round(share * length, 12), int(near), int(far), int(k), share)
                best = candidate if best is None or candidate < best else best
        if best is None:
            return
        _, near, far, _, share = best
        if _moved(surface, near, {near: 1.0 - share, far: share}, around):
            locked.add(near)
        else:
            refused.add((near, far))


def on_segment(point: Floats, segment: tuple[Floats, Floats]) -> bool:
    """Return True if a point is on a segment, up to `ON`."""
    a, b = segment
    along = (point - a) @ (b - a) / ((b - a) @ (b - a))
    if not -1e-9 <= along <= 1.0 + 1e-9:
        return False
    return bool(np.linalg.norm(point - a - along * (b - a)) < ON)


def _split(surface: CutSurface, segments: list[tuple[Floats, Floats]]) -> None:
    """Divide the cells along the segments."""
    edges = np.array(sorted(surface.edges()), dtype=np.int64)
    on: list[set[int]] = [
        {v for v, point in enumerate(surface.flat) if on_segment(point, s)} for s in segments
    ]
    added: dict[tuple[int, int], list[tuple[float, int]]] = {}
    for s, segment in enumerate(segments):
        t, _, inside = _crossings(surface, segment, edges)
        for k in np.flatnonzero(inside):
            a, b = map(int, edges[k])
            new = surface.add({a: 1.0 - float(t[k]), b: float(t[k])})
            added.setdefault((a, b), []).append((float(t[k]), new))
            on[s].add(new)
    cells: list[list[int]] = []
    owner: list[int] = []
    for cell, own in zip(surface.cells, surface.owner, strict=True):
        pieces = [_with_added(cell, added)]
        for s, segment in enumerate(segments):
            pieces = [part for piece in pieces for part in _divided(surface, piece, on[s], segment)]
        cells += pieces
        owner += [own] * len(pieces)
    surface.cells, surface.owner = cells, owner


def _with_added(
    cell: list[int], added: dict[tuple[int, int], list[tuple[float, int]]]
) -> list[int]:
    """Cell with the vertices that were added on its edges."""
    vertices: list[int] = []
    for a, b in zip(cell, cell[1:] + cell[:1], strict=True):
        here = sorted(added.get((min(a, b), max(a, b)), []))
        vertices += [a, *(v for _, v in (here if a < b else here[::-1]))]
    return vertices


def _divided(
    surface: CutSurface, piece: list[int], on: set[int], segment: tuple[Floats, Floats]
) -> list[list[int]]:
    """Divide a convex piece by the chord between two of its vertices on a segment, if any."""
    a, b = segment
    mine = sorted(
        (k for k, v in enumerate(piece) if v in on),
        key=lambda k: float((surface.flat[piece[k]] - a) @ (b - a)),
    )
    for i, j in zip(mine[:-1], mine[1:], strict=True):
        low, high = min(i, j), max(i, j)
        if high - low in (1, len(piece) - 1):
            continue
        one, two = piece[low : high + 1], piece[high:] + piece[: low + 1]
        if min(surface.area(one), surface.area(two)) <= 0.0:
            continue
        return _divided(surface, one, on, segment) + _divided(surface, two, on, segment)
    return [piece]


def triangulated(
    surface: CutSurface, piece: list[int], fans: frozenset[int] = frozenset()
) -> list[list[int]]:
    """Divide a piece into convex quadrilaterals and triangles with the largest smallest quality.

    A piece with a vertex among the `fans` is divided into triangles at this vertex.

    A good quadrilateral is not divided. Otherwise, the division is the optimum over all
    triangulations, by dynamic programming; the quality of a triangle is its area over the sum of
    its squared edges.
    """
    x = np.array([surface.flat[v] for v in piece])
    at = next((k for k, v in enumerate(piece) if v in fans), None)
    if at is not None and len(piece) > 3:
        turned = piece[at:] + piece[:at]
        parts = [[turned[0], b, c] for b, c in zip(turned[1:-1], turned[2:], strict=True)]
        if min(surface.area(part) for part in parts) > 0.02 * surface.area(piece):
            return parts
    if len(piece) == 3 or (len(piece) == 4 and _square(x) > 0.3):
        return [piece]
    n = len(piece)

    def quality(i: int, j: int, k: int) -> float:
        a, b, c = x[i], x[j], x[k]
        twice = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        return float(twice / (np.sum((a - b) ** 2) + np.sum((b - c) ** 2) + np.sum((c - a) ** 2)))

    best: dict[tuple[int, int], tuple[float, float, int]] = {}
    for size in range(2, n):
        for i in range(n - size):
            j = i + size
            options: list[tuple[float, float, int]] = []
            for k in range(i + 1, j):
                own = quality(i, k, j)
                low = best[i, k] if k - i > 1 else (np.inf, 0.0, -1)
                high = best[k, j] if j - k > 1 else (np.inf, 0.0, -1)
                options.append((min(own, low[0], high[0]), own + low[1] + high[1], k))
            best[i, j] = max(options, key=lambda o: (round(o[0], 9), round(o[1], 9), o[2]))

    def collect(i: int, j: int) -> list[list[int]]:
        if j - i < 2:
            return []
        k = best[i, j][2]
        return [[piece[i], piece[k], piece[j]], *collect(i, k), *collect(k, j)]

    return collect(0, n - 1)


def _square(x: Floats) -> float:
    """Smallest scaled Jacobian of the corners of a quadrilateral."""
    a, b = np.roll(x, -1, axis=0) - x, np.roll(x, 1, axis=0) - x
    cross = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    lengths = np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1)
    return float((cross / np.where(lengths > 0.0, lengths, np.inf)).min())
