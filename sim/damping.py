"""Damping laws formed from mass and stiffness."""

from dataclasses import dataclass

import numpy as np

from sim.errors import SceneError
from sim.scene import Index
from sim.state import Array


@dataclass(frozen=True)
class Rayleigh:
    """Rayleigh damping f = -(alpha M + beta K) v with the current tangent K.

    Attributes
    ----------
    alpha : float
        Mass damping [1/s].
    beta : float
        Stiffness damping [s].

    Raises
    ------
    SceneError
        A coefficient is negative.

    Notes
    -----
    K is taken at the start of the step, as in the published simulator, which keeps the step the
    minimiser of a potential. Source: Stavness et al., chapter on the coupled face model, alpha = 19 1/s
    and beta = 0.055 s.
    """

    alpha: float = 19.0
    beta: float = 0.055

    def __post_init__(self) -> None:
        """Check the ranges."""
        for name, value in (("alpha", self.alpha), ("beta", self.beta)):
            if not value >= 0.0:
                raise SceneError(f"Rayleigh: {name} = {value!r}, expected a number >= 0")

    def add_damping(self, mass: Array, K: Array, diagonal: Index, D: Array) -> None:
        """D += alpha M + beta K."""
        np.add(D, self.beta * K, out=D)
        D[diagonal] += self.alpha * mass
