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

from sim.checks import real_numbers, require
from sim.errors import SceneError
from sim.mesh import Mesh
from sim.scene import CompiledDamping, Layout, Stiffness
from sim.state import Array, Control


@dataclass(frozen=True)
@real_numbers
class _Coefficients:
    """Coefficients of mass and stiffness; their values are of Stavness et al., coupled face model."""

    alpha: float | Array = 19.0  #: mass damping [1/s], not negative; or (n_nodes,) of the nodes
    beta: float | Array = (
        0.055  #: stiffness damping [s], likewise; equal for nodes that are coupled
    )

    def __post_init__(self) -> None:
        for name, given in (("alpha", self.alpha), ("beta", self.beta)):
            values = np.asarray(given, dtype=np.float64)
            if values.ndim == 0:
                require(self, name, float(values), least=0.0)
                continue
            if values.ndim != 1 or not values.size or not np.isfinite(values).all():
                raise SceneError(
                    f"{type(self).__name__}: {name} has shape {values.shape} or contains NaN, expected "
                    "a number or finite (n_nodes,)"
                )
            require(self, name, float(values.min()), least=0.0)
            object.__setattr__(self, name, values)

    def require_nodes(self, mesh: Mesh) -> None:
        """Refuse coefficients of another number of nodes."""
        for name in ("alpha", "beta"):
            values: float | Array = getattr(self, name)
            if not isinstance(values, float | int):
                _of_nodes(name, values, mesh)

    def combine(self, layout: Layout, K: Array) -> Array:
        """Values of alpha M + beta K on the pattern."""
        pattern, mesh = layout.pattern, layout.mesh
        node = pattern.free // 3
        beta = self.beta
        if isinstance(beta, np.ndarray):
            beta = _of_nodes("beta", beta, mesh)
            _require_equal_in_elements(self, beta, layout)
            beta = np.repeat(beta[node], np.diff(pattern.indptr))
        alpha = self.alpha
        if isinstance(alpha, np.ndarray):
            alpha = _of_nodes("alpha", alpha, mesh)[node]
        D = beta * K
        D[pattern.diagonal] += alpha * layout.node_mass[node]
        return D

    @property
    def largest_beta(self) -> float:
        """Coefficient of the stiffness, the largest of all nodes."""
        return float(np.max(self.beta))


def _require_equal_in_elements(law: object, beta: Array, layout: Layout) -> None:
    """Refuse coefficients that differ between nodes that the stiffness couples.

    Rows of K with different factors are a damping matrix that is neither symmetric nor dissipative.
    """
    first = 0
    for block in layout.mesh.blocks:
        own = beta[block.nodes]
        uneven = np.flatnonzero(own.min(axis=1) != own.max(axis=1))
        if len(uneven):
            k = int(uneven[0])
            raise SceneError(
                f"{type(law).__name__}: beta of the nodes of element {first + k} is between "
                f"{own[k].min():g} and {own[k].max():g} s, expected one value in tissues that are "
                "coupled: give all nodes of a tissue the same beta"
            )
        first += len(block.nodes)


def _of_nodes(name: str, values: Array, mesh: Mesh) -> Array:
    """Values of the nodes of the mesh, with zeros for points without tissue."""
    n, tissue = mesh.n_nodes, mesh.n_nodes - mesh.n_points
    if len(values) not in (tissue, n):
        raise SceneError(
            f"damping: {name} has {len(values)} values, expected {tissue}, one per node of the mesh"
        )
    return np.concatenate([values, np.zeros(n - len(values))])


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
        self.require_nodes(layout.mesh)

        def matrix(q: Array, control: Control, K: Array | None = None) -> Array:
            return self.combine(layout, stiffness(q, control, K))

        return _Compiled(self.largest_beta, matrix)


@dataclass(frozen=True)
class PassiveRayleigh(_Coefficients):
    """K is the tangent at the current positions without activation."""

    def compile(self, layout: Layout, stiffness: Stiffness) -> CompiledDamping:
        """Compile with the passive tangent."""
        self.require_nodes(layout.mesh)
        at_rest = Control(np.zeros(len(layout.muscles)))

        def matrix(q: Array, control: Control, K: Array | None = None) -> Array:
            return self.combine(layout, stiffness(q, at_rest, None))

        return _Compiled(self.largest_beta, matrix)


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

        return _Compiled(self.largest_beta, matrix, layout.mesh.X)


DAMPING_LAWS = (Rayleigh, PassiveRayleigh, RestRayleigh)
"""All damping laws, which the tests include."""
