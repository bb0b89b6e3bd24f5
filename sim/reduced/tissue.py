"""Reduced solid and its damping as parts of a scene whose points carry the coordinates."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from sim._kernels.element import NODES, Part
from sim._kernels.lanes import LANES
from sim._kernels.reduced import VECTORS, Elements, Linear, Scratch, forces
from sim._kernels.reduced_element import OF_FIBRE, STORED_ROWS
from sim._kernels.solid import SOLID_ROWS
from sim.elements import ELEMENT_TYPES
from sim.errors import SceneError
from sim.linear.contract import symmetric_product
from sim.mesh import Mesh
from sim.scene import CompiledTerm, Contribution, Index, Layout, Stiffness, Term
from sim.state import Array, Control
from sim.system import System
from sim.terms.load import Gravity
from sim.terms.solid import CompiledSolid

LENGTHS = 4  #: number of lengths of steps whose matrices are kept, such as those of previews


def solid_of(system: System) -> CompiledSolid:
    """The solid of a scene whose other forces are constant.

    Raises SceneError if the scene has another term, a constraint, a body or a joint.
    """
    solids = [term for term in system.terms if isinstance(term, CompiledSolid)]
    others = [t for t in system.scene.terms if not isinstance(t, Gravity)]
    names = [type(t).__name__ for t in (*others, *system.scene.constraints, *system.scene.joints)]
    if len(solids) != 1 or len(names) != 1 or system.scene.bodies:
        raise SceneError(
            f"a reduced model supports one Solid and Gravity, the scene has {', '.join(names)}: use "
            "pointwise incompressibility without contact, walls and bodies, or full order"
        )
    return solids[0]


def projected_matrix(system: System, values: Array, modes: Array) -> Array:
    """Phi' K Phi (n, n) of values K on the pattern of a system, for modes (3 n_nodes, n)."""
    free = np.ascontiguousarray(modes[system.free])
    columns = [symmetric_product(system.point_pattern, values, mode) for mode in free.T]
    projected: Array = np.ascontiguousarray(np.array(columns) @ free)
    return projected


@dataclass(frozen=True, eq=False)
class ReducedSolid(Term):
    """Solid with few coordinates: three for every point of the scene, of unit mass."""

    whole: System  #: at full order, of one solid and gravity
    rest: Array  #: (n_nodes, 3) positions where all coordinates are zero [m]
    modes: Array  #: (3 n_nodes, n), orthonormal in the mass, of which the first r move
    weight: Array  #: (n_elements,) factors on the energies of the elements
    load: Array  #: (n,) constant generalised force [N kg^-1/2]
    #: (n, n) damping [1/s], and stiffness at rest [1/s^2]
    damping: Array
    stiffness: Array

    def pair_keys(self, mesh: Mesh) -> Index:
        """All pairs of points."""
        a, b = np.triu_indices(mesh.n_nodes)
        return (a * mesh.n_nodes + b).astype(np.int64)

    def node_mass(self, mesh: Mesh) -> Array:
        """Unit mass, since the modes are orthonormal in the mass."""
        return np.ones(mesh.n_nodes)

    def muscle_names(self) -> tuple[str, ...]:
        """Names of the muscles."""
        return self.whole.muscles

    def compile(self, layout: Layout) -> "CompiledReducedSolid":
        """Lay out the weighted elements."""
        return CompiledReducedSolid(self, 3 * layout.mesh.n_nodes)

    @cached_property
    def mass(self) -> float:
        """Mass of the tissue [kg]."""
        return float(self.whole.node_mass.sum())


def _some(part: Part, own: Index, number: Index) -> Part:
    """Some elements of a part, with the numbers of their nodes, in one chunk."""
    return part._replace(
        element=part.element[own],
        nodes=np.ascontiguousarray(number[part.nodes[own]]),
        inverse=np.ascontiguousarray(part.inverse.reshape(-1, 9, LANES)[own]).reshape(-1, LANES),
        volume=np.ascontiguousarray(part.volume[own]),
        chunk=np.array([0, len(own)]),
        colour=np.array([0, 1]),
    )


