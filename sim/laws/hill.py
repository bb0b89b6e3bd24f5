"""Hill-type line law: pennate fibres in series with a tendon."""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from sim._kernels import lines
from sim._kernels.laws import KINK
from sim.laws.parameters import Parametric, quantity
from sim.pattern import Array

_erf = np.vectorize(math.erf, otypes=[np.float64])


@dataclass(frozen=True)
class Hill(Parametric):
    """Fibres of a muscle in series with its tendon, in equilibrium, without effect of velocity.

    With the optimal length L_opt = stretch_opt L_rest, the slack length of the tendon
    L_T = tendon_ratio L_opt, and the optimal length of the fibres l_opt, l_opt cos(pennation) =
    L_opt - L_T, a fibre of the length l = r l_opt pulls with

        f(r) = force_max (activation exp(-(r - 1)^2 / 0.45) + passive_fraction p(r)),
        p(r) = (exp(5 (r - 1) / 0.6) - 1) / (exp(5) - 1) for r > 1, else 0.

    The thickness l sin(angle) of the muscle is constant, so that the tension is f cos(angle) of the
    fibres' direction. The tendon pulls with force_max e / tendon_strain at a strain e >= 0, and is rigid
    for tendon_strain = 0.

    Raises
    ------
    SceneError
        A parameter is out of range.

    Notes
    -----
    Source of the curves: Thelen 2003, Adjustment of muscle mechanics model parameters to simulate
    dynamic contractions in older adults, J. Biomech. Eng. 125, 70-77 (gamma = 0.45, k_PE = 5, e_0 =
    0.6; tendon strain 0.033 there); of the constant thickness: Zajac 1989, Crit. Rev. Biomed. Eng. 17,
    359-411.
    """

    force_max: float = quantity(1.0, "N", least=0.0)  #: largest active force of the fibres [N]
    #: optimal length of the muscle over its length at rest [1]
    stretch_opt: float = quantity(1.0, "1", above=0.0)
    #: share of the tendon in the optimal length [1]
    tendon_ratio: float = quantity(0.3, "1", least=0.0, below=1.0)
    #: passive force over force_max at a fibre strain of 0.6 [1]
    passive_fraction: float = quantity(0.015, "1", least=0.0)
    #: angle of the optimal fibres to the line of action [rad]
    pennation: float = quantity(0.0, "rad", least=0.0, below=0.5 * math.pi)
    tendon_strain: float = quantity(0.033, "1", least=0.0)  #: strain of the tendon at force_max [1]
    has_slope: ClassVar[bool] = True
    code: ClassVar[int] = lines.HILL

    def evaluate(self, length: Array, rest: Array, activation: Array) -> tuple[Array, Array, Array]:
        """Energy, tension and slope; the fibres' share y of the length is found by bisection.

        y solves F(y) = force_max (length - y - L_T)/(tendon_strain L_T).
        """
        optimal = self.stretch_opt * rest
        slack = self.tendon_ratio * optimal
        most = np.maximum(length - slack, 0.0)  # of the fibres along the line, the tendon slack
        fibres = optimal - slack, activation
        y = most
        elastic = self.tendon_strain > 0.0 and self.tendon_ratio > 0.0
        k_T = (
            self.force_max / (self.tendon_strain * slack)
            if elastic
            else np.full_like(slack, np.inf)
        )
        if elastic and self.force_max > 0.0:
            low, high = np.zeros_like(most), most
            for _ in range(200):
                y = 0.5 * (low + high)
                more = self._fibres(y, *fibres)[1] > k_T * (most - y)
                low, high = np.where(more, low, y), np.where(more, y, high)
        w, F, k = self._fibres(y, *fibres)
        stretched = np.where(y < most, most - y, 0.0)
        if not elastic or self.force_max == 0.0:
            return w, F, k
        w = w + 0.5 * k_T * stretched * stretched
        taut = most > 0.0
        return w, np.where(taut, F, 0.0), np.where(taut, k * k_T / (k + k_T), 0.0)

    def _fibres(self, y: Array, across: Array, activation: Array) -> tuple[Array, Array, Array]:
        """Energy, tension and slope of the fibres over their length along the line of action."""
        l_opt = across / np.cos(self.pennation)
        thickness = l_opt * np.sin(self.pennation)
        length = np.sqrt(y * y + thickness * thickness)
        x = length / l_opt - 1.0
        root, k, strain = np.sqrt(0.45), 5.0, 0.6
        active = np.exp(-x * x / 0.45)
        beyond = np.maximum(x, 0.0)
        grown = np.exp(k * beyond / strain)
        share = self.passive_fraction / np.expm1(k)
        w = activation * root * 0.5 * np.sqrt(np.pi) * _erf(x / root)
        w = w + share * (strain / k * (grown - 1.0) - beyond)
        f = activation * active + share * (grown - 1.0)
        slope = -2.0 * x / 0.45 * activation * active
        slope = slope + np.where(x > KINK, share * k / strain * grown, 0.0)
        cos = np.where(length > 0.0, y / np.where(length > 0.0, length, 1.0), 1.0)
        across_share = np.where(
            length > 0.0, (1.0 - cos * cos) / np.where(length > 0, length, 1.0), 0.0
        )
        F = self.force_max
        return F * l_opt * w, F * f * cos, F * (slope / l_opt * cos * cos + f * across_share)
