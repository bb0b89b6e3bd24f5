"""Pairs of surfaces that may touch."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from sim.contact.surfaces import NodeSurface, RigidShell, Surface
from sim.errors import ContactFailure, SceneError
from sim.mesh import Mesh
from sim.scene import Index


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
            found, counts = np.unique(both, axis=0, return_counts=True)
            if (counts > 1).any():
                nodes = found[np.argmax(counts > 1)].tolist()
                raise ContactFailure(
                    f"triangle with nodes {nodes} belongs to both surfaces of pairing "
                    f"{self.name!r}: remove it from one of them",
                    surface=self.name,
                )
