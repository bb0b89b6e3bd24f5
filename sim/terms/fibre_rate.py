"""Force-velocity relation and viscosity of muscle fibres in the elements of a solid."""

from dataclasses import dataclass

import numpy as np

from sim.assembly import NODES, element_pair_keys, slots
from sim.errors import SceneError
from sim.laws import FibreLaw
from sim.laws.parameters import require
from sim.laws.rate import ForceVelocity
from sim.mesh import Mesh
from sim.scene import Contribution, Index, Layout
from sim.state import Array, Control
from sim.terms.muscles import Muscles


@dataclass(frozen=True, eq=False)
class FibreRate:
    """Forces of the rate of fibre stretch, in addition to those of a solid with the same muscles.

    The dissipated power is the sum over Gauss points and fibres of weight V P dL/dt with the stretch
    L = J^(-1/3) |F a0| and

        P = T(L, a) (f_v(dL/dt) - 1) + viscosity dL/dt,    T = dw/dL(L, a) - dw/dL(L, 0),

    where T is the active part of the fibre law. At rest and at zero rate there is no force.

    Attributes
    ----------
    muscles : Muscles
        Those of the solid.
    relation : ForceVelocity or None
        None omits the first part.
    viscosity : float
        Of passive and active fibres [Pa s].

    Raises
    ------
    SceneError
        The viscosity is negative; on compiling, no solid of the scene has a muscle of this name.

    Notes
    -----
    Solids with a prestretch are not supported: their fibres are those of the stress-free state.
    """

    muscles: Muscles
    relation: ForceVelocity | None = None
    viscosity: float = 0.0

    def __post_init__(self) -> None:
        """Check the viscosity."""
        require(self, "viscosity", self.viscosity, at_least=0.0, strictly=False)

    def pair_keys(self, mesh: Mesh) -> Index:
        """All pairs of nodes within an element, those of the solid."""
        return element_pair_keys(mesh)

    def compile(self, layout: Layout) -> "CompiledFibreRate":
        """Lay out the Gauss points of all fibres."""
        return CompiledFibreRate(self, layout)