def elements_of(solid: ReducedSolid) -> Elements:
    """Weighted elements of a reduced solid, for the kernels."""
    compiled = solid_of(solid.whole)
    elements, weight = compiled.pointwise, solid.weight
    chosen = [np.flatnonzero(weight[part.element] > 0.0) for part in elements.parts]
    pairs = list(zip(elements.parts, chosen, strict=True))
    used = np.concatenate([part.nodes[own] for part, own in pairs])
    still = np.abs(solid.modes).reshape(len(solid.rest), -1).max(axis=1) == 0.0
    # nodes in the order of their first element, and those that do not move behind them
    nodes, first = np.unique(used, return_index=True)
    nodes = nodes[np.argsort(first + len(used) * NODES * still[nodes])]
    number = np.zeros(len(solid.rest), dtype=np.int64)
    number[nodes] = np.arange(len(nodes))
    m = len(nodes) - np.count_nonzero(still[nodes])
    parts = [_some(part, own, number) for part, own in pairs]
    empty = _some(elements.parts[0], np.zeros(0, dtype=np.int64), number)
    n = solid.modes.shape[1]
    rows = np.zeros((m, 3, LANES * -(-n // LANES)), dtype=np.float32)
    rows[..., :n] = solid.modes.reshape(len(solid.rest), 3, n)[nodes[:m]]
    return Elements(
        # always as many parts as there are types of elements, so that kernels are compiled once
        tuple(parts + [empty] * (len(ELEMENT_TYPES) - len(parts))),
        elements.laws,
        elements.fibres,
        np.ascontiguousarray(weight, dtype=np.float64),
        np.ascontiguousarray(solid.rest[nodes]),
        rows.reshape(-1, LANES),
        int(m),
    )


class CompiledReducedSolid(CompiledTerm):
    """Compiled reduced solid; the buffers contain no state between calls."""

    def __init__(self, solid: ReducedSolid, r: int) -> None:
        self.solid, self.r = solid, r
        self.elements = elements_of(solid)
        n, k, fibres = len(solid.load), len(self.elements.rest), self.elements.fibres
        blocks, own = -(-n // LANES), solid.weight > 0.0
        kept = STORED_ROWS * np.count_nonzero(own) + OF_FIBRE * int(
            np.diff(fibres.start)[own].sum()
        )
        self.scratch = Scratch(
            q=np.zeros((k, 3)),
            f=np.zeros((k, 3)),
            x=np.zeros((NODES, 3)),
            w=np.zeros((SOLID_ROWS, LANES)),
            kept=np.zeros((kept, LANES), dtype=np.float32),
            acts=np.zeros(len(fibres.muscle), dtype=np.bool_),
            y=np.zeros((blocks, LANES)),
            force=np.zeros((blocks, LANES)),
            start=np.zeros(n),
            change=np.zeros(n),
            stiff=np.zeros(n),
            vectors=np.zeros((VECTORS, self.r)),
        )
        self.linear = Linear(solid.load, solid.damping, solid.stiffness, float(np.sqrt(solid.mass)))
        self._upper = np.triu_indices(r)
        self._for_step: dict[float, tuple[Array, Array]] = {}

    def inverses(self, h: float) -> tuple[Array, Array]:
        """Inverses of 1 + h D + h^2 K at rest, of the coordinates that move and of the others."""
        h = float(f"{h:.9g}")  # steps that differ by rounding are the same
        if h not in self._for_step:
            r, s = self.r, self.solid
            A = np.eye(len(s.load)) + h * s.damping + h * h * s.stiffness
            pair = (np.linalg.inv(A[own, own]) for own in (slice(r), slice(r, None)))
            moving, omitted = (np.ascontiguousarray(0.5 * (B + B.T)) for B in pair)
            while len(self._for_step) >= LENGTHS:
                self._for_step.pop(next(iter(self._for_step)))
            self._for_step[h] = moving, omitted
        return self._for_step[h]

    def add(self, q: Array, control: Control, f: Array, K: Array | None = None) -> Contribution:
        """F += force at coordinates q (n_points, 3), and K += stiffness."""
        y, scratch, load = q.reshape(-1), self.scratch, self.solid.load[: self.r]
        every = scratch.y.reshape(-1)
        every[:], every[: self.r] = 0.0, y
        energy, J, element = forces(self.elements, control.activation, scratch)
        f += (load + scratch.force.reshape(-1)[: self.r]).reshape(-1, 3)
        if K is not None:
            np.add(K, self.tangent(y, control)[: self.r, : self.r][self._upper], out=K)
        return Contribution(energy - float(load @ y), J, element)

    def tangent(self, y: Array, control: Control) -> Array:
        """Stiffness (n, n) of all coordinates at coordinates y (r,) [1/s^2]."""
        s, values = self.solid, np.zeros(self.solid.whole.pattern.nnz)
        q = s.rest + (s.modes[:, : self.r] @ y).reshape(-1, 3)
        solid_of(s.whole).add(q, control, np.zeros_like(q), values, s.weight)
        return projected_matrix(s.whole, values, s.modes)

    def smallest_J(self, q: Array) -> tuple[float, int]:
        """Smallest det F of the weighted elements, and its element."""
        every = self.scratch.y.reshape(-1)
        every[:], every[: self.r] = 0.0, q.reshape(-1)
        _, J, element = forces(self.elements, np.zeros(len(self.solid.whole.muscles)), self.scratch)
        return J, element


@dataclass(frozen=True, eq=False)
class ReducedDamping:
    """Constant damping matrix over the coordinates (r, r) [1/s]."""

    matrix: Array

    def compile(self, layout: Layout, stiffness: Stiffness) -> "CompiledReducedDamping":
        """Values on the pattern."""
        upper = np.triu_indices(len(self.matrix))
        return CompiledReducedDamping(self.matrix[upper], layout.mesh.X)


@dataclass(frozen=True, eq=False)
class CompiledReducedDamping:
    """Compiled constant damping."""

    values: Array
    rest: Array
    beta: float = 0.0

    def __call__(self, q: Array, control: Control, K: Array | None = None) -> Array:
        """Return the values."""
        return self.values
