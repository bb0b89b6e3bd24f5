"""Excision of a part of a face: pieces of its columns, and pairs of nodes on the edges of the wound."""

from dataclasses import dataclass
from typing import Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.spatial import KDTree

from emgface.errors import FaceError
from emgface.face.lip_shape import lip_rim
from emgface.face.parts import FREE
from emgface.face.quality import element_quality
from emgface.treatment.columns import Chart, Columns, columns_of
from emgface.treatment.outline import Outline
from emgface.treatment.plane import (
    Degenerate,
    Surface,
    cut,
    inverse_bilinear,
    on_segment,
    triangulated,
)

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

AROUND: Final = 25e-3  #: distance from the outline within which cells may be divided [m]
SNAPS: Final = (0.25, 0.12, 0.04, 0.0)  #: fractions of an edge tried for moving nodes to the cut
MATCH: Final = 0.4  #: fraction of a segment within which nodes of both edges are paired as they are
LARGEST_SHARE: Final = 0.75  #: removed fraction of the margin beyond which nothing can be sutured


@dataclass(frozen=True, eq=False)
class Wound:
    """Face with a wound, before it is closed.

    `position` (nodes, 3) are those of the face after the excision, with unused nodes; `connectivity`
    (elements, 8), `parent` (elements,) the element of the face from which each comes, `changed` mask
    of the elements that are not whole. `pairs` are nodes (n, 2) that meet in the suture, with the
    skin first. `node_parents` are the original nodes of every added node.
    """

    position: Floats
    connectivity: Integers
    stress_free: Floats
    parent: Integers
    changed: NDArray[np.bool_]
    pairs: Integers
    aims: Floats  #: (n, 3) positions at which the pairs first meet [m]
    node_parents: dict[int, frozenset[int]]
    removed: float  #: volume [m^3]


def excise(face: xr.Dataset, outline: Outline, lip: str, method: str) -> Wound:
    """Remove the part of a face within an outline, by whole elements or by a conforming cut.

    Raises FaceError if the wound has no two edges, contains fixed nodes, leaves the skin of the lip,
    or if its elements would be degenerate.
    """
    if outline.share > LARGEST_SHARE:
        raise FaceError(
            f"{100 * outline.share:.0f} % of the margin of the {lip} lip is removed, expected at most "
            f"{100 * LARGEST_SHARE:.0f} %: the rest cannot be sutured directly"
        )
    rim = lip_rim(face)
    near = near_nodes(face, outline, lip)
    columns = columns_of(face, near)
    reasons: list[str] = []
    named = {int(n) for name in ("marker_node", "lip_opening_node") for n in face[name].values}
    still = frozenset(k for k, n in enumerate(sorted(columns.stack)) if n in named)
    # nodes of markers are moved only if the elements would otherwise be degenerate
    ways = [(snap, kept) for kept in (still, frozenset[int]()) for snap in SNAPS]
    for snap, kept in ways if method == "conforming" else ((None, still),):
        try:
            surface = _surface(face, outline.chart, columns)
            if snap is not None:
                lines = list(outline.corners), list(outline.sides)
                cut(surface, *lines, snap=snap, still=kept)
            return _opened(face, outline, columns, surface, np.union1d(rim.upper, rim.lower))
        except Degenerate as error:
            reasons.append(str(error))
    raise FaceError(
        f"the elements at the cut would be degenerate ({reasons[-1]}), expected valid ones: move the "
        "excision by a millimetre, use method = 'elements', or a finer face"
    )


def near_nodes(face: xr.Dataset, outline: Outline, lip: str) -> NDArray[np.bool_]:
    """Nodes of the region that may be divided: near the outline, and nearer to the lip's own margin."""
    rim = lip_rim(face)
    own, other = (rim.lower, rim.upper) if lip == "lower" else (rim.upper, rim.lower)
    position = face["position"].values
    points = np.array([p for side in outline.sides for p in side])
    flat = outline.chart.flat(position)
    low, high = points.min(axis=0) - AROUND, points.max(axis=0) + AROUND
    near = ((flat > low) & (flat < high)).all(axis=1)
    depth = (position - outline.chart.origin) @ outline.chart.out
    near &= np.abs(depth) < 45e-3
    away = [KDTree(position[margin]).query(position)[0] for margin in (own, other)]
    return near & (away[0] <= away[1] + 1e-9)


