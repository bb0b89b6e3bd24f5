"""Contact over one step: its rows, their multipliers, and what a state remembers of them."""

from collections.abc import Mapping

import numpy as np

from sim.contact.constraint import ALLOWED, FORCE, FRICTION, MEMORY, CompiledContact
from sim.contact.rows import Acting, Law, Places, Rows
from sim.pattern import SymmetricPattern
from sim.scene import Index
from sim.state import Array, State

TOUCH = 1e-6  # what counts as passed [m]


class ContactStep:
    """The contact of a scene from a state to a time.

    Parameters
    ----------
    contact : CompiledContact
    state : State
        Start of the step.
    t1 : float
        End of the step [s].
    """

    def __init__(self, contact: CompiledContact, state: State, t1: float) -> None:
        self.contact, self.q0 = contact, state.q
        self._t0, self._t1 = state.t, t1
        self._memory = contact.remembered(state.memory, state.q, state.t)
        self._allowed = self._memory[:, ALLOWED].copy()

    def at_start(self, way: Array) -> Rows:
        """Rows of the vertices near a face, which may come a way (n_nodes,) in the step [m]."""
        reach = way[self.contact.vertex_of_slot]
        return self.contact.find(self.q0, self.q0, self._t0, self._t1, self._allowed, reach)

    def at(self, q: Array) -> Rows:
        """Rows of the vertices near a face at positions q near the end of the step."""
        return self.contact.find(q, self.q0, self._t0, self._t1, self._allowed)

    def passed(self, q: Array, near: Rows) -> Rows:
        """Rows of the vertices that have passed a face on their way to positions q.

        Of those of `near` the ones inside, and of the others those that came in through a face and are
        behind it, as where a thin sheet was crossed.
        """
        u = q - self.q0
        inside = near.take(np.flatnonzero(near.gaps(u) < -TOUCH))
        entered = self.contact.entered(q, self.q0, self._t0, self._t1)
        behind = (entered.gaps(u) < -TOUCH) & ~np.isin(entered.slot, inside.slot)
        return inside.joined(entered.take(np.flatnonzero(behind)))

    def law(self, rows: Rows, rho: Array) -> Law:
        """Rows with the multipliers that the state remembers of their vertices."""
        _, first = np.unique(rows.slot, return_index=True)
        normal, tangent = np.zeros(len(rows)), np.zeros((len(rows), 3))
        normal[first] = self._memory[rows.slot[first], FORCE]
        tangent[first] = self._memory[rows.slot[first], FRICTION]
        tangent -= np.einsum("ki,ki->k", tangent, rows.normal)[:, None] * rows.normal
        return Law(rows, rho, normal, tangent)

    def places(self, pattern: SymmetricPattern, rows: Rows) -> Places:
        """Where the blocks of rows go."""
        return Places(pattern, rows, self.contact.names, self.contact.reach)

    def memory(self, q: Array, law: Law, acting: Acting) -> Mapping[str, Array]:
        """What the state at the end remembers, at positions q."""
        new = np.zeros_like(self._memory)
        np.add.at(new[:, FORCE], law.rows.slot, acting.force)
        for i in range(3):
            np.add.at(new[:, FRICTION.start + i], law.rows.slot, acting.friction[:, i])
        near = self.at(q)
        depth = self._allowed[near.slot] - near.gaps(q - self.q0)
        new[near.slot, ALLOWED] = np.clip(depth, 0.0, self._allowed[near.slot])
        return {MEMORY: new}


def penalties(pattern: SymmetricPattern, diagonal: Array, rows: Rows, factor: float) -> Array:
    """Penalty (k,) of every row: a factor on the stiffness that its direction feels [N/m].

    Parameters
    ----------
    diagonal : (n_free,) of the stiffness that the rows meet [N/m].
    """
    soft = np.zeros(3 * pattern.n_nodes)
    soft[pattern.free] = 1.0 / diagonal
    felt = np.einsum(
        "kj,ki,kji->k", rows.weight**2, rows.normal**2, soft.reshape(-1, 3)[rows.nodes]
    )
    return factor / felt


def carried_over(law: Law, rows: Rows, rho: Array) -> Law:
    """Other rows with the multipliers of the same vertices."""
    order = np.argsort(law.rows.slot, kind="stable")
    known: Index = law.rows.slot[order]
    normal, tangent = np.zeros(len(rows)), np.zeros((len(rows), 3))
    if len(known):
        place = np.minimum(np.searchsorted(known, rows.slot), len(known) - 1)
        same = np.flatnonzero(known[place] == rows.slot)
        _, first = np.unique(rows.slot[same], return_index=True)
        same = same[first]
        normal[same] = law.normal[order[place[same]]]
        tangent[same] = law.tangent[order[place[same]]]
        tangent -= np.einsum("ki,ki->k", tangent, rows.normal)[:, None] * rows.normal
    return Law(rows, rho, normal, tangent)
