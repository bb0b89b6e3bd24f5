"""Soft incompressibility: a pressure from the volume of a whole element.

It replaces the pointwise bulk law of a solid, whose kappa must be 0, and uses the quadratic
potential. It prevents volumetric locking because fewer volumes are constrained than there are Gauss
points.
"""

from dataclasses import dataclass

import numpy as np

from sim._kernels import volume as kernel
from sim._kernels.lanes import LANES
from sim.assembly import element_pair_keys, parts_of, places_of
from sim.checks import real_numbers
from sim.errors import SceneError
from sim.mesh import Mesh
from sim.scene import CompiledTerm, Contribution, Index, Layout, Term
from sim.state import Array, Control


@dataclass(frozen=True, eq=False)
@real_numbers
class ElementVolume(Term):
    """One pressure per element, E = sum_e kappa_e/2 V_e (v_e/V_e - 1)^2."""

    #: bulk modulus [Pa], also (n_elements,), positive; zero if another law determines the
    #: volume change
    kappa: float | Array = 25e3
    #: (n_elements, NODES, 3) as that of the `Solid`, whose volumes are then V_e [m]
    stress_free: Array | None = None

    def __post_init__(self) -> None:
        require_positive(self.kappa)

    def pair_keys(self, mesh: Mesh) -> Index:
        """All pairs of nodes within an element."""
        return element_pair_keys(mesh)

    def compile(self, layout: Layout) -> "CompiledElementVolume":
        """Lay out volumes and sums."""
        return CompiledElementVolume(self.kappa, layout, self.stress_free)


def require_positive(kappa: float | Array) -> None:
    """Refuse a bulk modulus that is negative or nowhere positive."""
    values = np.atleast_1d(kappa)
    if not ((values >= 0.0) & (values < np.inf)).all() or not (values > 0.0).any():
        raise SceneError(
            f"soft incompressibility: kappa = {kappa!r}, expected a number > 0, or one >= 0 per element"
        )


def kappa_by_element(kappa: float | Array, mesh: Mesh) -> Array:
    """Bulk modulus of every element (n_elements,), checked."""
    if np.ndim(kappa) and np.shape(kappa) != (mesh.n_elements,):
        raise SceneError(
            f"soft incompressibility: kappa has shape {np.shape(kappa)}, expected one number or "
            f"({mesh.n_elements},)"
        )
    return np.broadcast_to(np.asarray(kappa, dtype=np.float64), (mesh.n_elements,))


class CompiledElementVolume(CompiledTerm):
    """Compiled element volumes; the buffers contain no state between calls."""

    def __init__(
        self, kappa: float | Array, layout: Layout, stress_free: Array | None = None
    ) -> None:
        self._kappa = np.ascontiguousarray(kappa_by_element(kappa, layout.mesh))
        self._parts = parts_of(layout.mesh, stress_free=stress_free)
        self._places = [places_of(layout.mesh, part, layout.pattern) for part in self._parts]
        self._energy = np.zeros(layout.mesh.n_elements)
        self._no_values, self._no_pressure = np.zeros(0), np.zeros((0, LANES))

    def add(
        self,
        q: Array,
        control: Control,
        f: Array,
        K: Array | None = None,
        weight: Array | None = None,
    ) -> Contribution:
        """Subtract dE/dq from f, and add d2E/dq2 to K; weight (n_elements,) multiplies the energies."""
        kappa = self._kappa if weight is None else weight * self._kappa
        values = self._no_values if K is None else K
        for part, places in zip(self._parts, self._places, strict=True):
            about = kappa, self._no_pressure, True, K is not None
            kernel.add_pressure(q, part, places, *about, f, self._energy, values)
        return Contribution(float(self._energy.sum()))