def _surface(face: xr.Dataset, chart: Chart, columns: Columns) -> Surface:
    """Cells of the skin that face the chart, with local numbers of vertices."""
    position = face["position"].values
    nodes = sorted(columns.stack)
    local = {n: k for k, n in enumerate(nodes)}
    stack = [position[list(columns.stack[n])].copy() for n in nodes]
    flat = list(chart.flat(position[nodes]))
    surface = Surface(flat, stack, [], [])
    for k in range(len(columns.corner)):
        cell = [local[n] for n in columns.nodes(k)]
        if surface.area(cell) > 0.0:
            surface.cells.append(cell)
            surface.owner.append(k)
    if not surface.cells:
        raise FaceError("the skin at the excision does not face outwards: choose another place")
    return surface


def _opened(
    face: xr.Dataset, outline: Outline, columns: Columns, surface: Surface, margin: Integers
) -> Wound:
    """Remove the pieces inside, pair the edges of the wound, and rebuild the elements."""
    nodes = sorted(columns.stack)
    whole = {frozenset(n for n in columns.nodes(k)): k for k in range(len(columns.corner))}
    # Whole cells are removed by the middle of their corners, as pieces are
    middle = np.array([np.mean([surface.flat[v] for v in cell], axis=0) for cell in surface.cells])
    inside = outline.contains(middle)
    if outline.polygon and not inside.any():
        raise FaceError(
            "the excision contains no element, expected at least one: use method = 'conforming', a "
            "finer face, or a larger excision"
        )
    chains = _chains(surface, inside, outline)
    at_margin = set(np.flatnonzero(np.isin(nodes, margin)).tolist())
    pairs, aims = _paired(surface, inside, chains, outline, at_margin)
    fans = _flat_tips(surface, inside, pairs)
    depth = columns.layers if outline.layers is None else min(outline.layers, columns.layers)
    made = _Elements(face, columns, surface, nodes, outline.chart)
    removed = 0.0
    for cell, own, gone in zip(surface.cells, surface.owner, inside.tolist(), strict=True):
        unchanged = whole.get(frozenset(nodes[v] if v < len(nodes) else -1 for v in cell)) == own
        unchanged = unchanged and not fans.intersection(cell)
        for layer in range(columns.layers):
            if gone and layer < depth:
                removed += made.volume(cell, layer)
            elif unchanged and not (made.free is not None and made.moved(cell)):
                made.keep(own, layer)
            else:
                made.divide(cell, own, layer, fans)
    sheets = columns.layers + 1 if depth == columns.layers else depth
    return made.wound(pairs, aims, sheets, removed)


def _chains(surface: Surface, inside: NDArray[np.bool_], outline: Outline) -> list[list[int]]:
    """Edges of the wound as chains of vertices, with the tissue on their left.

    A slit has one chain down to its tip, in place of two.
    """
    if not outline.polygon:
        start, tip = map(np.array, outline.sides[0])
        on = [
            (float(np.linalg.norm(p - tip)), v)
            for v, p in enumerate(surface.flat)
            if on_segment(p, (start, tip))
        ]
        return [[v for _, v in sorted(on)]]  # from the tip
    gone: set[tuple[int, int]] = set()
    for cell, out in zip(surface.cells, inside.tolist(), strict=True):
        if out:
            gone.update(zip(cell, cell[1:] + cell[:1], strict=True))
    after: dict[int, int] = {}
    for cell, out in zip(surface.cells, inside.tolist(), strict=True):
        for a, b in zip(cell, cell[1:] + cell[:1], strict=True):
            if not out and (b, a) in gone:
                if a in after:
                    raise Degenerate("the wound touches itself")
                after[a] = b
    starts = sorted(set(after) - set(after.values()))
    chains: list[list[int]] = []
    for start in starts:
        chain = [start]
        while chain[-1] in after:
            chain.append(after[chain[-1]])
        chains.append(chain)
    if len(chains) != 1 or len(chains[0]) != len(after) + 1:
        raise FaceError(
            f"the excision divides the lip into {len(chains) + 1} parts or does not reach its margin, "
            "expected a wound with two edges from the margin inwards: choose another place or size"
        )
    return chains


