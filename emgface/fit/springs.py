"""Springs from points of the mesh to fixed targets, as a term of a scene."""

from dataclasses import dataclass

import numpy as np

from emgface.fit.triangulated import Floats, Integers
from sim.scene import CompiledTerm, Contribution, Layout, Term
from sim.state import Control


@dataclass(frozen=True, eq=False)
class Rows:
    """Springs with the energy 1/2 r'W r, r = sum_k weights_k x_k - target, one per row."""

    nodes: Integers  #: (n, 3) nodes of the point; its nodes are those of one element
    weights: Floats  #: (n, 3) [1]
    target: Floats  #: (n, 3) [m]
    stiffness: Floats  #: (n, 3, 3) symmetric W [N/m]

    def joined(self, *others: "Rows") -> "Rows":
        """All springs."""
        parts = (self, *others)
        return Rows(
            np.concatenate([p.nodes for p in parts]),
            np.concatenate([p.weights for p in parts]),
            np.concatenate([p.target for p in parts]),
            np.concatenate([p.stiffness for p in parts]),
        )


NO_ROWS = Rows(
    np.zeros((0, 3), dtype=np.int64), np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 3, 3))
)


def at_nodes(nodes: Integers, target: Floats, stiffness: Floats) -> Rows:
    """Springs at nodes (n,), with W of shape (n, 3, 3) [N/m]."""
    weights = np.zeros((len(nodes), 3))
    weights[:, 0] = 1.0
    return Rows(np.repeat(nodes[:, None], 3, axis=1), weights, target, stiffness)


def along_normal(area: Floats, normal: Floats, stiffness: float, tangential: float) -> Floats:
    """W (n, 3, 3) of springs along normals (n, 3), softer across by the factor `tangential`.

    `stiffness` is per area (n,) [Pa/m].
    """
    W = (1.0 - tangential) * normal[:, :, None] * normal[:, None, :] + tangential * np.eye(3)
    return (stiffness * area)[:, None, None] * W


def across(length: Floats, tangent: Floats, stiffness: float, tangential: float) -> Floats:
    """W (n, 3, 3) of springs across tangents (n, 3) of a curve, softer along it; per length [Pa]."""
    W = np.eye(3) - (1.0 - tangential) * tangent[:, :, None] * tangent[:, None, :]
    return (stiffness * length)[:, None, None] * W


@dataclass(frozen=True, eq=False)
class Springs(Term):
    """Springs to targets that may be exchanged in the compiled system (`CompiledSprings.to`).

    They couple no pairs of nodes of their own: those of a row belong to one element of the tissue.
    """

    def compile(self, layout: Layout) -> "CompiledSprings":
        """Springs without rows."""
        return CompiledSprings(layout, NO_ROWS)


class CompiledSprings(CompiledTerm):
    """Springs of one set of rows; their stiffness is constant."""

    def __init__(self, layout: Layout, rows: Rows) -> None:
        self._layout, self._rows = layout, rows
        pattern, n = layout.pattern, layout.mesh.n_nodes
        places, values = [np.zeros((0, 9), dtype=np.int32)], [np.zeros((0, 9))]
        for i in range(3):
            for j in range(3):
                a, b = rows.nodes[:, i], rows.nodes[:, j]
                upper = a <= b
                both = rows.weights[upper, i] * rows.weights[upper, j]
                places.append(pattern.target[pattern.pair_index(a[upper] * n + b[upper])])
                values.append((both[:, None, None] * rows.stiffness[upper]).reshape(-1, 9))
        place, value = np.concatenate(places), np.concatenate(values)
        stored = place >= 0
        self._K = np.bincount(place[stored], value[stored], minlength=pattern.nnz)

    def to(self, rows: Rows) -> "CompiledSprings":
        """Springs with other rows in the same scene."""
        return CompiledSprings(self._layout, rows)

    def add(self, q: Floats, control: Control, f: Floats, K: Floats | None = None) -> Contribution:
        """F -= W r at the nodes, and K += W."""
        rows = self._rows
        r = np.einsum("rk,rki->ri", rows.weights, q[rows.nodes]) - rows.target
        force = np.einsum("rij,rj->ri", rows.stiffness, r)
        for axis in range(3):
            own = rows.weights * force[:, axis, None]
            f[:, axis] -= np.bincount(rows.nodes.ravel(), own.ravel(), minlength=len(f))
        if K is not None:
            K += self._K
        return Contribution(0.5 * float((r * force).sum()))
