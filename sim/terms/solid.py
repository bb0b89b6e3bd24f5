"""The deformable solid: passive tissue and muscle fibres in one element loop."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from sim._kernels import solid as kernel
from sim.assembly import (
    MatrixSum,
    NodeSum,
    block_layouts,
    element_pair_keys,
    grouped,
    prestretched,
)
from sim.errors import SceneError
from sim.laws import Blemker, BulkLaw, FibreLaw, IsochoricLaw, MooneyRivlin, QuadraticBulk
from sim.laws.fibre import N_FIBRE
from sim.laws.isochoric import N_ISOCHORIC
from sim.mesh import Mesh
from sim.scene import Contribution, Index, Layout
from sim.state import Array, Control
from sim.vectors import dot


@dataclass(frozen=True)
class Material:
    """Passive tissue.

    Attributes
    ----------
    isochoric : IsochoricLaw
    bulk : BulkLaw
    density : float
        Rest density [kg/m^3].
    """

    isochoric: IsochoricLaw = field(default_factory=MooneyRivlin)
    bulk: BulkLaw = field(default_factory=QuadraticBulk)
    density: float = 1040.0

    def __post_init__(self) -> None:
        """Check the density."""
        if not self.density > 0.0:
            raise SceneError(f"Material: density = {self.density!r}, expected a number > 0")


@dataclass(frozen=True, eq=False)
class Muscles:
    """Fibres in elements: one row per element of a muscle; an element may have several.

    Attributes
    ----------
    names : tuple of str
    element : (k,) element index of the row.
    muscle : (k,) index into names.
    direction : (k, 3) rest direction a0; normalised on compiling.
    law : FibreLaw, or one per name.
    weight : (k,) share of the element that the muscle fills, a factor on its energy [1]; None is 1.

    Raises
    ------
    SceneError
        Arrays disagree, an index is out of range, a direction is zero, a weight negative or no
        number, or a muscle has no element.
    """

    names: tuple[str, ...]
    element: Index
    muscle: Index
    direction: Array
    law: FibreLaw | Sequence[FibreLaw] = field(default_factory=Blemker)
    weight: Array | None = None

    def __post_init__(self) -> None:
        """Refuse rows that cannot act."""
        k = len(self.element)
        if self.muscle.shape != (k,) or self.direction.shape != (k, 3):
            raise SceneError(
                f"muscle rows disagree: {k} elements, {self.muscle.shape} muscles, "
                f"{self.direction.shape} directions, expected ({k},) and ({k}, 3)"
            )
        empty = np.setdiff1d(np.arange(len(self.names)), self.muscle)
        if empty.size:
            raise SceneError(f"muscle {self.names[empty[0]]} has no element")
        if k and (self.muscle.min() < 0 or self.muscle.max() >= len(self.names)):
            raise SceneError(f"muscle index out of range, expected 0..{len(self.names) - 1}")
        norm = np.linalg.norm(self.direction, axis=1)
        if not (norm > 0.0).all():
            row = int(np.argmin(norm > 0.0))
            raise SceneError(
                f"muscle {self.names[self.muscle[row]]} has no fibre direction in element "
                f"{self.element[row]}"
            )
        if self.weight is not None:
            if self.weight.shape != (k,):
                raise SceneError(
                    f"muscle rows disagree: {k} elements, {self.weight.shape} weights, expected ({k},)"
                )
            if not (np.isfinite(self.weight) & (self.weight >= 0.0)).all():
                row = int(np.argmin(np.isfinite(self.weight) & (self.weight >= 0.0)))
                raise SceneError(
                    f"muscle {self.names[self.muscle[row]]} has weight {self.weight[row]} in element "
                    f"{self.element[row]}, expected a number >= 0"
                )
        if isinstance(self.law, Sequence) and len(self.law) != len(self.names):
            raise SceneError(f"{len(self.law)} fibre laws for {len(self.names)} muscles")

    def laws(self) -> tuple[FibreLaw, ...]:
        """One law per name."""
        if isinstance(self.law, Sequence):
            return tuple(self.law)
        return (self.law,) * len(self.names)


@dataclass(frozen=True, eq=False)
class Solid:
    """Total-Lagrangian solid, energy sum over Gauss points of w(I1bar) + U(J) + sum of fibre energies.

    Attributes
    ----------
    materials : tuple of Material
    region : (n_elements,) index into materials, or None if there is one material only.
    muscles : Muscles or None
    prestretch : (n_elements, 3, 3) deformation gradient F0 from the state free of stress to the mesh at
        rest, or None. The whole deformation is F F0; fibre directions remain those in the mesh, and the
        density that of the mesh.

    Raises
    ------
    SceneError
        On compiling: regions do not fit the mesh, a muscle names an element that does not exist, or a
        prestretch is not finite or has det F0 <= 0.
    """

    materials: tuple[Material, ...] = (Material(),)
    region: Index | None = None
    muscles: Muscles | None = None
    prestretch: Array | None = None

    def muscle_names(self) -> tuple[str, ...]:
        """Names of the muscles."""
        return self.muscles.names if self.muscles else ()

    def regions(self, mesh: Mesh) -> Index:
        """Row of every element among the materials (n_elements,), checked."""
        if self.region is None:
            if len(self.materials) != 1:
                raise SceneError(f"{len(self.materials)} materials but no region per element")
            return np.zeros(mesh.n_elements, dtype=np.int64)
        region = np.asarray(self.region, dtype=np.int64)
        if (
            region.shape != (mesh.n_elements,)
            or not ((region >= 0) & (region < len(self.materials))).all()
        ):
            raise SceneError(
                f"region has shape {region.shape} and range {region.min()}..{region.max()}, expected "
                f"({mesh.n_elements},) and 0..{len(self.materials) - 1}"
            )
        return region

    def node_mass(self, mesh: Mesh) -> Array:
        """Lumped mass: each element shares rho V equally among its nodes (n_nodes,) [kg]."""
        density = np.array([m.density for m in self.materials])[self.regions(mesh)]
        share = mesh.volumes() * density
        mass = np.zeros(mesh.n_nodes)
        first = 0
        for block in mesh.blocks:
            n, k = block.nodes.shape
            np.add.at(mass, block.nodes, (share[first : first + n] / k)[:, None])
            first += n
        return mass

    def pair_keys(self, mesh: Mesh) -> Index:
        """All pairs of nodes within an element."""
        return element_pair_keys(mesh)

    def compile(self, layout: Layout) -> "CompiledSolid":
        """Lay out gradients, parameters, fibres and sums."""
        return CompiledSolid(self, layout, self.regions(layout.mesh))


class CompiledSolid:
    """A solid laid out for its scene; the buffers are scratch and carry nothing between calls.

    With `elements`, which must ascend, only those take part; region is theirs, and there are no muscles.
    """

    def __init__(
        self, solid: Solid, layout: Layout, region: Index, elements: Index | None = None
    ) -> None:
        mesh, n = layout.mesh, len(region)
        self._blocks = block_layouts(mesh, elements)
        self._prestretch = None if solid.prestretch is None else _checked(solid.prestretch, mesh)
        if self._prestretch is not None:
            own = self._prestretch if elements is None else self._prestretch[elements]
            self._blocks = prestretched(self._blocks, own)
        self._region, self._elements = region, elements
        materials = solid.materials
        self._isochoric_code = np.array([m.isochoric.code for m in materials])
        self._isochoric_p = np.zeros((len(materials), N_ISOCHORIC))
        for row, m in zip(self._isochoric_p, materials, strict=True):
            row[: len(m.isochoric.parameters())] = m.isochoric.parameters()
        self._bulk_code = np.array([m.bulk.code for m in materials])
        self._kappa = np.array([m.bulk.kappa for m in materials], dtype=np.float64)
        self._lay_out_fibres(solid.muscles if elements is None else None, layout, n)

        self._node_sum = NodeSum(mesh, elements)
        self._matrix_sum = MatrixSum(mesh, layout.pattern, elements)
        self._force = np.zeros((n, 3, kernel.NODES))
        self._energy = np.zeros(n)
        self._least_J = np.zeros(n)
        self._tangent: Array | None = None
        self._no_tangent = np.zeros((1, 1, 1))

    def _lay_out_fibres(self, muscles: Muscles | None, layout: Layout, n: int) -> None:
        if muscles is None:
            self._fibre_start = np.zeros(n + 1, dtype=np.int64)
            self._fibre_muscle = np.zeros(0, dtype=np.int64)
            self._fibre_direction = np.zeros((0, 3))
            self._fibre_weight = np.zeros(0)
            self._muscle_code = np.zeros(0, dtype=np.int64)
            self._muscle_p = np.zeros((0, N_FIBRE))
            return
        if muscles.element.size and not (0 <= muscles.element.min() and muscles.element.max() < n):
            raise SceneError(f"a muscle names element {muscles.element.max()}, expected 0..{n - 1}")
        order, self._fibre_start = grouped(np.asarray(muscles.element, dtype=np.int64), n)
        scene_index = np.array([layout.muscles.index(name) for name in muscles.names])
        self._fibre_muscle = scene_index[muscles.muscle[order]]
        direction = muscles.direction[order]
        if self._prestretch is not None:
            F0 = self._prestretch[muscles.element[order]]
            direction = np.linalg.solve(F0, direction[..., None])[..., 0]
        self._fibre_direction = np.ascontiguousarray(
            direction / np.linalg.norm(direction, axis=1, keepdims=True)
        )
        weight = np.ones(len(order)) if muscles.weight is None else muscles.weight[order]
        self._fibre_weight = np.ascontiguousarray(weight, dtype=np.float64)
        self._muscle_code = np.zeros(len(layout.muscles), dtype=np.int64)
        self._muscle_p = np.zeros((len(layout.muscles), N_FIBRE))
        for index, law in zip(scene_index, muscles.laws(), strict=True):
            self._muscle_code[index] = law.code
            self._muscle_p[index, : len(law.parameters())] = law.parameters()

    def _evaluate(self, q: Array, control: Control, tangent: Array | None) -> Contribution:
        for block in self._blocks:
            rows = block.rows
            kernel.evaluate(
                q,
                block.nodes,
                block.gradient,
                block.volume,
                self._region[rows],
                self._isochoric_code,
                self._isochoric_p,
                self._bulk_code,
                self._kappa,
                self._fibre_start[rows.start : rows.stop + 1],
                self._fibre_muscle,
                self._fibre_direction,
                self._fibre_weight,
                self._muscle_code,
                self._muscle_p,
                control.activation,
                tangent is not None,
                self._force[rows],
                self._energy[rows],
                self._least_J[rows],
                self._no_tangent if tangent is None else tangent[rows],
            )
        worst = int(np.argmin(np.nan_to_num(self._least_J, nan=-np.inf)))
        element = worst if self._elements is None else int(self._elements[worst])
        return Contribution(float(self._energy.sum()), float(self._least_J[worst]), element)

    def add_weighted(
        self, weight: Array, q: Array, control: Control, f: Array, K: Array | None = None
    ) -> Contribution:
        """F -= sum_e weight_e dE_e/dq and, if given, K += sum_e weight_e d2E_e/dq2."""
        tangent = None if K is None else self._tangent_buffer()
        found = self._evaluate(q, control, tangent)
        self._force *= weight[:, None, None]
        self._node_sum.add(self._force, -1.0, f)
        if tangent is not None and K is not None:
            tangent *= weight[:, None, None]
            self._matrix_sum.add(tangent, K)
        return Contribution(dot(weight, self._energy), found.smallest_J, found.element)

    def _tangent_buffer(self) -> Array:
        if self._tangent is None:
            self._tangent = np.zeros(self._matrix_sum.shape)
        return self._tangent

    def add_force(self, q: Array, control: Control, f: Array) -> Contribution:
        """F -= dE/dq, shape (n_nodes, 3) [N]."""
        contribution = self._evaluate(q, control, None)
        self._node_sum.add(self._force, -1.0, f)
        return contribution

    def add_tangent(self, q: Array, control: Control, f: Array, K: Array) -> Contribution:
        """F -= dE/dq and K += d2E/dq2 in the values of the pattern."""
        tangent = self._tangent_buffer()
        contribution = self._evaluate(q, control, tangent)
        self._node_sum.add(self._force, -1.0, f)
        self._matrix_sum.add(tangent, K)
        return contribution

    def smallest_J(self, q: Array) -> tuple[float, int]:
        """Smallest det F over all Gauss points at positions q, and its element."""
        for block in self._blocks:
            kernel.smallest_J(q, block.nodes, block.gradient, self._least_J[block.rows])
        worst = int(np.argmin(np.nan_to_num(self._least_J, nan=-np.inf)))
        return float(self._least_J[worst]), worst


def _checked(prestretch: Array, mesh: Mesh) -> Array:
    """Return the prestretch unless it cannot be one."""
    if prestretch.shape != (mesh.n_elements, 3, 3):
        raise SceneError(
            f"prestretch has shape {prestretch.shape}, expected ({mesh.n_elements}, 3, 3)"
        )
    finite = np.isfinite(prestretch).reshape(mesh.n_elements, 9).all(axis=1)
    good = finite & (np.linalg.det(np.nan_to_num(prestretch, posinf=0.0, neginf=0.0)) > 0.0)
    if not good.all():
        raise SceneError(
            f"prestretch of element {int(np.argmin(good))} is not finite or has det F0 <= 0, expected a "
            "deformation gradient"
        )
    return prestretch
