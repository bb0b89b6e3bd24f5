"""Contact over one step: rows, multipliers, contact memory, and the correction of penetrations."""

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from sim.contact.compiled import (
    ALLOWED,
    CONTACT_MEMORY,
    DIRECTION,
    FORCE,
    FRICTION,
    PUSH,
    CompiledContact,
    StepGeometry,
)
from sim.contact.rows import ContactForces, ContactRows, Flags, Multipliers
from sim.pattern import SymmetricPattern
from sim.scene import Index
from sim.state import Array, State

PASSING = 0.05  #: penetration of a stage's base that remains, relative to the motion in the step
ALIKE = 0.5  #: cosine of the angle above which a normal is new and not filtered
OPPOSITE = -0.5  #: cosine of the angle below which two faces are those of both sides of a thin body
NORMAL_FILTER_TIME = 0.2  #: time of the low-pass filter of contact normals [s]

CORRECTIONS = 4
LARGEST_CORRECTION = 2.0  #: largest factor on a correction

Opened = Callable[[ContactRows, Array], Array]
"""Displacements (n_nodes, 3) that open rows by distances (k,) [m]."""

SHARING, SHARED = 40, 1e-12
"""Number of sweeps that distribute a force among the walls of a groove, and change at which they end."""


class ContactStep:
    """Contact of a scene from a state to a time.

    The time t1 is the end of the step [s]. In a quasi-static step (`equilibrium`) normals are not
    filtered and rows not renewed, so that an equilibrium does not depend on the renewals of motions.
    """

    def __init__(
        self, contact: CompiledContact, state: State, t1: float, *, equilibrium: bool = False
    ) -> None:
        self.contact, self.q0, self.tolerances = contact, state.q, contact.tolerances
        self._t0, self._t1 = state.t, t1
        self._start = StepGeometry(state.q, state.q, state.t, t1)
        h = t1 - state.t
        self.renewals = 0 if equilibrium else contact.renewals
        self._turn, self._way = 1.0 if equilibrium else h / NORMAL_FILTER_TIME, h * state.v
        self._memory = contact.remembered(state.memory, state.q, state.t)
        self._removed = contact.removed(self._memory[:, ALLOWED], h)
        self._allowed = self._memory[:, ALLOWED] - self._removed
        self._before = contact.turned(self._memory[:, DIRECTION], state.t, t1)

    def at_start(self, way: Array) -> ContactRows:
        """Rows of the vertices near a face, with nodal displacements (n_nodes,) in the step [m]."""
        # A face near a vertex of a shell may have the largest displacement of all nodes.
        reach = np.r_[way, way.max(initial=0.0)][self.contact.node_of_vertex]
        rows = self.contact.near(self._start, self._allowed, reach + self._removed)
        return self._steadied(rows)

    def at(self, q: Array) -> ContactRows:
        """Rows of the vertices near a face at positions q near the end of the step."""
        return self.contact.near(self._move(q), self._allowed, self._removed)

    def passed(self, q: Array, near: ContactRows) -> ContactRows:
        """Rows of the vertices that have passed a face on their path to positions q.

        They are the vertices of `near` that are inside, and others that entered through a face and
        are behind it, for example a thin sheet; not vertices that slid around a ridge and are
        outside of a face with the same orientation. Vertices inside a thin body that are closer to its
        other side have rows of the faces through which they entered.
        """
        u = q - self.q0
        touch = self.tolerances.residual
        crossed = self.contact.crossed(self._move(q), self._allowed)
        crossed = crossed.take(np.flatnonzero(crossed.gaps(u) < -touch))
        inside = (near.gaps(u) < -touch) & (_cosines(near, crossed)[0] >= OPPOSITE)
        inside = near.take(np.flatnonzero(inside))
        behind = ~np.isin(crossed.contact_vertex, inside.contact_vertex) & (
            _cosines(crossed, near)[1] <= 0.0
        )
        return inside.joined(crossed.take(np.flatnonzero(behind)))

    def through(self, rows: ContactRows, q: Array, near: ContactRows) -> ContactRows:
        """Rows by which penetrations at positions q are removed: those near, and `rows` without one.

        The initial velocities, which are independent of the rows, may carry a vertex through a thin
        sheet or beyond the middle of a thin body, whose nearest face is then that of the other side.
        """
        rows = rows.joined(self.passed(q, near))
        broken = rows.gaps(q - self.q0) < -self.tolerances.residual
        rows = rows.take(np.flatnonzero(broken))
        near = near.take(np.flatnonzero(_cosines(near, rows)[0] >= OPPOSITE))
        rows = rows.take(np.flatnonzero(~np.isin(rows.contact_vertex, near.contact_vertex)))
        return near.joined(rows.take(np.unique(rows.keys, return_index=True)[1]))

    def _steadied(self, rows: ContactRows) -> ContactRows:
        """Rows of the closest faces with low-pass filtered normals.

        Without the filter, a vertex at a ridge slides alternately along both faces, because normals
        are those at the start of a step. Normals of active rows are stored and rotate with their
        face. Further walls of a groove keep their normals.
        """
        first = rows.foremost()
        before, normal = self._before[rows.contact_vertex[first]], rows.normal[first]
        slide = rows.take(first).displacement(self._way)
        slide -= np.einsum("ki,ki->k", slide, normal)[:, None] * normal
        way = np.linalg.norm(slide, axis=1) / self.tolerances.slide
        share = np.minimum(self._turn + way, 1.0)
        share[np.einsum("ki,ki->k", before, normal) < ALIKE] = 1.0
        turned = share[:, None] * normal + (1.0 - share[:, None]) * before
        every = rows.normal.copy()
        every[first] = turned / np.linalg.norm(turned, axis=1, keepdims=True)
        return replace(rows, normal=every)

    def entering(self, rows: ContactRows) -> ContactRows:
        """Same rows with gaps limited to those allowed in this step.

        Other vertices that are already inside may stay, but not go deeper.
        """
        return replace(rows, gap=np.maximum(rows.gap, -self._removed[rows.contact_vertex]))

    def ahead(self, rows: ContactRows, after: float) -> ContactRows:
        """Rows some time [s] after the end of the step, where rigid faces keep their velocity."""
        on = after / (self._t1 - self._t0) * np.einsum("ki,ki->k", rows.normal, rows.shell_motion)
        return replace(rows, gap=rows.gap - on)

    @property
    def passing(self) -> float:
        """Penetration of a stage's base that changes velocities considerably [m]."""
        return PASSING * float(np.abs(self._way).max(initial=0.0))

    def considerable(self, rows: ContactRows, u: Array, pushing: Index) -> Flags:
        """Test if rows (k,) are too deep at displacements u (n_nodes, 3) for a correction.

        `pushing` contains the contact vertices of active rows.
        """
        active, tolerances = np.isin(rows.contact_vertex, pushing), self.tolerances
        return -rows.gaps(u) > np.where(active, tolerances.considerable, tolerances.unexpected)

    def remove_penetration(
        self, q: Array, near: ContactRows, opened: Opened, noticed: float = np.inf
    ) -> Array:
        """Positions with penetrations removed along the compliance of the tissue.

        `near` are the rows at the positions q (n_nodes, 3) at the end of the step; `noticed` is the
        smallest penetration that is removed [m], at most that of the tolerances.
        """
        noticed = min(noticed, self.tolerances.noticed)
        for _ in range(CORRECTIONS):
            gap = near.gaps(q - self.q0)
            deep = np.flatnonzero(gap < -noticed)
            if not len(deep):
                break
            rows, wanted = near.take(deep), -gap[deep]
            move = opened(rows, wanted)
            moved = rows.gaps(move) - rows.gaps(np.zeros_like(q))
            share = float(moved @ wanted) / max(float(moved @ moved), np.finfo(float).tiny)
            q = q + min(max(share, 0.0), LARGEST_CORRECTION) * move
        return q

    def _move(self, q: Array) -> StepGeometry:
        return replace(self._start, q=q)

    def multipliers(self, rows: ContactRows, rho: Array) -> Multipliers:
        """Rows with the multipliers of their vertices from the state."""
        return _shared(rows, rho, self._memory[:, PUSH], self._memory[:, FRICTION])

    def memory(
        self, q: Array, near: ContactRows, multipliers: Multipliers, acting: ContactForces
    ) -> Mapping[str, Array]:
        """Contact memory of the state at the end, at positions q, with the rows."""
        new = np.zeros_like(self._memory)
        contact_vertex = multipliers.rows.contact_vertex
        np.add.at(new[:, FORCE], contact_vertex, acting.force)
        np.add.at(new[:, PUSH], contact_vertex, acting.force[:, None] * multipliers.rows.normal)
        np.add.at(new[:, FRICTION], contact_vertex, acting.friction)
        foremost = multipliers.rows.foremost()
        foremost = foremost[acting.force[foremost] > 0.0]
        first, force = multipliers.rows.take(foremost), acting.force[foremost]
        outward = (self.contact.outward(at, first) for at in (q, self.q0))
        turned = force[:, None] * (first.normal + next(outward) - next(outward))
        np.add.at(new[:, DIRECTION], first.contact_vertex, turned)
        size = np.linalg.norm(new[:, DIRECTION], axis=1, keepdims=True)
        new[:, DIRECTION] /= np.where(size > 0.0, size, 1.0)
        depth = self._allowed[near.contact_vertex] - near.gaps(q - self.q0)
        np.maximum.at(
            new[:, ALLOWED],
            near.contact_vertex,
            np.clip(depth, 0.0, self._allowed[near.contact_vertex]),
        )
        return {CONTACT_MEMORY: new}


