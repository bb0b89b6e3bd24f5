"""Solutions under the constraints of a scene, and their multipliers."""

from collections.abc import Mapping

from sim.errors import SceneError
from sim.integrators.clock import PhaseClock
from sim.integrators.kept import named, part_of
from sim.linear.saddle import Saddle
from sim.state import Array
from sim.system import System


class ConstraintSolver:
    """Saddle systems A x + G' y = r, G x = gamma.

    Attributes
    ----------
    multipliers : (m,) or None
        Of the latest constrained step, the initial values of the next one.
    """

    def __init__(self, system: System, clock: PhaseClock) -> None:
        self._system, self._timed = system, clock.timed
        self._saddle: Saddle | None = None
        self.multipliers: Array | None = None

    @property
    def saddle(self) -> Saddle:
        """Solver with the constraints of the scene, analysed at the first use."""
        if self._saddle is None:
            if self._system.constraints is None:
                raise SceneError("the scene has no constraints, expected at least one")
            self._saddle = Saddle(self._system.point_pattern, self._system.constraints)
        return self._saddle

    def factorise(self, A: Array, G: Array) -> None:
        """Factorise the matrix of `solve`, for several solutions with `saddle`."""
        with self._timed("factorisation"):
            self.saddle.factorise(A, G)

    def solve(self, A: Array, G: Array, r: Array, gamma: Array) -> tuple[Array, Array]:
        """Solve for x and the multipliers y.

        Raises
        ------
        SingularSystem
            The matrix is singular or holds NaN.
        """
        self.factorise(A, G)
        with self._timed("solution"):
            return self.saddle.solve(r, gamma)

    def arrays(self) -> dict[str, Array]:
        """Multipliers of the latest step."""
        if self.multipliers is None:
            return {}
        return named("step", {"multipliers": self.multipliers})

    def restore(self, arrays: Mapping[str, Array]) -> None:
        """Restore the memory from `arrays`."""
        self.multipliers = part_of(arrays, "step").get("multipliers")
