"""Force-velocity relation: factor of the active tension of a muscle at its rate of lengthening."""

from dataclasses import dataclass

import numpy as np

from sim.laws.parameters import Parametric, quantity
from sim.pattern import Array


@dataclass(frozen=True)
class ForceVelocity(Parametric):
    """Factor f_v of the active tension as a function of u, the rate of stretch over `v_max`.

    * Shortening, -1 <= u <= 0: Hill's hyperbola (1 + u)/(1 - u/curvature); 0 for faster shortening.
    * Lengthening, u > 0: lengthening - (lengthening - 1)/(1 + (1 + 1/curvature) u/(lengthening - 1)),
      the hyperbola with the same slope at u = 0 and the asymptote `lengthening`.

    The relation increases monotonically, so that the forces (f_v - 1) times the active tension
    dissipate energy at any rate.

    Raises
    ------
    SceneError
        A parameter is out of range.

    Notes
    -----
    Source: Hill 1938, Proc. R. Soc. B 126, 136-195 (shortening); Zajac 1989, Crit. Rev. Biomed. Eng.
    17, 359-411 (v_max of 10 lengths per second, curvature 0.25); Thelen 2003, J. Biomech. Eng. 125,
    70-77 (asymptote 1.4). The equal slopes at u = 0 are a choice.
    """

    #: largest rate of shortening, in rest lengths per second [1/s]
    v_max: float = quantity(10.0, "1/s", above=0.0)
    curvature: float = quantity(0.25, "1", above=0.0)  #: a/F0 of Hill's equation [1]
    #: largest tension in lengthening over the isometric one [1]
    lengthening: float = quantity(1.4, "1", above=1.0)

    def evaluate(self, rate: Array) -> tuple[Array, Array]:
        """Factor f_v [1] and its derivative [s] at rates of stretch [1/s]."""
        u = np.maximum(rate / self.v_max, -1.0)
        slow, more, slope = np.minimum(u, 0.0), self.lengthening - 1.0, 1.0 + 1.0 / self.curvature
        below, above = 1.0 - slow / self.curvature, 1.0 + slope * np.maximum(u, 0.0) / more
        factor = np.where(u <= 0.0, (1.0 + slow) / below, self.lengthening - more / above)
        steep = np.where(u <= 0.0, slope / below**2, slope / above**2)
        return factor, np.where(u > -1.0, steep, 0.0) / self.v_max