def _paired(
    surface: Surface,
    inside: NDArray[np.bool_],
    chains: list[list[int]],
    outline: Outline,
    margin: set[int],
) -> tuple[list[tuple[int, int]], list[Floats]]:
    """Vertices that meet in the suture, and where; vertices are added where the edges do not match."""
    if not outline.polygon:
        return [(v, v) for v in chains[0]], [surface.stack[v] for v in chains[0]]
    chain = chains[0]
    ends = [surface.parents.get(v, frozenset((v,))) for v in (chain[0], chain[-1])]
    if not all(end <= margin for end in ends):
        raise FaceError(
            "the excision does not begin and end at the margin of the lip, expected both edges of the "
            "wound to reach it: choose another place or size"
        )

    def closest(points: tuple[tuple[float, float], ...], among: list[int]) -> list[int]:
        away = [
            [float(np.linalg.norm(surface.flat[v] - np.array(p))) for v in among] for p in points
        ]
        return [int(np.argmin(np.round(row, 9))) for row in away]

    bounds = [0, *sorted(closest(outline.peaks, chain)), len(chain) - 1]
    pairs: list[tuple[int, int]] = []
    aims: list[Floats] = []
    for first, last, tip in zip(bounds[:-1], bounds[1:], outline.tips, strict=True):
        part = chain[first : last + 1]
        if len(part) < 3:
            raise FaceError(
                "an edge of the wound has no node between its ends, expected some on both edges: use "
                "method = 'conforming', a finer face or a larger excision"
            )
        middle = _middle(surface, part, np.array(tip))
        own = _matched(surface, inside, part[middle::-1], part[middle:])
        pairs += own
        aims += list(_aims(surface, own))
    return pairs, aims


def _middle(surface: Surface, part: list[int], tip: Floats) -> int:
    """Place of the tip in a chain: of the nodes about as close, the one nearest to half its length."""
    x = np.array([surface.flat[v] for v in part])
    length = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(x, axis=0), axis=1)))
    away = np.linalg.norm(x - tip, axis=1)
    away[[0, -1]] = np.inf
    near = np.flatnonzero(away < away.min() + 1e-6)
    return int(near[np.argmin(np.round(np.abs(length[near] / length[-1] - 0.5), 9))])


def _aims(surface: Surface, pairs: list[tuple[int, int]]) -> Floats:
    """Positions (pairs, layers + 1, 3) at which the pairs of a suture meet [m].

    They lie on the line of the middles of the pairs, at the mean arc length along both edges, so that
    edges that are laid on each other, as the lower one of a rectangle, do not become a point.
    """
    stack = np.array([[surface.stack[a], surface.stack[b]] for a, b in pairs])
    middle = stack.mean(axis=1)
    steps = np.linalg.norm(np.diff(stack, axis=0), axis=-1).mean(axis=1)  # pair, sheet
    found = middle.copy()
    for sheet in range(middle.shape[1]):
        s = np.append(0.0, np.cumsum(steps[:, sheet]))
        along = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(middle[:, sheet], axis=0), axis=1)))
        if along[-1] > 0.0:
            at = s / s[-1] * along[-1]
            found[:, sheet] = np.stack(
                [np.interp(at, along, middle[:, sheet, k]) for k in range(3)], axis=-1
            )
    return found


def _matched(
    surface: Surface, inside: NDArray[np.bool_], left: list[int], right: list[int]
) -> list[tuple[int, int]]:
    """Pairs along two edges of a wound from their common tip, by normalised arc length."""

    def places(arm: list[int]) -> Floats:
        x = np.array([surface.stack[v][0] for v in arm])
        length = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(x, axis=0), axis=1)))
        return length / length[-1]

    s, t = places(left), places(right)
    pairs, i, j = [(left[0], right[0])], 1, 1
    where = {"left": _owners(surface, inside, left), "right": _owners(surface, inside, right)}
    last_i = last_j = 0.0
    here = {"left": left[0], "right": right[0]}
    while i < len(left) and j < len(right):
        gap = min(s[i] - last_i, t[j] - last_j)
        final = i == len(left) - 1 and j == len(right) - 1
        one_left = i == len(left) - 1 or j == len(right) - 1
        if final or (not one_left and abs(s[i] - t[j]) <= MATCH * gap):
            pairs.append((left[i], right[j]))
            here = {"left": left[i], "right": right[j]}
            last_i, last_j, i, j = s[i], t[j], i + 1, j + 1
        elif s[i] < t[j]:
            share = (s[i] - last_j) / (t[j] - last_j)
            new = _inserted(surface, where["right"], here["right"], right[j], float(share))
            pairs.append((left[i], new))
            here = {"left": left[i], "right": new}
            last_i, last_j, i = s[i], s[i], i + 1
        else:
            share = (t[j] - last_i) / (s[i] - last_i)
            new = _inserted(surface, where["left"], here["left"], left[i], float(share))
            pairs.append((new, right[j]))
            here = {"left": new, "right": right[j]}
            last_i, last_j, j = t[j], t[j], j + 1
    return pairs


