"""Multipliers of rows, and contact forces of the augmented Lagrangian.

With the gap g and the relative displacement r of a row (`sim.contact.rows`), the multipliers lambda
(along n) and lambda_t (tangential) and the penalty rho, the force on the vertex is

    f = max(0, lambda - rho g) n + tau min(1, bound/|tau|),   tau = lambda_t - rho (r - n n . r),

with bound = friction lambda. It is minus the derivative of a convex potential; converged
multipliers satisfy 0 <= f_n, g >= 0, f_n g = 0 and Coulomb's law, for any rho.

Source of the augmentation: Alart and Curnier 1991, A mixed formulation for frictional contact
problems prone to Newton like solution methods; Simo and Laursen 1992, An augmented Lagrangian
treatment of contact problems involving friction.
"""

from dataclasses import dataclass

import numpy as np

from sim.contact.rows import Flags, Rows
from sim.scene import Index
from sim.state import Array
from sim.vectors import dot


@dataclass(eq=False)
class Multipliers:
    """Multipliers and penalties of rows, and contact forces at given displacements.

    Attributes
    ----------
    rows : Rows
    rho : (k,) penalties [N/m].
    normal : (k,) multipliers along the normals [N].
    tangent : (k, 3) tangential multipliers [N].
    """

    rows: Rows
    rho: Array
    normal: Array
    tangent: Array

    def __post_init__(self) -> None:
        """Fix the bounds of friction at the present multipliers."""
        self.bound = self.rows.friction * self.normal
        self.released = np.zeros(len(self.rows), dtype=bool)

    def at(self, u: Array) -> "Acting":
        """Contact forces at nodal displacements u (n_nodes, 3) since the start of the step."""
        return self.at_relative(self.rows.displacement(u))

    def at_relative(self, r: Array) -> "Acting":
        """Contact forces at relative displacements r (k, 3)."""
        n, rho = self.rows.normal, self.rho
        along = np.einsum("ki,ki->k", n, r)
        gap = self.rows.gap + along
        force = np.where(self.released, 0.0, np.maximum(self.normal - rho * gap, 0.0))
        energy = float((force * force / (2.0 * rho)).sum())
        if not (self.rows.friction > 0.0).any():
            none = np.zeros(len(n))
            return Acting(gap, force, np.zeros_like(n), none > 0.0, none, 0.0, energy)
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
        return Acting(gap, force, friction, sticks, turn, slip, energy)

    def stiffness(self, acting: "Acting", pushes: Flags | None = None) -> Array:
        """Blocks (k, 3, 3), minus the derivative of the force on the vertex by r [N/m].

        With `pushes` (k,) these rows are treated as active.
        """
        n = self.rows.normal
        nn = n[:, :, None] * n[:, None, :]
        pushing = acting.force > 0.0 if pushes is None else pushes
        block = np.where(pushing, self.rho, 0.0)[:, None, None] * nn
        if not (self.bound > 0.0).any():
            return block
        plane = np.eye(3) - nn
        size = np.sqrt(np.einsum("ki,ki->k", acting.friction, acting.friction))
        along = acting.friction / np.where(size > 0.0, size, 1.0)[:, None]
        # A sliding contact resists only changes of its direction.
        turn = plane - along[:, :, None] * along[:, None, :]
        block += np.where(acting.sticks, self.rho, 0.0)[:, None, None] * plane
        return block + acting.turn[:, None, None] * turn

    def held(self, acting: "Acting", pushes: Flags) -> Array:
        """Normal forces (k,) if these rows are active and no others [N]."""
        return np.where(pushes, self.normal - self.rho * acting.gap, 0.0)

    def pushing(self, acting: "Acting") -> Index:
        """Slots of the active rows."""
        return self.rows.slot[acting.force > 0.0]

    def update(self, acting: "Acting") -> None:
        """Set the multipliers to the present forces."""
        self.normal, self.tangent = acting.force, acting.friction
        self.bound = self.rows.friction * self.normal


@dataclass(frozen=True, eq=False)
class Acting:
    """Gaps and forces of rows at given displacements.

    Attributes
    ----------
    gap : (k,) [m]
    force : (k,) along the normals [N].
    friction : (k, 3) tangential [N].
    sticks : (k,) True for sticking contacts.
    turn : (k,) stiffness of a sliding contact against a change of direction [N/m].
    slip : float
        Largest slip of a sticking contact [m].
    energy : float
        Of the augmentation [J].
    """

    gap: Array
    force: Array
    friction: Array
    sticks: Flags
    turn: Array
    slip: float
    energy: float

    def on_vertices(self, rows: Rows) -> Array:
        """Total forces (k, 3) on the vertices [N]."""
        return self.force[:, None] * rows.normal + self.friction

    def miss(self, multipliers: Multipliers, pushes: Flags | None = None) -> float:
        """Largest violation [m]: gap of an active row, penetration of an inactive one, or slip.

        With `pushes` (k,) these rows are treated as active.
        """
        pushing = self.force > 0.0
        if pushes is not None:
            miss = np.where(pushes & pushing, np.abs(self.gap), 0.0)
        else:
            inside = np.where(multipliers.released, 0.0, np.maximum(-self.gap, 0.0))
            miss = np.where(pushing, np.abs(self.gap), inside)
        return max(float(miss.max(initial=0.0)), self.slip)
