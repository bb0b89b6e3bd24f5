"""What can touch: surfaces of the mesh, rigid shells, and which of them are paired."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from sim.errors import ContactFailure, SceneError
from sim.mesh import Mesh
from sim.scene import Index
from sim.state import Array

FLAT = 1e-10  # a triangle with less than this share of its longest edge squared has no normal

Motion = Callable[[float], tuple[ArrayLike, ArrayLike]]
"""Rotation (3, 3) and shift (3,) [m] of a shell at a time [s]: x = R X + s."""


class _Triangles:
    """What surfaces of both kinds know from their connectivity alone."""

    triangles: Index
    name: str

    @cached_property
    def edges(self) -> Index:
        """Edges (k, 2), each once, the lower index first."""
        sides = np.sort(_sides(self.triangles), axis=1)
        return np.unique(sides, axis=0)

    @cached_property
    def nodes(self) -> Index:
        """Indices that the triangles name, ascending."""
        return np.unique(self.triangles)

    @cached_property
    def open_edges(self) -> Index:
        """Edges (k, 2) that belong to one triangle only."""
        sides, counts = np.unique(
            np.sort(_sides(self.triangles), axis=1), axis=0, return_counts=True
        )
        return sides[counts == 1]

    @property
    def closed(self) -> bool:
        """Whether the surface has an inside."""
        return len(self.open_edges) == 0

    def require_closed(self, what: str) -> None:
        """Refuse an open surface where an inside is needed.

        Raises
        ------
        ContactFailure
            An edge belongs to one triangle only.
        """
        if not self.closed:
            a, b = self.open_edges[0]
            raise ContactFailure(
                f"surface {self.name!r} has {len(self.open_edges)} open edges (first: {a}-{b}), "
                f"expected a closed surface for {what}: close it",
                surface=self.name,
                edge=(int(a), int(b)),
            )


@dataclass(frozen=True, eq=False)
class NodeSurface(_Triangles):
    """Surface of the scene's mesh, or a part of it.

    Attributes
    ----------
    triangles : (m, 3) int
        Nodes of the scene's mesh, counter-clockwise seen from outside.
    name : str
        For messages and records.

    Raises
    ------
    ContactFailure
        A triangle names a node twice, two triangles have the same nodes, or neighbours are seen from
        different sides.
    """

    triangles: Index
    name: str = "surface"

    def __post_init__(self) -> None:
        """Check the connectivity."""
        object.__setattr__(self, "triangles", _connectivity(self.triangles, self.name))

    def check(self, mesh: Mesh) -> None:
        """Check the surface against the mesh at rest.

        Raises
        ------
        ContactFailure
            A node does not exist, a triangle has no area at rest, or a closed surface is inside out.
        """
        _require_nodes(self, mesh.n_nodes, "the mesh")
        _require_area(self, mesh.X)


@dataclass(frozen=True, eq=False)
class RigidShell(_Triangles):
    """Rigid surface, at rest or on a given motion.

    Attributes
    ----------
    vertices : (k, 3) float
        Positions [m], before the motion.
    triangles : (m, 3) int
        Vertices, counter-clockwise seen from outside.
    name : str
    motion : callable, optional
        Rotation and shift [m] at a time [s]; the shell rests without it.

    Raises
    ------
    ContactFailure
        As `NodeSurface`; a vertex is not finite; a triangle has no area; a closed shell is inside out.
    """

    vertices: Array
    triangles: Index
    name: str = "shell"
    motion: Motion | None = None

    def __post_init__(self) -> None:
        """Check connectivity and geometry."""
        object.__setattr__(self, "vertices", np.ascontiguousarray(self.vertices, np.float64))
        if self.vertices.ndim != 2 or self.vertices.shape[1] != 3:
            raise ContactFailure(
                f"vertices of shell {self.name!r} have shape {self.vertices.shape}, expected (k, 3)",
                surface=self.name,
            )
        object.__setattr__(self, "triangles", _connectivity(self.triangles, self.name))
        finite = np.isfinite(self.vertices).all(axis=1)
        if not finite.all():
            bad = int(np.argmin(finite))
            raise ContactFailure(
                f"vertex {bad} of shell {self.name!r} is not finite: repair it",
                surface=self.name,
                node=bad,
            )
        _require_nodes(self, len(self.vertices), "the shell")
        _require_area(self, self.vertices)

    def at(self, t: float) -> Array:
        """Vertices (k, 3) at time t [s].

        Raises
        ------
        ContactFailure
            The motion returns no rotation, or what is not finite.
        """
        if self.motion is None:
            return self.vertices
        R, s = self._place(t)
        return self.vertices @ R.T + s

    def rotation(self, t: float) -> Array:
        """Rotation (3, 3) at time t [s]; errors as `at`."""
        return np.eye(3) if self.motion is None else self._place(t)[0]

    def _place(self, t: float) -> tuple[Array, Array]:
        assert self.motion is not None
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
    """Two surfaces that may touch, or one that may touch itself.

    Attributes
    ----------
    a : NodeSurface or RigidShell
    b : NodeSurface or RigidShell, optional
        The same as `a`, or nothing, for self-contact.

    Raises
    ------
    SceneError
        Neither surface belongs to the mesh.

    Notes
    -----
    Two surfaces of the mesh may share nodes, as lips do at the mouth corners: a vertex and a triangle
    that it belongs to, and two edges with a common node, never touch each other.
    """

    a: Surface
    b: Surface | None = None

    def __post_init__(self) -> None:
        """Refuse what cannot move against each other."""
        if all(isinstance(surface, RigidShell) for surface in self.surfaces):
            raise SceneError(
                f"pairing {self.name!r} has rigid shells only, expected at least one NodeSurface: "
                "shells have no unknowns that a contact could push"
            )

    @property
    def itself(self) -> bool:
        """Whether this is self-contact."""
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
        """Nodes that both surfaces of the mesh name (none for self-contact)."""
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
            found, counts = np.unique(both, axis=0, return_counts=True)
            if (counts > 1).any():
                nodes = found[np.argmax(counts > 1)].tolist()
                raise ContactFailure(
                    f"triangle with nodes {nodes} belongs to both surfaces of pairing {self.name!r}: "
                    "leave it to one of them",
                    surface=self.name,
                )


def boundary_surface(mesh: Mesh, name: str = "boundary") -> NodeSurface:
    """Outer surface of a mesh: the faces of one element only, quadrilaterals cut in two.

    Parameters
    ----------
    mesh : Mesh
    name : str

    Returns
    -------
    NodeSurface
        Closed, counter-clockwise seen from outside, if the faces of the elements match.
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