def _owners(
    surface: Surface, inside: NDArray[np.bool_], arm: list[int]
) -> dict[frozenset[int], int]:
    """Index of the piece of tissue at every edge of an arm."""
    wanted = {frozenset(pair) for pair in zip(arm[:-1], arm[1:], strict=True)}
    found: dict[frozenset[int], int] = {}
    for k, cell in enumerate(surface.cells):
        if not inside[k]:
            for a, b in zip(cell, cell[1:] + cell[:1], strict=True):
                if frozenset((a, b)) in wanted:
                    found[frozenset((a, b))] = k
    return found


def _inserted(
    surface: Surface, owners: dict[frozenset[int], int], a: int, b: int, share: float
) -> int:
    """Add a vertex on the edge from a to b of a piece."""
    piece = owners.pop(frozenset((a, b)))
    new = surface.add({a: 1.0 - share, b: share})
    cell = surface.cells[piece]
    place = cell.index(a)
    at = place + 1 if cell[(place + 1) % len(cell)] == b else place
    surface.cells[piece] = cell[:at] + [new] + cell[at:] if at else [*cell, new]
    for v in (a, b):
        owners[frozenset((v, new))] = piece
    return new


def _flat_tips(
    surface: Surface, inside: NDArray[np.bool_], pairs: list[tuple[int, int]]
) -> frozenset[int]:
    """Tips of the wound at which the corner of an element would become straight when it is closed.

    The two edges at a tip are laid on each other; an element with one of them and a right angle at the
    tip is then flat there, and is divided.
    """
    tips = {a for a, b in pairs if a == b}
    if len(tips) == len(pairs):
        return frozenset()
    found: set[int] = set()
    wound = {v for pair in pairs for v in pair}
    gone: set[frozenset[int]] = set()
    for cell, out in zip(surface.cells, inside.tolist(), strict=True):
        if out:
            gone.update(frozenset(edge) for edge in zip(cell, cell[1:] + cell[:1], strict=True))
    for cell, out in zip(surface.cells, inside.tolist(), strict=True):
        for at, v in enumerate(cell if not out else ()):
            edges = frozenset((cell[at - 1], v)), frozenset((v, cell[(at + 1) % len(cell)]))
            if len(cell) > 3 and v in wound and edges[0] in gone and edges[1] in gone:
                found.add(v)  # a corner of the tissue, which is opened to a straight edge
        for tip in tips.intersection(cell) if not out else ():
            at = cell.index(tip)
            a, b = (surface.flat[cell[(at + k) % len(cell)]] - surface.flat[tip] for k in (1, -1))
            cosine = float(a @ b / (np.linalg.norm(a) * np.linalg.norm(b)))
            if len(cell) > 3 and cosine < 0.5:
                found.add(tip)
    return frozenset(found)


