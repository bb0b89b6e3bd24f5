"""Polylines between nodes or points inside elements, as segments and products of their derivatives."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from sim.checks import real_numbers, require
from sim.embedding import embed
from sim.errors import SceneError
from sim.indices import index, indices
from sim.mesh import Mesh
from sim.scene import Index
from sim.state import Array


@dataclass(frozen=True, eq=False)
@real_numbers
class LineFibre:
    """A polyline with one tension along its whole length, as over frictionless via points."""

    muscle: int  #: index into the names of its `LineMuscles`
    #: (k,) of int, nodes (the fibre is then parallel to edges); or (k, 3), rest positions [m] in the
    #: elements; at least two
    points: NDArray[Any]
    #: factor on the tension of the law [1], if several fibres divide the force of a muscle
    share: float = 1.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "muscle", index("a line fibre", "muscle", self.muscle, None))
        points = np.asarray(self.points)
        if points.ndim == 1 and points.dtype != bool:  # nodes in an order, which a mask has not
            points = indices("a line fibre", "node", points, None)
        elif points.ndim != 2 or points.shape[1] != 3 or points.dtype == bool:
            raise SceneError(
                f"line fibre has points of shape {points.shape} and type {points.dtype}, "
                "expected node indices (k,) or positions (k, 3)"
            )
        object.__setattr__(self, "points", points)
        if len(self.points) < 2:
            raise SceneError(f"line fibre has {len(self.points)} point, expected at least two")
        require(self, "share", self.share, least=0.0)


class Strands:
    """Segments d = D q of all fibres, and the pairs of segments coupled by the energy.

    Names are those of the muscles, for messages; `coupled` (n_fibres,) is True if the tension depends
    on the length or its rate; the tolerance is that of embedded points outside the mesh.
    """

    def __init__(
        self,
        fibres: Sequence[LineFibre],
        names: tuple[str, ...],
        coupled: NDArray[np.bool_],
        mesh: Mesh,
        tolerance: float,
    ) -> None:
        self.n_nodes = mesh.n_nodes
        rows, columns, values = list[Index](), list[Index](), list[Array]()
        fibre_of, n = list[int](), 0
        for k, fibre in enumerate(fibres):
            nodes, weights = _placed(fibre, mesh, tolerance)
            count = len(nodes) - 1
            for shift, sign in ((0, -1.0), (1, 1.0)):
                here = slice(shift, shift + count)
                rows.append(np.repeat(np.arange(n, n + count), nodes.shape[1]))
                columns.append(nodes[here].ravel())
                values.append(sign * weights[here].ravel())
            fibre_of += [k] * count
            n += count
        place = np.concatenate(rows), np.concatenate(columns)
        self.D = csr_array((np.concatenate(values), place), shape=(n, mesh.n_nodes))
        self.D.sum_duplicates()
        self.D.eliminate_zeros()
        self.fibre = np.array(fibre_of, dtype=np.int64)
        length = np.linalg.norm(product_of(self.D, mesh.X), axis=1)
        if not (length > 0.0).all():
            bad = int(self.fibre[np.argmin(length > 0.0)])
            raise SceneError(
                f"line fibre {bad} of muscle {names[fibres[bad].muscle]} has two "
                "successive points at the same position, expected segments of positive "
                "length"
            )
        own = np.arange(n)
        later = [
            (s, np.flatnonzero(self.fibre[s + 1 :] == self.fibre[s]) + s + 1)
            for s in own[coupled[self.fibre]]
        ]
        self.first = np.concatenate([own, *(np.full(len(t), s) for s, t in later)])
        self.second = np.concatenate([own, *(t for _, t in later)])

    def products(self) -> tuple[Index, Index, Array, NDArray[np.bool_]]:
        """Node-pair key, segment pair, coefficient and transposition of every product D_sa D_tb.

        Block (a, b), a <= b, of the stiffness is the sum of coefficient times block (s, t),
        transposed if the segments are in reverse order.
        """
        keys, pair, value, turned = list[Index](), list[Index](), list[Array](), list[bool]()
        sizes = list[int]()
        start, columns, data = self.D.indptr, self.D.indices, self.D.data
        for k, (s, t) in enumerate(zip(self.first, self.second, strict=True)):
            for one, other in ((s, t),) if s == t else ((s, t), (t, s)):
                a = columns[start[one] : start[one + 1]].astype(np.int64)
                b = columns[start[other] : start[other + 1]].astype(np.int64)
                product = np.outer(
                    data[start[one] : start[one + 1]], data[start[other] : start[other + 1]]
                )
                keep = a[:, None] <= b[None, :]
                pairs = (a[:, None] * self.n_nodes + b[None, :])[keep]
                keys.append(pairs)
                value.append(product[keep])
                pair.append(np.full(len(pairs), k))
                turned.append(one != s)
                sizes.append(len(pairs))
        return (
            np.concatenate(keys),
            np.concatenate(pair),
            np.concatenate(value),
            np.repeat(np.array(turned, dtype=bool), sizes),
        )


def _placed(fibre: LineFibre, mesh: Mesh, tolerance: float) -> tuple[Index, Array]:
    """Nodes (k, m) and weights (k, m) of every point of a fibre."""
    if fibre.points.ndim == 2:
        embedding = embed(mesh, fibre.points, tolerance=tolerance)
        return embedding.nodes, embedding.weights
    nodes = indices("a line fibre", "node", fibre.points, mesh.n_nodes)
    return nodes[:, None], np.ones((len(nodes), 1))


def product_of(matrix: csr_array, x: Array) -> Array:
    """Product as an array of floats."""
    return np.asarray(matrix @ x, dtype=np.float64)
