"""Kinematics of meshes whose nodes are free or fixed: R selects unknowns and is constant."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.sparse import csr_array

from sim.matrix import Product
from sim.pattern import Index, SymmetricPattern
from sim.state import Array, Pose, State


@dataclass(frozen=True, eq=False)
class Selection:
    """Free components of nodes as coordinates; inertial velocities are the velocities themselves.

    Attributes
    ----------
    pattern : SymmetricPattern
    mass : (n,) lumped mass of each free component [kg].
    """

    pattern: SymmetricPattern
    mass: Array
    matrix_varies = False
    rest_frames: Array = field(default_factory=lambda: np.zeros((0, 7)))

    def velocities(self, state: State) -> Array:
        """Free components of the nodal velocities."""
        return self._of(state.v)

    def state(self, pose: Pose, w: Array, memory: Mapping[str, Array]) -> State:
        """State with zero velocity of fixed components."""
        return State(pose.t, pose.q, self.displacements(w, pose), memory)

    def displacements(self, d: Array, pose: Pose) -> Array:
        """Nodal vector with components d, zero where fixed."""
        out = np.zeros_like(pose.q)
        out.reshape(-1)[self.pattern.free] = d
        return out

    def advance(self, pose: Pose, d: Array, t: float) -> Pose:
        """Add d to the free components."""
        q = pose.q.copy()
        q.reshape(-1)[self.pattern.free] += d
        return replace(pose, q=q, t=t)

    def at(self, pose: Pose, t: float) -> Pose:
        """Return the pose itself, since nothing is prescribed."""
        return pose

    def between(self, start: Pose, end: Pose) -> Array:
        """Difference of the free components."""
        return self._of(end.q) - self._of(start.q)

    def rate(self, d: Array, w: Array) -> Array:
        """Return the velocities."""
        return w

    def gradient(self, g: Array, d: Array) -> Array:
        """Return the gradient itself."""
        return g

    def add_damping(self, values: Array) -> None:
        """Do nothing: there are no bodies."""

    def generalised_force(self, f: Array, pose: Pose) -> Array:
        """Free components of nodal forces."""
        return self._of(f)

    def generalised_matrix(self, K: Array, f: Array | None, pose: Pose) -> Array:
        """Return K itself, which is assembled over the free components."""
        return K

    def product(self, part: Product, pose: Pose) -> Product:
        """Return the product itself."""
        return part

    def drift(self, pose: Pose, t: float) -> Array | None:
        """Return None, since nothing is prescribed."""
        return None

    def inertial(self, w: Array, pose: Pose) -> Array:
        """Return the velocities."""
        return w

    def momentum(self, u: Array, pose: Pose) -> Array:
        """Mass times velocity."""
        return self.mass * u

    def apply_mass(self, w: Array, pose: Pose) -> Array:
        """Product with the diagonal mass."""
        return self.mass * w

    def solve_mass(self, p: Array, pose: Pose) -> Array:
        """Quotient by the diagonal mass."""
        return (p.T / self.mass).T

    def add_mass(self, values: Array, pose: Pose) -> None:
        """Add the mass to the diagonal."""
        values[self.pattern.diagonal] += self.mass

    def kinetic_energy(self, state: State) -> float:
        """Return zero, since there are no bodies."""
        return 0.0

    def matrix(self, pose: Pose) -> csr_array:
        """Unit vectors of the free components."""
        free, n = self.pattern.free, self.pattern.n
        place = free, np.arange(n)
        return csr_array((np.ones(n), place), shape=(3 * self.pattern.n_nodes, n))

    def body_columns(self, n_bodies: int) -> Index:
        """Return the last entry, that of space, since there are no bodies."""
        return np.array([-1], dtype=np.int64)

    def prescribe(self, frames: Array, t: float) -> None:
        """Do nothing: no body is prescribed."""

    def prescribed_twists(self, t: float) -> Array:
        """Return an empty array."""
        return np.zeros((0, 6))

    def inertial_force(self, state: State) -> Array:
        """Return zero, since R is constant."""
        return np.zeros(self.pattern.n)

    def kicked(self, u: Array, impulse: Array, s: float, state: State) -> Array:
        """Add the impulse divided by the mass."""
        return u + impulse / self.mass

    def _of(self, x: Array) -> Array:
        return x.reshape(-1)[self.pattern.free]
