"""Checks of the triangles of a surface, which report the index of a failure."""

import numpy as np
from numpy.typing import ArrayLike

from sim.errors import ContactFailure, SceneError
from sim.indices import index_rows
from sim.scene import Index
from sim.state import Array

FLAT = 1e-10
"""Area relative to the square of the longest side below which a triangle has no normal."""


def sides_of(triangles: Index) -> Index:
    """Directed sides (3 m, 2), those of a triangle together."""
    return triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)


def checked_triangles(triangles: ArrayLike, name: str) -> Index:
    """Triangles (m, 3) as a contiguous array of int64; `name` is that of the surface in messages.

    Raises ContactFailure if the array has another shape or type, a triangle contains a node twice, two
    triangles have the same nodes, or two have a common edge in the same direction.
    """
    try:
        array = index_rows(f"surface {name!r}", "node", triangles, None, 3, error=SceneError)
    except SceneError as wrong:
        raise ContactFailure(
            f"{wrong}; triangles: expected whole numbers (m, 3), m > 0", surface=name
        ) from None
    if len(array) == 0:
        raise ContactFailure(
            f"triangles of surface {name!r} have shape {array.shape}, expected whole numbers (m, 3), "
            "m > 0",
            surface=name,
        )
    array = np.ascontiguousarray(array)
    ordered = np.sort(array, axis=1)
    twice = (ordered[:, 1:] == ordered[:, :-1]).any(axis=1)
    if twice.any():
        bad = int(np.argmax(twice))
        raise ContactFailure(
            f"triangle {bad} of surface {name!r} contains a node twice "
            f"({array[bad].tolist()}): remove the degenerate triangle",
            surface=name,
            triangle=bad,
        )
    repeated = _first_repeated(ordered)
    if repeated is not None:
        bad, other = repeated
        raise ContactFailure(
            f"triangle {bad} of surface {name!r} has the nodes of triangle "
            f"{other} ({array[bad].tolist()}): remove the duplicate",
            surface=name,
            triangle=bad,
        )
    sides = sides_of(array)
    repeated = _first_repeated(sides)
    if repeated is not None:
        bad, other = repeated
        a, b = sides[bad].tolist()
        raise ContactFailure(
            f"triangles {other // 3} and {bad // 3} of surface {name!r} run along edge "
            f"{a}-{b} in the same direction, expected opposite ones: reverse one of them, or "
            "divide a surface that branches",
            surface=name,
            triangle=bad // 3,
            edge=(a, b),
        )
    return array


def require_nodes(triangles: Index, name: str, n: int, of: str) -> None:
    """Raise ContactFailure for triangles with nodes outside 0..n-1 of a mesh or shell."""
    outside = (triangles < 0) | (triangles >= n)
    if outside.any():
        bad = int(np.argmax(outside.any(axis=1)))
        node = int(triangles[bad][outside[bad]][0])
        raise ContactFailure(
            f"triangle {bad} of surface {name!r} refers to node {node}, expected 0..{n - 1} of {of}",
            surface=name,
            triangle=bad,
            node=node,
        )


def require_area(triangles: Index, name: str, x: Array) -> None:
    """Raise ContactFailure for triangles without area at positions x [m]."""
    a, b, c = (x[triangles[:, i]] for i in range(3))
    double = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    longest = np.max([((p - r) ** 2).sum(axis=1) for p, r in ((a, b), (b, c), (c, a))], axis=0)
    flat = ~(double > FLAT * longest)
    if flat.any():
        bad = int(np.argmax(flat))
        raise ContactFailure(
            f"triangle {bad} of surface {name!r} has no area "
            f"({0.5 * double[bad]:.3g} m^2 with nodes {triangles[bad].tolist()}): "
            "remove it or separate its nodes",
            surface=name,
            triangle=bad,
        )


def require_outside_out(triangles: Index, name: str, x: Array) -> None:
    """Raise ContactFailure for a closed surface that is inside out at positions x [m]."""
    centre = x[np.unique(triangles)].mean(axis=0)
    a, b, c = (x[triangles[:, i]] - centre for i in range(3))
    volume = float(np.einsum("mi,mi->", a, np.cross(b, c))) / 6.0
    if volume < 0.0:
        raise ContactFailure(
            f"surface {name!r} is inside out (it encloses {volume:.3g} m^3), expected "
            "triangles counter-clockwise seen from outside: reverse them",
            surface=name,
        )


def _first_repeated(rows: Index) -> tuple[int, int] | None:
    """First row (k, n) that has occurred before, and its first occurrence."""
    _, first, back = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    if len(first) == len(rows):
        return None
    at = first[back.ravel()]
    bad = int(np.argmax(at != np.arange(len(rows))))
    return bad, int(at[bad])
