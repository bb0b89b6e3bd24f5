"""Linear splines of the activations over a trial."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import BSpline

from sim.checks import real_numbers
from sim.state import Array

DEGREE = 1
"""Degree of the splines: an activation that is zero is one coefficient at its bound, which has a
positive density; the sum of several positive coefficients would not."""


@dataclass(frozen=True)
@real_numbers
class Splines:
    """Linear B-splines on 0 to `duration`, with equal distances of about `spacing` [s].

    Coefficients within 0-1 result in activations within 0-1 (convex hull property).
    """

    duration: float
    spacing: float = 0.06

    @cached_property
    def knots(self) -> Array:
        """Knots [s], which extend beyond the ends."""
        parts = max(1, round(self.duration / self.spacing))
        return float(self.duration / parts) * np.arange(-DEGREE, parts + DEGREE + 1.0)

    @property
    def n(self) -> int:
        """Number of splines."""
        return len(self.knots) - DEGREE - 1

    def basis(self, t: Array) -> Array:
        """Values (len(t), n) of the splines at times within the duration."""
        inside = np.clip(t, 0.0, self.duration * (1.0 - 1e-12))
        matrix = BSpline.design_matrix(inside, self.knots, DEGREE).toarray()
        return np.asarray(matrix, dtype=np.float64)


def ends_of_steps(n: int, h: float) -> Array:
    """Times (n,) of the ends of steps of length h [s]."""
    return np.asarray(h * np.arange(1, n + 1), dtype=np.float64)
