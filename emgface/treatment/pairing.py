"""Edges of a wound in the skin as chains of vertices, and the pairs that meet in its suture."""

from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from emgface.errors import TreatmentError
from emgface.treatment.outline import Outline
from emgface.treatment.plane import CutSurface, Degenerate

Floats = NDArray[np.float64]

MATCH: Final = 0.4  #: fraction of a segment within which nodes of both edges are paired as they are


def chains(surface: CutSurface, inside: NDArray[np.bool_]) -> list[list[int]]:
    """Edges of the wound as chains of vertices, with the tissue on their left."""
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
        raise TreatmentError(
            "off the lip",
            f"the excision divides the lip into {len(chains) + 1} parts or does not reach its margin, "
            "expected a wound with two edges from the margin inwards: choose another place or size",
        )
    return chains


def nearest_edges(surface: CutSurface, start: Floats, tip: Floats) -> list[int]:
    """Vertices from the tip of a slit to the margin, along the edges of cells nearest to it."""
    counted = surface.edges()
    x = np.array(surface.flat)
    down = (tip - start) / np.linalg.norm(tip - start)
    length = float((tip - start) @ down)
    along, across = (x - start) @ down, np.abs((x - start) @ np.array([-down[1], down[0]]))
    rows, columns = np.array(sorted(counted)).T
    # edges away from the line are longer
    cost = np.linalg.norm(x[rows] - x[columns], axis=1) * (
        1.0 + 1e3 * (across[rows] + across[columns])
    )
    graph = coo_matrix((cost, (rows, columns)), shape=(len(x), len(x)))
    margin = np.array(sorted({v for edge, n in counted.items() if n == 1 for v in edge}))
    first = int(margin[np.argmin(across[margin] + 10.0 * (along[margin] > 0.5 * length))])
    away = np.linalg.norm(x - tip, axis=1)
    away[first] = np.inf
    last = int(np.argmin(away))
    before = dijkstra(graph, directed=False, indices=np.array([first]), return_predecessors=True)[
        1
    ][0]
    path = [last]
    while path[-1] != first and before[path[-1]] >= 0:
        path.append(int(before[path[-1]]))
    if len(path) < 2 or path[-1] != first:
        raise TreatmentError(
            "too small",
            "no edges of the mesh follow the incision, expected some: choose a longer incision or a "
            "finer face",
        )
    return path


def paired_surfaces(
    surface: CutSurface,
    inside: NDArray[np.bool_],
    chains: list[list[int]],
    outline: Outline,
    margin: set[int],
) -> tuple[list[tuple[int, int]], list[Floats]]:
    """Vertices that meet in the suture, and where; vertices are added where the edges do not match."""
    chain = chains[0]
    ends = [surface.parents.get(v, frozenset((v,))) for v in (chain[0], chain[-1])]
    if not all(end <= margin for end in ends):
        raise TreatmentError(
            "off the lip",
            "the excision does not begin and end at the margin of the lip, expected both edges of the "
            "wound to reach it: choose another place or size",
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
            raise TreatmentError(
                "too small",
                "an edge of the wound has no node between its ends, expected some on both edges: use "
                "method = 'conforming', a finer face or a larger excision",
            )
        middle = _middle(surface, part, np.array(tip))
        own = _matched(surface, inside, part[middle::-1], part[middle:])
        pairs += own
        aims += list(_aims(surface, own))
    return pairs, aims


def _middle(surface: CutSurface, part: list[int], tip: Floats) -> int:
    """Place of the tip in a chain: of the nodes about as close, the one nearest to half its length."""
    x = np.array([surface.flat[v] for v in part])
    length = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(x, axis=0), axis=1)))
    away = np.linalg.norm(x - tip, axis=1)
    away[[0, -1]] = np.inf
    near = np.flatnonzero(away < away.min() + 1e-6)
    return int(near[np.argmin(np.round(np.abs(length[near] / length[-1] - 0.5), 9))])


def _aims(surface: CutSurface, pairs: list[tuple[int, int]]) -> Floats:
    """Positions (pairs, layers + 1, 3) at which the pairs of a suture meet [m].

    They lie on the line of the middles of the pairs, at the mean arc length along both edges, so that
    edges that are laid on each other, as the lower one of a rectangle, do not become a point.
    """
    stack = np.array([[surface.stack[a], surface.stack[b]] for a, b in pairs])
    middle = stack.mean(axis=1)
    steps = np.linalg.norm(np.diff(stack, axis=0), axis=-1).mean(axis=1)  # pair, sheet
    aims = middle.copy()
    for sheet in range(middle.shape[1]):
        s = np.append(0.0, np.cumsum(steps[:, sheet]))
        along = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(middle[:, sheet], axis=0), axis=1)))
        if along[-1] > 0.0:
            at = s / s[-1] * along[-1]
            aims[:, sheet] = np.stack(
                [np.interp(at, along, middle[:, sheet, k]) for k in range(3)], axis=-1
            )
    return aims


def _matched(
    surface: CutSurface, inside: NDArray[np.bool_], left: list[int], right: list[int]
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
    surface: CutSurface, inside: NDArray[np.bool_], arm: list[int]
) -> dict[frozenset[int], int]:
    """Index of the piece of tissue at every edge of an arm."""
    wanted = {frozenset(pair) for pair in zip(arm[:-1], arm[1:], strict=True)}
    owners: dict[frozenset[int], int] = {}
    for k, cell in enumerate(surface.cells):
        if not inside[k]:
            for a, b in zip(cell, cell[1:] + cell[:1], strict=True):
                if frozenset((a, b)) in wanted:
                    owners[frozenset((a, b))] = k
    return owners


def _inserted(
    surface: CutSurface, owners: dict[frozenset[int], int], a: int, b: int, share: float
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


def flat_tips(
    surface: CutSurface, inside: NDArray[np.bool_], pairs: list[tuple[int, int]]
) -> frozenset[int]:
    """Tips of the wound at which the corner of an element would become straight when it is closed.

    The two edges at a tip are laid on each other; an element with one of them and a right angle at the
    tip is then flat there, and is divided.
    """
    tips = {a for a, b in pairs if a == b}
    flat: set[int] = set()
    wound = {v for pair in pairs for v in pair}
    gone: set[frozenset[int]] = set()
    for cell, out in zip(surface.cells, inside.tolist(), strict=True):
        if out:
            gone.update(frozenset(edge) for edge in zip(cell, cell[1:] + cell[:1], strict=True))
    for cell, out in zip(surface.cells, inside.tolist(), strict=True):
        for at, v in enumerate(cell if not out else ()):
            edges = frozenset((cell[at - 1], v)), frozenset((v, cell[(at + 1) % len(cell)]))
            if len(cell) > 3 and v in wound and edges[0] in gone and edges[1] in gone:
                flat.add(v)  # a corner of the tissue, which is opened to a straight edge
        for tip in tips.intersection(cell) if not out else ():
            at = cell.index(tip)
            a, b = (surface.flat[cell[(at + k) % len(cell)]] - surface.flat[tip] for k in (1, -1))
            cosine = float(a @ b / (np.linalg.norm(a) * np.linalg.norm(b)))
            if len(cell) > 3 and cosine < 0.5:
                flat.add(tip)
    return frozenset(flat)
