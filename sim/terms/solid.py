"""Deformable solid: passive tissue and muscle fibres in one element loop."""

from copy import copy
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sim._kernels import solid as kernel
from sim._kernels.element import Part
from sim._kernels.laws import FibreTable, LawTable
from sim._kernels.scatter import Places
from sim.assembly import element_pair_keys, parts_of, places_of, require_stress_free
from sim.checks import real_numbers
from sim.errors import SceneError
from sim.indices import index_rows
from sim.laws.isochoric import N_ISOCHORIC
from sim.mesh import Mesh
from sim.scene import CompiledTerm, Contribution, Index, Layout, Term
from sim.state import Array, Control
from sim.terms.material import Material
from sim.terms.muscles import Muscles, fibre_table, no_fibres
from sim.terms.relaxation import Relaxation
from sim.terms.tensor_elements import TensorElements, rotations, tensor_laws


@dataclass(frozen=True, eq=False)
@real_numbers
class Solid(Term):
    """Total-Lagrangian solid, energy sum over Gauss points of w + U(J) + sum of fibre energies."""

    materials: tuple[Material, ...] = (Material(),)
    #: (n_elements,) index into materials, or None if there is one material only
    region: Index | None = None
    muscles: Muscles | None = None
    #: (n_elements, 3, 3) deformation gradient F0 from the stress-free state to the mesh at rest, or
    #: None. The total deformation is F F0; fibre directions and density are those of the mesh
    prestretch: Array | None = None
    #: (n_elements, NODES, 3) stress-free positions of the nodes of every element, each for itself, in
    #: place of a prestretch, or None; slots beyond the nodes of an element are not read. They may
    #: differ between neighbours, as on both sides of a suture [m]
    stress_free: Array | None = None
    #: (n_elements, 3, 3) orthonormal material axes in the mesh, one per column, or None if no law
    #: requires them. A prestretch changes them only by its rotation
    axes: Array | None = None

    def muscle_names(self) -> tuple[str, ...]:
        """Names of the muscles."""
        return self.muscles.names if self.muscles else ()

    def regions(self, mesh: Mesh) -> Index:
        """Row of every element among the materials (n_elements,), checked."""
        if self.region is None:
            if len(self.materials) != 1:
                raise SceneError(f"{len(self.materials)} materials but no region per element")
            return np.zeros(mesh.n_elements, dtype=np.int64)
        region = index_rows("the region of an element", "material", self.region, None, None)
        if region.shape != (mesh.n_elements,):
            raise SceneError(
                f"region has shape {region.shape}, expected ({mesh.n_elements},), a material per element"
            )
        return index_rows("the region of an element", "material", region, len(self.materials), None)

    def node_mass(self, mesh: Mesh) -> Array:
        """Lumped mass: rho V of each element is distributed equally among its nodes (n_nodes,) [kg]."""
        density = np.array([m.density for m in self.materials])[self.regions(mesh)]
        share = self._volumes(mesh) * density
        mass = np.zeros(mesh.n_nodes)
        first = 0
        for block in mesh.blocks:
            n, k = block.nodes.shape
            np.add.at(mass, block.nodes, (share[first : first + n] / k)[:, None])
            first += n
        return mass

    def _volumes(self, mesh: Mesh) -> Array:
        """Volume of every element in the mesh, or in its stress-free state if that is given [m^3]."""
        if self.stress_free is None:
            return mesh.volumes()
        _stretch_at_centres(self, mesh)  # refuses invalid positions
        first, volumes = 0, [np.empty(0)]
        for block in mesh.blocks:
            n, kind = len(block.nodes), block.kind
            corners = self.stress_free[first : first + n, : kind.n_nodes]
            volumes.append(
                np.linalg.det(np.einsum("eai,paj->epij", corners, kind.dN)) @ kind.weights
            )
            first += n
        return np.concatenate(volumes)

    def pair_keys(self, mesh: Mesh) -> Index:
        """All pairs of nodes within an element."""
        return element_pair_keys(mesh)

    def compile(self, layout: Layout) -> "CompiledSolid":
        """Lay out gradients, parameters, fibres and sums."""
        region = self.regions(layout.mesh)
        remembers = np.array([m.relaxation is not None for m in self.materials])[region].any()
        return (RelaxingSolid if remembers else CompiledSolid)(self, layout, region)


