"""Contact rows, each of one vertex and one face, their lengths, directions, multipliers and forces.

Of the relative displacement r of vertex and face since the start of the step, a row contains the
gap g = gap0 + n . r at the end of the step. With its multipliers lambda (along n) and lambda_t
(tangential) and its penalty rho, the force on the vertex is

    f = max(0, lambda - rho g) n + tau min(1, bound/|tau|),   tau = lambda_t - rho (r - n n . r),

with bound = friction lambda. It is minus the derivative of a convex potential; converged
multipliers satisfy 0 <= f_n, g >= 0, f_n g = 0 and Coulomb's law, for any rho.

Source of the augmentation: Alart and Curnier 1991, A mixed formulation for frictional contact
problems prone to Newton like solution methods; Simo and Laursen 1992, An augmented Lagrangian
treatment of contact problems involving friction.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.sparse import csr_array

from sim.dense import dot
from sim.pattern import Flags, SymmetricPattern
from sim.scene import Index
from sim.state import Array

LARGEST_SHARE = 0.2  #: largest tolerance relative to the approach distance


@dataclass(frozen=True)
class ContactTolerances:
    """Lengths at which contact decides, in terms of two."""

    length: float = 5e-4  #: distance of a vertex and a face below which they have a row [m]
    share: float = 2e-3  #: gap, penetration or slip that an iteration leaves, relative to `length`

    def _residuals(self, number: float) -> float:
        return min(number * self.share, LARGEST_SHARE) * self.length

    @cached_property
    def residual(self) -> float:
        """Remaining gap or slip of an iteration [m]; ten times larger values cause visible gaps."""
        return self._residuals(1.0)

    @cached_property
    def solution(self) -> float:
        """Error of an iterative linear solution [m], below the residual, so that gaps converge."""
        return self._residuals(0.3)

    @cached_property
    def converged(self) -> float:
        """Residual of a converged step [m], which the correction of positions removes."""
        return self._residuals(2.0)

    @cached_property
    def noticed(self) -> float:
        """Smallest penetration that is corrected [m]; smaller ones remain."""
        return self._residuals(3.0)

    @cached_property
    def left(self) -> float:
        """Penetration after a correction above which rows are searched again [m]."""
        return self._residuals(5.0)

    @cached_property
    def accepted(self) -> float:
        """Violation of rows that the correction removes [m]; limited, so that no vertex enters."""
        return self._residuals(10.0)

    @cached_property
    def unexpected(self) -> float:
        """Depth of an inactive row above which a step is solved again [m]."""
        return self._residuals(20.0)

    @cached_property
    def considerable(self) -> float:
        """Depth of an active row above which a step is solved again [m]."""
        return 0.2 * self.length

    @cached_property
    def likely(self) -> float:
        """Gap below which rows may become active in the same iteration [m]."""
        return 0.2 * self.length

    @cached_property
    def slide(self) -> float:
        """Sliding distance over which contact normals are low-pass filtered [m]."""
        return 0.5 * self.length

    @cached_property
    def hair(self) -> float:
        """Initial depth up to which a vertex is regarded as on the surface [m]."""
        return 0.2 * self.length

    @cached_property
    def lift(self) -> float:
        """Distance outside the surface from which the path of such a vertex starts [m]."""
        return 2e-4 * self.length


PLACED = 1e-6  #: change of normals and weights of rows that requires no renewal

NEAREST, CROSSED, WALL, ALTERNATING, NO_RANK = 0, 1, 2, 3, 4  #: ranks of rows


@dataclass(frozen=True, eq=False)
class ContactRows:
    """Contact constraints of vertices and faces."""

    contact_vertex: Index  #: (k,) index of the vertex in the contact memory
    place: Index  #: (k,) index of the opposite feature: a triangle, an edge, or a vertex
    rank: Index  #: (k,) 0 for the nearest faces of a vertex, larger for rows of lower priority
    #: (k, 4) the vertex with weight 1, then the nodes of the face with minus their barycentric weights;
    #: those of a shell have weight zero and repeat a node of the other
    nodes: Index
    weight: Array
    normal: Array  #: (k, 3) outward normal of the opposite face
    gap: Array  #: (k,) gap at the end of the step without motion of the mesh [m]
    #: (k, 3) displacement of a rigid face over the step, or minus that of a rigid vertex [m]
    shell_motion: Array
    friction: Array  #: (k,) coefficient
    pairing: Index  #: (k,) index of the pairing

    def __len__(self) -> int:
        """Number of rows."""
        return len(self.contact_vertex)

    def displacement(self, u: Array) -> Array:
        """Relative displacement r (k, 3) for nodal displacements u (n_nodes, 3) since the start."""
        return np.einsum("kj,kji->ki", self.weight, u[self.nodes]) - self.shell_motion

    def gaps(self, u: Array) -> Array:
        """Gaps (k,) for nodal displacements u [m]."""
        return self.gap + np.einsum("ki,ki->k", self.normal, self.displacement(u))

    def foremost(self) -> Index:
        """Rows of the lowest rank of every vertex."""
        lowest = np.full(int(self.contact_vertex.max(initial=-1)) + 1, NO_RANK)
        np.minimum.at(lowest, self.contact_vertex, self.rank)
        return np.flatnonzero(self.rank == lowest[self.contact_vertex])

    def spread(self, force: Array, n_nodes: int) -> Array:
        """Nodal forces (n_nodes, 3) of the forces (k, 3) on the vertices."""
        at = self.nodes.ravel()
        parts = (self.weight[:, :, None] * force[:, None, :]).reshape(-1, 3)
        out = np.empty((n_nodes, 3))
        for i in range(3):
            out[:, i] = np.bincount(at, parts[:, i], n_nodes)
        return out

    def take(self, which: Index) -> "ContactRows":
        """Selection of rows."""
        return ContactRows(*(getattr(self, name)[which] for name in self.__dataclass_fields__))

    def joined(self, *others: "ContactRows") -> "ContactRows":
        """Concatenation of these and other rows."""
        parts = [part for part in (self, *others) if len(part)]
        if len(parts) < 2:
            return parts[0] if parts else self
        names = self.__dataclass_fields__
        return ContactRows(*(np.concatenate([getattr(part, n) for part in parts]) for n in names))

    @property
    def keys(self) -> Index:
        """Unique integer (k,) of vertex and feature."""
        return self.contact_vertex * (1 << 32) + self.place

    def without(self, others: "ContactRows") -> "ContactRows":
        """Rows whose vertex and feature do not occur in other rows."""
        return self.take(np.flatnonzero(~np.isin(self.keys, others.keys)))


_NONE, _REAL, _VECTOR = np.empty(0, np.int64), np.empty(0), np.empty((0, 3))

NO_ROWS = ContactRows(
    *(_NONE, _NONE, _NONE, np.empty((0, 4), np.int64), np.empty((0, 4))),
    *(_VECTOR, _REAL, _VECTOR, _REAL, _NONE),
)


def at_end(rows: ContactRows, lift: Array, near: ContactRows) -> ContactRows:
    """Rows with the normals and closest points that they have at the end, if these differ.

    Those of the start are of first order where surfaces slide while they turn, and their pairs of forces
    would change the angular momentum. `lift` (k,) are initial depths that may remain [m].
    """
    order = np.argsort(near.keys)
    place = np.searchsorted(near.keys[order], rows.keys).clip(max=max(len(near) - 1, 0))
    if not len(near) or not len(rows):
        return rows
    other = near.take(order[place])
    same = other.keys == rows.keys
    turned = np.abs(other.normal - rows.normal).max(axis=1)
    changed = same & (np.maximum(turned, np.abs(other.weight - rows.weight).max(axis=1)) > PLACED)
    if not changed.any():
        return rows
    one = changed[:, None]
    return replace(
        rows,
        nodes=np.where(one, other.nodes, rows.nodes),
        weight=np.where(one, other.weight, rows.weight),
        normal=np.where(one, other.normal, rows.normal),
        gap=np.where(changed, other.gap + lift, rows.gap),
        shell_motion=np.where(one, other.shell_motion, rows.shell_motion),
    )


@dataclass(frozen=True, eq=False)
class Multipliers:
    """Multipliers and penalties of rows, and contact forces at given displacements."""

    rows: ContactRows
    rho: Array  #: (k,) penalties [N/m]
    normal: Array  #: (k,) multipliers along the normals [N]
    tangent: Array  #: (k, 3) tangential multipliers [N]
    bound: Array  #: (k,) bounds of friction [N]

    @classmethod
    def with_bounds(
        cls, rows: ContactRows, rho: Array, normal: Array, tangent: Array
    ) -> "Multipliers":
        """Multipliers with the bounds of friction by the normal ones."""
        return cls(rows, rho, normal, tangent, rows.friction * normal)

    def at(self, u: Array) -> "ContactForces":
        """Contact forces at nodal displacements u (n_nodes, 3) since the start of the step."""
        r, n, rho = self.rows.displacement(u), self.rows.normal, self.rho
        along = np.einsum("ki,ki->k", n, r)
        gap = self.rows.gap + along
        force = np.maximum(self.normal - rho * gap, 0.0)
        energy = float((force * force / (2.0 * rho)).sum())
        if not (self.rows.friction > 0.0).any():
            none, zero = np.zeros(len(n)), np.zeros_like(n)
            return ContactForces(gap, force, zero, zero, none > 0.0, none, 0.0, energy)
        across = r - along[:, None] * n
        tau = self.tangent - rho[:, None] * across
        size = np.sqrt(np.einsum("ki,ki->k", tau, tau))
        sticks = (size <= self.bound) & (self.bound > 0.0)
        share = np.where(sticks, 1.0, self.bound / np.where(size > 0.0, size, 1.0))
        friction = share[:, None] * tau
        stuck: Array = 0.5 * size**2 / rho
        slid: Array = self.bound * (size - 0.5 * self.bound) / rho
        stored: Array = np.where(sticks, stuck, slid)
        energy += dot(stored, np.ones(len(n)))
        slip = float(np.abs(across[sticks]).max()) if sticks.any() else 0.0
        turn = np.where(sticks, 0.0, share * rho)
        return ContactForces(gap, force, across, friction, sticks, turn, slip, energy)

    def stiffness(self, acting: "ContactForces") -> Array:
        """Blocks (k, 3, 3), minus the derivative of the force on the vertex by r [N/m]."""
        n = self.rows.normal
        nn = n[:, :, None] * n[:, None, :]
        block = np.where(acting.force > 0.0, self.rho, 0.0)[:, None, None] * nn
        if not (self.bound > 0.0).any():
            return block
        plane = np.eye(3) - nn
        size = np.sqrt(np.einsum("ki,ki->k", acting.friction, acting.friction))
        along = acting.friction / np.where(size > 0.0, size, 1.0)[:, None]
        # A sliding contact resists only changes of its direction.
        turn = plane - along[:, :, None] * along[:, None, :]
        block += np.where(acting.sticks, self.rho, 0.0)[:, None, None] * plane
        return block + acting.turn[:, None, None] * turn

    def pushing(self, acting: "ContactForces") -> Index:
        """Slots of the active rows."""
        return self.rows.contact_vertex[acting.force > 0.0]

    def forces(self, normal: Array, tangent: Array) -> "Multipliers":
        """The rows with other multipliers [N]."""
        return Multipliers.with_bounds(self.rows, self.rho, normal, tangent)


@dataclass(frozen=True, eq=False)
class ContactForces:
    """Gaps and forces of rows at given displacements."""

    gap: Array  #: (k,) [m]
    force: Array  #: (k,) along the normals [N]
    across: (
        Array  #: (k, 3) displacement across the normals since the start; zero without friction [m]
    )
    friction: Array  #: (k, 3) tangential [N]
    sticks: Flags  #: (k,) True for sticking contacts
    turn: Array  #: (k,) stiffness of a sliding contact against a change of direction [N/m]
    slip: float  #: largest slip of a sticking contact [m]
    energy: float  #: of the augmentation [J]

    def on_nodes(self, rows: ContactRows, n_nodes: int) -> Array:
        """Total forces (n_nodes, 3) on the nodes of the rows [N]."""
        return rows.spread(self.force[:, None] * rows.normal + self.friction, n_nodes)

    def violation(self) -> float:
        """Largest violation [m]: gap of an active row, penetration of an inactive one, or slip."""
        violation = np.where(self.force > 0.0, np.abs(self.gap), np.maximum(-self.gap, 0.0))
        return max(float(violation.max(initial=0.0)), self.slip)


def directions(
    pattern: SymmetricPattern, rows: ContactRows, along: Array | None = None
) -> csr_array:
    """D (k, n_free), motion along directions (k, 3), by default the normals, by the free unknowns."""
    along = rows.normal if along is None else along
    k = len(rows)
    place = np.full(3 * pattern.n_nodes, -1)
    place[pattern.free] = np.arange(len(pattern.free))
    column = place[(3 * rows.nodes[:, :, None] + np.arange(3)).reshape(k, 12)]
    entry = (rows.weight[:, :, None] * along[:, None, :]).reshape(k, 12)
    used = (column >= 0) & (entry != 0.0)
    ends = np.r_[0, np.cumsum(used.sum(axis=1))]
    return csr_array((entry[used], column[used], ends), shape=(k, len(pattern.free)))


def across(normal: Array) -> tuple[Array, Array]:
    """Two unit vectors (k, 3) perpendicular to normals and each other."""
    one: Array = np.cross(normal, np.eye(3)[np.abs(normal).argmin(axis=1)]).astype(np.float64)
    one /= np.linalg.norm(one, axis=1, keepdims=True)
    return one, np.cross(normal, one).astype(np.float64)
