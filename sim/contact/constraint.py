"""Contact by constraints, as published: vertices of one surface against the faces of the other."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from sim.checks import real_numbers, require
from sim.contact.compiled import CompiledContact
from sim.contact.rows import ContactTolerances
from sim.contact.search import faces_within
from sim.contact.surfaces import NodeSurface, Pairing
from sim.errors import SceneError
from sim.mesh import Mesh
from sim.pattern import distinct
from sim.scene import Index, Layout, Term


@dataclass(frozen=True, eq=False)
@real_numbers
class ConstraintContact(Term):
    """Contact of vertices with the opposite faces, enforced by multipliers.

    Every vertex near the other surface of its pairing has a row: the gap to its nearest face, along
    the normal of that face, remains >= 0; in a groove it has one row for each wall. Vertices of
    both surfaces have rows, also those of shells, because a tooth may be narrower than a face of
    the lip. Rows with tensile forces are released. Remaining penetrations are removed by a
    correction of the positions that does not change the velocities.

    Raises
    ------
    SceneError
        A number is out of range, or there is no pairing.
    ContactFailure
        On compiling: a surface is unusable; in a step with assembled rows: a vertex and a face
        touch whose distance at rest exceeds `reach`.

    Notes
    -----
    The depth of a vertex that is initially inside a closed surface may decrease, but not increase
    again; it does not jump. With initial_penetration = "removed" the allowed depth decreases by
    removal_speed h in a step of h, which does the work of a wall that moves at this speed. Behind
    an open surface, which has no inside, vertices beyond `approach`, including those that pass
    around its free edge, have no rows. A surface is not in contact with itself through its own
    thickness: faces whose normals are not opposite to that of a vertex, and those that contain it,
    are omitted. Nodes common to both surfaces of a pairing have no rows.

    As published, only vertices are tested against faces, and points on edges if requested. Two sharp
    edges that cross between these pass each other by up to a fraction of a cell, and so do initially
    overlapping bodies with coplanar sides.

    Source: contact of the published model (Stavness et al., 11.3.3: vertices against opposing
    faces, direction of the nearest face, released when they would separate). The rows here are
    unilateral.
    """

    pairings: tuple[Pairing, ...]
    friction: float | tuple[float, ...] = 0.0  #: Coulomb's coefficient, of all pairings or of each
    #: largest distance at rest of a vertex and a face of the mesh that may touch if rows are assembled
    #: into the matrix [m], which contains all such pairs, as in equilibria and in converged steps with
    #: products; other steps have no such bound
    reach: float = 0.01
    #: distance of a vertex and a face below which they have a row [m]. A vertex that enters a more
    #: distant face within one step is found from its path, and the step is solved again
    approach: float = 5e-4
    #: {"kept", "removed"}; vertices that are initially inside a closed surface may keep their depth, or
    #: are moved out at `removal_speed`
    initial_penetration: Literal["kept", "removed"] = "kept"
    removal_speed: float = 0.01  #: speed of this removal [m/s]
    #: gap, penetration or slip that the iteration of a step leaves, relative to `approach`
    tolerance: float = 2e-3
    #: number of points on each sharp convex edge of a surface of the mesh that have rows with rigid
    #: shells, like its vertices; the angle of its faces at rest exceeds 45 degrees
    edge_points: int = 0
    #: largest number of renewals of the normals and closest points of rows by those at the end of a
    #: converged stage. With 0, a row of tissue keeps the low-pass filtered normal of the start, and the
    #: error is of first order in the step where surfaces slide
    renewals: int = 0

    def __post_init__(self) -> None:
        if not self.pairings:
            raise SceneError("a contact has no pairings, expected at least one")
        if len(self.frictions) != len(self.pairings):
            raise SceneError(
                f"friction has {len(self.frictions)} values for {len(self.pairings)} pairings, expected "
                "one number or one per pairing"
            )
        for friction in self.frictions:
            require(self, "friction", friction, least=0.0)
        require(self, "reach", self.reach, least=0.0)
        for name in ("approach", "removal_speed", "tolerance"):
            require(self, name, getattr(self, name), above=0.0)
        require(self, "edge_points", self.edge_points, least=0.0)
        require(self, "renewals", self.renewals, least=0.0)
        if self.initial_penetration not in ("kept", "removed"):
            raise SceneError(
                f"ConstraintContact: initial_penetration = {self.initial_penetration!r}, expected "
                "'kept' or 'removed'"
            )

    @property
    def tolerances(self) -> ContactTolerances:
        """Lengths at which contact decides."""
        return ContactTolerances(self.approach, self.tolerance)

    @property
    def frictions(self) -> tuple[float, ...]:
        """Coefficient of every pairing."""
        if isinstance(self.friction, tuple):
            return self.friction
        return (float(self.friction),) * len(self.pairings)

    def pair_keys(self, mesh: Mesh) -> Index:
        """Pairs of nodes of two surfaces of the mesh within reach, and those of their triangles."""
        keys = [np.empty(0, dtype=np.int64)]
        for pairing in self.pairings:
            pairing.check(mesh)
            a, b = (pairing.surfaces * 2)[:2]
            if not (isinstance(a, NodeSurface) and isinstance(b, NodeSurface)):
                continue
            for one, other in ((a, b),) if pairing.itself else ((a, b), (b, a)):
                near = faces_within(mesh.X[one.nodes], mesh.X, other.triangles, self.reach)
                vertex, face = np.nonzero(near)
                vertex = np.repeat(one.nodes[vertex], 3)
                corner = other.triangles[face].ravel()
                keys.append(np.minimum(vertex, corner) * mesh.n_nodes + np.maximum(vertex, corner))
                keys.append(other.edges[:, 0] * mesh.n_nodes + other.edges[:, 1])
        return distinct(np.concatenate(keys))

    def without_contact_entries(self) -> "WithoutContactEntries":
        """Return this contact without entries for its rows in the matrix of points."""
        return WithoutContactEntries(self)

    def compile(self, layout: Layout) -> CompiledContact:
        """Lay out the directions of all pairings."""
        speed = self.removal_speed if self.initial_penetration == "removed" else 0.0
        lengths = self.reach, self.tolerances, speed
        counts = self.edge_points, self.renewals
        return CompiledContact(self.pairings, self.frictions, *lengths, *counts, layout)


@dataclass(frozen=True, eq=False)
class WithoutContactEntries(Term):
    """Contact whose rows have no entries in the matrix, as declared."""

    contact: ConstraintContact

    def pair_keys(self, mesh: Mesh) -> Index:
        """No pairs, after the checks of the pairings."""
        for pairing in self.contact.pairings:
            pairing.check(mesh)
        return np.empty(0, dtype=np.int64)

    def compile(self, layout: Layout) -> CompiledContact:
        """Lay out the directions of all pairings."""
        return self.contact.compile(layout).without_contact_entries(layout.pattern)
