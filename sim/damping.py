"""Rayleigh damping f = -(alpha M + beta K) v with different tangents K.

With active muscles the current tangent need not be positive definite; beta K is then a *negative*
damping, and the incremental potential of a step has no minimum. `PassiveRayleigh` omits the active
stress from K, and `RestRayleigh` uses K at rest, which is always positive semi-definite.

In all three K is that at the start of a step, so that the step minimises a potential. M and K are those
of the tissue: rigid bodies and line muscles have coefficients of their own.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sim.checks import require
from sim.scene import CompiledDamping, Layout, Stiffness
from sim.state import Array, Control


@dataclass(frozen=True)
class _Coefficients:
    """Coefficients of mass and stiffness.

    Notes
    -----
    Source of the values: Stavness et al., chapter on the coupled face model.
    """

    alpha: float = 19.0  #: mass damping [1/s], not negative
    beta: float = 0.055  #: stiffness damping [s], not negative

    def __post_init__(self) -> None:
        require(self, "alpha", self.alpha, least=0.0)
        require(self, "beta", self.beta, least=0.0)

    def combine(self, layout: Layout, K: Array) -> Array:
        """Values of alpha M + beta K on the pattern."""
        D = self.beta * K
        D[layout.pattern.diagonal] += self.alpha * layout.node_mass[layout.pattern.free // 3]
        return D


@dataclass(frozen=True, eq=False)
class _Compiled:
    """Compiled law; `rest` are the positions of a constant stiffness."""

    beta: float
    matrix: Callable[[Array, Control, Array | None], Array]
    rest: Array | None = None

    def __call__(self, q: Array, control: Control, K: Array | None = None) -> Array:
        return self.matrix(q, control, K)


@dataclass(frozen=True)
class Rayleigh(_Coefficients):
    """K is the tangent at the current positions and activation, as in the published simulator."""

    def compile(self, layout: Layout, stiffness: Stiffness) -> CompiledDamping:
        """Compile with the current tangent."""

        def matrix(q: Array, control: Control, K: Array | None = None) -> Array:
            return self.combine(layout, stiffness(q, control, K))

        return _Compiled(self.beta, matrix)


@dataclass(frozen=True)
class PassiveRayleigh(_Coefficients):
    """K is the tangent at the current positions without activation."""

    def compile(self, layout: Layout, stiffness: Stiffness) -> CompiledDamping:
        """Compile with the passive tangent."""
        at_rest = Control(np.zeros(len(layout.muscles)))

        def matrix(q: Array, control: Control, K: Array | None = None) -> Array:
            return self.combine(layout, stiffness(q, at_rest, None))

        return _Compiled(self.beta, matrix)


@dataclass(frozen=True)
class RestRayleigh(_Coefficients):
    """K is the constant tangent of the scene at rest.

    It has the lowest cost, but is not frame indifferent: a large rotation is damped like a strain.
    """

    def compile(self, layout: Layout, stiffness: Stiffness) -> CompiledDamping:
        """Compile with the constant matrix."""
        D = self.combine(
            layout, stiffness(layout.mesh.X, Control(np.zeros(len(layout.muscles))), None)
        )

        def matrix(q: Array, control: Control, K: Array | None = None) -> Array:
            return D

        return _Compiled(self.beta, matrix, layout.mesh.X)


DAMPING_LAWS = (Rayleigh, PassiveRayleigh, RestRayleigh)
"""All damping laws, which the tests include."""
