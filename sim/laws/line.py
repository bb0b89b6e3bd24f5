"""Line laws: tension F(length, activation) of a line muscle, with its energy and slope."""

from dataclasses import dataclass
from typing import ClassVar, Protocol

import numpy as np

from sim._kernels import lines
from sim._kernels.laws import KINK
from sim.laws.hill import Hill
from sim.laws.parameters import Parametric, quantity
from sim.pattern import Array


class LineLaw(Protocol):
    """Interface of line laws; `evaluate` is the array form of the kernel that steps use."""

    code: ClassVar[int]
    """Code of the law in `sim._kernels.lines`."""
    has_slope: ClassVar[bool]
    """True if the tension depends on the length, which couples all points of a fibre."""

    def parameters(self) -> tuple[float, ...]:
        """Parameters in the order of the kernel, at most `PARAMETERS` of them."""
        ...

    def evaluate(self, length: Array, rest: Array, activation: Array) -> tuple[Array, Array, Array]:
        """Energy [J], tension dE/dL [N] and slope dF/dL [N/m] at a length [m] and rest length [m]."""
        ...


@dataclass(frozen=True)
class ConstantForce(Parametric):
    """Tension without dependence on length, F = force_max (activation + passive_fraction).

    Raises
    ------
    SceneError
        A parameter is negative.

    Notes
    -----
    Source: the line muscles of the published reference face, 1 N per cable without passive part.
    """

    force_max: float = quantity(1.0, "N", least=0.0)  #: tension at full activation [N]
    passive_fraction: float = quantity(0.0, "1", least=0.0)  #: passive fraction of the tension [1]
    has_slope: ClassVar[bool] = False
    code: ClassVar[int] = lines.CONSTANT

    def evaluate(self, length: Array, rest: Array, activation: Array) -> tuple[Array, Array, Array]:
        """Energy F (L - L_rest), tension F, slope 0."""
        F = self.force_max * (activation + self.passive_fraction)
        return F * (length - rest), F, np.zeros_like(length)


@dataclass(frozen=True)
class Peck(Parametric):
    """Hill-type tension, F = force_max (activation f(n) + passive_fraction p(r)).

    With r = L/(stretch_opt L_rest) and n = (r - tendon_ratio)/(1 - tendon_ratio),

    * f = (1 + cos 2 pi n)/2 for 0.5 < n < 1.5, else 0;
    * p = 0 for r <= 1, (r - 1)/(stretch_max - 1) up to stretch_max, then 1.

    Raises
    ------
    SceneError
        A parameter is out of range.

    Notes
    -----
    Source: the muscles of the jaw model of Peck et al. 2000 as used by Stavness et al., without
    their velocity dependence. The default stretch_max = 1.5 is an assumption; it is specific to
    each muscle.
    """

    force_max: float = quantity(1.0, "N", least=0.0)  #: largest active tension [N]
    stretch_opt: float = quantity(1.0, "1", above=0.0)  #: ratio of optimal to rest length [1]
    #: ratio of length to optimal length from which the passive tension is constant [1]
    stretch_max: float = quantity(1.5, "1", above=1.0)
    #: tendon fraction of the optimal length [1]
    tendon_ratio: float = quantity(0.0, "1", least=0.0, below=1.0)
    #: largest passive tension over force_max [1]
    passive_fraction: float = quantity(0.015, "1", least=0.0)
    has_slope: ClassVar[bool] = True
    code: ClassVar[int] = lines.PECK

    def evaluate(self, length: Array, rest: Array, activation: Array) -> tuple[Array, Array, Array]:
        """Energy counted from the optimal length, tension and slope."""
        optimal = self.stretch_opt * rest
        r = length / optimal
        n = np.clip((r - self.tendon_ratio) / (1.0 - self.tendon_ratio), 0.5, 1.5)
        turn, belly = 2.0 * np.pi, optimal * (1.0 - self.tendon_ratio)
        w_act = belly * (0.5 * (n - 1.0) + np.sin(turn * n) / (2.0 * turn))
        f_act = 0.5 * (1.0 + np.cos(turn * n))
        k_act = np.where((n > 0.5) & (n < 1.5), -0.5 * turn * np.sin(turn * n) / belly, 0.0)
        span = self.stretch_max - 1.0
        x = np.clip(r - 1.0, 0.0, span)
        w_pas = optimal * (0.5 * x * x / span + np.maximum(r - self.stretch_max, 0.0))
        k_pas = np.where((r > 1.0 + KINK) & (r < self.stretch_max), 1.0 / (span * optimal), 0.0)
        a, phi = self.force_max * activation, self.force_max * self.passive_fraction
        return a * w_act + phi * w_pas, a * f_act + phi * x / span, a * k_act + phi * k_pas


@dataclass(frozen=True)
class LinearSpring(Parametric):
    """Tension F = force_max (activation + passive_fraction max(0, L/(slack L_rest) - 1)).

    Raises
    ------
    SceneError
        A parameter is out of range.
    """

    force_max: float = quantity(1.0, "N", least=0.0)  #: active tension at full activation [N]
    #: passive tension per unit of strain over force_max [1]
    passive_fraction: float = quantity(1.0, "1", least=0.0)
    #: length without passive tension over the length at rest [1]
    slack: float = quantity(1.0, "1", above=0.0)
    has_slope: ClassVar[bool] = True
    code: ClassVar[int] = lines.LINEAR_SPRING

    def evaluate(self, length: Array, rest: Array, activation: Array) -> tuple[Array, Array, Array]:
        """Energy, the passive part counted from the slack length, tension and slope."""
        slack = self.slack * rest
        x = np.maximum(length / slack - 1.0, 0.0)
        k = self.force_max * self.passive_fraction
        w = self.force_max * activation * (length - rest) + 0.5 * k * slack * x * x
        return w, self.force_max * activation + k * x, np.where(x > KINK, k / slack, 0.0)


LINE_LAWS: tuple[type[LineLaw], ...] = (ConstantForce, Peck, LinearSpring, Hill)
"""All line laws, the members of the derivative tests."""