FACES = {
    "hex8": ((0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)),
    "wedge6": ((0, 2, 1), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5)),
    "tet4": ((0, 2, 1), (0, 1, 3), (1, 2, 3), (2, 0, 3)),
}
"""Faces of every element type, counter-clockwise seen from outside (VTK node order)."""


def _sides(triangles: Index) -> Index:
    """Directed sides (3 m, 2), those of a triangle together."""
    return triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)


def _connectivity(triangles: ArrayLike, name: str) -> Index:
    """Checked triangles as a contiguous array of int64."""
    array = np.asarray(triangles)
    whole = array.dtype.kind in "iu" and array.ndim == 2 and array.shape[1:] == (3,)
    if not whole or len(array) == 0:
        raise ContactFailure(
            f"triangles of surface {name!r} have shape {array.shape} and type {array.dtype}, expected "
            "whole numbers (m, 3), m > 0",
            surface=name,
        )
    array = np.ascontiguousarray(array, dtype=np.int64)
    ordered = np.sort(array, axis=1)
    twice = (ordered[:, 1:] == ordered[:, :-1]).any(axis=1)
    if twice.any():
        bad = int(np.argmax(twice))
        raise ContactFailure(
            f"triangle {bad} of surface {name!r} names a node twice ({array[bad].tolist()}): leave the "
            "degenerate triangle out",
            surface=name,
            triangle=bad,
        )
    _, first, back = np.unique(ordered, axis=0, return_index=True, return_inverse=True)
    if len(first) < len(array):
        repeated = first[back.ravel()] != np.arange(len(array))
        bad = int(np.argmax(repeated))
        raise ContactFailure(
            f"triangle {bad} of surface {name!r} has the nodes of triangle "
            f"{int(first[back.ravel()[bad]])} ({array[bad].tolist()}): leave the duplicate out",
            surface=name,
            triangle=bad,
        )
    sides = _sides(array)
    _, first, back = np.unique(sides, axis=0, return_index=True, return_inverse=True)
    if len(first) < len(sides):
        repeated = first[back.ravel()] != np.arange(len(sides))
        bad = int(np.argmax(repeated))
        other = int(first[back.ravel()[bad]]) // 3
        a, b = sides[bad].tolist()
        raise ContactFailure(
            f"triangles {other} and {bad // 3} of surface {name!r} run along edge {a}-{b} in the same "
            "direction, expected opposite ones: reverse one of them, or part a surface that branches",
            surface=name,
            triangle=bad // 3,
            edge=(a, b),
        )
    return array


def _require_nodes(surface: Surface, n: int, of: str) -> None:
    outside = (surface.triangles < 0) | (surface.triangles >= n)
    if outside.any():
        bad = int(np.argmax(outside.any(axis=1)))
        node = int(surface.triangles[bad][outside[bad]][0])
        raise ContactFailure(
            f"triangle {bad} of surface {surface.name!r} names node {node}, expected 0..{n - 1} of {of}",
            surface=surface.name,
            triangle=bad,
            node=node,
        )


def _require_area(surface: Surface, x: Array) -> None:
    """Refuse triangles without area and closed surfaces that are inside out."""
    a, b, c = (x[surface.triangles[:, i]] for i in range(3))
    double = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    longest = np.max([((p - r) ** 2).sum(axis=1) for p, r in ((a, b), (b, c), (c, a))], axis=0)
    flat = ~(double > FLAT * longest)
    if flat.any():
        bad = int(np.argmax(flat))
        raise ContactFailure(
            f"triangle {bad} of surface {surface.name!r} has no area "
            f"({0.5 * double[bad]:.3g} m^2 with nodes {surface.triangles[bad].tolist()}): "
            "leave it out or part its nodes",
            surface=surface.name,
            triangle=bad,
        )
    if surface.closed:
        centre = x[surface.nodes].mean(axis=0)
        volume = float(np.einsum("mi,mi->", a - centre, np.cross(b - centre, c - centre))) / 6.0
        if volume < 0.0:
            raise ContactFailure(
                f"surface {surface.name!r} is inside out (it encloses {volume:.3g} m^3), expected "
                "triangles counter-clockwise seen from outside: reverse them",
                surface=surface.name,
            )
