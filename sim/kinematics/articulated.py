"""Kinematics of free nodes, rigid bodies, and points attached to either.

The velocities w are those of the free components of nodes, followed by six for every free body:
linear velocity of the centre of mass and angular velocity, both in space. Points are x = sum_n w_n
x_n + sum_b (share_b c_b + Q_b arm_b), so that rows of R contain weights, shares, and -[Q_b arm_b]x.
"""

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import replace

import numpy as np
from scipy.sparse import csr_array, hstack

from sim._kernels import matrix as kernel
from sim._kernels.frames import coast_all
from sim.bodies import Body
from sim.dense import solved
from sim.errors import NotConverged
from sim.kinematics import rotations
from sim.kinematics.chains import Chains
from sim.kinematics.congruence import Congruence, lay_out
from sim.kinematics.contract import Kinematics
from sim.kinematics.paths import Path, Paths
from sim.linear.contract import LowRankTerm
from sim.pattern import Index, Sparsity, SymmetricPattern
from sim.state import Array, Pose, State

_UPPER = np.triu_indices(6)
_ROTATION = ((0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1))  #: entries of -[r]x that are not zero


CACHED_POSES = 4  #: number of poses whose R is kept


class Articulated(Kinematics):
    """Maps of a scene with bodies or attachments.

    `points` is the sparsity of the tangents of terms over the components that move, and `node_mass`
    (n_points,) includes the mass of every body at its centre [kg]. `free_bodies` are those without
    prescribed motion, `first` is the column of the first body among the velocities, and `chains` and
    `paths` are attachments and prescribed motions.
    """

    matrix_varies = True

    def __init__(
        self,
        points: SymmetricPattern,
        node_mass: Array,
        bodies: Sequence[Body],
        motions: Sequence[Path | None],
        chains: Chains,
    ) -> None:
        self.chains, self._n = chains, points.n_nodes
        self.paths = Paths(chains.paths, motions, bodies)
        self.free_bodies: Index = np.flatnonzero(~self.paths.moved)
        own: list[Body] = [bodies[int(b)] for b in self.free_bodies]
        inertia = [np.asarray(b.inertia, dtype=np.float64) for b in own]
        self._inertia = np.array(inertia).reshape(-1, 3, 3)
        self._damping = np.array([b.damping for b in own], dtype=np.float64).reshape(-1, 2)
        self._point_mass = np.repeat(node_mass, 3)

        root = np.ones(self._n, dtype=bool)
        root[chains.dependent] = False
        for nodes, _ in chains.paths:
            root[nodes] = False
        moves = root[:, None] & ~chains.fixed
        self._free = np.flatnonzero(moves.ravel())
        self.first = len(self._free)
        self._number = np.full(3 * self._n, -1, dtype=np.int64)
        self._number[self._free] = np.arange(self.first)
        self._body_number = np.full(len(bodies), -1, dtype=np.int64)
        self._body_number[self.free_bodies] = np.arange(len(own))
        n = self.first + 6 * len(own)

        # those of the last poses, by their frames, which do not change
        self._matrices: list[tuple[Array, csr_array]] = []
        self._arms_of: tuple[Array | None, Array] = None, np.zeros((0, 3))
        self._inertias_of: tuple[Array | None, Array] = None, self._inertia
        self._lay_out_rows(n)
        self._lay_out_matrix(points, n)
        rest = np.array([[*b.centre, 1.0, 0.0, 0.0, 0.0] for b in bodies]).reshape(-1, 7)
        self.rest_frames: Array = rest.astype(np.float64)
        values = np.zeros(self.pattern.nnz)
        self.add_mass(values, Pose(np.empty((0, 3)), self.rest_frames, 0.0))
        self.mass: Array = values[self.pattern.diagonal]

    @property
    def bodies_alone(self) -> bool:
        """True if all velocities are those of bodies, and all points are on bodies or fixed."""
        of_nodes = self.chains.weights.nnz or self.chains.paths
        return self.first == 0 and not of_nodes and bool((self.chains.share == 1.0).all())

    def carriers(self) -> Index:
        """Body (n_points,) that carries each point rigidly; -1 for others."""
        bodies, whole = super().carriers(), self.chains.share == 1.0
        bodies[self.chains.point[whole]] = self.chains.body[whole]
        return bodies

    # -- layout ------------------------------------------------------------------------------------

    def _lay_out_rows(self, n: int) -> None:
        """Sparsity of R over all components, its constant values, and the entries of the lever arms."""
        chains, number = self.chains, self._number
        W = chains.weights.tocoo()
        axis = np.arange(3)
        node_row = 3 * chains.dependent[W.row][:, None] + axis
        node_column = number[3 * W.col[:, None] + axis]
        used = node_column >= 0
        node_value = np.repeat(W.data[:, None], 3, axis=1)
        self._arms = np.flatnonzero(self._body_number[chains.body] >= 0)
        column = self.first + 6 * self._body_number[chains.body[self._arms]]
        row = 3 * chains.point[self._arms]
        share_row, share_column = row[:, None] + axis, column[:, None] + axis
        i, j = np.array(_ROTATION).T
        arm_row, arm_column = row[:, None] + i, column[:, None] + 3 + j
        rows = np.concatenate([self._free, node_row[used], share_row.ravel(), arm_row.ravel()])
        columns = np.concatenate(
            [np.arange(self.first), node_column[used], share_column.ravel(), arm_column.ravel()]
        )
        values = np.concatenate(
            [
                np.ones(self.first),
                node_value[used],
                np.repeat(chains.share[self._arms], 3),
                np.zeros(arm_row.size),
            ]
        )
        order = np.lexsort((columns, rows))
        place = np.empty(len(order), dtype=np.int64)
        place[order] = np.arange(len(order))
        self._arm_place = place[len(order) - arm_row.size :]
        indptr = np.concatenate([[0], np.cumsum(np.bincount(rows, minlength=3 * self._n))])
        self._constant = values[order]
        self._rows = csr_array(
            (self._constant.copy(), columns[order].astype(np.int32), indptr.astype(np.int32)),
            shape=(3 * self._n, n),
        )

    def _lay_out_matrix(self, points: SymmetricPattern, n: int) -> None:
        """Sparsity of R'KR and of the mass."""
        compact = self._rows[points.free]
        unit = np.where(np.diff(self._rows.indptr)[points.free] == 1, self._number[points.free], -1)
        k, a, b = len(self.free_bodies), *_UPPER
        start = self.first + 6 * np.arange(k)[:, None]
        blocks = ((start + a) * n + start + b).ravel()
        self._compact = compact.indptr
        self._congruence: Congruence = lay_out(points, compact, unit.astype(np.int64), blocks)
        self._of_mass = self._congruence.diagonal_part(points)
        self._masses = self._point_mass[points.free]
        # Values of R are numbered over all components; prescribed ones have none, so `compact`
        # keeps the order.
        self.pattern: Sparsity = self._congruence.pattern
        self._block = self._congruence.at(blocks).reshape(k, len(a))
        coupled = np.zeros(n, dtype=bool)
        dependent = np.zeros(3 * self._n, dtype=bool)
        dependent[(3 * self.chains.dependent[:, None] + np.arange(3)).ravel()] = True
        heavy = np.flatnonzero(dependent & (self._point_mass > 0.0))
        coupled[self._rows[heavy].indices] = True
        coupled[self.first :] = True
        self._coupled = np.flatnonzero(coupled)
        self._dense_mass = self._of_mass.among(self._coupled)

    # -- R -----------------------------------------------------------------------------------------

    def matrix(self, pose: Pose) -> csr_array:
        """R (3 n_points, n) at a pose; it depends only on the orientations."""
        for frames, known in self._matrices:
            if frames is pose.frames:
                return known
        r = self._turned(pose.frames)[self._arms]
        z = np.stack([r[:, 2], -r[:, 1], -r[:, 2], r[:, 0], r[:, 1], -r[:, 0]], axis=1)
        data = self._constant.copy()
        data[self._arm_place] = z.ravel()
        made = copy(self._rows)  # of the same sparsity, which need not be checked again
        made.data = data
        self._matrices = [(pose.frames, made), *self._matrices[: CACHED_POSES - 1]]
        return made

    def _of_points(self, w: Array, pose: Pose) -> Array:
        """R w (3 n_points,)."""
        R, out = self.matrix(pose), np.empty(3 * self._n)
        kernel.product(R.indptr, R.indices, R.data, w, out)
        return out

    def _of_velocities(self, f: Array, pose: Pose) -> Array:
        """R'f (n,) of f (3 n_points,)."""
        R = self.matrix(pose)
        out = np.empty(R.shape[1])
        kernel.transposed_product(R.indptr, R.indices, R.data, f, out)
        return out

    def _turned(self, frames: Array) -> Array:
        """Lever arms (m, 3) in space."""
        if frames is not self._arms_of[0]:
            Q = rotations.matrices(frames[:, 3:])
            turned = np.einsum("mij,mj->mi", Q[self.chains.body], self.chains.arm)
            self._arms_of = frames, turned
        return self._arms_of[1]

    def velocities(self, state: State) -> Array:
        """Free components of nodes and the twists of free bodies."""
        nodes = state.v.reshape(-1)[self._free]
        return np.concatenate([nodes, state.twists[self.free_bodies].ravel()])

    def state(self, pose: Pose, w: Array, memory: Mapping[str, Array]) -> State:
        """State with the velocities of all points and bodies."""
        twists = self.paths.twists(pose.t)
        twists[self.free_bodies] = w[self.first :].reshape(-1, 6)
        v = self.displacements(w, pose)
        drift = self.drift(pose, pose.t)
        v = v if drift is None else v + drift
        return State(pose.t, pose.q, v, memory, pose.frames, twists)

    def displacements(self, d: Array, pose: Pose) -> Array:
        """R d."""
        return self._of_points(d, pose).reshape(-1, 3)

    def drift(self, pose: Pose, t: float) -> Array | None:
        """Velocities gamma (n_points, 3) of points by prescribed motions, or None."""
        if not self.paths:
            return None
        v, chains, twists = np.zeros((self._n, 3)), self.chains, self.paths.twists(t)
        self.paths.set_velocities(v, t)
        moved = chains.share[:, None] * twists[chains.body, :3]
        moved += np.cross(twists[chains.body, 3:], self._turned(pose.frames))
        v[chains.dependent] = chains.weights @ v
        _add(v, chains.point, moved)
        return v

    def advance(self, pose: Pose, d: Array, t: float) -> Pose:
        """Add to nodes, rotate bodies by the exponential map, place attached points."""
        q, frames = pose.q.copy(), pose.frames.copy()
        q.reshape(-1)[self._free] += d[: self.first]
        moved = d[self.first :].reshape(-1, 6)
        own = self.free_bodies
        frames[own, :3] += moved[:, :3]
        frames[own, 3:] = rotations.turned(frames[own, 3:], moved[:, 3:])
        self.paths.set_frames(frames, t)
        self.paths.set_positions(q, t)
        chains = self.chains
        q[chains.dependent] = chains.weights @ q
        parts = chains.share[:, None] * frames[chains.body, :3] + self._turned(frames)
        _add(q, chains.point, parts)
        return Pose(q, frames, t)

    def at(self, pose: Pose, t: float) -> Pose:
        """Return the pose with prescribed nodes and bodies moved to a time."""
        if not self.paths:
            return pose
        return self.advance(pose, np.zeros(self.pattern.n), t)

    def between(self, start: Pose, end: Pose) -> Array:
        """Differences of nodes, and rotation vectors of bodies."""
        nodes = (end.q - start.q).reshape(-1)[self._free]
        own = self.free_bodies
        moved = end.frames[own, :3] - start.frames[own, :3]
        theta = rotations.difference(start.frames[own, 3:], end.frames[own, 3:])
        return np.concatenate([nodes, np.concatenate([moved, theta], axis=1).ravel()])

    def rate(self, d: Array, w: Array) -> Array:
        """Velocities; rotation vectors change by the inverse of dexp."""
        return self._by_rotation(d, w, rotations.vector_rate)

    def gradient(self, g: Array, d: Array) -> Array:
        """Derivative of an energy by d relative to a pose, from its generalised gradient g."""
        return self._by_rotation(d, g, rotations.vector_gradient)

    def gradients(self, G: csr_array, d: Array) -> csr_array:
        """As `gradient`, of every row of G (m, n)."""
        vectors, m = d[self.first :].reshape(-1, 6)[:, 3:], G.shape[0]
        own = np.asarray(G[:, self.first :].toarray()).reshape(m, len(vectors), 6)
        theta = np.broadcast_to(vectors, own[..., 3:].shape).reshape(-1, 3)
        turned = rotations.vector_gradient(theta, own[..., 3:].reshape(-1, 3))
        own[..., 3:] = turned.reshape(own[..., 3:].shape)
        own = csr_array(own.reshape(m, 6 * len(vectors)))
        return csr_array(hstack([G[:, : self.first], own]))

    def _by_rotation(self, d: Array, x: Array, change: "rotations.Change") -> Array:
        out = x.copy()
        theta = d[self.first :].reshape(-1, 6)[:, 3:]
        block = out[self.first :].reshape(-1, 6)
        block[:, 3:] = change(theta, block[:, 3:])
        return out

    # -- forces and matrices -----------------------------------------------------------------------

    def generalised_force(self, f: Array, pose: Pose) -> Array:
        """R'f."""
        return self._of_velocities(np.ascontiguousarray(f).reshape(-1), pose)

    def generalised_matrix(self, K: Array, f: Array | None, pose: Pose) -> Array:
        """R'KR minus the derivative of the lever arms under forces f."""
        values = np.zeros(self.pattern.nnz)
        self._congruence.add(K, self.matrix(pose).data, values)
        if f is not None and len(self._arms):
            # d(s x f)/dtheta = s f' - (s.f) 1; its symmetric part is the second derivative of the
            # potential.
            s, F = self._turned(pose.frames)[self._arms], f[self.chains.point[self._arms]]
            sf = np.einsum("mi,mj->mij", s, F)
            trace = np.einsum("mii->m", sf)[:, None, None] * np.eye(3)
            turning = np.zeros((len(self.free_bodies), 6, 6))
            body = self._body_number[self.chains.body[self._arms]]
            np.add.at(turning[:, 3:, 3:], body, trace - 0.5 * (sf + sf.transpose(0, 2, 1)))
            values[self._block] += turning[:, *_UPPER]
        return values

    def product(self, part: LowRankTerm, pose: Pose) -> LowRankTerm:
        """A product multiplied by the rows of R that are not constant."""
        R = self.matrix(pose)
        shape = len(self._compact) - 1, R.shape[1]
        return replace(part, R=csr_array((R.data, R.indices, self._compact), shape=shape))

    def add_damping(self, values: Array) -> None:
        """Add the damping of bodies relative to space."""
        D = np.zeros((len(self.free_bodies), 6, 6))
        D[:, range(6), range(6)] = np.repeat(self._damping, 3, axis=1)
        values[self._block] += D[:, *_UPPER]

    # -- inertia -----------------------------------------------------------------------------------

    def _inertias(self, pose: Pose) -> Array:
        """Inertia (k, 3, 3) of free bodies in space."""
        if pose.frames is not self._inertias_of[0]:
            Q = rotations.matrices(pose.frames[self.free_bodies, 3:])
            self._inertias_of = pose.frames, Q @ self._inertia @ Q.transpose(0, 2, 1)
        return self._inertias_of[1]

    def inertial(self, w: Array, pose: Pose) -> Array:
        """Velocities of all points, then the angular momentum of every free body about its centre."""
        v = self._of_points(w, pose)
        drift = self.drift(pose, pose.t)
        if drift is not None:
            v = v + drift.reshape(-1)
        omega = w[self.first :].reshape(-1, 6)[:, 3:]
        return np.concatenate([v, np.einsum("bij,bj->bi", self._inertias(pose), omega).ravel()])

    def momentum(self, u: Array, pose: Pose) -> Array:
        """R'm v of the points, and the angular momentum of the bodies."""
        p = self._of_velocities(self._point_mass * u[: 3 * self._n], pose)
        p[self.first :].reshape(-1, 6)[:, 3:] += u[3 * self._n :].reshape(-1, 3)
        return p

    def apply_mass(self, w: Array, pose: Pose) -> Array:
        """R'm R w, and the inertia of the bodies."""
        p = self._of_velocities(self._point_mass * self._of_points(w, pose), pose)
        omega = w[self.first :].reshape(-1, 6)[:, 3:]
        own = p[self.first :].reshape(-1, 6)
        own[:, 3:] += np.einsum("bij,bj->bi", self._inertias(pose), omega)
        return p

    def add_mass(self, values: Array, pose: Pose) -> None:
        """Add the inertia and the masses of nodes, those of attached nodes at their supports."""
        self._of_mass.add(self._masses, self.matrix(pose).data, values)
        M = np.zeros((len(self.free_bodies), 6, 6))
        M[:, 3:, 3:] = self._inertias(pose)
        values[self._block] += M[:, *_UPPER]

    def solve_mass(self, p: Array, pose: Pose) -> Array:
        """Solve M w = p by division where the mass is diagonal, and by one dense solution elsewhere."""
        w, own = (p.T / self.mass).T, self._coupled
        if len(own):
            upper = np.zeros((len(own), len(own)))
            self._dense_mass.add(self._masses, self.matrix(pose).data, upper.reshape(-1))
            M = upper + upper.T
            M[np.diag_indices(len(own))] *= 0.5
            start = len(own) - 6 * len(self.free_bodies)
            angular = start + 6 * np.arange(len(self.free_bodies))[:, None] + np.arange(3, 6)
            M[angular[:, :, None], angular[:, None, :]] += self._inertias(pose)
            w[own] = solved(M, p[own], "the mass of bodies and attached nodes")
        return w

    def kinetic_energy(self, state: State) -> float:
        """Rotational kinetic energy of the free bodies."""
        omega = state.twists[self.free_bodies, 3:]
        return 0.5 * float(np.einsum("bi,bij,bj->", omega, self._inertias(state.pose), omega))

    def body_columns(self, n_bodies: int) -> Index:
        """First velocity of every body, -1 where it is not free, and a last -1 for space."""
        own = self._body_number
        return np.append(np.where(own >= 0, self.first + 6 * own, -1), -1)

    def prescribe(self, frames: Array, t: float) -> None:
        """Place prescribed bodies at their positions at a time."""
        self.paths.set_frames(frames, t)

    def prescribed_twists(self, t: float) -> Array:
        """Twists of prescribed bodies; zero for other bodies."""
        return self.paths.twists(t)

    def inertial_force(self, state: State) -> Array:
        """Centripetal forces of attached points and gyroscopic moments of bodies."""
        a = self._convective(state)
        b = self._of_velocities(self._point_mass * a.reshape(-1), state.pose)
        omega = state.twists[self.free_bodies, 3:]
        spin = np.einsum("bij,bj->bi", self._inertias(state.pose), omega)
        b[self.first :].reshape(-1, 6)[:, 3:] += np.cross(omega, spin)
        return b

    def _convective(self, state: State) -> Array:
        """Accelerations (n_points, 3) of points while w is constant."""
        chains, a = self.chains, np.zeros((self._n, 3))
        arms, omega = self._turned(state.frames), state.twists[chains.body, 3:]
        parts = np.cross(omega, np.cross(omega, arms))
        if self.paths:
            rates = self.paths.accelerations(a, state.t)
            parts += chains.share[:, None] * rates[chains.body, :3]
            parts += np.cross(rates[chains.body, 3:], arms)
        a[chains.dependent] = chains.weights @ a
        _add(a, chains.point, parts)
        return a

    def gyration(self, state: State) -> Array:
        """Rates of the angular velocities by the gyroscopic moments of the bodies' own inertia."""
        out, inertia = np.zeros(self.pattern.n), self._inertias(state.pose)
        omega = state.twists[self.free_bodies, 3:]
        moment: Array = np.cross(omega, np.einsum("bij,bj->bi", inertia, omega)).astype(np.float64)
        rate = solved(inertia, moment[..., None], "the inertia of a body")[..., 0]
        out[self.first :].reshape(-1, 6)[:, 3:] = rate
        return out

    def coasted(self, w: Array, pose: Pose, h: float, theta: float) -> Array:
        """Solve I1 w1 = I0 w0 for every body by Newton's method."""
        out, own = w.copy(), self.free_bodies
        omega = np.ascontiguousarray(w[self.first :].reshape(-1, 6)[:, 3:])
        after = np.empty_like(omega)
        missing = coast_all(self._inertias(pose), omega, h, theta, after)
        if missing >= 0:
            turn = h * float(np.linalg.norm(omega[missing]))
            reason = f"body {int(own[missing])} turns by {turn:.3g} rad, too much for one step"
            raise NotConverged((), pose.t + h, reason)
        out[self.first :].reshape(-1, 6)[:, 3:] = after
        return out

    def kicked(self, u: Array, impulse: Array, s: float, state: State) -> Array:
        """Inertial velocities plus s times their rate under the mean force impulse/s."""
        pose = state.pose
        dw = self.solve_mass(impulse - s * self.inertial_force(state), pose)
        v = self._of_points(dw, pose) + s * self._convective(state).reshape(-1)
        rate, omega = dw[self.first :].reshape(-1, 6)[:, 3:], state.twists[self.free_bodies, 3:]
        inertia = self._inertias(pose)
        spin = np.einsum("bij,bj->bi", inertia, omega)
        angular = np.einsum("bij,bj->bi", inertia, rate) + s * np.cross(omega, spin)
        return u + np.concatenate([v, angular.ravel()])


def _add(out: Array, rows: Index, values: Array) -> None:
    """Add values (m, 3) to rows of an array, some of which occur several times."""
    for axis in range(3):
        out[:, axis] += np.bincount(rows, values[:, axis], len(out))