@dataclass(frozen=True, eq=False)
class Pointwise:
    """Tables of a solid whose energy is a sum over points, as of `sim._kernels.solid.evaluate`."""

    parts: tuple[Part, ...]
    places: list[Places]
    laws: LawTable
    fibres: FibreTable


class CompiledSolid(CompiledTerm):
    """Compiled solid; the buffers contain no state between calls.

    With `chosen` (n_elements,) only those elements are included, without muscles.
    """

    def __init__(
        self, solid: Solid, layout: Layout, region: Index, chosen: NDArray[np.bool_] | None = None
    ) -> None:
        mesh, n = layout.mesh, len(region)
        if solid.stress_free is not None:
            solid = replace(solid, prestretch=_stretch_at_centres(solid, mesh))
        self._prestretch = None if solid.prestretch is None else _checked(solid.prestretch, mesh)
        materials = solid.materials
        p = np.zeros((len(materials), N_ISOCHORIC))
        for row, m in zip(p, materials, strict=True):
            if m.tensor_form is None:
                row[: len(m.law.parameters())] = m.law.parameters()
        code, bulk_code = np.array([[m.law.code, m.bulk_code] for m in materials]).T.copy()
        kappa = np.array([m.kappa for m in materials], dtype=np.float64)
        self._laws = LawTable(region, code, p, bulk_code, kappa)
        self._lay_out_parts(solid, layout, np.ones(n, dtype=bool) if chosen is None else chosen)
        muscles = solid.muscles if chosen is None else None
        self._fibres = (
            no_fibres(n)
            if muscles is None
            else fibre_table(muscles, n, layout.muscles, self._prestretch)
        )
        self._energy = np.zeros(n)
        self._least_J = np.full(n, np.inf)
        self._even, self._no_values = np.zeros(0), np.zeros(0)

    def _lay_out_parts(self, solid: Solid, layout: Layout, chosen: NDArray[np.bool_]) -> None:
        """Divide the elements by the element loop of their law."""
        mesh, materials, region = layout.mesh, solid.materials, self._laws.region
        axes = _axes(solid, mesh, region, chosen)
        tensor = np.array([m.tensor_form is not None for m in materials])[region]
        remembers = np.array([m.relaxation is not None for m in materials])[region]
        free = solid.stress_free
        F0 = self._prestretch if free is None else None
        self._scalar_parts = parts_of(mesh, chosen & ~tensor, prestretch=F0, stress_free=free)
        self._scalar_places = [places_of(mesh, p, layout.pattern) for p in self._scalar_parts]
        laws = tensor_laws(materials, region)
        self._elastic, self._relaxing = (
            tuple(
                TensorElements(part, places_of(mesh, part, layout.pattern), axes, laws)
                for part in parts_of(mesh, own, prestretch=F0, stress_free=free)
            )
            for own in (chosen & tensor & ~remembers, chosen & tensor & remembers)
        )

    def add(
        self,
        q: Array,
        control: Control,
        f: Array,
        K: Array | None = None,
        weight: Array | None = None,
    ) -> Contribution:
        """F -= dE/dq, shape (n_nodes, 3) [N], and K += d2E/dq2 in the values of the pattern.

        weight (n_elements,) [1] multiplies the energies; elements of weight zero are skipped.
        """
        rest = (
            self._fibres,
            control.activation,
            self._even if weight is None else weight,
            K is not None,
            f,
            self._energy,
            self._least_J,
            self._no_values if K is None else K,
        )
        for part, places in zip(self._scalar_parts, self._scalar_places, strict=True):
            kernel.evaluate(q, part, places, self._laws, *rest)
        for elements in (*self._elastic, *self._relaxing):
            elements.evaluate(q, *rest)
        return Contribution(float(self._energy.sum()), *self._smallest_J())

    @property
    def pointwise(self) -> "Pointwise":
        """Points and laws of the solid; SceneError if a law is of another family."""
        if self._elastic or self._relaxing:
            raise SceneError(
                "a reduced solid supports laws of the invariants I1, J and fibre stretch alone: "
                "simulate tissues with other laws at full order"
            )
        return Pointwise(self._scalar_parts, self._scalar_places, self._laws, self._fibres)

    def _smallest_J(self) -> tuple[float, int]:
        worst = int(np.argmin(np.nan_to_num(self._least_J, nan=-np.inf, posinf=np.inf)))
        return float(self._least_J[worst]), worst

    def nodes_of_muscle(self, muscle: int) -> Index:
        """Nodes on which the fibres of a muscle of the scene act."""
        fibres = self._fibres
        owner = np.repeat(np.arange(len(fibres.start) - 1), np.diff(fibres.start))
        own = np.unique(owner[fibres.muscle == muscle])
        tensor = (elements.part for elements in (*self._elastic, *self._relaxing))
        parts = (*self._scalar_parts, *tensor)
        nodes = [part.nodes[np.isin(part.element, own)].ravel() for part in parts]
        return np.unique(np.concatenate([np.zeros(0, dtype=np.int64), *nodes]))

    def smallest_J(self, q: Array) -> tuple[float, int]:
        """Smallest det F over all Gauss points at positions q, and its element."""
        tensor = (elements.part for elements in (*self._elastic, *self._relaxing))
        for part in (*self._scalar_parts, *tensor):
            kernel.smallest_J(q, part, self._least_J)
        return self._smallest_J()