def _cosines(rows: ContactRows, others: ContactRows) -> tuple[Array, Array]:
    """Least and largest cosine (k,) of the normal of each row with those of other rows of its vertex.

    They are infinite where there is none.
    """
    order = np.argsort(others.contact_vertex, kind="stable")
    low, high = (
        np.searchsorted(others.contact_vertex[order], rows.contact_vertex, side)
        for side in ("left", "right")
    )
    least = np.full(rows.contact_vertex.shape, np.inf)
    most = -least
    for k in range(int((high - low).max(initial=0))):
        has = np.flatnonzero(low + k < high)
        cosine = np.einsum("ki,ki->k", rows.normal[has], others.normal[order[low[has] + k]])
        least[has], most[has] = np.minimum(least[has], cosine), np.maximum(most[has], cosine)
    return least, most


def penalties(
    pattern: SymmetricPattern, diagonal: Array, rows: ContactRows, factor: float
) -> Array:
    """Penalty (k,) of every row, proportional to the stiffness along its normal [N/m].

    diagonal (n_free,) is that of the stiffness [N/m].
    """
    soft = np.zeros(3 * pattern.n_nodes)
    soft[pattern.free] = 1.0 / diagonal
    felt = np.einsum(
        "kj,ki,kji->k", rows.weight**2, rows.normal**2, soft.reshape(-1, 3)[rows.nodes]
    )
    return factor / felt


