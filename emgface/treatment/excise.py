"""Excision of a part of a face: pieces of its columns, and pairs of nodes on the edges of the wound."""

from dataclasses import dataclass
from typing import Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.spatial import KDTree

from emgface.errors import TreatmentError
from emgface.face.lip_shape import lip_rim
from emgface.face.parts import FREE
from emgface.face.quality import element_quality
from emgface.treatment.columns import Chart, TissueColumns, columns_of
from emgface.treatment.outline import Outline
from emgface.treatment.pairing import chains, flat_tips, nearest_edges, paired_surfaces
from emgface.treatment.plane import (
    CutSurface,
    Degenerate,
    containing,
    cut_by_plane,
    inverse_bilinear,
    triangulated,
)

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

CUT_SURROUNDINGS: Final = 25e-3  #: distance from the outline within which cells may be divided [m]
OUTLINE_POINTS: Final = 201  #: points of a cut that removes nothing
SNAPS: Final = (0.25, 0.12, 0.04, 0.0)  #: fractions of an edge tried for moving nodes to the cut
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
    line: Floats | None = None  #: (n, 3) points of a cut that removes nothing [m]


def excise(
    face: xr.Dataset,
    outline: Outline,
    lip: str,
    method: str,
    fans: frozenset[int] = frozenset(),
    *,
    keep_markers: bool = True,
) -> Wound:
    """Remove the part of a face within an outline, by whole elements or by a conforming cut.

    Elements with one of the nodes `fans` of an earlier wound of the same outline are divided there.
    With `keep_markers`, nodes of markers are moved to the cut only if no other way is found.
    Raises TreatmentError if the wound has no two edges, contains fixed nodes, leaves the skin of the
    lip, or if its elements would be degenerate.
    """
    if outline.share > LARGEST_SHARE:
        raise TreatmentError(
            "too wide",
            f"{100 * outline.share:.0f} % of the margin of the {lip} lip is removed, expected at most "
            f"{100 * LARGEST_SHARE:.0f} %: the rest cannot be sutured directly",
        )
    rim = lip_rim(face)
    near = near_nodes(face, outline, lip)
    columns = columns_of(face, near)
    if not outline.polygon:
        return _slit(face, outline, columns, method)
    # stacks with a stress-free state of their own would be strained by a change of their thickness
    unstressed = "stress_free_position" not in face
    reasons: list[str] = []
    named = {int(n) for name in ("marker_node", "lip_opening_node") for n in face[name].values}
    still = frozenset(k for k, n in enumerate(sorted(columns.stack)) if n in named)
    choices = (still, frozenset[int]()) if keep_markers else (frozenset[int](),)
    ways = [(snap, kept) for kept in choices for snap in SNAPS]
    for snap, kept in ways if method == "conforming" else ((None, still),):
        try:
            surface = _surface(face, outline.chart, columns)
            if snap is not None:
                lines = list(outline.corners), list(outline.sides)
                cut_by_plane(surface, *lines, snap=snap, still=kept, restores=unstressed)
            margin = np.union1d(rim.upper, rim.lower)
            return _opened(face, outline, columns, surface, margin, fans)
        except Degenerate as error:
            reasons.append(str(error))
    raise TreatmentError(
        "degenerate",
        f"the elements at the cut would be degenerate ({reasons[-1]}), expected valid ones: move the "
        "excision by a millimetre, use method = 'elements', or a finer face",
    )


def _slit(face: xr.Dataset, outline: Outline, columns: TissueColumns, method: str) -> Wound:
    """Cut that removes nothing, whose edges meet where they were.

    The tied edges have no gap, so that the displacement is continuous across the cut, and the elements
    that it crosses keep their shape functions: in the terms of an enriched element, the jump is zero.
    Divided elements would interpolate another field, and move a node by up to 0.35 mm in a coarse mesh.
    The nodes of the suture are those of the edges nearest to the cut, which `method` = 'elements'
    follows; a conforming cut crosses the elements, whose fibres it cuts.
    """
    surface = _surface(face, outline.chart, columns)
    start, tip = map(np.array, outline.sides[0])
    nodes = sorted(columns.stack)
    chain = nearest_edges(surface, start, tip)
    stacks = np.array([columns.stack[nodes[v]] for v in chain])
    rows = np.repeat(stacks.reshape(-1, 1), 2, axis=1)
    position = face["position"].values.copy()
    connectivity = face["connectivity"].values.astype(np.int64)
    changed, line = np.zeros(len(connectivity), dtype=bool), position[stacks].reshape(-1, 3)
    if method == "conforming":
        along = start + np.linspace(0.0, 1.0, OUTLINE_POINTS)[:, None] * (tip - start)
        points: list[Floats] = []
        for at in along:
            here = containing(surface, at)
            if here is None:
                continue  # beyond the margin
            cell = surface.cells[here]
            weights = inverse_bilinear(np.array([surface.flat[v] for v in cell]), at)
            points.append(np.einsum("v,vsx->sx", weights, [surface.stack[v] for v in cell]))
            if weights.min() > 1e-6:  # inside, and not along an edge
                changed[columns.element[surface.owner[here]]] = True
        if not points:
            raise TreatmentError(
                "off the skin", "the incision is outside the skin of the lip: choose another place"
            )
        line = np.concatenate(points)
    free = face["stress_free_position"].values if "stress_free_position" in face else None
    if free is None:
        free = np.where(connectivity[..., None] < 0, 0.0, position[np.maximum(connectivity, 0)])
    attached = face["fixed"].values[rows[:, 0]] != FREE
    if 2 * attached.sum() > len(rows):
        raise TreatmentError(
            "bone",
            f"{int(attached.sum())} of {len(rows)} nodes at the incision are attached to bone: choose a "
            "smaller height",
        )
    own = np.arange(len(connectivity))
    return Wound(
        position, connectivity, free, own, changed, rows, position[rows[:, 0]], {}, 0.0, line
    )