class CompiledFibreRate:
    """Compiled forces of the rate of fibre stretch, at k pairs of a Gauss point and a fibre.

    gradient (k, NODES, 3) are the derivatives of the shape functions by the mesh, direction (k, 3)
    those of fibres, and volume (k,) that of the point times the weight of the fibre.
    """

    def __init__(self, term: FibreRate, layout: Layout) -> None:
        mesh, muscles = layout.mesh, term.muscles
        self._relation, self._viscosity = term.relation, term.viscosity
        row, self._gradient, self._volume = _points(mesh, muscles.element)
        if muscles.weight is not None:
            self._volume = self._volume * muscles.weight[row]
        size = np.linalg.norm(muscles.direction, axis=1, keepdims=True)
        self._direction = (muscles.direction / size)[row]
        self._nodes = slots(mesh)[0][muscles.element[row]]
        own = muscles.muscle[row]
        self._laws: list[tuple[FibreLaw, Index]] = [
            (law, np.flatnonzero(own == i)) for i, law in enumerate(muscles.laws())
        ]
        unknown = [name for name in muscles.names if name not in layout.muscles]
        if unknown:
            raise SceneError(
                f"FibreRate refers to muscle {unknown[0]!r}, which no term of the scene has: add a "
                "solid with the same muscles"
            )
        self._drive = np.array([layout.muscles.index(n) for n in muscles.names])[own]
        a, b = (self._nodes[:, side] for side in np.divmod(np.arange(NODES**2), NODES))
        low, high = np.minimum(a, b), np.maximum(a, b)
        pattern = layout.pattern
        place = np.minimum(pattern.pair_index(low * mesh.n_nodes + high), len(pattern.pairs) - 1)
        # Slots without a node have no gradient, so that their entries are zero anywhere.
        self._target = np.where((a <= b)[..., None], pattern.target[place], -1)

    def add_force(self, q: Array, control: Control, f: Array) -> Contribution:
        """No force without motion."""
        return Contribution(0.0)

    def add_tangent(self, q: Array, control: Control, f: Array, K: Array) -> Contribution:
        """No force and no stiffness without motion."""
        return Contribution(0.0)

    def add_rate_force(self, q: Array, v: Array, control: Control, f: Array, D: Array) -> None:
        """F += forces at positions q and velocities v (n_nodes, 3), and D += -df/dv."""
        stretch, B = self._stretch(q)
        rate = np.einsum("kai,kai->k", B, v[self._nodes])
        stress, slope = self._viscosity * rate, np.full(len(rate), self._viscosity)
        if self._relation is not None and control.activation.any():
            factor, steep = self._relation.evaluate(rate)
            active = self._active(stretch, control)
            stress, slope = stress + active * (factor - 1.0), slope + active * steep
        force = (self._volume * stress)[:, None, None] * B
        for i in range(3):
            f[:, i] -= np.bincount(self._nodes.ravel(), force[:, :, i].ravel(), len(f))
        entries = np.einsum("k,kai,kbj->kabij", self._volume * slope, B, B, optimize=True)
        stored = self._target >= 0
        values = entries.reshape(self._target.shape)[stored]
        D[:] += np.bincount(self._target[stored], values, len(D))

    def _stretch(self, q: Array) -> tuple[Array, Array]:
        """Stretch L (k,) and its derivatives B (k, NODES, 3) by the nodes.

        dL/dF = L (F a0 a0' / |F a0|^2 - F^-T / 3), and dL/dx_a = dL/dF g_a.
        """
        F: Array = np.einsum("kai,kaj->kij", q[self._nodes], self._gradient)
        Fa = np.einsum("kij,kj->ki", F, self._direction)
        squared = np.einsum("ki,ki->k", Fa, Fa)
        L = np.cbrt(1.0 / np.linalg.det(F)) * np.sqrt(squared)
        along = (L / squared)[:, None, None] * Fa[:, :, None] * self._direction[:, None, :]
        inverse: Array = np.linalg.inv(F).astype(np.float64)
        dL = along - (L / 3.0)[:, None, None] * inverse.transpose(0, 2, 1)
        return L, np.einsum("kij,kaj->kai", dL, self._gradient)

    def _active(self, stretch: Array, control: Control) -> Array:
        """Active part T (k,) of the fibre laws [Pa]."""
        drive, T = control.activation[self._drive], np.zeros(len(stretch))
        for law, own in self._laws:
            L = stretch[own]
            T[own] = law.evaluate(L, drive[own])[1] - law.evaluate(L, 0.0 * L)[1]
        return T


def _points(mesh: Mesh, element: Index) -> tuple[Index, Array, Array]:
    """Rows of `element` (k,), gradients (k, NODES, 3) and volumes (k,) of their Gauss points."""
    rows, gradients, volumes, first = list[Index](), list[Array](), list[Array](), 0
    for block in mesh.blocks:
        dN, n = block.kind.dN, len(block.nodes)
        own = np.flatnonzero((element >= first) & (element < first + n))
        X = mesh.X[block.nodes[element[own] - first]]
        jacobian: Array = np.einsum("eai,paj->epij", X, dN)
        inverse: Array = np.linalg.inv(jacobian).astype(np.float64)
        slope = np.einsum("paj,epji->epai", dN, inverse)
        gradient = np.zeros((len(own), len(dN), NODES, 3))
        gradient[:, :, : block.kind.n_nodes] = slope
        rows.append(np.repeat(own, len(dN)))
        gradients.append(gradient.reshape(-1, NODES, 3))
        volumes.append((np.linalg.det(jacobian) * block.kind.weights).ravel())
        first += n
    return np.concatenate(rows), np.concatenate(gradients), np.concatenate(volumes)
