"""Maps between the coordinates of a scene and its points, v = R(q) w + gamma.

Terms exert forces on points: the nodes of the meshes and the points of bodies. Integrators advance
independent velocities w: those of free nodes and of bodies. R is used only within `Kinematics`.
"""

from collections.abc import Mapping
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from sim.matrix import Product
from sim.pattern import Sparsity
from sim.state import Array, Pose, State

Index = NDArray[np.int64]


class Kinematics(Protocol):
    """Interface of the maps of one scene.

    Notes
    -----
    The momentum is linear in the inertial velocities u for any pose: u contains the velocities of
    all points and the angular momenta of all bodies. The discrete equation of motion is written in
    differences of u, so that inertial forces of a rotating R need no separate term and momentum is
    conserved.
    """

    @property
    def pattern(self) -> Sparsity:
        """Sparsity of generalised matrices over w."""
        ...

    @property
    def mass(self) -> Array:
        """Positive scale of the mass of each velocity (n,) [kg, kg m^2]."""
        ...

    @property
    def matrix_varies(self) -> bool:
        """True if R depends on the pose."""
        ...

    @property
    def rest_frames(self) -> Array:
        """Frames (n_bodies, 7) at rest."""
        ...

    def velocities(self, state: State) -> Array:
        """Independent velocities w (n,) of a state."""
        ...

    def state(self, pose: Pose, w: Array, memory: Mapping[str, Array]) -> State:
        """State at a pose with velocities w; all points have v = R w + gamma."""
        ...

    def displacements(self, d: Array, pose: Pose) -> Array:
        """R d (n_points, 3), the displacement of points for small changes d of the coordinates."""
        ...

    def advance(self, pose: Pose, d: Array, t: float) -> Pose:
        """Pose at time t after the motion d (n,): nodes add, bodies rotate by the exponential map."""
        ...

    def at(self, pose: Pose, t: float) -> Pose:
        """Return the pose with prescribed nodes and bodies moved to a time [s]."""
        ...

    def between(self, start: Pose, end: Pose) -> Array:
        """Motion d (n,) that advances one pose to another."""
        ...

    def rate(self, d: Array, w: Array) -> Array:
        """Rate dd/dt (n,) of a motion d at velocities w: equal to w except for rotations."""
        ...

    def gradient(self, g: Array, d: Array) -> Array:
        """Derivative of an energy by d, from its generalised gradient g: g except for rotations."""
        ...

    def add_damping(self, values: Array) -> None:
        """Add the damping of bodies relative to space to values on `pattern`."""
        ...

    def generalised_force(self, f: Array, pose: Pose) -> Array:
        """R'f (n,) of forces on points (n_points, 3) [N]."""
        ...

    def generalised_matrix(self, K: Array, f: Array | None, pose: Pose) -> Array:
        """Values of R'K R - dR'f on `pattern`, from values K on the pattern of the points."""
        ...

    def product(self, part: Product, pose: Pose) -> Product:
        """Transform a matrix-free product over the components of points to one over w."""
        ...

    def drift(self, pose: Pose, t: float) -> Array | None:
        """Velocities gamma (n_points, 3) by prescribed motions at a time, or None."""
        ...

    def inertial(self, w: Array, pose: Pose) -> Array:
        """Inertial velocities u of velocities w."""
        ...

    def momentum(self, u: Array, pose: Pose) -> Array:
        """Generalised momentum (n,) of inertial velocities u."""
        ...

    def apply_mass(self, w: Array, pose: Pose) -> Array:
        """M(q) w, the generalised momentum of velocities w (n,)."""
        ...

    def solve_mass(self, p: Array, pose: Pose) -> Array:
        """Solution w of M(q) w = p, each (n,) or (n, k)."""
        ...

    def add_mass(self, values: Array, pose: Pose) -> None:
        """Add M(q) to values on `pattern`."""
        ...

    def kinetic_energy(self, state: State) -> float:
        """Rotational kinetic energy [J] of the bodies, in addition to that of the masses of points."""
        ...

    def matrix(self, pose: Pose) -> csr_array:
        """R (3 n_points, n) at a pose."""
        ...

    def body_columns(self, n_bodies: int) -> Index:
        """First velocity of every body, -1 where it is not free, and a last -1 for space."""
        ...

    def prescribe(self, frames: Array, t: float) -> None:
        """Set frames (n_bodies, 7) of prescribed bodies to their values at a time."""
        ...

    def prescribed_twists(self, t: float) -> Array:
        """Twists (n_bodies, 6) of prescribed bodies at a time; zero for other bodies."""
        ...

    def inertial_force(self, state: State) -> Array:
        """Inertial forces b (n,) of M dw/dt = R'f - b: gyroscopic moments and centripetal forces."""
        ...

    def kicked(self, u: Array, impulse: Array, s: float, state: State) -> Array:
        """Inertial velocities u after the time s under a generalised impulse (n,), from a state."""
        ...
