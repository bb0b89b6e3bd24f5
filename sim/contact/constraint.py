"""Contact by constraints, as published: vertices of one surface against the faces of the other."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from sim.contact.compiled import CompiledContact
from sim.contact.pairing import Pairing
from sim.contact.search import faces_within
from sim.contact.surfaces import NodeSurface
from sim.errors import SceneError
from sim.mesh import Mesh
from sim.pattern import distinct
from sim.scene import Index, Layout


@dataclass(frozen=True, eq=False)
class ConstraintContact:
    """Contact of vertices with the opposite faces, enforced by multipliers.

    Every vertex near the other surface of its pairing gets a row: the gap to its nearest face, along the
    direction from that face, stays >= 0; in a groove it gets one for each wall. Both surfaces take the
    part of the vertices, shells too: a tooth may be narrower than a face of the lip. Rows that would
    pull let go. Remaining penetrations are removed by a correction of the positions that
    leaves the velocities alone.

    Attributes
    ----------
    pairings : tuple of Pairing
    friction : float or tuple of float
        Coulomb's coefficient, of all pairings or of each.
    reach : float
        Largest distance at rest of a vertex and a face of the mesh that may touch where rows are in the
        matrix [m]; all such pairs have a place in it, so that it is analysed once. Steps of
        `ConvergedEuler` without friction, constraints and products have no such bound.
    approach : float
        Rows are made for vertices nearer than this to a face [m]. A vertex that meets a face from
        farther away within one step is found by the way it takes, and its step is solved again.

    initial_penetration : {"kept", "removed"}
        What becomes of vertices that start inside a closed surface: they may stay as deep as they are,
        or are moved out, all at `removal_speed` until they are outside.
    removal_speed : float
        Speed at which they are moved out [m/s], as by a surface that rises at this speed.

    Raises
    ------
    SceneError
        A number is out of range, or there is no pairing.
    ContactFailure
        On compiling: a surface is unusable; in a step with rows in the matrix: a vertex and a face
        touch that lie farther apart at rest than `reach`.

    Notes
    -----
    Overlap at the start: a vertex that begins inside a closed surface may stay as deep as it is and
    come out, and may never go back in; it does not jump. With initial_penetration = "removed" the depth
    that is allowed falls by removal_speed h in a step of h until no penetration remains, which does
    the work of a wall that rises at this speed. Behind an open surface, which has a front and no
    inside, vertices farther away than `approach` are left alone, also those that pass around its free
    edge. A surface never touches itself through its own thickness: faces that do not oppose a vertex,
    and those it belongs to, are left out. Nodes that both surfaces of a pairing share belong to
    neither's vertices.

    Only vertices meet faces, as published. Two sharp edges that cross between their vertices pass each
    other by up to a part of a cell, and so do bodies that start overlapped with their sides in one
    plane: `BarrierContact` holds edges too.

    Source: contact of the published model (Stavness et al., 11.3.3: vertices against opposing faces,
    direction of the nearest face, released when they would separate). The rows here are unilateral.
    """

    pairings: tuple[Pairing, ...]
    friction: float | tuple[float, ...] = 0.0
    reach: float = 0.01
    approach: float = 5e-4
    initial_penetration: Literal["kept", "removed"] = "kept"
    removal_speed: float = 0.01

    def __post_init__(self) -> None:
        """Check the ranges."""
        if not self.pairings:
            raise SceneError("a contact has no pairings, expected at least one")
        if len(self.frictions) != len(self.pairings):
            raise SceneError(
                f"friction has {len(self.frictions)} values for {len(self.pairings)} pairings, expected "
                "one number or one per pairing"
            )
        for name, value in (
            *(("friction", value) for value in self.frictions),
            ("reach", self.reach),
        ):
            if not 0.0 <= value < np.inf:
                raise SceneError(f"ConstraintContact: {name} = {value!r}, expected a number >= 0")
        for name, value in (("approach", self.approach), ("removal_speed", self.removal_speed)):
            if not 0.0 < value < np.inf:
                raise SceneError(f"ConstraintContact: {name} = {value!r}, expected a number > 0")
        if self.initial_penetration not in ("kept", "removed"):
            raise SceneError(
                f"ConstraintContact: initial_penetration = {self.initial_penetration!r}, expected "
                "'kept' or 'removed'"
            )

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

    def compile(self, layout: Layout) -> CompiledContact:
        """Lay out the directions of all pairings."""
        speed = self.removal_speed if self.initial_penetration == "removed" else 0.0
        return CompiledContact(
            self.pairings, self.frictions, self.reach, self.approach, speed, layout
        )


@dataclass(frozen=True, eq=False)
class RowsApart:
    """Compiled contact without entries for its rows in the matrix."""

    compiled: CompiledContact

    def pair_keys(self, mesh: Mesh) -> Index:
        """No pairs, because the contact forces are solved separately."""
        return np.empty(0, dtype=np.int64)

    def compile(self, layout: Layout) -> CompiledContact:
        """Return the compiled contact."""
        return self.compiled.apart(layout.pattern)
