"""Quasi-Newton directions from the latest factor and later updates."""

from sim.integrators.newton import Point
from sim.integrators.workspace import Workspace
from sim.state import Array


class BySecants:
    """Choice of directions of a `Potential` whose stiffness is factorised completely."""

    scale: float
    patience, haste = 1, 1.0

    def direction(self, point: Point, work: Workspace) -> tuple[Point, Array]:
        """Current iterate, and direction -H g with the quasi-Newton inverse H."""
        return point, work.secants.direction(point.g, lambda r: work.solve(self.scale * r))

    def accepted(self, start: Point, end: Point, length: float, work: Workspace) -> Point:
        """End of a step, which updates the quasi-Newton history."""
        work.secants.learn(end.d - start.d, end.g - start.g)
        return end

    def refused(self, work: Workspace) -> bool:
        """False: a new factor is required."""
        return False
