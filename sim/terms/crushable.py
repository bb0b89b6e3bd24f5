"""A morsel between a point and a plane: it resists compression until it is crushed."""

from dataclasses import dataclass

import numpy as np

from sim.checks import real_numbers, require
from sim.errors import SceneError
from sim.indices import index
from sim.multibody import PointForces
from sim.scene import CompiledTerm, Contribution, Index, Layout, Term
from sim.state import Array, Control

GONE = 1e-6  #: distance from the plane at which a morsel is crushed [m]


@dataclass(frozen=True, eq=False)
@real_numbers
class Crushable(Term):
    """Force F = force_max (1 - d/diameter) - damping d' on a point at the distance d from a plane.

    It acts along the normal for 0 < d < diameter. If d falls below 1 um, the morsel is crushed, and the
    force is zero until d exceeds the diameter, at which a new morsel is present. Initially it is
    crushed.

    Raises
    ------
    SceneError
        A parameter is out of range, or, on compiling, the node does not exist.

    Notes
    -----
    Source: the food bolus of Hannam et al. 2008, J. Biomech. 41, 1069. The unit of its damping of 0.01
    is not stated; the forces stored with the published model are those of N s/mm
    (docs/jaw_published.md).
    """

    node: int  #: node or point
    #: (3,) of the plane, fixed in space [m], [1]; the normal points to the point
    origin: Array
    normal: Array
    diameter: float = 10e-3  #: [m]
    force_max: float = 35.0  #: [N]
    damping: float = 10.0  #: [N s/m]

    def __post_init__(self) -> None:
        object.__setattr__(self, "node", index("Crushable", "node", self.node, None))
        require(self, "diameter", self.diameter, above=GONE)
        require(self, "force_max", self.force_max, least=0.0)
        require(self, "damping", self.damping, least=0.0)
        if not abs(float(np.linalg.norm(self.normal)) - 1.0) < 1e-6:
            raise SceneError(f"Crushable: normal {self.normal!r} has no unit length: normalise it")

    @property
    def label(self) -> str:
        """Name in the memory of states, which does not depend on the order of terms."""
        return f"Crushable at {self.node}"

    def compile(self, layout: Layout) -> "CompiledCrushable":
        """Find the place in the matrix."""
        n = layout.mesh.n_nodes
        key = np.array([index("Crushable", "node", self.node, n) * (n + 1)])
        target = np.asarray(layout.pattern.target[layout.pattern.pair_index(key)]).ravel()
        return CompiledCrushable(self, target.astype(np.int64))


class CompiledCrushable(CompiledTerm):
    """Compiled morsel, without force outside a step."""

    def __init__(self, term: Crushable, target: Index, whole: bool = False) -> None:
        self._term, self._target, self._whole = term, target, whole

    def _distance(self, q: Array) -> float:
        return float((q[self._term.node] - self._term.origin) @ self._term.normal)

    def during(self, q: Array, memory: Array | None, h: float) -> "CrushableInStep":
        """Morsel over a step, intact or crushed according to the previous positions."""
        whole = memory is not None and bool(memory[0])
        return CrushableInStep(self._term, self._target, whole)

    def add_to(self, forces: PointForces) -> None:
        """Add the morsel."""
        term = self._term
        plane = [*term.origin, *term.normal, term.diameter, term.force_max, term.damping]
        forces.morsels.append((term.node, np.array(plane)))

    def add(self, q: Array, control: Control, f: Array, K: Array | None = None) -> Contribution:
        """Add the force and the stiffness along the normal."""
        term, d = self._term, self._distance(q)
        if not self._whole or not d < term.diameter:
            return Contribution(0.0)
        k, left = term.force_max / term.diameter, term.diameter - d
        f[term.node] += k * left * term.normal
        if K is not None:
            block, stored = k * np.outer(term.normal, term.normal).ravel(), self._target >= 0
            np.add.at(K, self._target[stored], block[stored])
        return Contribution(0.5 * k * left * left)

    def add_damping(self, q: Array, control: Control, D: Array) -> None:
        """Add the damping along the normal."""
        term = self._term
        if self._whole and self._distance(q) < term.diameter:
            block = term.damping * np.outer(term.normal, term.normal).ravel()
            stored = self._target >= 0
            np.add.at(D, self._target[stored], block[stored])


class CrushableInStep(CompiledCrushable):
    """Morsel over one step."""

    def remember(self, q: Array) -> Array:
        """1 if it is intact after the step."""
        d = self._distance(q)
        whole = d > self._term.diameter or (self._whole and d >= GONE)
        return np.array([float(whole)])
