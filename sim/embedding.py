"""Points inside elements: the element of each point, and its shape functions."""

from dataclasses import dataclass

import numpy as np

from sim.elements import ElementType
from sim.errors import MeshError
from sim.mesh import Mesh
from sim.pattern import Array, Index

MAX_ITERATIONS = 50
INSIDE = 1e-9  #: tolerance for negative shape functions [1]


@dataclass(frozen=True, eq=False)
class Embedding:
    """Embedded points x = sum_a weights_a x_a, which move with the mesh."""

    element: Index  #: (n,) element of each point
    nodes: Index  #: (n, 8) its nodes; an element with fewer nodes repeats its first
    #: (n, 8) shape functions at the point [1], zero for repeated nodes; their sum is 1
    weights: Array


def embed(mesh: Mesh, points: Array, *, tolerance: float = 1e-6) -> Embedding:
    """Find points in a mesh by inverting the isoparametric map.

    Newton's method solves sum_a N_a(xi) X_a = p in every element whose bounding box contains p; p
    is inside if no N_a(xi) is negative.

    Parameters
    ----------
    mesh : Mesh
    points : (n, 3) rest positions [m].
    tolerance : float
        Largest absolute value of a negative shape function [1]; larger tolerances accept points
        outside, whose weights extrapolate.

    Raises
    ------
    MeshError
        A point is not finite or lies in no element; the message states it and its nearest node.
    """
    points = np.asarray(points, dtype=np.float64).reshape(-1, 3)
    if not np.isfinite(points).all():
        bad = int(np.argmin(np.isfinite(points).all(axis=1)))
        raise MeshError(f"point {bad} to embed is not finite: {points[bad]}")
    n = len(points)
    element, violation = np.full(n, -1), np.full(n, np.inf)
    nodes, weights = np.zeros((n, 8), dtype=np.int64), np.zeros((n, 8))
    first = 0
    for block in mesh.blocks:
        point, own = _candidates(mesh.X[block.nodes], points, tolerance)
        N = _invert(block.kind, mesh.X[block.nodes[own]], points[point])
        short = np.maximum(-N.min(axis=1), 0.0)
        short[short <= INSIDE] = 0.0  # Of elements with a common face the first is chosen.
        # The element with the smallest violation, and of equal ones that with the lowest index.
        for k in np.lexsort((own, short)):
            p = point[k]
            if short[k] < violation[p]:
                element[p], violation[p] = first + own[k], short[k]
                used = block.kind.n_nodes
                nodes[p] = block.nodes[own[k], 0]
                nodes[p, :used] = block.nodes[own[k]]
                weights[p] = 0.0
                weights[p, :used] = N[k]
        first += len(block.nodes)
    if not (violation <= tolerance).all():
        bad = int(np.argmin(violation <= tolerance))
        distance = float(np.linalg.norm(mesh.X - points[bad], axis=1).min())
        raise MeshError(
            f"point {bad} at {points[bad]} m lies in no element (its nearest node is {distance:.3g} m "
            "away): move it into the mesh or raise the tolerance"
        )
    return Embedding(element.astype(np.int64), nodes, weights)


def _candidates(X: Array, points: Array, tolerance: float) -> tuple[Index, Index]:
    """Pairs (point, element) with the point in the enlarged bounding box of the element."""
    low, high = X.min(axis=1), X.max(axis=1)
    margin = (1e-6 + 2.0 * tolerance) * (high - low).max(axis=1, keepdims=True)
    pairs = [
        np.flatnonzero(((p >= low - margin) & (p <= high + margin)).all(axis=1)) for p in points
    ]
    point = np.repeat(np.arange(len(points)), [len(own) for own in pairs])
    return point, np.concatenate([*pairs, np.empty(0, dtype=np.int64)])


def _invert(kind: ElementType, X: Array, points: Array) -> Array:
    """Shape functions (pairs, n_nodes) of each point in its element; -inf where Newton fails."""
    centre: Array = kind.corners.mean(axis=0)
    low: Array = kind.corners.min(axis=0)
    high: Array = kind.corners.max(axis=0)
    xi: Array = np.repeat(centre[None], len(points), axis=0)
    size = (X.max(axis=1) - X.min(axis=1)).max(axis=1, initial=0.0)
    with np.errstate(all="ignore"):
        for _ in range(MAX_ITERATIONS):
            here, dN = kind.shape(xi)
            miss = points - np.einsum("pa,pai->pi", here, X)
            if (np.abs(miss).max(axis=1, initial=0.0) <= 1e-15 * size).all():
                break
            jacobian = np.einsum("pai,paj->pij", X, dN)
            det = np.linalg.det(jacobian)
            jacobian[~(np.abs(det) > 0.0)] = np.eye(3)
            move = np.asarray(np.linalg.solve(jacobian, miss[..., None]), dtype=np.float64)
            # In distorted elements the iteration may diverge for points outside.
            xi = np.clip(xi + move[..., 0], low - 2.0, high + 2.0)
        N, _ = kind.shape(xi)
        miss = np.abs(points - np.einsum("pa,pai->pi", N, X)).max(axis=1, initial=0.0)
    return np.where((miss <= 1e-10 * size)[:, None], N, -np.inf)
