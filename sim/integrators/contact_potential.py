"""Potentials with contact forces, augmented Lagrangians of the gaps g >= 0, (11) of docs/step.md.

Contact forces follow from the Schur complement (5) of rows apart from the matrix, also under
constraints (12). `sim.integrators.assembled_contact` has the rows in the matrix instead.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csr_array

from sim.contact.compliance import Compliance, DelassusMatrix
from sim.contact.cone import frictional, solve_lcp
from sim.contact.rows import ContactForces, ContactRows, Multipliers, across, directions
from sim.dense import solve_under_rows
from sim.integrators.newton import Point, Potential
from sim.integrators.workspace import Workspace
from sim.linear.contract import Matrix
from sim.pattern import Flags, SymmetricPattern
from sim.scene import Index
from sim.state import Array

SCHUR_PENALTY = 300.0  #: penalty of a row relative to the stiffness

FORCE_UPDATES = 6  #: largest number of updates of the contact forces in one iteration

ROUGH, SURE = (0.5, 1.0, 1.0), (0.02, 1e-3, 0.0)
"""Tolerance of the displacement by a change of forces, relative to it and to the contact residual, and
depth of omitted rows in residuals: while all steps were taken in full, and after a shortened or refused
step, when rows that are closed in the potential but omitted in its model could prevent a descent."""

REFACTOR_RATIO = 0.5
"""Factor on the criterion of slow convergence, because an iteration takes two solutions."""

CORRECTIONS_UNDER_ROWS, LEFT_OPEN = 2, 0.05
"""Number of corrections of a solution that keeps rows closed, and share of their opening left by it."""

CORRECTION_REGULARISATION = 1e-3  #: relative regularisation of redundant rows in a correction

AT_BOUND = 1e-9  #: relative distance of friction from its bound below which a contact slides


@dataclass(frozen=True, eq=False)
class PointInContact(Point):
    """A trial configuration with contact."""

    alone: Point  #: point of the potential without contact


class ContactPotential(Potential):
    """Potential with the augmentation of rows for their multipliers, from q0 (n_nodes, 3) [m]."""

    penalty: float
    multipliers: Multipliers

    def __init__(self, potential: Potential, multipliers: Multipliers, q0: Array) -> None:
        self._potential, self.multipliers, self._q0 = potential, multipliers, q0
        self.system, self.base = potential.system, potential.base
        self.scale, self.shift = potential.scale, potential.shift

    def generalised(self, f: Array) -> Array:
        """Generalised force (n,) of forces on nodes (n_nodes, 3)."""
        return self.system.kinematics.generalised_force(f, self.base)

    def opening(self, x: Array) -> Array:
        """Displacements (n_nodes, 3) of a small motion (n,)."""
        return self.system.kinematics.displacements(x, self.base)

    def point(self, d: Array) -> PointInContact:
        """Evaluate potential and augmentation, and their gradients."""
        return self.with_contact(self._potential.point(d))

    def with_contact(self, point: Point, acting: ContactForces | None = None) -> PointInContact:
        """Point of the potential with augmentation; `acting` are the contact forces there, if known."""
        acting = self.acting(point) if acting is None else acting
        g = point.g - self.generalised(acting.on_nodes(self.multipliers.rows, len(self._q0)))
        return PointInContact(point.d, point.pose, g, point.phi + acting.energy, point.here, point)

    def matrix(self, point: Point) -> Matrix:
        """Scale times the second derivative of the potential."""
        A = self._potential.matrix(point)
        self.shift = self._potential.shift
        return A

    def answer(self, rhs: Array, work: Workspace) -> Array:
        """Solution (n,) with the factor for a right-hand side."""
        if self.system.constraints is None:
            return work.newton.solve(rhs)
        return work.constraints.saddle.roughly(rhs)

    def freed(self, point: Point, rhs: Array, work: Workspace) -> Array:
        """Solution (n,) for a right-hand side without the rows; the factor has none of them."""
        return self.answer(rhs, work)

    def acting(self, point: Point) -> ContactForces:
        """Contact forces at a point."""
        return self.multipliers.at(point.pose.q - self._q0)


class UnitVectors:
    """Directions of all rows; the normal of each row is followed by two vectors across it.

    Attributes
    ----------
    friction : (k,) coefficient; rows with zero have the normal alone.
    first : (k,) index of the normal of each row.
    contact : (m,) row of each direction.
    """

    def __init__(self, rows: ContactRows) -> None:
        self._rows, self.friction = rows, rows.friction
        self._size = np.where(rows.friction > 0.0, 3, 1)
        self.first: Index = np.cumsum(self._size) - self._size
        self.contact: Index = np.repeat(np.arange(len(rows)), self._size)
        self._rubs = np.flatnonzero(rows.friction > 0.0)
        self._across = self.first[self._rubs, None] + np.array([1, 2])
        vectors = across(rows.normal[self._rubs])
        self._vectors = np.stack(vectors, axis=1)  # (rubbing rows, 2, 3)

    def directions(self, pattern: SymmetricPattern) -> csr_array:
        """D (m, n_free), motion along all directions by the free unknowns."""
        along = self._rows.normal[self.contact]
        along[self._across] = self._vectors
        return directions(pattern, self._rows.take(self.contact), along)

    def components_of(self, on: Flags) -> Index:
        """Directions of some rows (k,), in ascending order."""
        return np.flatnonzero(on[self.contact])

    def is_of(self, contacts: Flags, sticking: Flags) -> Flags:
        """Directions (m,): normals of some rows (k,), and vectors across others."""
        out = sticking[self.contact]
        out[self.first] = contacts
        return out

    def components(self, normal: Array, across: Array) -> Array:
        """Components (m,) of vectors with normal components (k,) and parts (k, 3) across."""
        out = normal[self.contact]
        out[self._across] = np.einsum("kij,kj->ki", self._vectors, across[self._rubs])
        return out

    def vectors(self, components: Array) -> tuple[Array, Array]:
        """Normal components (k,), and parts (k, 3) across, of components (m,)."""
        across = np.zeros((len(self.first), 3))
        across[self._rubs] = np.einsum("kij,ki->kj", self._vectors, components[self._across])
        return components[self.first], across


class SchurContact(ContactPotential):
    """Contact by the Schur complement, with a factor of the potential alone.

    Each iteration minimises a quadratic model of the potential under all rows. The contact forces follow
    from the Schur complement, and the displacement from the forces, which become the multipliers. Rows
    with friction have three directions, the normal one and two across it.
    """

    penalty, patience, refactor_ratio = SCHUR_PENALTY, 2, REFACTOR_RATIO

    def __init__(self, potential: Potential, multipliers: Multipliers, q0: Array) -> None:
        super().__init__(potential, multipliers, q0)
        self._unit = UnitVectors(multipliers.rows)
        self._rubs = bool((self._unit.friction > 0.0).any())
        self._directions = self._unit.directions(self.system.point_pattern)
        self._compliance: DelassusMatrix | None = None
        # of the last direction: previous and new forces (m,), displacements (n,) by the factor with the
        # previous ones and by their change; of the last step: start, displacement by the factor, number
        # of the factor
        self._tried: tuple[Array, Array, Array, Array] | None = None
        self._moved: tuple[Point, Array, int] | None = None
        self._left = ROUGH
        #: violation of Coulomb's law by the latest forces, 0 if they converged [m]
        self.missed = 0.0
        assert self.system.contact is not None  # it has the rows
        self._tolerances = self.system.contact.tolerances

    def direction(self, point: Point, work: Workspace) -> tuple[Point, Array]:
        """Point for the present multipliers, and the direction to the minimum of the model.

        The gradient of the model is that of the potential; its matrix is the factorised one with the
        quasi-Newton updates of later steps. The bounds of friction are those of the new normal forces,
        so that the direction is one of descent.
        """
        assert isinstance(point, PointInContact)  # result of `point`
        alone, secants = point.alone, work.newton.inverse_secants
        forces, rest = self._rest(alone)
        by_factor = work.newton.solve(self.scale * rest)
        if self._moved is not None and self._moved[2] == work.newton.number:
            before, moved, _ = self._moved
            secants.learn(alone.d - before.d, alone.g - before.g, moved - by_factor)
        self._moved = None
        return self._directed(alone, forces, by_factor, by_factor + secants.added(rest), work)

    def _rest(self, alone: Point) -> tuple[Array, Array]:
        """Contact forces (m,), and what they leave (n,) of the forces at a point without contact."""
        forces = self._unit.components(self.multipliers.normal, self.multipliers.tangent)
        return forces, self._directions.T @ forces - alone.g

    def _directed(
        self, alone: Point, forces: Array, by_factor: Array, free: Array, work: Workspace
    ) -> tuple[Point, Array]:
        """Point and direction as of `direction`, from displacements (n,) by the present forces (m,).

        They are those by the factor, and in total.
        """
        acting = self.acting(alone)
        gap = self._unit.components(acting.gap, acting.across) + self._directions @ free
        new, answer, pushed = self._pushed(gap, forces, self._rows(work), work)
        self._tried = forces, new, by_factor, answer
        if not self._rubs:
            return self.with_contact(alone, acting), free + pushed
        bound = self._unit.friction * new[self._unit.first]
        self.multipliers = replace(self.multipliers, bound=bound)
        return self.with_contact(alone), free + pushed

    def _rows(self, work: Workspace) -> DelassusMatrix:
        if self._compliance is None:
            self._compliance = DelassusMatrix(self._directions, self._of_tissue(work))
        return self._compliance

    def _of_tissue(self, work: Workspace) -> Compliance:
        return work.contact.compliance(self.scale)

    def _response(self, change: Array, work: Workspace) -> Array:
        """Displacement (n,) by a change of the forces, which the compliance learns."""
        return self.answer(self.scale * change, work)

    def _pushed(
        self, gap: Array, forces: Array, compliance: DelassusMatrix, work: Workspace
    ) -> tuple[Array, Array, Array]:
        """Forces (m,) of the model, and displacements (n,) by their change: by the factor, and in total.

        Gaps and slips (m,) are those after the displacement without a change of the forces (m,) [m, N].
        """
        unit, soft = self._unit, 1.0 / self.multipliers.rho
        secants, D = work.newton.inverse_secants, self._directions
        share, least, omitted = self._left
        residual = self._tolerances.residual
        new, answer = forces, np.zeros(D.shape[1])
        pushed, on = answer, (forces[unit.first] > 0.0) | (gap[unit.first] < 0.0)
        likely = on | (gap[unit.first] < self._tolerances.likely)
        compliance.expect(unit.components_of(likely))
        seen = secants.seen_by(D)
        for _ in range(FORCE_UPDATES):
            contacts = np.flatnonzero(on)
            if not len(contacts):
                break
            rows = unit.components_of(on)
            G = compliance.among(rows) + secants.between(seen[rows])
            G[np.diag_indices_from(G)] += soft[unit.contact[rows]]
            start, new = new, np.zeros_like(forces)
            first, rubs = np.searchsorted(rows, unit.first[contacts]), unit.friction[contacts]
            free = gap[rows] - G @ forces[rows]
            new[rows], self.missed = frictional(G, free, first, rubs, start[rows])
            change = D.T @ (new - forces)
            answer = self._response(change, work)
            pushed = answer + secants.added(change)
            missed, size = compliance.learn(new - forces, answer)
            more = ~on & ((gap + D @ pushed)[unit.first] < -omitted * residual)
            if missed <= max(share * size, least * residual) and not more.any():
                break
            on |= more
        return new, answer, pushed

    def accepted(self, start: Point, end: Point, length: float, work: Workspace) -> Point:
        """End of a step, with the forces of the model as the new multipliers."""
        assert isinstance(start, PointInContact) and isinstance(end, PointInContact)
        if length < 1.0:
            self._left = SURE
        assert self._tried is not None  # set by `direction`
        (before, new, by_factor, answer), self._tried = self._tried, None
        forces = before + length * (new - before)
        self.multipliers = self.multipliers.forces(*self._unit.vectors(forces))
        self._moved = start.alone, by_factor + length * answer, work.newton.number
        return replace(end, g=end.alone.g - self._directions.T @ forces)

    def refused(self, work: Workspace) -> bool:
        """Test if the compliance may be inaccurate; if so, it is computed again."""
        self._left = SURE
        self._compliance = None
        return work.contact.forget_compliance()

    def settled(self, point: Point) -> ContactForces:
        """Contact forces at the end of the iteration: the multipliers.

        The slip contains that which friction in another direction than the multipliers would require.
        """
        acting, own = self.acting(point), self.multipliers
        turned = np.linalg.norm(acting.friction - own.tangent, axis=1) / own.rho
        slip = max(acting.slip, float(turned.max(initial=0.0)), self.missed)
        return replace(acting, force=own.normal, friction=own.tangent, slip=slip)

    def solve_under_rows(self, rhs: Array, work: Workspace, opening: Array) -> Array:
        """Solution x with the factor and D x = opening (k,) [m] for the active rows.

        It does not move sticking contacts across their normals.

        x = A^-1 (rhs - s^2 D' f), (D C D' + 1/rho) f = D A^-1 rhs - opening, with the compliance C = s^2
        A^-1. The solution is repeated, because C may belong to an earlier factor.
        """
        multipliers = self.multipliers
        tangent = np.linalg.norm(multipliers.tangent, axis=1)
        sticks = tangent < multipliers.rows.friction * multipliers.normal * (1.0 - AT_BOUND)
        on = np.flatnonzero(self._unit.is_of(multipliers.normal > 0.0, sticks))
        x = self.answer(rhs, work)
        if not len(on):
            return x
        D, G = self._directions[on], self._rows(work).among(on)
        G[np.diag_indices_from(G)] += 1.0 / multipliers.rho[self._unit.contact[on]]
        wanted = self._unit.components(opening, np.zeros((len(opening), 3)))[on]
        most = LEFT_OPEN * float(np.abs(D @ x - wanted).max())

        def push(f: Array) -> Array:
            return self.answer(self.scale * (D.T @ f), work)

        what = "the matrix of active contacts"
        return solve_under_rows(
            x, D, G, push, what, wanted=wanted, repeats=CORRECTIONS_UNDER_ROWS, most=most
        )[0]

    def opened(
        self, rows: ContactRows, wanted: Array, pushing: Index, diagonal: Array, work: Workspace
    ) -> Array:
        """Displacements (n_nodes, 3) that open rows by (k,) [m], without friction.

        Other active rows stay closed; `pushing` are contact vertices of active rows.
        """
        own = self.multipliers.rows
        others = np.flatnonzero(
            np.isin(own.contact_vertex, pushing) & ~np.isin(own.contact_vertex, rows.contact_vertex)
        )
        elsewhere = self._unit.first[others]
        D = directions(self.system.point_pattern, rows)
        G = self._rows(work).with_other_rows(D, elsewhere)
        G[np.diag_indices_from(G)] *= 1.0 + CORRECTION_REGULARISATION
        gap = np.r_[-wanted, np.zeros(len(elsewhere))]
        force = solve_lcp(G, gap, gap < 0.0)
        here, there = np.split(force, [len(wanted)])
        push = D.T @ here + self._directions[elsewhere].T @ there
        return self.opening(self.answer(self.scale * push, work))


class SchurContactUnderConstraints(SchurContact):
    """Contact by the Schur complement, with a factor of the saddle matrix of tissue and constraints.

    The compliance C of the Delassus matrix D C D' of the rows is that of motions that do not change the
    constraints. Columns of C are solutions by an older factor, which satisfy the constraints roughly;
    every solution for a change of the contact forces satisfies them, and updates C.
    """

    def __init__(self, potential: Potential, multipliers: Multipliers, q0: Array) -> None:
        super().__init__(potential, multipliers, q0)
        conditions = self.system.constraints
        assert conditions is not None  # of tissue with constraints
        self._none = np.zeros(conditions.n)
        self._further, self._error, self._renewed = self._none, 0.0, False

    def gradient(self, point: Point) -> Array:
        """Gradient (n,) with the present contact forces."""
        assert isinstance(point, PointInContact)  # result of `point`
        return -self._rest(point.alone)[1]

    def under_rows(
        self, point: Point, free: Array, error: float, work: Workspace
    ) -> tuple[Point, Array, Array]:
        """Point for the present multipliers, direction, and change of the constraints' multipliers.

        `free` (n,) is the direction under the present contact forces. Each solution leaves an `error`
        [m] at most.
        """
        self._further, self._error = self._none, error
        assert isinstance(point, PointInContact)  # result of `point`
        forces = self._rest(point.alone)[0]
        start, direction = self._directed(point.alone, forces, free, free, work)
        return start, direction, self._further

    def _of_tissue(self, work: Workspace) -> Compliance:
        def solve_many(f: Array) -> Array:
            return self.answer(self.scale * f, work)

        return work.contact.compliance(self.scale, solve_many)

    def _response(self, change: Array, work: Workspace) -> Array:
        """Displacement (n,) by a change of the forces, which satisfies the constraints."""
        push, saddle = self.scale * change, work.constraints.saddle
        answer, y = saddle.solve(push, self._none, None, self._error)
        self._further = y / self.scale
        return answer

    def refused(self, work: Workspace) -> bool:
        """Test if the compliance may be inaccurate; if so, it is computed again, once."""
        super().refused(work)
        if self._renewed:
            return False
        work.contact.discard()
        self._renewed = True
        return True
