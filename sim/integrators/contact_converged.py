"""Minimum of a potential with contact, by an augmented Lagrangian."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from sim.contact.rows import ALTERNATING, ContactRows, Multipliers, at_end
from sim.contact.step import ContactStep, Opened, carried_over, penalties, renewed
from sim.errors import NotConverged
from sim.integrators.assembled_contact import AssembledContact, RowPlaces
from sim.integrators.contact_potential import (
    PointInContact,
    SchurContact,
    SchurContactUnderConstraints,
)
from sim.integrators.factor import alike
from sim.integrators.newton import Iteration, Point, Potential
from sim.integrators.workspace import Workspace
from sim.scene import Index
from sim.state import Array, Evaluation, Pose, require_upright

SLOW, PENALTY_FACTOR = (
    0.5,
    4.0,
)  #: ratio of gaps above which the penalty is increased, and its factor
FRICTION_SETTLED = 1e-3  #: relative tolerance of the bounds of friction
UPDATES, RENEWALS = 200, 20  #: largest numbers of updates of multipliers and of rows

Replaced = tuple[Multipliers, ContactRows, Array]
"""Rows with forces, those at the end, and displacements (n_nodes, 3) [m], when rows were renewed."""
Minimise = Callable[[Potential, Point], tuple[Point, Iteration]]


@dataclass(frozen=True)
class ContactSolution:
    """Result of an iteration with contact."""

    point: Point  #: of the potential
    #: (n_nodes, 3) positions, which differ from those of the point by the correction of penetrations
    q: Array
    here: Evaluation  #: at the point, with the smallest det F of the positions
    went: Iteration
    memory: Mapping[str, Array]  #: arrays for the next step
    #: (n_nodes, 3) contact forces at the end, and for released vertices those at the start [N]
    pushed: Array
    active: ContactRows  #: with contact forces
    near: ContactRows  #: at the end
    #: state of the solver at the end
    step: ContactStep
    touching: AssembledContact | SchurContact
    opened: Opened
    work: Workspace
    #: change of rows when they were first renewed, if they were
    replaced: Replaced | None = None

    def solve_under_rows(self, rhs: Array, opening: Array | float = 0.0) -> Array:
        """Solve with the latest factor for a right-hand side (n,), under the active rows.

        They stay closed, or open by (k,) [m].
        """
        return self.touching.solve_under_rows(
            rhs, self.work, np.broadcast_to(opening, len(self.touching.multipliers.rows))
        )

    def renewed(self) -> tuple[Array, Array] | None:
        """Change of nodal forces (n_nodes, 3) [N] and of gaps (k,) [m] by the rows at the end.

        If the rows were renewed, it is that of the rows before, which bounds what remains of it.
        """
        own = self.touching.multipliers
        if self.replaced is None:
            return renewed(own.rows, own.normal, self.near, self.q - self.step.q0)
        before, near, u = self.replaced
        change = renewed(before.rows, before.normal, near, u)
        if change is None:
            return None
        # rows may have been found again since
        gap = np.zeros(
            1 + max(int(rows.contact_vertex.max(initial=-1)) for rows in (before.rows, own.rows))
        )
        pressed = before.normal > 0.0
        gap[before.rows.contact_vertex[pressed]] = change[1][pressed]
        return change[0], np.where(own.normal > 0.0, gap[own.rows.contact_vertex], 0.0)

    def kick(self, old: Index) -> Array:
        """Displacement (n,) due to the present forces on vertices whose indices are not in `old`.

        They include friction, which an impact changes as suddenly.
        """
        multipliers = self.touching.multipliers
        new = (multipliers.normal > 0.0) & ~np.isin(multipliers.rows.contact_vertex, old)
        if not new.any():
            return np.zeros(self.touching.system.pattern.n)
        force = multipliers.normal[:, None] * multipliers.rows.normal + multipliers.tangent
        force = np.where(new[:, None], force, 0.0)
        push = self.touching.generalised(multipliers.rows.spread(force, len(self.q)))
        return self.touching.freed(self.point, self.touching.scale * push, self.work)

    def outside(self, pose: Pose, after: float) -> Pose:
        """Pose a time [s] after the end, without penetration of the active rows."""
        return self._remove_penetration(pose, self.active, after)

    def base(self, pose: Pose, after: float) -> Pose:
        """As `outside`, of all rows: vertices would rebound from a face that their base has passed."""
        return self._remove_penetration(pose, self.touching.multipliers.rows, after)

    def _remove_penetration(self, pose: Pose, rows: ContactRows, after: float) -> Pose:
        step = self.step
        q = step.remove_penetration(pose.q, step.ahead(rows, after), self.opened, step.passing)
        return pose if q is pose.q else replace(pose, q=q)


def minimise_in_contact(
    potential: Potential,
    start: Point,
    step: ContactStep,
    way: Array,
    key: tuple[str, float],
    work: Workspace,
    minimise: Minimise,
    until: float,
    most: float = np.inf,
    start_closed: bool = False,
) -> ContactSolution:
    """Minimum of a potential with the rows of a contact.

    The augmented potential is minimised and the multipliers are set to the resulting forces, repeatedly
    until the gaps are closed; rows are then searched at the present positions, until there is no
    penetration. Every augmentation is convex, so that the active set cannot alternate indefinitely.

    Raises InvertedElement if the removal of a penetration inverts an element; NotConverged if an
    iteration failed, the gaps did not close, or a vertex still penetrates after the last search of
    rows; SingularSystem if a matrix could not be factorised.

    Parameters
    ----------
    start : of the potential, with det F > 0.
    way : (n_nodes,) upper bound of the displacement of each node in the step [m].
    key : integrator and step of the factor.
    minimise : minimum of a potential from a point.
    until : end of the step, for messages [s].
    most : total number of iterations after which the step is given up.
    start_closed : True if rows without a gap are active from the start, which the equilibrium of a body
        that is held only by contact requires.
    """
    settled = step.tolerances.converged
    pattern, in_matrix = potential.system.point_pattern, step.contact.in_matrix
    penalty = (AssembledContact if in_matrix else SchurContact).penalty

    def touched(multipliers: Multipliers) -> AssembledContact | SchurContact:
        if not in_matrix:
            constrained = potential.system.constraints is not None
            kind = SchurContactUnderConstraints if constrained else SchurContact
            return kind(potential, multipliers, step.q0)
        places = RowPlaces(pattern, multipliers.rows, step.contact.names, step.contact.reach)
        return AssembledContact(potential, multipliers, step.q0, places)

    diagonal = _stiffness_met(potential, start, key, work)
    rows = step.at_start(way)
    multipliers = step.multipliers(rows, penalties(pattern, diagonal, rows, penalty))
    if start_closed:
        closed = multipliers.rho * (step.tolerances.residual - rows.gap)
        normal = np.maximum(multipliers.normal, closed)
        multipliers = multipliers.forces(normal, multipliers.tangent)
    touching = touched(multipliers)
    first, begun = rows, multipliers.normal[:, None] * rows.normal + multipliers.tangent
    contested = np.empty(0, dtype=np.int64)
    point, went, renewals, places, violation = start, None, 0, 0, np.inf
    replaced: Replaced | None = None
    before = np.full(len(rows), np.inf)
    for _ in range(UPDATES):
        if went is not None and went.iterations > most:
            break
        end, more = minimise(touching, touching.with_contact(point))
        assert isinstance(end, PointInContact)  # made by `touching`
        went = more if went is None else went.joined(more)
        u = end.pose.q - step.q0
        acting, point = touching.settled(end), end.alone
        now: Multipliers = touching.multipliers
        violation, bound = acting.violation(), now.bound
        multipliers = now.forces(acting.force, acting.friction)
        change = float(np.abs(multipliers.bound - bound).max(initial=0.0))
        # forces are accurate to the remaining residual of the iteration only
        known = 2.0 * float(multipliers.rows.friction.max(initial=0.0)) * more.residual
        if (
            violation > settled
            or change > FRICTION_SETTLED * multipliers.bound.max(initial=0.0) + known
        ):
            left = np.where(acting.force > 0.0, np.abs(acting.gap), 0.0)
            slow = (left > settled) & (left > SLOW * before)
            rho = np.where(slow, PENALTY_FACTOR, 1.0) * multipliers.rho
            before, touching.multipliers = left, replace(multipliers, rho=rho)
            continue
        touching.multipliers, q = multipliers, end.pose.q
        near = step.at(q)
        passed = step.passed(q, near)
        pushing = multipliers.pushing(acting)
        last = renewals == RENEWALS
        deep = step.considerable(passed, u, pushing).any()
        if places < step.renewals and not (last or deep):
            rows = multipliers.rows
            moved = at_end(rows, np.zeros(len(rows)), near)
            if moved is not rows:
                replaced = replaced or (multipliers, near, u)
                touching = touched(replace(multipliers, rows=moved))
                before = np.full(len(rows), np.inf)
                multipliers, places = touching.multipliers, places + 1
                continue
        if last or not deep:
            opened = partial(touching.opened, pushing=pushing, diagonal=diagonal, work=work)
            q = step.remove_penetration(q, near, opened)
            if last:
                _require_outside(step, q, until)
            if last or float(near.gaps(q - step.q0).min(initial=0.0)) >= -step.tolerances.left:
                here = moved_upright(potential, point, q, until)
                memory = step.memory(q, near, multipliers, acting)
                released = np.flatnonzero(~np.isin(first.contact_vertex, pushing))
                pushed = acting.on_nodes(multipliers.rows, len(q))
                pushed += first.take(released).spread(begun[released], len(q))
                active = multipliers.rows.take(np.flatnonzero(acting.force > 0.0))
                solver = step, touching, opened, work, replaced
                return ContactSolution(point, q, here, went, memory, pushed, active, near, *solver)
        renewals += 1
        new = near.joined(passed.without(near))
        contested = np.union1d(
            contested, new.contact_vertex[new.gaps(u) < -step.tolerances.residual]
        )
        new = new.joined(_alternating_rows(multipliers.rows, new, contested))
        multipliers = carried_over(multipliers, new, penalties(pattern, diagonal, new, penalty))
        touching, before = touched(multipliers), np.full(len(new), np.inf)
    raise NotConverged(
        (), until, f"contact did not converge; a violation of {violation:.2g} m remains"
    )


def _stiffness_met(
    potential: Potential, start: Point, key: tuple[str, float], work: Workspace
) -> Array:
    """Diagonal (n_free,) of the stiffness [N/m], once per integrator and step."""
    known = work.contact.stiffness
    if known is None or not alike(known[0], key):
        A = potential.matrix(start).to_factorise()
        diagonal = A[potential.system.pattern.diagonal] / potential.scale
        # an active muscle may make the tangent negative; its absolute value is of the right size
        known = work.contact.stiffness = (key, np.abs(diagonal))
    return known[1]


def _require_outside(step: ContactStep, q: Array, until: float) -> None:
    """Refuse positions with a considerable penetration, which a shorter step avoids."""
    depth = -step.passed(q, step.at(q)).gaps(q - step.q0)
    deepest = float(depth.max(initial=0.0))
    if deepest > step.tolerances.unexpected:
        raise NotConverged((), until, f"contact leaves a vertex {deepest:.2g} m inside")


def moved_upright(potential: Potential, point: Point, q: Array, until: float) -> Evaluation:
    """Evaluation at a point, with the smallest det F at corrected positions, which is positive."""
    least, element = potential.system.smallest_J(q)
    require_upright(element, least, until)
    return replace(point.here, smallest_J=least, element=element)


def _alternating_rows(old: ContactRows, new: ContactRows, contested: Index) -> ContactRows:
    """Previous rows that are kept to prevent cycling.

    A vertex in a groove between two faces may be separated from one and then penetrate the other, in
    turn and without end. Vertices for which this has happened (`contested`) keep both rows.
    """
    lost = old.without(new)
    lost = lost.take(np.flatnonzero(np.isin(lost.contact_vertex, contested)))
    return replace(lost, rank=np.full(len(lost), ALTERNATING))
