"""Lengths of the contact by constraints, relative to the approach distance."""

from dataclasses import dataclass

LARGEST_SHARE = 0.2  #: largest tolerance relative to the approach distance


@dataclass(frozen=True)
class ContactTolerances:
    """Lengths at which contact decides, in terms of two."""

    length: float = 5e-4  #: distance of a vertex and a face below which they have a row [m]
    share: float = 2e-3  #: gap, penetration or slip that an iteration leaves, relative to `length`

    def _residuals(self, number: float) -> float:
        return min(number * self.share, LARGEST_SHARE) * self.length

    @property
    def residual(self) -> float:
        """Remaining gap or slip of an iteration [m]; ten times larger values cause visible gaps."""
        return self._residuals(1.0)

    @property
    def solution(self) -> float:
        """Error of an iterative linear solution [m], below the residual, so that gaps converge."""
        return self._residuals(0.3)

    @property
    def converged(self) -> float:
        """Residual of a converged step [m], which the correction of positions removes."""
        return self._residuals(2.0)

    @property
    def noticed(self) -> float:
        """Smallest penetration that is corrected [m]; smaller ones remain."""
        return self._residuals(3.0)

    @property
    def left(self) -> float:
        """Penetration after a correction above which rows are searched again [m]."""
        return self._residuals(5.0)

    @property
    def accepted(self) -> float:
        """Violation of rows that the correction removes [m]; limited, so that no vertex enters."""
        return self._residuals(10.0)

    @property
    def unexpected(self) -> float:
        """Depth of an inactive row above which a step is solved again [m]."""
        return self._residuals(20.0)

    @property
    def considerable(self) -> float:
        """Depth of an active row above which a step is solved again [m]."""
        return 0.2 * self.length

    @property
    def likely(self) -> float:
        """Gap below which rows may become active in the same iteration [m]."""
        return 0.2 * self.length

    @property
    def slide(self) -> float:
        """Sliding distance over which contact normals are low-pass filtered [m]."""
        return 0.5 * self.length

    @property
    def hair(self) -> float:
        """Initial depth up to which a vertex is regarded as on the surface [m]."""
        return 0.2 * self.length

    @property
    def lift(self) -> float:
        """Distance outside the surface from which the path of such a vertex starts [m]."""
        return 2e-4 * self.length
