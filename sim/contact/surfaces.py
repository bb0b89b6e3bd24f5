"""Contact surfaces, of the mesh, of bodies or rigid shells, and pairs of them that may touch."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from sim.checks import real_numbers
from sim.errors import ContactFailure, SceneError
from sim.indices import index_rows
from sim.kinematics.members import OnBody
from sim.mesh import Mesh
from sim.scene import Index
from sim.state import Array

FLAT_FACE = 1e-10
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


def require_nodes(triangles: Index, name: str, n: int, owner: str) -> None:
    """Raise ContactFailure for triangles with nodes outside 0..n-1 of a mesh or shell."""
    outside = (triangles < 0) | (triangles >= n)
    if outside.any():
        bad = int(np.argmax(outside.any(axis=1)))
        node = int(triangles[bad][outside[bad]][0])
        raise ContactFailure(
            f"triangle {bad} of surface {name!r} refers to node {node}, expected 0..{n - 1} of {owner}",
            surface=name,
            triangle=bad,
            node=node,
        )


def require_area(triangles: Index, name: str, x: Array) -> None:
    """Raise ContactFailure for triangles without area at positions x [m]."""
    a, b, c = (x[triangles[:, i]] for i in range(3))
    double = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    longest = np.max([((p - r) ** 2).sum(axis=1) for p, r in ((a, b), (b, c), (c, a))], axis=0)
    flat = ~(double > FLAT_FACE * longest)
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


Motion = Callable[[float], tuple[ArrayLike, ArrayLike]]
"""Rotation (3, 3) and shift (3,) [m] of a shell at a time [s]: x = R X + s."""


class _Triangles:
    """Connectivity of surfaces of both kinds."""

    triangles: Index
    name: str

    @cached_property
    def edges(self) -> Index:
        """Edges (k, 2), each once, the lower index first."""
        sides = np.sort(sides_of(self.triangles), axis=1)
        return np.unique(sides, axis=0)

    @cached_property
    def nodes(self) -> Index:
        """Indices of the vertices of the triangles, ascending."""
        return np.unique(self.triangles)

    @cached_property
    def open_edges(self) -> Index:
        """Edges (k, 2) that belong to one triangle only."""
        sides, counts = np.unique(
            np.sort(sides_of(self.triangles), axis=1), axis=0, return_counts=True
        )
        return sides[counts == 1]

    @cached_property
    def closed(self) -> bool:
        """True if the surface has an inside."""
        return len(self.open_edges) == 0

    def _require_shape(self, x: Array, owner: str) -> None:
        """Refuse invalid triangles at positions x [m] of a mesh or shell."""
        require_nodes(self.triangles, self.name, len(x), owner)
        require_area(self.triangles, self.name, x)
        if self.closed:
            require_outside_out(self.triangles, self.name, x)


@dataclass(frozen=True, eq=False)
class NodeSurface(_Triangles):
    """Surface of the scene's mesh, or a part of it.

    Raises
    ------
    ContactFailure
        A triangle contains a node twice, two triangles have the same nodes, or neighbours have
        opposite orientations.
    """

    triangles: Index  #: (m, 3) nodes of the scene's mesh, counter-clockwise seen from outside
    name: str = "surface"  #: for messages and records

    def __post_init__(self) -> None:
        object.__setattr__(self, "triangles", checked_triangles(self.triangles, self.name))

    def check(self, mesh: Mesh) -> None:
        """Check the surface against the mesh at rest.

        Raises
        ------
        ContactFailure
            A node does not exist, a triangle has no area at rest, or a closed surface is inside
            out.
        """
        self._require_shape(mesh.X, "the mesh")


@dataclass(frozen=True, eq=False)
@real_numbers
class RigidShell(_Triangles):
    """Rigid surface, at rest or on a given motion.

    Raises
    ------
    ContactFailure
        As `NodeSurface`; a vertex is not finite; a triangle has no area; a closed shell is inside
        out.
    """

    vertices: Array  #: (k, 3) positions [m], before the motion
    triangles: Index  #: (m, 3) vertices, counter-clockwise seen from outside
    name: str = "shell"
    #: rotation and shift [m] at a time [s]; without it the shell is fixed
    motion: Motion | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "vertices", np.ascontiguousarray(self.vertices, np.float64))
        if self.vertices.ndim != 2 or self.vertices.shape[1] != 3:
            raise ContactFailure(
                f"vertices of shell {self.name!r} have shape {self.vertices.shape}, expected (k, 3)",
                surface=self.name,
            )
        object.__setattr__(self, "triangles", checked_triangles(self.triangles, self.name))
        finite = np.isfinite(self.vertices).all(axis=1)
        if not finite.all():
            bad = int(np.argmin(finite))
            raise ContactFailure(
                f"vertex {bad} of shell {self.name!r} is not finite: repair it",
                surface=self.name,
                node=bad,
            )
        self._require_shape(self.vertices, "the shell")

    def at(self, t: float) -> Array:
        """Vertices (k, 3) at time t [s].

        Raises
        ------
        ContactFailure
            The motion returns no rotation, or values that are not finite.
        """
        if self.motion is None:
            return self.vertices
        R, s = self.place(t)
        return self.vertices @ R.T + s

    def place(self, t: float) -> tuple[Array, Array]:
        """Rotation (3, 3) and shift (3,) [m] at time t [s]; errors as `at`."""
        if self.motion is None:
            return np.eye(3), np.zeros(3)
        R, s = (np.asarray(part, dtype=np.float64) for part in self.motion(t))
        proper = R.shape == (3, 3) and s.shape == (3,) and bool(np.isfinite(s).all())
        if not proper or not np.allclose(R @ R.T, np.eye(3), rtol=0, atol=1e-9):
            raise ContactFailure(
                f"motion of shell {self.name!r} at t = {t:.4g} s is not a rotation (3, 3) with a finite "
                "shift (3,): return an orthogonal matrix and metres",
                surface=self.name,
            )
        if np.linalg.det(R) < 0.0:
            raise ContactFailure(
                f"motion of shell {self.name!r} at t = {t:.4g} s mirrors it (determinant -1), expected "
                "a rotation",
                surface=self.name,
            )
        return R, s


Surface = NodeSurface | RigidShell


@dataclass(frozen=True, eq=False)
class Pairing:
    """Two surfaces that may touch, or one surface with self-contact (`b` is `a` or None).

    At least one of them belongs to the mesh. Two surfaces of the mesh may share nodes, as lips do
    at the mouth corners: a vertex and a triangle that contains it, and two edges with a common
    node, are not in contact.
    """

    a: Surface
    b: Surface | None = None

    def __post_init__(self) -> None:
        """Refuse surfaces without relative motion."""
        if all(isinstance(surface, RigidShell) for surface in self.surfaces):
            raise SceneError(
                f"pairing {self.name!r} has rigid shells only, expected at least one NodeSurface: "
                "shells have no unknowns on which contact forces could act"
            )

    @property
    def itself(self) -> bool:
        """True for self-contact."""
        return self.b is None or self.b is self.a

    @property
    def surfaces(self) -> tuple[Surface, ...]:
        """The surfaces, one for self-contact."""
        return (self.a,) if self.b is None or self.b is self.a else (self.a, self.b)

    @property
    def name(self) -> str:
        """Name for messages and records."""
        names = [surface.name for surface in self.surfaces]
        return f"{names[0]} on {names[-1]}"

    @cached_property
    def shared(self) -> Index:
        """Nodes of both surfaces of the mesh (none for self-contact)."""
        if self.itself or not all(isinstance(s, NodeSurface) for s in self.surfaces):
            return np.empty(0, dtype=np.int64)
        return np.intersect1d(self.surfaces[0].nodes, self.surfaces[1].nodes)

    def check(self, mesh: Mesh) -> None:
        """Check the surfaces of the mesh.

        Raises
        ------
        ContactFailure
            As `NodeSurface.check`; a triangle belongs to both surfaces.
        """
        for surface in self.surfaces:
            if isinstance(surface, NodeSurface):
                surface.check(mesh)
        if len(self.shared):
            both = np.concatenate([np.sort(s.triangles, axis=1) for s in self.surfaces])
            edges, counts = np.unique(both, axis=0, return_counts=True)
            if (counts > 1).any():
                nodes = edges[np.argmax(counts > 1)].tolist()
                raise ContactFailure(
                    f"triangle with nodes {nodes} belongs to both surfaces of pairing "
                    f"{self.name!r}: remove it from one of them",
                    surface=self.name,
                )


FACES = {
    "hex8": ((0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)),
    "wedge6": ((0, 2, 1), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5)),
    "tet4": ((0, 2, 1), (0, 1, 3), (1, 2, 3), (2, 0, 3)),
}
"""Faces of every element type, counter-clockwise seen from outside (VTK node order)."""


def boundary_surface(mesh: Mesh, name: str = "boundary") -> NodeSurface:
    """Outer surface of a mesh: the faces of one element only, quadrilaterals divided into two.

    It is closed and counter-clockwise seen from outside if the faces of the elements match.
    """
    faces: list[Index] = []
    for block in mesh.blocks:
        for corners in FACES[block.kind.name]:
            face = block.nodes[:, corners]
            faces.append(face if face.shape[1] == 4 else np.c_[face, np.full(len(face), -1)])
    every = np.concatenate(faces)
    _, first, counts = np.unique(
        np.sort(every, axis=1), axis=0, return_index=True, return_counts=True
    )
    outer = every[np.sort(first[counts == 1])]
    quads = outer[outer[:, 3] >= 0]
    triangles = np.concatenate([outer[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    return NodeSurface(triangles, name)


def body_surfaces(
    shapes: Mapping[str, tuple[Array, Index]], first: int = 0
) -> tuple[Array, tuple[OnBody, ...], dict[str, NodeSurface]]:
    """Points and members of a scene that carry the surfaces of bodies, and these surfaces.

    Parameters
    ----------
    shapes : mapping of str to ((n, 3) array, (m, 3) array of int)
        Name of a body, and the vertices of its surface at rest [m] with its triangles,
        counter-clockwise seen from outside.
    first : number of the first of these points in the scene: that of the nodes of the mesh and of other
        points before them.

    Returns
    -------
    points : (k, 3) array
        For `Scene.points`.
    members : tuple of OnBody
        For `Scene.reductions`.
    surfaces : dict of str to NodeSurface
        For the pairings of a `ConstraintContact`, by name of the body.
    """
    members: list[OnBody] = []
    surfaces: dict[str, NodeSurface] = {}
    for name, (X, triangles) in shapes.items():
        members.append(OnBody(name, first + np.arange(len(X))))
        surfaces[name] = NodeSurface(triangles + first, name)
        first += len(X)
    points = np.vstack([np.empty((0, 3)), *(X for X, _ in shapes.values())])
    return points, tuple(members), surfaces
