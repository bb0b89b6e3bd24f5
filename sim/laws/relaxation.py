"""Quasi-linear viscoelasticity: relaxation of the stress of a law."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.checks import real_numbers, require
from sim.errors import SceneError


@dataclass(frozen=True)
@real_numbers
class Prony:
    """Reduced relaxation function G(t) = 1 - sum_i g_i (1 - exp(-t/tau_i)), G(0) = 1.

    The stress of a law becomes S(t) = int_0^t G(t - s) dS_e/ds ds with S_e its elastic
    (instantaneous) stress. Over a step in which S_e changes linearly the integral is exact by the
    recursion

        H_i(t + h) = e_i H_i(t) + a_i (S_e(t + h) - S_e(t)),
        S = (1 - sum g_i) S_e + sum g_i H_i,   e_i = exp(-h/tau_i),   a_i = (1 - e_i) tau_i/h.

    Notes
    -----
    Source: Fung 1993, Biomechanics, Chap. 7; recursion: Taylor, Pister and Goudreau 1970. The
    coefficients of the law are the instantaneous ones, which a static equilibrium reduces by the
    factor 1 - sum g_i.
    """

    g: tuple[float, ...]  #: relaxing fraction of the stress for each time, with a sum below 1
    tau: tuple[float, ...]  #: relaxation times [s]

    def __post_init__(self) -> None:
        if len(self.g) != len(self.tau) or not self.g:
            raise SceneError(
                f"Prony: {len(self.g)} fractions g for {len(self.tau)} times tau, expected as many of "
                "each, at least one"
            )
        for name in ("g", "tau"):
            for value in getattr(self, name):
                require(self, name, value, above=0.0)
        require(self, "1 - sum of g", self.relaxed, above=0.0)

    @property
    def relaxed(self) -> float:
        """Remaining fraction of the stress, G at infinite time."""
        return 1.0 - sum(self.g)

    def decay(self, h: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """e_i and a_i over a step of length h [s], which may be infinite."""
        x = h / np.array(self.tau)
        with np.errstate(invalid="ignore"):
            mean = np.where(x > 0.0, -np.expm1(-x) / np.where(x > 0.0, x, 1.0), 1.0)
        return np.exp(-x), mean

    def at(self, t: float) -> float:
        """G(t)."""
        return self.relaxed + float(np.dot(self.g, np.exp(-t / np.array(self.tau))))