def carried_over(multipliers: Multipliers, rows: ContactRows, rho: Array) -> Multipliers:
    """Other rows with the multipliers of the same vertices."""
    n = max(int(part.contact_vertex.max(initial=-1)) for part in (rows, multipliers.rows)) + 1
    push, friction = np.zeros((n, 3)), np.zeros((n, 3))
    np.add.at(
        push, multipliers.rows.contact_vertex, multipliers.normal[:, None] * multipliers.rows.normal
    )
    np.add.at(friction, multipliers.rows.contact_vertex, multipliers.tangent)
    return _shared(rows, rho, push, friction)


def renewed(
    rows: ContactRows, force: Array, near: ContactRows, u: Array
) -> tuple[Array, Array] | None:
    """Change of active rows by the normals and closest points of others: of nodal forces, and of gaps.

    `force` (k,) are the normal forces of the rows [N], `near` the rows of the same vertices at the end
    of a stage, and u (n_nodes, 3) its displacements [m]. The forces (n_nodes, 3) [N] have the same
    sizes; the gaps (k,) [m] are those of the closest ones of the other rows, zero for rows that do not
    press. A vertex without another row keeps its own. None if nothing presses.
    """
    if not (force > 0.0).any():
        return None
    n_nodes, gap = len(u), np.zeros(len(rows))
    kept = np.flatnonzero((force > 0.0) & np.isin(rows.contact_vertex, near.contact_vertex))
    first = near.foremost()
    at_end = np.zeros(int(max(rows.contact_vertex.max(), near.contact_vertex.max(initial=0))) + 1)
    at_end[near.contact_vertex[first]] = near.gaps(u)[first]
    gap[kept] = at_end[rows.contact_vertex[kept]]
    before, size = rows.take(kept), force[kept]
    after = near.take(np.flatnonzero(np.isin(near.contact_vertex, before.contact_vertex)))
    along = Multipliers.with_bounds(before, np.ones(len(kept)), size, np.zeros((len(kept), 3)))
    new = carried_over(along, after, np.ones(len(after))).normal
    change = after.spread(new[:, None] * after.normal, n_nodes)
    return change - before.spread(size[:, None] * before.normal, n_nodes), gap


def _shared(rows: ContactRows, rho: Array, push: Array, friction: Array) -> Multipliers:
    """Distribute normal forces among all rows of a vertex, and friction to the closest one.

    The multipliers are those >= 0 whose sum along the normals is closest to the force. They are
    computed simultaneously, so that the order of the rows does not matter.
    """
    n, n_contact_vertices = rows.normal, len(push)
    count = np.bincount(rows.contact_vertex, minlength=n_contact_vertices)[rows.contact_vertex]
    left, normal = push.copy(), np.zeros_like(rows.gap)
    single = count.max(initial=1) == 1
    for _ in range(1 if single else SHARING):
        more = np.einsum("ki,ki->k", left[rows.contact_vertex], n) / count
        more = np.maximum(more, -normal)
        normal += more
        if float(np.abs(more).max(initial=0.0)) <= SHARED * float(np.abs(push).max(initial=0.0)):
            break
        np.subtract.at(left, rows.contact_vertex, more[:, None] * n)
    first = rows.foremost()
    number = np.bincount(rows.contact_vertex[first], minlength=n_contact_vertices)
    tangent = np.zeros_like(n)
    tangent[first] = friction[rows.contact_vertex[first]] / number[rows.contact_vertex[first], None]
    tangent -= np.einsum("ki,ki->k", tangent, n)[:, None] * n
    return Multipliers.with_bounds(rows, rho, normal, tangent)


def penalty_forces(
    rows: ContactRows,
    wanted: Array,
    pushing: Index,
    pattern: SymmetricPattern,
    diagonal: Array,
    penalty: float,
) -> Array:
    """Nodal forces (n_nodes, 3) that open rows approximately by distances (k,) [m].

    `pushing` are contact vertices of active rows, for which the matrix with the diagonal (n_free,) [N/m]
    contains `penalty` times the stiffness.
    """
    factor = np.where(np.isin(rows.contact_vertex, pushing), penalty, 1.0)
    rho = factor * penalties(pattern, diagonal, rows, 1.0)
    return rows.spread((rho * wanted)[:, None] * rows.normal, pattern.n_nodes)
