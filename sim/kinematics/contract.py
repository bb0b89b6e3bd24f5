"""Maps between the coordinates of a scene and its points, v = R(q) w + gamma.

Terms exert forces on points: the nodes of the meshes and the points of bodies. Integrators advance
independent velocities w: those of free nodes and of bodies. R is used only in a `Kinematics`.
"""

from collections.abc import Mapping
from typing import Protocol

from sim.pattern import Sparsity
from sim.state import Array, Pose, State


class Kinematics(Protocol):
    """Interface of the maps of one scene.

    Notes
    -----
    The momentum is linear in the inertial velocity u for any pose: that of every point and the
    momentum of every body. The discrete equation of motion is written in differences of u, so that
    inertial forces of a rotating R need no separate term and momentum is conserved.
    """

    @property
    def pattern(self) -> Sparsity:
        """Of generalised matrices over w."""
        ...

    @property
    def mass(self) -> Array:
        """Positive scale of the mass of each velocity (n,) [kg, kg m^2]."""
        ...

    @property
    def matrix_varies(self) -> bool:
        """True if R depends on the pose."""
        ...

    def velocities(self, state: State) -> Array:
        """Independent velocities w (n,) of a state."""
        ...

    def state(self, pose: Pose, w: Array, memory: Mapping[str, Array]) -> State:
        """State at a pose with velocities w, those of all points v = R w + gamma."""
        ...

    def displacements(self, d: Array, pose: Pose) -> Array:
        """R d (n_points, 3), the motion of all points by small changes d (n,) of the coordinates."""
        ...

    def advance(self, pose: Pose, d: Array, t: float) -> Pose:
        """Pose at time t after the motion d (n,): nodes add, bodies turn by the exponential map."""
        ...

    def between(self, start: Pose, end: Pose) -> Array:
        """Motion d (n,) that advances one pose to another."""
        ...

    def rate(self, d: Array, w: Array) -> Array:
        """Rate dd/dt (n,) of a motion d since some pose by velocities w: w but for rotations."""
        ...

    def generalised_force(self, f: Array, pose: Pose) -> Array:
        """R'f (n,) of forces on points (n_points, 3) [N]."""
        ...

    def generalised_matrix(self, K: Array, f: Array | None, pose: Pose) -> Array:
        """Values of R'K R - dR'f on `pattern`, from values K on the pattern of the points."""
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
        """Solution w (n,) of M(q) w = p."""
        ...

    def add_mass(self, values: Array, pose: Pose) -> None:
        """Add M(q) to values on `pattern`."""
        ...

    def inertial_force(self, state: State) -> Array:
        """Inertial forces b (n,) of M dw/dt = R'f - b: gyroscopic moments and centripetal forces."""
        ...

    def kicked(self, u: Array, impulse: Array, s: float, state: State) -> Array:
        """Inertial velocities u after the time s under a generalised impulse (n,) at a state."""
        ...
