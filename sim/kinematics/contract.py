"""Maps between the coordinates of a scene and its points, v = R(q) w + gamma.

Terms exert forces on points: the nodes of the meshes and the points of bodies. Integrators advance
independent velocities w: those of free nodes and of bodies. R is used only within `Kinematics`.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from scipy.sparse import csr_array

from sim.linear.contract import LowRankTerm
from sim.pattern import Index, Sparsity, SymmetricPattern
from sim.state import Array, Pose, State


class Kinematics:
    """Interface of the maps of one scene, and the maps of nodes that are free or fixed.

    Without bodies and attachments R selects the free components; `Articulated` defines the maps of other
    scenes.

    The momentum is linear in the inertial velocities u for any pose: u contains the velocities of all
    points and the angular momenta of all bodies. The discrete equation of motion is written in
    differences of u, so that inertial forces of a rotating R need no separate term and momentum is
    conserved. `matrix_varies` is True if R depends on the pose.
    """

    pattern: Sparsity  #: sparsity of generalised matrices over w
    mass: Array  #: (n,) positive scale of the mass of each velocity [kg, kg m^2]
    rest_frames: Array  #: (n_bodies, 7) frames at rest
    matrix_varies = False

    def __init__(self, points: SymmetricPattern, node_mass: Array) -> None:
        self.pattern, self._free, self._n = points, points.free, points.n_nodes
        self.mass, self.rest_frames = node_mass[points.free // 3], np.zeros((0, 7))
        n = len(self._free)
        entries = np.ones(n), (self._free, np.arange(n))
        self._selection = csr_array(entries, shape=(3 * self._n, n))

    def carriers(self) -> Index:
        """Body (n_points,) that carries each point rigidly; -1 for others."""
        return np.full(self._n, -1, dtype=np.int64)

    def velocities(self, state: State) -> Array:
        """Independent velocities w (n,) of a state."""
        return state.v.reshape(-1)[self._free]

    def state(self, pose: Pose, w: Array, memory: Mapping[str, Array]) -> State:
        """State at a pose with velocities w; all points have v = R w + gamma."""
        return State(pose.t, pose.q, self.displacements(w, pose), memory)

    def displacements(self, d: Array, pose: Pose) -> Array:
        """R d (n_points, 3), the displacement of points for small changes d of the coordinates."""
        out = np.zeros_like(pose.q)
        out.reshape(-1)[self._free] = d
        return out

    def advance(self, pose: Pose, d: Array, t: float) -> Pose:
        """Pose at time t after the motion d (n,): nodes add, bodies rotate by the exponential map."""
        q = pose.q.copy()
        q.reshape(-1)[self._free] += d
        return replace(pose, q=q, t=t)

    def at(self, pose: Pose, t: float) -> Pose:
        """Return the pose with prescribed nodes and bodies moved to a time [s]."""
        return pose

    def between(self, start: Pose, end: Pose) -> Array:
        """Motion d (n,) that advances one pose to another."""
        return end.q.reshape(-1)[self._free] - start.q.reshape(-1)[self._free]

    def rate(self, d: Array, w: Array) -> Array:
        """Rate dd/dt (n,) of a motion d at velocities w: equal to w except for rotations."""
        return w

    def gradient(self, g: Array, d: Array) -> Array:
        """Derivative of an energy by d, from its generalised gradient g: g except for rotations."""
        return g

    def gradients(self, G: csr_array, d: Array) -> csr_array:
        """As `gradient`, of every row of G (m, n)."""
        return G

    def add_damping(self, values: Array) -> None:
        """Add the damping of bodies relative to space to values on `pattern`."""

    def generalised_force(self, f: Array, pose: Pose) -> Array:
        """R'f (n,) of forces on points (n_points, 3) [N]."""
        return f.reshape(-1)[self._free]

    def generalised_matrix(self, K: Array, f: Array | None, pose: Pose) -> Array:
        """Values of R'K R - dR'f on `pattern`, from values K on the pattern of the points."""
        return K

    def product(self, part: LowRankTerm, pose: Pose) -> LowRankTerm:
        """Transform a matrix-free product over the components of points to one over w."""
        return part

    def drift(self, pose: Pose, t: float) -> Array | None:
        """Velocities gamma (n_points, 3) by prescribed motions at a time, or None."""
        return None

    def inertial(self, w: Array, pose: Pose) -> Array:
        """Inertial velocities u of velocities w."""
        return w

    def momentum(self, u: Array, pose: Pose) -> Array:
        """Generalised momentum (n,) of inertial velocities u."""
        return self.mass * u

    def apply_mass(self, w: Array, pose: Pose) -> Array:
        """M(q) w, the generalised momentum of velocities w (n,)."""
        return self.mass * w

    def solve_mass(self, p: Array, pose: Pose) -> Array:
        """Solution w of M(q) w = p, each (n,) or (n, k)."""
        return (p.T / self.mass).T

    def add_mass(self, values: Array, pose: Pose) -> None:
        """Add M(q) to values on `pattern`."""
        values[self.pattern.diagonal] += self.mass

    def kinetic_energy(self, state: State) -> float:
        """Rotational kinetic energy [J] of the bodies, in addition to that of the masses of points."""
        return 0.0

    def matrix(self, pose: Pose) -> csr_array:
        """R (3 n_points, n) at a pose."""
        return self._selection

    def body_columns(self, n_bodies: int) -> Index:
        """First velocity of every body, -1 where it is not free, and a last -1 for space."""
        return np.array([-1], dtype=np.int64)

    def prescribe(self, frames: Array, t: float) -> None:
        """Set frames (n_bodies, 7) of prescribed bodies to their values at a time."""

    def prescribed_twists(self, t: float) -> Array:
        """Twists (n_bodies, 6) of prescribed bodies at a time; zero for other bodies."""
        return np.zeros((0, 6))

    def inertial_force(self, state: State) -> Array:
        """Inertial forces b (n,) of M dw/dt = R'f - b: gyroscopic moments and centripetal forces."""
        return np.zeros(self.pattern.n)

    def gyration(self, state: State) -> Array:
        """Rates (n,) I^-1 (w x I w) of the angular velocities of bodies, zero for other velocities."""
        return np.zeros(self.pattern.n)

    def coasted(self, w: Array, pose: Pose, h: float, theta: float) -> Array:
        """Velocities (n,) after a time h without forces, by implicit Euler or a symmetric rule.

        Bodies keep their angular momentum, I1 w1 = I0 w0, with the inertia I1 after the rotation
        h ((1 - theta) w0 + theta w1). Raises NotConverged if the rotation is too large for the rule.
        """
        return w

    def kicked(self, u: Array, impulse: Array, s: float, state: State) -> Array:
        """Inertial velocities u after the time s under a generalised impulse (n,), from a state."""
        return u + impulse / self.mass
