"""How a potential is lowered by the latest factor and what moves since have told."""

from sim.integrators.newton import Point
from sim.integrators.workspace import Workspace
from sim.state import Array


class BySecants:
    """The part of a `Potential` that chooses moves, where a factor holds all of its stiffness.

    Attributes: as of `Potential`.
    """

    scale: float
    patience, haste = 1, 1.0

    def direction(self, point: Point, work: Workspace) -> tuple[Point, Array]:
        """The point, and -H g with H the inverse of the factorised matrix and of later moves."""
        return point, work.secants.direction(point.g, lambda r: work.solve(self.scale * r))

    def accepted(self, start: Point, end: Point, length: float, work: Workspace) -> Point:
        """The end; secants learn."""
        work.secants.learn(end.d - start.d, end.g - start.g)
        return end

    def refused(self, work: Workspace) -> bool:
        """No: another factor may serve."""
        return False
