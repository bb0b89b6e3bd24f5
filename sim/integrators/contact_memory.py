"""Compliance and stiffness of the tissue that contact forces use over many steps."""

import math
from collections.abc import Callable

from sim.contact.compliance import Compliance
from sim.integrators.newton_factor import Key, NewtonFactor
from sim.state import Array


class ContactMemory:
    """Memory of converged steps with contact, for n unknowns.

    `stiffness` is the diagonal (n,) of the stiffness of an integrator and step, to which penalties are
    proportional [N/m].
    """

    def __init__(self, newton: NewtonFactor, n: int) -> None:
        self._newton, self._n = newton, n
        self._compliance: Compliance | None = None
        self._made_by: int | None = None
        self._scale = 0.0
        self.stiffness: tuple[Key, Array] | None = None

    def compliance(
        self, scale: float, solve_many: Callable[[Array], Array] | None = None
    ) -> Compliance:
        """Compliance of the tissue of the latest factor, or of earlier ones of the same scale.

        New parts come from `solve_many`, by default the latest factor of Newton's method, of `scale`
        times the stiffness without products, in its own precision. One of shorter steps would be too
        small: its updates correct it for the forces that have occurred, and any other force, such as
        rounding that is not symmetric, would grow from iteration to iteration.
        """

        def by_factor(rhs: Array) -> Array:
            return scale * self._newton.solve_many(rhs)

        if self._compliance is None or not math.isclose(scale, self._scale, rel_tol=1e-9):
            self._compliance, self._scale = Compliance(self._n, by_factor), scale
            self._made_by = self._newton.number
        self._compliance.solve_many = solve_many or by_factor
        return self._compliance

    def discard(self) -> None:
        """Discard the compliance."""
        self._compliance, self._made_by = None, None

    def forget_compliance(self) -> bool:
        """Discard the compliance if it is not of the latest factor; return True if discarded."""
        if self._made_by == self._newton.number:
            return False
        self.discard()
        return True

    def forget(self) -> None:
        """Discard compliance and stiffness."""
        self.discard()
        self.stiffness = None
