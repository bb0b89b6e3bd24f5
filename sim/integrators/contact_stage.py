"""Converged stage of scenes with joints, or with contact of bodies and attachments.

Newton's method on g(d) = G'f, the equations (1) to (7) of docs/step.md: each iteration solves (4) for
the motion with the forces f of all rows, which follow from their Delassus matrix (5). An equilibrium
under joints is a stage of infinite duration, (9), whose matrix contains the curvature of the rows.

In large scenes the Delassus matrix is that of the compliance of an earlier factor with compact
quasi-Newton updates, (6). Every solution for a change of the forces updates it, until no row moves
otherwise than expected.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from sim.contact.compliance import learnt
from sim.contact.rows import NO_ROWS, ContactRows, at_end
from sim.contact.step import ContactStep, renewed
from sim.dense import dot, inverse
from sim.errors import NotConverged
from sim.integrators.equilibrium_rows import LARGEST_MOTION, ReducedStiffness
from sim.integrators.factor import Key
from sim.integrators.linear_rows import ROW_ADDITIONS
from sim.integrators.newton import (
    Iteration,
    Point,
    PotentialOfMoves,
    Tolerances,
    Trial,
    error_left,
    line_search,
    rounding_of,
)
from sim.integrators.rows_of_step import STILL, RowsAt, RowsOfStep, dense, joint_rows
from sim.integrators.workspace import Workspace
from sim.linear import NotPositiveDefinite
from sim.multibody import MOST_DENSE
from sim.scene import Index
from sim.state import Array, Pose

STAGE_SHIFTS = 24  #: shifts of indefinite matrices that end a stage; an ordinary one has none
STAGE_PASSES, STAGE_SHARE = 8, 0.02
"""Largest number of solutions for the forces of rows in one iteration, and the error of the motion of
rows that ends them, relative to the largest motion."""
GAP_CLOSED = 0.1  #: the same, relative to the residual of contact
RATE = 1e-9  #: error of the rates of rows that are corrected by further solutions [m]
PLACES = 3  #: largest number of renewals of the normals and closest points of rows

NOTHING: Mapping[str, Array] = {}  #: memory without contact


@dataclass(frozen=True, eq=False)
class StageInContact:
    """End of a stage with rows, with the methods of `contact_converged.ContactSolution`."""

    point: Point
    pose: Pose  #: with penetrations removed
    went: Iteration
    memory: Mapping[str, Array]
    pushed: Array  #: (n_points, 3) contact forces at the end [N]
    reaction: Array | None  #: forces of joints
    rows: ContactRows
    near: ContactRows  #: at the end
    at: RowsAt
    f: Array  #: (m,) forces of all rows
    step: ContactStep | None
    solver: RowsOfStep

    def solve_under_rows(self, rhs: Array, opening: Array | float = 0.0) -> Array:
        """Solution (n,) for a right-hand side under the active rows.

        Those of joints stay closed, and those of contacts too, or open by (k,) [m].
        """
        on, wanted = self.f != 0.0, np.zeros(len(self.f))
        on[self.at.blocks.equations] = True
        wanted[self.at.first] = opening
        return self.at.kept(on, rhs, self.solver.solve, wanted)[0]

    def renewed(self) -> tuple[Array, Array] | None:
        """Change of nodal forces (n_points, 3) [N] and of gaps (k,) [m] by the rows at the end."""
        if self.step is None:
            return None
        u = self.pose.q - self.step.q0
        return renewed(self.rows, self.f[self.at.first], self.near, u)

    def kick(self, old: Index) -> Array:
        """Motion (n,) due to the present forces on vertices whose indices are not in `old`."""
        new = np.where(
            (self.at.contact_vertex >= 0) & ~np.isin(self.at.contact_vertex, old), self.f, 0.0
        )
        return self.at.scale * self.solver.solve(self.at.G.T @ new)

    def outside(self, pose: Pose, after: float) -> Pose:
        """Pose a time [s] after the end, without penetration of the active rows."""
        if self.step is None:
            return pose
        active = self.rows.take(np.flatnonzero(self.f[self.at.first] > 0.0))
        return self.solver.remove_penetration(pose, self.step.ahead(active, after), search=False)[0]

    def base(self, pose: Pose, after: float) -> Pose:
        """As `outside`, of all rows: bodies would rebound from the face that their base has passed."""
        if self.step is None:
            return pose
        return self.solver.remove_penetration(
            pose, self.step.ahead(self.rows, after), search=False
        )[0]


class StageWithRows:
    """Iteration of one stage that ends at a time [s], with the integrator and step of its factor."""

    def __init__(
        self,
        phi: PotentialOfMoves,
        step: ContactStep | None,
        work: Workspace,
        key: Key,
        tolerances: Tolerances,
        until: float,
    ) -> None:
        self._phi, self._step, self._work, self._key = phi, step, work, key
        self._tolerances, self._until, self._system = tolerances, until, phi.system
        self._inverse: Array | None = None
        self._rows = RowsOfStep(phi.system, step, self._solved, self._delassus, phi.scale)
        self._iterations = self._factorisations = self._shifts = 0
        self._residuals, self._left, self._shortest = list[float](), np.inf, 1.0
        # of the last iteration: start, displacement by the factor without rows, number of the factor
        self._moved: tuple[Point, Array, int] | None = None
        self._stiff: ReducedStiffness | None = None  # of an equilibrium

    @property
    def _rests(self) -> bool:
        return self._phi.duration == math.inf

    def solve(self, point: Point, way: Array) -> StageInContact:
        """Motion from a start, with nodal displacements (n_points,) of at most `way` [m] by contact.

        Raises NotConverged if the tolerances were not met, or new rows appear in every iteration;
        SingularSystem if the matrix could not be factorised.
        """
        step, made_here, f = self._step, not self._work.newton.belongs_to(self._key), None
        if made_here or self._rests:  # an older factor has an unknown multiple of the unit matrix
            self._renew(point)
        else:
            self._solve_densely()
        if step is None:
            made_here = made_here or self._rests
            point, at, f = self._settled(NO_ROWS, point, made_here, None)
            pose = point.pose
            about = np.zeros_like(pose.q), f, NO_ROWS, NO_ROWS, at, f, None
            return StageInContact(point, pose, self._went(), NOTHING, *about, self._rows)
        contacts = step.at_start(way)
        rows, searches, places = step.entering(contacts), 0, 0
        lift = rows.gap - contacts.gap  # initial depths may remain
        while True:
            point, at, f = self._settled(rows, point, made_here, f)
            pose = point.pose
            near = step.at(pose.q)
            acting = at.acting(f, rows.gaps(pose.q - step.q0))
            missed = self._rows.missed(rows, acting, pose, near)
            if len(missed):
                entering, searches, f = step.entering(missed), searches + 1, None
                rows, lift = rows.joined(entering), np.r_[lift, entering.gap - missed.gap]
            elif places < PLACES:
                moved = at_end(rows, lift, near)
                if moved is rows:
                    break
                rows, places = moved, places + 1
            else:
                break
            if searches == ROW_ADDITIONS:
                reason = "new contact constraints appear in every iteration"
                raise NotConverged(tuple(self._residuals), self._until, reason)
        pose, near = self._rows.remove_penetration(pose, near)
        memory = step.memory(pose.q, near, at.remembered, acting)
        pushed = acting.on_nodes(rows, len(pose.q))
        about = memory, pushed, f[: at.joints] if at.joints else None, rows, near, at, f, step
        return StageInContact(point, pose, self._went(), *about, self._rows)

    def _went(self) -> Iteration:
        counts = self._iterations, self._factorisations, self._residuals[-1]
        return Iteration(*counts, self._left, self._shortest, self._shifts)

    def _renew(self, point: Point) -> None:
        with self._work.timed("tangent"):
            A = self._phi.matrix(point)
        if self._rests:
            self._stiff = ReducedStiffness.regularised(self._phi, A, self._work.newton)
        try:
            more = self._work.newton.factorise(A, self._phi.shift, self._key)
        except NotPositiveDefinite as error:
            reason = "the matrix remains indefinite for any shift"
            raise NotConverged(tuple(self._residuals), self._until, reason) from error
        self._factorisations, self._shifts = self._factorisations + 1 + more, self._shifts + more
        if self._shifts > STAGE_SHIFTS:
            reason = f"limit of {STAGE_SHIFTS} shifts of indefinite matrices"
            raise NotConverged(tuple(self._residuals), self._until, reason)
        self._solve_densely()

    def _solve_densely(self) -> None:
        """In small scenes use the inverse in double precision: rows may repeat each other."""
        values, pattern = self._work.newton.matrix, self._system.pattern
        if values is not None and pattern.n <= MOST_DENSE and not self._rests:
            self._inverse = inverse(dense(pattern, values), "the matrix of the stage")

    def _solved(self, rhs: Array) -> Array:
        """Solution (n,) by the factor at hand."""
        if self._stiff is not None:
            return self._stiff.solve(rhs)
        return self._work.newton.solve(rhs) if self._inverse is None else self._inverse @ rhs

    def _delassus(self, G: csr_array) -> Array:
        """G A^-1 G' (m, m)."""
        if not G.shape[0]:
            return np.zeros((0, 0))
        if self._stiff is not None:
            product = self._stiff.between(G)
        elif self._inverse is None:
            scale = self._phi.scale
            product = self._work.contact.compliance(scale).between(G, G) / scale
        else:
            product = np.asarray(G @ (G @ self._inverse).T)
        return 0.5 * (product + product.T)

    def _free(self, start: Point) -> Array:
        """Motion x0 (n,) without rows, (4) of docs/step.md, by the factor and its updates."""
        by_factor = -self._phi.scale * self._solved(start.g)
        if self._inverse is not None or self._rests:
            return by_factor
        newton, secants = self._work.newton, self._work.newton.inverse_secants
        if self._moved is not None and self._moved[2] == newton.number:
            before, moved, _ = self._moved
            secants.learn(start.d - before.d, start.g - before.g, moved - by_factor)
        self._moved = start, by_factor, newton.number
        return by_factor + secants.added(-start.g)

    def _pushed(self, at: RowsAt, free: Array, before: Array) -> tuple[Array, Array]:
        """Forces (m,) of rows and the motion (n,) that they cause, from initial forces (m,)."""
        at.S = self._delassus(at.G)
        if self._inverse is not None or self._rests or not at.G.shape[0]:
            f = at.forces(at.value + at.G @ free, before, STILL, self._until)
            return f, at.scale * self._solved(at.G.T @ f)
        secants, compliance = (
            self._work.newton.inverse_secants,
            self._work.contact.compliance(at.scale),
        )
        by_factor = at.S
        of_updates = secants.between(secants.seen_by(at.G)) / at.scale
        at.S = by_factor + of_updates
        step, own = self._step, self._tolerances.tolerance
        least = GAP_CLOSED * (own if step is None else step.tolerances.residual)
        most = max(least, STAGE_SHARE * float(np.abs(free).max(initial=0.0)))
        push = at.G.T @ before
        f, u = before, at.scale * self._solved(push) + secants.added(push)
        for _ in range(STAGE_PASSES):
            gap = at.value + at.G @ (free + u) - at.scale * (at.S @ f)
            new = at.forces(gap, f, RATE, self._until)
            change, push = new - f, at.G.T @ (new - f)
            answer = at.scale * self._solved(push)
            moved, seen = at.G @ answer, at.scale * (by_factor @ change)
            f, u = new, u + answer + secants.added(push)
            missed, _, more = learnt(change, moved, seen, STAGE_SHARE)
            if more is not None:
                by_factor = by_factor + more / at.scale
                at.S = by_factor + of_updates
                compliance.learn(push, answer)
            if missed <= most:
                break
        return f, u

    def _at(self, rows: ContactRows, point: Point) -> RowsAt:
        """Rows at a point, with their derivatives by its motion."""
        joints = None if self._system.rows is None else joint_rows(self._phi, point.d)
        return self._rows.at(rows, point.pose, joints, point.d)

    def _settled(
        self, rows: ContactRows, point: Point, made_here: bool, f: Array | None
    ) -> tuple[Point, RowsAt, Array]:
        """Motion under some rows, the rows there and their forces, from initial ones."""
        phi, tolerances = self._phi, self._tolerances
        at, last = self._at(rows, point), np.inf
        for _ in range(tolerances.max_iterations):
            start, self._iterations = phi.at(point), self._iterations + 1
            if self._stiff is not None:
                self._stiff.bend(self._phi, start, joint_rows(self._phi, point.d))
            free = self._free(start)
            f, pushed = self._pushed(at, free, at.before if f is None else f)
            move = free + pushed
            solution = self._search(start, at, f, move)
            if solution is None:
                stale = self._inverse is None and self._work.contact.forget_compliance()
                if made_here and stale:
                    continue  # with the compliance of this factor
                if made_here:
                    size = float(np.abs(move).max(initial=0.0))
                    left = float(np.abs(start.g - at.G.T @ f).max(initial=0.0))
                    if tolerances.met(size, left):
                        self._residuals.append(left)
                        self._left = size
                        return point, at, f
                    reason = "no step lowers the Lagrangian"
                    raise NotConverged(tuple(self._residuals), self._until, reason)
                self._renew(point)
                made_here = True
                continue
            length, point = solution
            at, moved = self._at(rows, point), length * float(np.abs(move).max(initial=0.0))
            residual = float(np.abs(point.g - at.G.T @ f).max(initial=0.0))
            self._shortest = min(self._shortest, length)
            left, before_last, last = error_left(moved, last), last, moved
            self._residuals.append(residual)
            self._left = left
            if at.broken <= tolerances.tolerance and tolerances.met(left, residual):
                at.S = self._delassus(at.G)
                return point, at, f
            made_here = length < 1.0 or moved > tolerances.keep_factor * before_last
            if made_here:
                self._renew(point)
        raise NotConverged(
            tuple(self._residuals), self._until, f"limit of {self._iterations} iterations"
        )

    def _search(
        self, start: Point, at: RowsAt, f: Array, move: Array
    ) -> tuple[float, Point] | None:
        """Longest tried step with det F > 0 and sufficient decrease of (7) of docs/step.md, or None.

        Rows that yield have the energy (r + G x)^2/(2 C) in place of forces.
        """
        Gx, soft, f = at.G @ move, at.compliance > 0.0, f.copy()
        f[soft] = -at.value[soft] / at.compliance[soft]
        slope, borne = dot(start.g, move) - dot(f, Gx), dot(f, Gx)
        stored = 0.5 * float((Gx[soft] ** 2 / at.compliance[soft]).sum())

        def trial(length: float) -> Trial[Point]:
            end = self._phi.point(start.d + length * move)
            change = end.phi - start.phi - length * borne + length**2 * stored
            there = dot(end.g, move) - borne + 2.0 * length * stored
            return Trial(end, end.here.smallest_J, change, there)

        rounding = rounding_of(start.phi, start.here.energy, borne)
        farthest = float(np.abs(move).max(initial=0.0)) if self._rests else 0.0
        return line_search(trial, slope, rounding, LARGEST_MOTION / max(farthest, LARGEST_MOTION))
