"""Pairing in the IPC Toolkit: collision mesh, barrier, step limit and friction.

The toolkit (ipctk, MIT licence) is imported when the first barrier is compiled.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np
from scipy.sparse import coo_array

from sim.contact.curvature import NormalStiffness, normal_stiffness
from sim.contact.search import nearest_faces
from sim.contact.surfaces import NodeSurface, Pairing, RigidShell
from sim.errors import SceneError
from sim.pattern import Flags
from sim.scene import Index
from sim.state import Array

CLOSEST = 0.1  #: fraction of a gap that remains when a step is limited
NEAREST = 1e-9  #: smallest gap after a limited step [m], the limit of double precision
MOST_ADVANCES = 10_000  #: largest number of conservative advancements towards a first contact

SLACK = 2e-4
"""Displacement of vertices after which pairs are searched again [m].

Larger values cause hundreds of thousands of pairs, which every evaluation examines.
"""


def toolkit() -> Any:
    """The module ipctk, single-threaded so that results do not depend on the machine.

    Raises SceneError if it is not installed.
    """
    try:
        ipctk = import_module("ipctk")
    except ImportError as missing:
        raise SceneError(
            "BarrierContact needs the package ipctk, which is not installed: try pip install ipctk "
            "(it has wheels for Linux on x86-64, Windows, and macOS on ARM), or ConstraintContact"
        ) from missing
    ipctk.set_num_threads(1)
    return ipctk


@dataclass(frozen=True)
class Barrier:
    """Parameters of a barrier; see `sim.contact.barrier.BarrierContact`."""

    distance: float
    stiffness: float
    friction: float
    stick_speed: float


class CollisionPair:
    """The two surfaces of a pairing (or one) as one collision mesh.

    `shells` replace the surfaces of the pairing, in the same order; X (n_nodes, 3) are the rest
    positions of the mesh [m]. `node` (k,) is the node of every vertex, -1 for those of a shell, which
    come after the `n_soft` others.
    """

    def __init__(
        self, pairing: Pairing, shells: Sequence[RigidShell], X: Array, barrier: Barrier
    ) -> None:
        self._ipc = toolkit()
        self.pairing, self._barrier = pairing, barrier
        soft = [s for s in pairing.surfaces if isinstance(s, NodeSurface)]
        self._nodes = np.unique(np.concatenate([s.nodes for s in soft]))
        number = np.full(len(X), -1)
        number[self._nodes] = np.arange(len(self._nodes))
        triangles = [number[s.triangles] for s in soft]
        self.n_soft, self._shells = len(self._nodes), tuple(shells)
        first = self.n_soft
        self.node = np.full(first + sum(len(s.vertices) for s in shells), -1)
        self.node[:first] = self._nodes
        for shell in shells:
            triangles.append(shell.triangles + first)
            first += len(shell.vertices)
        faces = np.asfortranarray(np.concatenate(triangles), dtype=np.int32)
        rest = self.vertices(X, 0.0)
        self.mesh = self._ipc.CollisionMesh(rest, self._ipc.edges(faces), faces)
        self._weigh_shells()
        if not pairing.itself:
            self._separate(number)
        self._potential = self._ipc.BarrierPotential(barrier.distance, barrier.stiffness, True)
        self._stop = self._ipc.AdditiveCCD(MOST_ADVANCES, 1.0 - CLOSEST)
        self._candidates = self._ipc.Candidates()
        self._reference: Array | None = None

    def vertices(self, q: Array, t: float) -> Array:
        """Positions (k, 3) of all vertices at time t [m], column-major as required by the toolkit."""
        parts = [q[self._nodes], *(shell.at(t) for shell in self._shells)]
        return np.asfortranarray(np.concatenate(parts))

    @property
    def moves(self) -> bool:
        """Test if a shell moves."""
        return any(shell.motion is not None for shell in self._shells)

    def carry(self, q: Array, free: Flags, t0: float, t1: float) -> None:
        """Advect the free nodes near a shell, in q (n_nodes, 3), with its motion from t0 to t1."""
        for shell in self._shells:
            if shell.motion is None:
                continue
            before, after = shell.at(t0), shell.at(t1)
            travel = float(np.linalg.norm(after - before, axis=1).max()) + self._barrier.distance
            (R0, s0), (R1, s1) = shell.place(t0), shell.place(t1)
            x = q[self._nodes]
            near = nearest_faces(x, travel, np.ascontiguousarray(before), shell.triangles).point
            moved = (x - s0) @ R0 @ R1.T + s1
            rows = self._nodes[near]
            unknowns = (3 * rows[:, None] + np.arange(3)).ravel()
            unknowns = unknowns[free[unknowns]]
            whole = q.copy()
            whole[rows] = moved[near]
            q.reshape(-1)[unknowns] = whole.reshape(-1)[unknowns]

    def _weigh_shells(self) -> None:
        """Limit the area of vertices and edges of a shell to that of the tissue.

        A barrier is weighted by the area around vertices and edges; otherwise the few long edges of
        a coarse shell would carry the whole load.
        """
        soft = self.node >= 0
        if soft.all():
            return
        areas, sides = np.array(self.mesh.vertex_areas), np.array(self.mesh.edge_areas)
        along = soft[np.asarray(self.mesh.edges)].all(axis=1)
        areas[~soft] = np.minimum(areas[~soft], areas[soft].mean())
        sides[~along] = np.minimum(sides[~along], sides[along].mean())
        self.mesh.vertex_areas, self.mesh.edge_areas = areas, sides

    def _separate(self, number: Index) -> None:
        """Restrict contact to vertices of different surfaces, without shared nodes.

        Shared nodes belong to triangles and edges that the other vertices touch.
        """
        sides: list[Index] = []
        first = self.n_soft
        for surface in self.pairing.surfaces:
            if isinstance(surface, NodeSurface):
                sides.append(number[np.setdiff1d(surface.nodes, self.pairing.shared)])
            else:
                sides.append(np.arange(first, first + len(surface.vertices)))
                first += len(surface.vertices)
        chosen = np.zeros((2, len(self.node)), dtype=np.int32)
        chosen[0, sides[0]] = 1
        chosen[1, sides[1]] = 1
        a, b = (self._ipc.make_vertex_patches_filter(row) for row in chosen)
        self.mesh.can_collide = a & b

    def forget(self) -> None:
        """Discard stored pairs, because the order of their sum depends on the search."""
        self._reference = None

    def _near(self, *x: Array) -> Any:
        """Pairs that may come within the distance on a path through these positions."""
        if self._reference is not None and all(_farthest(p, self._reference) <= SLACK for p in x):
            return self._candidates
        half = 0.5 * self._barrier.distance
        if max(_farthest(p, x[0]) for p in x) > SLACK:
            swept = self._ipc.Candidates()
            swept.build(self.mesh, x[0], x[-1], half)
            return swept
        self._candidates.build(self.mesh, x[0], half + SLACK)
        self._reference = x[0].copy(order="F")
        return self._candidates

    def collisions(self, x: Array) -> Any:
        """All pairs within the distance, weighted by area so that their sum is a pressure.

        The weights are those of Li et al. (2023, Convergent incremental potential contact), with
        which every closest point counts once, independent of its position on a triangle.
        """
        found = self._ipc.NormalCollisions()
        found.use_area_weighting = True
        found.collision_set_type = self._ipc.NormalCollisions.IMPROVED_MAX_APPROX
        found.build(self._near(x), self.mesh, x, self._barrier.distance)
        return found

    def energy(self, x: Array) -> tuple[float, Array]:
        """Energy [J] and its gradient (k, 3) [N]."""
        found = self.collisions(x)
        if len(found) == 0:
            return 0.0, np.zeros((len(x), 3))
        gradient = self._potential.gradient(found, self.mesh, x)
        return self._potential(found, self.mesh, x), gradient.reshape(-1, 3)

    def stiffness(self, x: Array) -> NormalStiffness:
        """Stiffness [N/m]: the second derivative without the rotation of normals."""
        b = self._barrier
        return normal_stiffness(self.collisions(x), self.mesh, x, b.distance, b.stiffness)

    def largest_step(self, x0: Array, x1: Array) -> float:
        """Largest fraction in (0, 1] of the displacement from x0 to x1 without contact."""
        near = self._near(x0, x1)
        if len(near) == 0:
            return 1.0
        return near.compute_collision_free_stepsize(self.mesh, x0, x1, NEAREST, self._stop)

    def smallest_distance(self, x: Array) -> float:
        """Smallest distance of pairs within the barrier's reach [m], infinite if there is none."""
        found = self.collisions(x)
        if len(found) == 0:
            return float("inf")
        return float(np.sqrt(found.compute_minimum_distance(self.mesh, x)))

    def sliding(self, x: Array, slip: float) -> "Sliding":
        """Friction over a step that starts at vertices x (k, 3) [m], with the normal forces there.

        Friction is fully mobilised at the displacement `slip` within the step [m].
        """
        lagged = self._ipc.TangentialCollisions()
        lagged.build(self.mesh, x, self.collisions(x), self._potential, self._barrier.friction)
        return Sliding(self, x, lagged, self._ipc.FrictionPotential(slip))


class Sliding:
    """Friction of a pairing over one step, as a potential of the displacement within it."""

    def __init__(self, pair: CollisionPair, start: Array, lagged: Any, potential: Any) -> None:
        self._pair, self._start, self._lagged = pair, start, lagged
        self._potential = potential
        self._clamp = toolkit().PSDProjectionMethod.CLAMP

    def energy(self, x: Array) -> tuple[float, Array]:
        """Energy [J] and its gradient (k, 3) [N]."""
        if len(self._lagged) == 0:
            return 0.0, np.zeros((len(x), 3))
        rows = self._lagged, self._pair.mesh, np.asfortranarray(x - self._start)
        return self._potential(*rows), self._potential.gradient(*rows).reshape(-1, 3)

    def hessian(self, x: Array) -> coo_array:
        """Second derivative, positive semi-definite [N/m], each entry once."""
        if len(self._lagged) == 0:
            return coo_array((x.size, x.size))
        rows = self._lagged, self._pair.mesh, np.asfortranarray(x - self._start)
        return coo_array(self._potential.hessian(*rows, self._clamp))


def _farthest(x: Array, y: Array) -> float:
    return float(np.sqrt(((x - y) ** 2).sum(axis=1).max()))
