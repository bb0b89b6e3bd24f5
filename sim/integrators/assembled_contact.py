"""Contact with its rows assembled into the matrix, for a matrix that is singular without them.

Equilibria of bodies that rest by contact alone have such a matrix, and matrix-free products cannot be
solved with one factor; (11) of docs/step.md. The penalty of a row is small, so that factors are reused.
"""

import numpy as np

from sim.contact.rows import ContactForces, ContactRows, Multipliers
from sim.contact.step import penalty_forces
from sim.errors import ContactFailure
from sim.integrators.contact_potential import ContactPotential
from sim.integrators.newton import Point, Potential
from sim.integrators.workspace import Workspace
from sim.linear.contract import Matrix
from sim.linear.krylov import conjugate_gradients
from sim.pattern import SymmetricPattern
from sim.scene import Index
from sim.state import Array

PAIR_FIRST = np.array([0, 0, 0, 0, 1, 1, 1, 2, 2, 3])
PAIR_SECOND = np.array([0, 1, 2, 3, 1, 2, 3, 2, 3, 3])

IN_MATRIX = 3.0
"""Penalty of a row relative to the stiffness, so small that factors can be reused."""

ASSEMBLED_PATIENCE = 6  #: number of iterations with one factor if rows are assembled

FREED, FREED_LIMIT = 1e-4, 60
"""Relative error of a solution without the rows of the factor, and largest number of its iterations."""


class RowPlaces:
    """Positions of the blocks of rows in the values of a pattern.

    Names of the pairings and the declared reach [m] are for the message.
    """

    def __init__(
        self, pattern: SymmetricPattern, rows: ContactRows, names: tuple[str, ...], reach: float
    ) -> None:
        a, b = rows.nodes[:, PAIR_FIRST], rows.nodes[:, PAIR_SECOND]
        self._product = rows.weight[:, PAIR_FIRST] * rows.weight[:, PAIR_SECOND]
        used = self._product != 0.0
        keys = np.minimum(a, b) * pattern.n_nodes + np.maximum(a, b)
        place = np.minimum(
            pattern.pair_index(keys.ravel()).reshape(keys.shape), len(pattern.pairs) - 1
        )
        lost = used & (pattern.pairs[place] != keys)
        # A row need not become active.
        self._lost = lost.any(axis=1)
        self._rows, self._names, self._reach = rows, names, reach
        self._row, self._entry = np.nonzero(used & ~lost)
        self._target = pattern.target[place[self._row, self._entry]]
        self._nnz = pattern.nnz

    def add(self, block: Array, scale: float, values: Array) -> None:
        """Values += scale sum over rows of the blocks (k, 3, 3) between all nodes of a row.

        Raises ContactFailure if the pattern does not contain the nodes of a row with a block.
        """
        lost = np.flatnonzero(self._lost & block.any(axis=(1, 2)))
        if len(lost):
            vertex, *face = self._rows.nodes[lost[0]].tolist()
            name = self._names[int(self._rows.pairing[lost[0]])]
            raise ContactFailure(
                f"node {vertex} and the face of nodes {face} of pairing {name!r} are in "
                f"contact, but their distance at rest exceeds the reach of {self._reach:g} "
                "m: increase the reach of the contact",
                surface=name,
                node=vertex,
            )
        parts = (
            scale * self._product[self._row, self._entry, None] * block.reshape(-1, 9)[self._row]
        )
        # The pattern stores only the upper triangle of a pair of two nodes.
        stored = (self._target >= 0) & (parts != 0.0)
        values += np.bincount(self._target[stored], parts[stored], self._nnz)


class AssembledContact(ContactPotential):
    """Assembled contact, for very many rows or a matrix that is singular without contact."""

    penalty, patience = IN_MATRIX, ASSEMBLED_PATIENCE

    def __init__(
        self, potential: Potential, multipliers: Multipliers, q0: Array, places: RowPlaces
    ) -> None:
        super().__init__(potential, multipliers, q0)
        self._places = places

    def matrix(self, point: Point) -> Matrix:
        """Scale times the second derivative of potential and augmentation."""
        A = super().matrix(point)
        self._places.add(self.multipliers.stiffness(self.acting(point)), self.scale, A.values)
        return A

    def freed(self, point: Point, rhs: Array, work: Workspace) -> Array:
        """Solution (n,) without the rows, which the factor contains and by which it is too small."""
        times = super().matrix(point).times
        return conjugate_gradients(times, lambda r: self.answer(r, work), rhs, FREED, FREED_LIMIT)[
            0
        ]

    def settled(self, point: Point) -> ContactForces:
        """Contact forces at the end of the iteration."""
        return self.acting(point)

    def solve_under_rows(self, rhs: Array, work: Workspace, opening: Array) -> Array:
        """Solution with the factor, whose matrix contains the active rows, opened by (k,) [m]."""
        if opening.any():
            rows = self.multipliers.rows
            push = (self.multipliers.rho * opening)[:, None] * rows.normal
            rhs = rhs + self.scale * self.generalised(rows.spread(push, len(self._q0)))
        return self.answer(rhs, work)

    def opened(
        self, rows: ContactRows, wanted: Array, pushing: Index, diagonal: Array, work: Workspace
    ) -> Array:
        """Displacements (n_nodes, 3) that open rows approximately by distances (k,) [m].

        `pushing` are contact vertices of active rows; `diagonal` (n_free,) is of the stiffness [N/m].
        """
        push = penalty_forces(
            rows, wanted, pushing, self.system.point_pattern, diagonal, self.penalty
        )
        return self.opening(self.answer(self.scale * self.generalised(push), work))