class RelaxingSolid(CompiledSolid):
    """Solid with viscoelastic elements, fully relaxed except during a step."""

    def __init__(self, solid: Solid, layout: Layout, region: Index) -> None:
        super().__init__(solid, layout, region)
        self._materials = solid.materials
        self._relaxation = Relaxation(self._relaxing, region, solid.materials)
        self._relaxation.begin(layout.mesh.X, None, np.inf)

    def during(self, q: Array, memory: Array | None, h: float) -> "RelaxingSolid":
        """Solid over one step of length h [s]; it shares the scratch buffers of this one."""
        step = copy(self)
        step._relaxing = tuple(map(copy, self._relaxing))
        step._relaxation = Relaxation(step._relaxing, self._laws.region, self._materials)
        step._relaxation.begin(q, memory, h)
        return step

    def remember(self, q: Array) -> Array:
        """Elastic and internal stresses at the end of the step, at positions q."""
        return self._relaxation.end(q)


def _axes(solid: Solid, mesh: Mesh, region: Index, chosen: NDArray[np.bool_]) -> Array | None:
    """Axes before the prestretch (n_elements, 3, 3); None if no law of chosen elements requires them."""
    needs = np.flatnonzero(np.array([m.needs_axes for m in solid.materials])[region] & chosen)
    if len(needs) == 0:
        return None
    shape = (mesh.n_elements, 3, 3)
    if solid.axes is None or solid.axes.shape != shape:
        axes_shape = None if solid.axes is None else solid.axes.shape
        raise SceneError(
            f"material axes have shape {axes_shape}, expected {shape}: a law of the solid depends on "
            "them"
        )
    axes = rotations(solid.axes, needs)
    if solid.prestretch is None:
        return axes
    U, _, Vt = np.linalg.svd(solid.prestretch)
    return (U @ Vt).transpose(0, 2, 1) @ axes


def _stretch_at_centres(solid: Solid, mesh: Mesh) -> Array:
    """F0 (n_elements, 3, 3) at the centre of every element, from its stress-free positions.

    It transforms the directions of fibres and material axes, which are those of the mesh.
    """
    free = solid.stress_free
    assert free is not None
    if solid.prestretch is not None:
        raise SceneError(
            "the solid has stress_free positions and a prestretch, expected one of them: the positions "
            "contain the stretch"
        )
    require_stress_free(free, mesh)
    F0 = np.empty((mesh.n_elements, 3, 3))
    first = 0
    for block in mesh.blocks:
        own = slice(first, first + len(block.nodes))
        corners = free[own, : block.kind.n_nodes]
        dN = block.kind.dN.mean(axis=0)
        before = np.einsum("eai,aj->eij", corners, dN)
        F0[own] = np.einsum("eai,aj->eij", mesh.X[block.nodes], dN) @ np.linalg.inv(before)
        first += len(block.nodes)
    return F0


def _checked(prestretch: Array, mesh: Mesh) -> Array:
    """Check the prestretch."""
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
