"""Potentials with contact forces, and that with assembled rows.

They are augmented Lagrangians of the rows' gaps g >= 0, (11) of docs/step.md (`sim.contact.rows`).
"""

from dataclasses import dataclass

from sim.contact.rows import Acting, Multipliers, RowPlaces, Rows
from sim.contact.step import pressed
from sim.integrators.newton import Point, Potential
from sim.integrators.workspace import Workspace
from sim.linear.conjugate_gradients import conjugate_gradients
from sim.matrix import Matrix
from sim.scene import Index
from sim.state import Array, Pose

IN_MATRIX = 3.0
"""Penalty of a row relative to the stiffness, so small that factors can be reused."""

PATIENCE = 6  #: number of iterations with one factor if rows are assembled

FREED, FREED_LIMIT = 1e-4, 60
"""Relative error of a solution without the rows of the factor, and largest number of its iterations."""


@dataclass(frozen=True, eq=False)
class InContact(Point):
    """A trial configuration with contact."""

    alone: Point  #: point of the potential without contact


class Touching(Potential):
    """Potential with the augmentation of rows for their multipliers, from q0 (n_nodes, 3) [m]."""

    penalty: float
    multipliers: Multipliers

    def __init__(self, potential: Potential, multipliers: Multipliers, q0: Array) -> None:
        self._potential, self.multipliers, self._q0 = potential, multipliers, q0
        self.system, self.base = potential.system, potential.base
        self.scale, self.shift = potential.scale, potential.shift

    def pose(self, d: Array) -> Pose:
        """Pose after a motion."""
        return self._potential.pose(d)

    def generalised(self, f: Array) -> Array:
        """Generalised force (n,) of forces on nodes (n_nodes, 3)."""
        return self.system.kinematics.generalised_force(f, self.base)

    def opening(self, x: Array) -> Array:
        """Displacements (n_nodes, 3) of a small motion (n,)."""
        return self.system.kinematics.displacements(x, self.base)

    def point(self, d: Array) -> InContact:
        """Evaluate potential and augmentation, and their gradients."""
        return self.with_contact(self._potential.point(d))

    def with_contact(self, point: Point) -> InContact:
        """Point of the potential with augmentation."""
        rows, acting = self.multipliers.rows, self.acting(point.d)
        f = rows.spread(acting.on_vertices(rows), len(self._q0))
        g = point.g - self.generalised(f)
        return InContact(point.d, g, point.phi + acting.energy, point.here, point)

    def matrix(self, d: Array) -> Matrix:
        """Scale times the second derivative of the potential."""
        A = self._potential.matrix(d)
        self.shift = self._potential.shift
        return A

    def answer(self, rhs: Array, work: Workspace) -> Array:
        """Solution (n,) with the factor for a right-hand side."""
        if self.system.constraints is None:
            return work.newton.solve(rhs)
        return work.constraints.saddle.roughly(rhs)

    def freed(self, d: Array, rhs: Array, work: Workspace) -> Array:
        """Solution (n,) for a right-hand side without the rows; the factor has none of them."""
        return self.answer(rhs, work)

    def acting(self, d: Array) -> Acting:
        """Contact forces at displacements d."""
        return self.multipliers.at(self.positions(d) - self._q0)


class TouchingInMatrix(Touching):
    """Assembled contact, for very many rows or a matrix that is singular without contact."""

    penalty, patience = IN_MATRIX, PATIENCE

    def __init__(
        self, potential: Potential, multipliers: Multipliers, q0: Array, places: RowPlaces
    ) -> None:
        super().__init__(potential, multipliers, q0)
        self._places = places

    def matrix(self, d: Array) -> Matrix:
        """Scale times the second derivative of potential and augmentation."""
        A = super().matrix(d)
        self._places.add(self.multipliers.stiffness(self.acting(d)), self.scale, A.values)
        return A

    def freed(self, d: Array, rhs: Array, work: Workspace) -> Array:
        """Solution (n,) without the rows, which the factor contains and by which it is too small."""
        times = super().matrix(d).times
        return conjugate_gradients(times, lambda r: self.answer(r, work), rhs, FREED, FREED_LIMIT)[
            0
        ]

    def settled(self, d: Array) -> Acting:
        """Contact forces at the end of the iteration."""
        return self.acting(d)

    def held(self, rhs: Array, work: Workspace, opening: Array) -> Array:
        """Solution with the factor, whose matrix contains the active rows, opened by (k,) [m]."""
        if opening.any():
            rows = self.multipliers.rows
            push = (self.multipliers.rho * opening)[:, None] * rows.normal
            rhs = rhs + self.scale * self.generalised(rows.spread(push, len(self._q0)))
        return self.answer(rhs, work)

    def opened(
        self, rows: Rows, wanted: Array, pushing: Index, diagonal: Array, work: Workspace
    ) -> Array:
        """Displacements (n_nodes, 3) that open rows approximately by distances (k,) [m].

        `pushing` are slots of active rows, and `diagonal` (n_free,) is that of the stiffness [N/m].
        """
        push = pressed(rows, wanted, pushing, self.system.point_pattern, diagonal, self.penalty)
        return self.opening(self.answer(self.scale * self.generalised(push), work))
