"""Members: nodes and bodies that are fixed, attached, or have a prescribed motion.

A node or point without a member is free. Each member describes the nodes it holds by an
`Attachment`; a node has at most one. On compiling, a node or body that does not exist raises
`SceneError`.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from sim.bodies import Motion
from sim.checks import real_numbers
from sim.embedding import Embedding, embed
from sim.errors import SceneError
from sim.indices import index_rows, indices, node_indices
from sim.mesh import Mesh
from sim.pattern import Array, Index

NodeMotion = Callable[[float], ArrayLike]  #: positions (k, 3) [m] at a time [s]


def _none() -> Index:
    return np.empty(0, dtype=np.int64)


@dataclass(frozen=True, eq=False)
class Attachment:
    """Nodes of one member and their dependence."""

    name: str  #: of the member, for messages
    nodes: Index = field(default_factory=_none)  #: (k,) nodes and points of the member
    axes: tuple[int, ...] = ()  #: directions fixed in space; the others are free
    #: (k, m) nodes from which each is interpolated, and weights; m = 0 without
    holders: Index = field(default_factory=lambda: np.empty((0, 0), dtype=np.int64))
    weights: Array = field(default_factory=lambda: np.empty((0, 0)))
    body: int = -1  #: body to which they are rigidly attached, -1 without
    places: Array | None = None  #: (k, 3) positions on the body at its start [m]; None: at rest
    path: NodeMotion | None = None  #: their positions over time
    #: (body, Motion or None), optional Body with a prescribed motion; None if it is fixed
    motion: tuple[int, Motion | None] | None = None


class Member(Protocol):
    """A kinematic condition on nodes, points or a body."""

    def attach(self, mesh: Mesh, bodies: Mapping[str, int]) -> Attachment:
        """Lay the member out for a mesh with points and bodies by name."""
        ...


def _checked(member: object, nodes: ArrayLike, mesh: Mesh) -> Index:
    return node_indices(type(member).__name__, nodes, mesh.n_nodes, mesh.n_points)


def _number(name: str, bodies: Mapping[str, int]) -> int:
    if name not in bodies:
        raise SceneError(f"no body is called {name!r}, expected one of {list(bodies)}")
    return bodies[name]


@dataclass(frozen=True, eq=False)
class Fixed:
    """Nodes that keep their position, in all or some directions (0 = x, 1 = y, 2 = z)."""

    nodes: Index  #: (k,) numbers, or a mask (n_nodes,)
    axes: tuple[int, ...] = (0, 1, 2)

    def attach(self, mesh: Mesh, bodies: Mapping[str, int]) -> Attachment:
        """Nodes held in space."""
        axes = tuple(int(axis) for axis in indices("Fixed", "axis", self.axes, 3))
        return Attachment("Fixed", _checked(self, self.nodes, mesh), axes=axes)


@dataclass(frozen=True, eq=False)
@real_numbers
class OnBody:
    """Nodes that are rigidly attached to a body at their rest positions, or at other `places`.

    Tissue between nodes whose places differ from those at rest is deformed from the start.
    """

    body: str
    nodes: Index  #: (k,) numbers, or a mask (n_nodes,)
    places: Array | None = None  #: (k, 3) positions at the start [m]

    def attach(self, mesh: Mesh, bodies: Mapping[str, int]) -> Attachment:
        """Nodes rigid on a body."""
        nodes, places = _checked(self, self.nodes, mesh), self.places
        places = None if places is None else np.asarray(places, dtype=np.float64)
        if places is not None and places.shape != (len(nodes), 3):
            raise SceneError(
                f"OnBody: places have shape {places.shape}, expected ({len(nodes)}, 3), one per node"
            )
        body = _number(self.body, bodies)
        return Attachment(f"OnBody({self.body!r})", nodes, body=body, places=places)


@dataclass(frozen=True, eq=False)
@real_numbers
class InElement:
    """Nodes and points attached to elements: they move by the shape functions there.

    Raises
    ------
    MeshError
        A node lies in no element (on compiling).
    """

    nodes: Index  #: (k,) numbers, or a mask (n_nodes,)
    #: elements of the nodes; by default those that contain the rest positions
    embedding: Embedding | None = None
    tolerance: float = 1e-6  #: as `sim.embed`

    def attach(self, mesh: Mesh, bodies: Mapping[str, int]) -> Attachment:
        """Nodes interpolated from those of an element."""
        nodes = _checked(self, self.nodes, mesh)
        embedding = self.embedding or embed(mesh, mesh.X[nodes], tolerance=self.tolerance)
        holders = index_rows("InElement", "holding node", embedding.nodes, mesh.n_nodes, None)
        weights = np.asarray(embedding.weights, dtype=np.float64)
        if holders.shape != weights.shape or holders.shape[:1] != nodes.shape:
            raise SceneError(
                f"InElement: an embedding with nodes {holders.shape} and weights {weights.shape} for "
                f"{len(nodes)} nodes, expected one row of both for each"
            )
        return Attachment("InElement", nodes, holders=holders, weights=weights)


@dataclass(frozen=True, eq=False)
class PrescribedNodes:
    """Nodes with positions prescribed as a function of time."""

    nodes: Index  #: (k,) numbers, or a mask (n_nodes,)
    #: positions (k, 3) [m] at a time [s], smooth; velocities are its differences over 0.1 ms
    path: NodeMotion

    def attach(self, mesh: Mesh, bodies: Mapping[str, int]) -> Attachment:
        """Nodes on a path."""
        nodes, path = _checked(self, self.nodes, mesh), self.path

        def checked(t: float) -> Array:
            x = np.asarray(path(t), dtype=np.float64)
            if x.shape != (len(nodes), 3):
                raise SceneError(
                    f"PrescribedNodes: the path returns positions of shape {x.shape} at t = {t:.4g} s, "
                    f"expected ({len(nodes)}, 3), one for each node"
                )
            return x

        return Attachment("PrescribedNodes", nodes, path=checked)


@dataclass(frozen=True, eq=False)
class PrescribedBody:
    """A body with a prescribed motion, or fixed."""

    body: str
    #: position of its centre (3,) [m] and unit quaternion (4,) at a time [s], smooth; by default the
    #: body is fixed at rest
    motion: Motion | None = None

    def attach(self, mesh: Mesh, bodies: Mapping[str, int]) -> Attachment:
        """Body on a path."""
        name = f"PrescribedBody({self.body!r})"
        return Attachment(name, motion=(_number(self.body, bodies), self.motion))


MEMBERS: tuple[type[Member], ...] = (Fixed, OnBody, InElement, PrescribedNodes, PrescribedBody)
"""All members, which the tests include."""
