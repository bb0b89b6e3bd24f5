"""Failures of the acoustics of tubes."""

from sim.errors import SimulationError


class AcousticsError(SimulationError, ValueError):
    """A tube, its source or its sampling cannot be computed."""


class CourantError(AcousticsError):
    """The Courant number of a tube exceeds 1: sound crosses more than one cell within a time step.

    `number` is the Courant number c dt/dx found.
    """

    def __init__(self, number: float, dt: float, cell: float) -> None:
        self.number = number
        super().__init__(
            f"the Courant number is {number:.3g} (step {1e6 * dt:.3g} us, cell {1e3 * cell:.3g} mm), "
            "expected at most 1: use more steps per sample or fewer sections"
        )
