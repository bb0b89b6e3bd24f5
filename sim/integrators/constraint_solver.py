"""Solutions under the constraints of a scene, and their multipliers."""

from collections.abc import Mapping

import numpy as np

from sim.constraints.projection import Projection
from sim.constraints.union import Constraints
from sim.errors import SceneError
from sim.integrators.clock import PhaseClock
from sim.integrators.kept import named, part_of
from sim.linear import Factor, ReusedFactor
from sim.linear.saddle import Saddle
from sim.state import Array
from sim.system import System


class ConstraintSolver:
    """Saddle systems A x + G' y = r, G x = gamma, and projection of positions.

    Parameters
    ----------
    linear : solver of steps; factors of saddle systems are reused if it reuses its own.

    Attributes
    ----------
    multipliers : (m,) or None
        Of the latest constrained step, the initial values of the next one.
    """

    def __init__(self, system: System, linear: Factor | ReusedFactor, clock: PhaseClock) -> None:
        self._system, self._timed, self._linear = system, clock.timed, linear
        self._saddle: Saddle | None = None
        self._projection: Projection | None = None
        self.multipliers: Array | None = None

    @property
    def saddle(self) -> Saddle:
        """Solver with the constraints of the scene, analysed at the first use."""
        if self._saddle is None:
            linear = self._linear
            factor = type(linear.factor)() if isinstance(linear, ReusedFactor) else None
            pattern = self._system.point_pattern
            self._saddle = Saddle(pattern, self._constraints, factor, self._timed)
        return self._saddle

    @property
    def projection(self) -> Projection:
        """Projection of positions to the constraints, analysed at the first use."""
        if self._projection is None:
            # constraints are for nodes alone, whose mass is diagonal
            one, pose = np.ones(self._system.pattern.n), self._system.rest_state().pose
            mass = self._system.kinematics.apply_mass(one, pose)
            self._projection = Projection(self._constraints, mass)
        return self._projection

    @property
    def _constraints(self) -> Constraints:
        if self._system.constraints is None:
            raise SceneError("the scene has no constraints, expected at least one")
        return self._system.constraints

    def arrays(self) -> dict[str, Array]:
        """Multipliers of the latest step, and the memory of both solvers."""
        found: dict[str, Array] = {}
        if self.multipliers is not None:
            found |= named("step", {"multipliers": self.multipliers})
        if self._saddle is not None:
            found |= named("saddle", self._saddle.arrays())
        if self._projection is not None:
            found |= named("projection", self._projection.arrays())
        return found

    def restore(self, arrays: Mapping[str, Array]) -> None:
        """Restore the memory from `arrays`."""
        self.multipliers = part_of(arrays, "step").get("multipliers")
        # unused parts are in their initial state
        if (saddle := part_of(arrays, "saddle")) or self._saddle is not None:
            self.saddle.restore(saddle)
        if (projection := part_of(arrays, "projection")) or self._projection is not None:
            self.projection.restore(projection)