def near_nodes(face: xr.Dataset, outline: Outline, lip: str) -> NDArray[np.bool_]:
    """Nodes of the region that may be divided: near the outline, and nearer to the lip's own margin."""
    rim = lip_rim(face)
    own, other = (rim.lower, rim.upper) if lip == "lower" else (rim.upper, rim.lower)
    position = face["position"].values
    points = np.array([p for side in outline.sides for p in side])
    flat = outline.chart.flat(position)
    low, high = points.min(axis=0) - CUT_SURROUNDINGS, points.max(axis=0) + CUT_SURROUNDINGS
    near = ((flat > low) & (flat < high)).all(axis=1)
    depth = (position - outline.chart.origin) @ outline.chart.out
    near &= np.abs(depth) < 45e-3
    away = [KDTree(position[margin]).query(position)[0] for margin in (own, other)]
    return near & (away[0] <= away[1] + 1e-9)


def _surface(face: xr.Dataset, chart: Chart, columns: TissueColumns) -> CutSurface:
    """Cells of the skin that face the chart, with local numbers of vertices."""
    position = face["position"].values
    nodes = sorted(columns.stack)
    local = {n: k for k, n in enumerate(nodes)}
    stack = [position[list(columns.stack[n])].copy() for n in nodes]
    flat = list(chart.flat(position[nodes]))
    surface = CutSurface(flat, stack, [], [])
    for k in range(len(columns.corner)):
        cell = [local[n] for n in columns.nodes(k)]
        if surface.area(cell) > 0.0:
            surface.cells.append(cell)
            surface.owner.append(k)
    if not surface.cells:
        raise TreatmentError(
            "off the skin", "the skin at the excision does not face outwards: choose another place"
        )
    return surface


def _opened(
    face: xr.Dataset,
    outline: Outline,
    columns: TissueColumns,
    surface: CutSurface,
    margin: Integers,
    folded: frozenset[int],
) -> Wound:
    """Remove the pieces inside, pair the edges of the wound, and rebuild the elements."""
    nodes = sorted(columns.stack)
    whole = {frozenset(n for n in columns.nodes(k)): k for k in range(len(columns.corner))}
    # Whole cells are removed by the middle of their corners, as pieces are
    middle = np.array([np.mean([surface.flat[v] for v in cell], axis=0) for cell in surface.cells])
    inside = outline.contains(middle)
    if not inside.any():
        raise TreatmentError(
            "too small",
            "the excision contains no element, expected at least one: use method = 'conforming', a "
            "finer face, or a larger excision",
        )
    edges = chains(surface, inside)
    at_margin = set(np.flatnonzero(np.isin(nodes, margin)).tolist())
    pairs, aims = paired_surfaces(surface, inside, edges, outline, at_margin)
    depth = columns.layers if outline.layers is None else min(outline.layers, columns.layers)
    made = _Elements(face, columns, surface, nodes, outline.chart)
    fans = flat_tips(surface, inside, pairs)
    fans |= {v for v, stack in made.stack.items() if not folded.isdisjoint(stack)}
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


class _Elements:
    """Elements of the face after an excision, and positions of their nodes."""

    def __init__(
        self,
        face: xr.Dataset,
        columns: TissueColumns,
        surface: CutSurface,
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
        stress_free: list[Floats] = []
        for depth in (1, 0):
            corners = self.free[parent][
                [own.index(self.columns.stack[n][layer + depth]) for n in names]
            ]
            for v in part:
                stress_free.append(inverse_bilinear(before, self.surface.flat[v]) @ corners)
        return np.array(stress_free)

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
        attached = np.append(self.face["fixed"].values, np.zeros(len(self.node_parents))) != FREE
        for node, parents in self.node_parents.items():
            attached[node] = attached[list(parents)].all()
        rows = self._rows(pairs, sheets)
        free = ~attached[rows].any(axis=1)
        if 2 * free.sum() < len(rows):
            raise TreatmentError(
                "bone",
                f"{len(rows) - int(free.sum())} of {len(rows)} pairs of nodes at the edges of the wound "
                "are attached to bone, where nothing can be brought together: choose a smaller height",
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
