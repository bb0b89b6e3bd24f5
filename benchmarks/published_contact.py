"""Contact of the published simulator as a separate time step, each rule of which can be replaced.

A step of the trapezoidal rule with hard volumes, in the published order: velocities under the rows of
contact, positions from the velocities, search, correction of the positions. The integrators of `sim`
do not use this module; `contact_rules` compares them with it.

Source: Lloyd, Stavness and Fels 2012, ArtiSynth, Fig. 10 (order, correction of positions with the
mass, Eq. 8); Stavness et al., Coupled biomechanical modeling, 11.3.3 (nodes inside, normal of the
nearest face, rows held for one step and released after one that pulls). That only nodes of the tissue
are tested against rigid bodies, and that a released row returns after one step, follows from the public
source of the program (artisynth_core, CollisionHandler), of which nothing is copied.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

import sim
from sim.constraints.union import Constraints, unite
from sim.contact import NodeSurface, Pairing, RigidShell
from sim.contact.search import nearest_faces
from sim.contact.signed_distance import SignedFaces
from sim.linear.saddle import Saddle
from sim.scene import CompiledConstraint, Layout
from sim.step_matrices import damping_matrix, implicit_matrix

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

DEEPEST = 5e-3  #: depth up to which nodes inside are found [m]

NO_NODES = np.empty(0, dtype=np.int64)


@dataclass(frozen=True)
class Rules:
    """Rules of the contact."""

    #: "face": normal of the nearest face; "point": direction to its nearest point
    direction: str = "face"
    released: bool = True  #: rows that have pulled in a step are left out of the next
    #: positions are corrected by the masses of the nodes, otherwise along the compliance of the
    #: tissue
    mass: bool = True
    #: volumes are held while positions are corrected, otherwise restored afterwards
    volumes: bool = True
    corners: bool = True  #: rows beside the nodes that both lips share; otherwise none
    bones: bool = False  #: vertices of the bones are tested against the tissue, too
    tolerance: float = 1.2e-5  #: depth that a correction leaves [m]


@dataclass(eq=False)
class Inside:
    """Rows of the vertices inside a closed surface, constraints c(q) = 0 on the velocities.

    `start`, `unknown` and `entries` are the rows of the derivative of the gaps, as of
    `CompiledConstraint`.
    """

    vertex: Integers  #: (k,) number of each vertex among those of all directions
    gap: Floats  #: (k,) distance along the normal, negative inside [m]
    start: Integers
    unknown: Integers
    entries: Floats
    scale: float = 1.0  #: factor that gives gaps and derivative the size of the rows of volumes

    def evaluate(self, q: Floats) -> tuple[Floats, Floats]:
        """Return the scaled gaps and their derivative, which do not depend on q."""
        return self.scale * self.gap, self.scale * self.entries

    def add_curvature(self, q: Floats, multiplier: Floats, K: Floats) -> None:
        """Rows are linear."""


class Search:
    """Vertices inside the closed surfaces of pairings, with their nearest faces.

    `pairings` are those of closed lips, and of tissue with closed shells at rest; `free` (n_nodes,)
    marks the nodes that move.
    """

    def __init__(self, pairings: Sequence[Pairing], free: NDArray[np.bool_], rules: Rules) -> None:
        self._rules, self._parts, first = rules, [], 0
        for pairing in pairings:
            a, b = pairing.surfaces
            for one, other in ((a, b), (b, a)):
                if isinstance(one, RigidShell) and not rules.bones:
                    continue
                vertices = np.unique(one.triangles)
                shared = pairing.shared
                if not rules.corners and len(shared):
                    beside = one.triangles[np.isin(one.triangles, shared).any(axis=1)]
                    shared = np.union1d(shared, beside)
                if isinstance(one, NodeSurface):
                    vertices = np.setdiff1d(vertices[free[vertices]], shared)
                self._parts.append((one, SignedFaces(other), vertices, pairing.shared, first))
                first += len(vertices)

    def __call__(self, q: Floats, left_out: Integers) -> Inside:
        """Rows at positions q (n_nodes, 3), without some vertices."""
        found = [self._of(q, left_out, *part) for part in self._parts]
        vertex, gap, nodes, weight = (np.concatenate(part) for part in zip(*found, strict=True))
        used = (weight != 0.0).any(axis=2)
        unknown = (3 * nodes[:, :, None] + np.arange(3))[used].ravel()
        counts = 3 * used.sum(axis=1)
        start = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
        return Inside(vertex, gap, start, unknown, weight[used].ravel())

    def _of(
        self,
        q: Floats,
        left_out: Integers,
        one: NodeSurface | RigidShell,
        faces: SignedFaces,
        vertices: Integers,
        shared: Integers,
        first: int,
    ) -> tuple[Integers, Floats, Integers, Floats]:
        """Number, gap, nodes (k, 4) and derivative by them (k, 4, 3) of one direction."""
        other = faces.surface
        points = (one.vertices if isinstance(one, RigidShell) else q)[vertices]
        x = other.vertices if isinstance(other, RigidShell) else q
        both = isinstance(one, NodeSurface) and isinstance(other, NodeSurface)
        own = vertices if both else NO_NODES
        near = nearest_faces(points, DEEPEST, x, other.triangles, nodes=own)
        depth, _ = faces.signed(points, near, x)  # not a number at a free edge
        number = first + near.point
        corner = other.triangles[near.face]
        beside = np.zeros(len(corner), dtype=bool)
        if not self._rules.corners:
            beside = np.isin(corner, shared).any(axis=1)
        inside = (depth < 0.0) & ~np.isin(number, left_out) & ~beside
        k = np.flatnonzero(inside)
        near, corner = near.take(k), corner[k]
        at = np.einsum("kj,kji->ki", near.weight, x[corner])
        away = points[near.point] - at
        normal = faces.normals(x)[0][near.face]
        if self._rules.direction == "point":
            size = np.linalg.norm(away, axis=1, keepdims=True)
            normal = np.where(size > 1e-9, -away / np.maximum(size, 1e-9), normal)
        gap = np.einsum("ki,ki->k", normal, away)
        weight = np.zeros((len(k), 4))
        row = np.zeros((len(k), 4), dtype=np.int64)
        if isinstance(one, NodeSurface):
            weight[:, 0], row[:, 0] = 1.0, vertices[near.point]
        if isinstance(other, NodeSurface):
            weight[:, 1:], row[:, 1:] = -near.weight, corner
        return number[k], gap, row, weight[:, :, None] * normal[:, None, :]


@dataclass(eq=False)
class PublishedContact:
    """Trapezoidal rule with hard volumes and the published contact."""

    system: sim.System  #: with hard element volumes and without contact
    pairings: Sequence[Pairing]
    rules: Rules
    counts: list[int] = field(default_factory=list)  #: number of rows of each step

    def __post_init__(self) -> None:
        """Compile volumes and search."""
        system, scene = self.system, self.system.scene
        self._pattern = system.point_pattern
        muscles, carriers = tuple(system.muscles), system.kinematics.carriers()
        layout = Layout(scene.mesh, system.node_mass, self._pattern, muscles, carriers)
        self._volumes: CompiledConstraint = sim.HardElementVolume().compile(layout)
        self._scale = float(np.abs(self._volumes.evaluate(scene.mesh.X)[1]).mean())
        moves = np.zeros(scene.mesh.n_nodes, dtype=bool)
        moves[self._pattern.free // 3] = True
        self._search = Search(self.pairings, moves, self.rules)
        self._rows = self._search(scene.mesh.X, NO_NODES)

    def step(self, state: sim.State, activation: Floats, h: float) -> sim.State:
        """State after a step of h [s] with the activation of its end."""
        system, kinematics, rules = self.system, self.system.kinematics, self.rules
        control = system.control(activation, state.t + h)
        here, K = system.tangent(state.q, control)
        D = damping_matrix(system, state.pose, state.v, control, K)
        A = implicit_matrix(system, state.pose, here, K, D, 0.5 * h, 0.25 * h * h)
        w0 = kinematics.velocities(state)
        force = kinematics.generalised_force(here.f, state.pose)
        rhs = 2.0 * kinematics.apply_mass(w0, state.pose) - A.times(w0) + h * force
        rows = self._rows
        both = self._united(rows)
        _, G = both.evaluate(state.pose)
        w1, impulse = self._solved(both, A.values, G, rhs, np.zeros(both.n))
        q = kinematics.advance(state.pose, 0.5 * h * (w0 + w1), state.t + h).q
        pulled = rows.vertex[impulse[both.n - len(rows.vertex) :] > 0.0]
        self._rows = rows = self._search(q, pulled if rules.released else NO_NODES)
        self.counts.append(len(rows.vertex))
        mass = np.zeros(system.pattern.nnz)
        kinematics.add_mass(mass, state.pose)
        deep = np.minimum(rows.gap + rules.tolerance, 0.0)
        if rules.volumes:
            q = self._moved(state, q, rows, deep, mass if rules.mass else A.values)
        else:
            q = self._moved(state, q, rows, deep, mass if rules.mass else A.values, volumes=False)
            q = self._moved(state, q, None, deep[:0], mass)
        return sim.State(state.t + h, q, kinematics.displacements(w1, state.pose))

    def _united(self, rows: Inside | None, volumes: bool = True) -> Constraints:
        """Volumes followed by rows of contact."""
        parts = [self._volumes] if volumes else []
        if rows is not None and len(rows.vertex):
            rows.scale = self._scale
            parts.append(rows)
        rest = self.system.rest_state().pose
        found = unite(parts, self.system.kinematics, rest)
        assert found is not None  # there are volumes, or rows
        return found

    def _moved(
        self,
        state: sim.State,
        q: Floats,
        rows: Inside | None,
        deep: Floats,
        weight: Floats,
        volumes: bool = True,
    ) -> Floats:
        """Positions moved such that rows open and volumes are restored, with the least weight."""
        if not volumes and not len(deep):
            return q
        both = self._united(rows, volumes)
        c, _ = both.evaluate(replace(state.pose, q=q))
        _, G = both.evaluate(state.pose)
        wanted = -c
        if len(deep):
            wanted[both.n - len(deep) :] = -self._scale * deep
        back, _ = self._solved(both, weight, G, np.zeros(self._pattern.n), wanted)
        return self.system.kinematics.advance(replace(state.pose, q=q), back, state.t).q

    def _solved(
        self, both: Constraints, values: Floats, G: Floats, r: Floats, gamma: Floats
    ) -> tuple[Floats, Floats]:
        saddle = Saddle(self._pattern, both)
        saddle.factorise(values, G)
        return saddle.solve(r, gamma)
