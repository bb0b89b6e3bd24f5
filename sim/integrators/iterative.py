"""Base class of iterative integrators: tolerances, and the iteration for a scene."""

from collections.abc import Callable
from dataclasses import dataclass

from sim.errors import SceneError
from sim.integrators.constrained import Placed, minimise_constrained
from sim.integrators.newton import Iteration, Point, Tolerances, minimise
from sim.integrators.workspace import Workspace
from sim.system import System


@dataclass(frozen=True)
class Iterative:
    """Newton's method to a tolerance, on a potential.

    The line search requires det F > 0 at every Gauss point and a decrease of the potential. A
    factor is reused, with quasi-Newton updates, over many steps as long as the iteration converges;
    a matrix that is not positive definite is shifted.

    Attributes
    ----------
    tolerance : float
        Largest estimated remaining error of a nodal position [m].
    residual_tolerance : float
        Largest nodal residual force [N].
    max_iterations : int
    keep_factor : float
        The factor is renewed if an iteration reduces the residual by a smaller factor.
    """

    tolerance: float = 1e-6
    residual_tolerance: float = 2e-5
    max_iterations: int = 80
    keep_factor: float = 0.6

    def _minimiser(
        self, system: System, work: Workspace, s: float, until: float
    ) -> Callable[[Placed, Point], tuple[Point, Iteration]]:
        """Return the iteration for a system, with its constraints if it has any.

        Factors belong to this integrator and s, its implicit part of a step [s].
        """
        if system.rows is not None:
            raise SceneError(
                f"{type(self).__name__} does not hold joints: use LinearlyImplicitEuler or RungeKutta4"
            )
        tolerances = Tolerances(
            self.tolerance, self.residual_tolerance, self.max_iterations, self.keep_factor
        )

        def settle(potential: Placed, point: Point) -> tuple[Point, Iteration]:
            if system.constraints is None:
                return minimise(potential, point, work, (type(self).__name__, s), tolerances, until)
            return minimise_constrained(potential, point, work, tolerances, until)

        return settle