class _Elements:
    """Elements of the face after an excision, and positions of their nodes."""

    def __init__(
        self,
        face: xr.Dataset,
        columns: Columns,
        surface: Surface,
        nodes: list[int],
        chart: Chart,
    ) -> None:
        self.chart = chart
        self.face, self.columns, self.surface, self.nodes = face, columns, surface, nodes
        self.connectivity = face["connectivity"].values.astype(np.int64)
        self.position = face["position"].values.copy()
        self.free = face["stress_free_position"].values if "stress_free_position" in face else None
        n = len(self.position)
        self.stack = {k: columns.stack[node] for k, node in enumerate(nodes)}
        extra: list[Floats] = []
        self.node_parents: dict[int, frozenset[int]] = {}
        for k in range(len(nodes), len(surface.flat)):
            line: list[int] = []
            for sheet in range(columns.layers + 1):
                new = n + len(extra)
                self.node_parents[new] = frozenset(
                    columns.stack[nodes[p]][sheet] for p in surface.parents[k]
                )
                extra.append(surface.stack[k][sheet])
                line.append(new)
            self.stack[k] = tuple(line)
        for k, node in enumerate(nodes):
            self.position[list(columns.stack[node])] = surface.stack[k]
        self.position = np.concatenate([self.position, np.array(extra).reshape(-1, 3)])
        touched = np.zeros(len(self.connectivity), dtype=bool)
        for own in surface.owner:
            touched[columns.element[own]] = True
        self.kept = np.flatnonzero(~touched).tolist()
        self.rows: list[tuple[list[int], int, Floats]] = []

    def keep(self, column: int, layer: int) -> None:
        """Keep a whole element."""
        self.kept.append(int(self.columns.element[column, layer]))

    def _corners(self, part: list[int], layer: int) -> list[int]:
        """Nodes of the element beneath a quadrilateral or triangle of the skin."""
        low, high = ([self.stack[v][layer + k] for v in part] for k in (1, 0))
        return low + high

    def volume(self, cell: list[int], layer: int) -> float:
        """Volume of a removed piece [m^3]."""
        total = 0.0
        for part in triangulated(self.surface, cell):
            row = self._corners(part, layer)
            padded = np.array([row + [-1] * (8 - len(row))])
            total += float(element_quality(self.position, padded).volume[0])
        return total

    def divide(self, cell: list[int], column: int, layer: int, fans: frozenset[int]) -> None:
        """Add the elements beneath a piece of a cell."""
        parent = int(self.columns.element[column, layer])
        for part in triangulated(self.surface, cell, fans):
            row = self._corners(part, layer)
            free = self.position[row] if self.free is None else self._free(part, column, layer)
            self.rows.append((row, parent, free))

    def _free(self, part: list[int], column: int, layer: int) -> Floats:
        """Stress-free corners of a piece of an element that already has some."""
        assert self.free is not None
        parent = int(self.columns.element[column, layer])
        own = self.connectivity[parent].tolist()
        names = self.columns.nodes(column)
        before = self.surface_before(column)
        found: list[Floats] = []
        for depth in (1, 0):
            corners = self.free[parent][
                [own.index(self.columns.stack[n][layer + depth]) for n in names]
            ]
            for v in part:
                found.append(inverse_bilinear(before, self.surface.flat[v]) @ corners)
        return np.array(found)

    def surface_before(self, column: int) -> Floats:
        """Corners of a cell in the chart before nodes were moved."""
        position = self.face["position"].values[self.columns.nodes(column)]
        return self.chart.flat(position)

    def moved(self, cell: list[int]) -> bool:
        """Return True if a corner of a cell was moved."""
        position = self.face["position"].values
        corners = [(self.stack[v][0], self.surface.stack[v][0]) for v in cell]
        return any((position[n] != x).any() for n, x in corners)

    def _ties(self, pairs: list[tuple[int, int]], sheets: int) -> NDArray[np.bool_]:
        """Mask of the pairs of nodes that meet; those attached to bone stay where they are."""
        held = np.append(self.face["fixed"].values, np.zeros(len(self.node_parents))) != FREE
        for node, parents in self.node_parents.items():
            held[node] = held[list(parents)].all()
        rows = self._rows(pairs, sheets)
        free = ~held[rows].any(axis=1)
        if 2 * free.sum() < len(rows):
            raise FaceError(
                f"{len(rows) - int(free.sum())} of {len(rows)} pairs of nodes at the edges of the wound "
                "are attached to bone, where nothing can be brought together: choose a smaller height"
            )
        return free

    def _rows(self, pairs: list[tuple[int, int]], sheets: int) -> Integers:
        rows = [(self.stack[a][k], self.stack[b][k]) for a, b in pairs for k in range(sheets)]
        return np.array(rows, dtype=np.int64).reshape(-1, 2)

    def wound(
        self, pairs: list[tuple[int, int]], aims: list[Floats], sheets: int, removed: float
    ) -> Wound:
        """Collect all elements; degenerate ones are refused."""
        kept = np.array(sorted(self.kept), dtype=np.int64)
        rows = [row + [-1] * (8 - len(row)) for row, _, _ in self.rows]
        new = np.array(rows, dtype=np.int64).reshape(-1, 8)
        connectivity = np.concatenate([self.connectivity[kept], new])
        quality = element_quality(self.position, connectivity)
        bad = (quality.smallest_det <= 0.0) | (quality.scaled_jacobian < 0.01)
        before = element_quality(self.face["position"].values, self.connectivity)
        poor = before.scaled_jacobian[kept] < 0.02
        bad[: len(kept)] &= ~poor
        if bad.any():
            raise Degenerate(
                f"{int(bad.sum())} elements with a scaled Jacobian down to "
                f"{float(quality.scaled_jacobian[bad].min()):.2g}"
            )
        free = np.zeros((len(connectivity), 8, 3))
        whole = self.position[np.where(connectivity < 0, 0, connectivity)]
        free[:] = np.where(connectivity[..., None] < 0, 0.0, whole)
        if self.free is not None:
            free[: len(kept)] = self.free[kept]
            for k, (row, _, corners) in enumerate(self.rows):
                free[len(kept) + k, : len(row)] = corners
        meet = self._ties(pairs, sheets)
        return Wound(
            self.position,
            connectivity,
            free,
            np.concatenate([kept, np.array([p for _, p, _ in self.rows], dtype=np.int64)]),
            np.arange(len(connectivity)) >= len(kept),
            self._rows(pairs, sheets)[meet],
            np.array([aim[:sheets] for aim in aims]).reshape(-1, 3)[meet],
            self.node_parents,
            removed,
        )
