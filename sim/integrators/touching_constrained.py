"""Contact forces by the Schur complement with constraints, (5), (11) and (12) of docs/step.md."""

import numpy as np

from sim.contact.compliance import Compliance
from sim.contact.rows import Multipliers
from sim.integrators.newton import Point, Potential
from sim.integrators.touching_apart import TouchingApart
from sim.integrators.workspace import Workspace
from sim.state import Array


class TouchingConstrained(TouchingApart):
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
        return -self._rest(point)[1]

    def under_rows(
        self, point: Point, free: Array, error: float, work: Workspace
    ) -> tuple[Point, Array, Array]:
        """Point for the present multipliers, direction, and change of the constraints' multipliers.

        `free` (n,) is the direction under the present contact forces. Each solution leaves an `error`
        [m] at most.
        """
        self._further, self._error = self._none, error
        start, direction = self._directed(point, free, free, work)
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
