"""Stress stiffening: the stiffness of the tissue in a muscle increases with its activation."""

from dataclasses import dataclass, replace

import numpy as np

from sim.assembly import element_pair_keys
from sim.checks import real_numbers, require
from sim.errors import SceneError
from sim.indices import count_of, indices, kept_until_known
from sim.mesh import Mesh
from sim.scene import CompiledTerm, Contribution, Index, Layout, Term
from sim.state import Array, Control
from sim.terms.solid import CompiledSolid, Solid
from sim.terms.volume import CompiledElementVolume


@dataclass(frozen=True, eq=False)
@real_numbers
class Stiffening(Term):
    """Passive energy added to that of the solid, E = sum_e (s_e - 1) E_e with the tissue's own E_e.

    s_e = 1 + (factor - 1) min(1, sum over the muscles m of element e of weight_em activation_m), so
    that all passive moduli of the element are multiplied by s_e, but not the active stress.

    Notes
    -----
    Source: Stavness et al., Lip stiffness enables protrusion and rounding (on and off); Nazari et
    al. 2010, a constitutive law that varies with muscle activation; the linear rule with the factor
    10 is that of the tongue model with line muscles in the same collection. No element is evaluated
    while no muscle is active.
    """

    names: tuple[str, ...]  #: muscles of the scene that stiffen
    element: Index  #: (k,) element index of each row, or a mask (n_elements,)
    muscle: Index  #: (k,) index into names
    tissue: Solid  #: materials and regions of the solid that is stiffened; its muscles are ignored
    factor: float = 10.0  #: of the moduli at full activation [1], at least 1
    weight: Array | None = None  #: (k,) fraction of the element filled by the muscle [1]; None is 1
    #: bulk modulus, also (n_elements,), of the `ElementVolume` of the scene, which is
    #: then stiffened, too [Pa]
    kappa: float | Array | None = None

    def __post_init__(self) -> None:
        place = "stiffening"
        object.__setattr__(self, "element", kept_until_known(place, "element", self.element))
        muscle = indices(place, "muscle", self.muscle, len(self.names))
        object.__setattr__(self, "muscle", muscle)
        k = count_of(self.element)
        for what, rows in (("muscles", self.muscle), ("weights", self.weight)):
            if rows is not None and rows.shape != (k,):
                raise SceneError(
                    f"the sizes of the stiffening arrays differ: {k} elements, {rows.shape} "
                    f"{what}, expected ({k},)"
                )
        require(self, "factor", self.factor, least=1.0)

    def pair_keys(self, mesh: Mesh) -> Index:
        """All pairs of nodes within an element, those of the solid."""
        return element_pair_keys(mesh)

    def compile(self, layout: Layout) -> "CompiledStiffening":
        """Lay out the elements of the muscles."""
        return CompiledStiffening(self, layout)


class CompiledStiffening(CompiledTerm):
    """Compiled stiffening elements."""

    def __init__(self, term: Stiffening, layout: Layout) -> None:
        mesh = layout.mesh
        unknown = [name for name in term.names if name not in layout.muscles]
        if unknown:
            raise SceneError(
                f"stiffening refers to muscle {unknown[0]!r}, which no term of the scene has: expected "
                f"some of {', '.join(layout.muscles)}"
            )
        scene_index = np.array([layout.muscles.index(name) for name in term.names], dtype=np.int64)
        self._element = indices("stiffening", "element", term.element, mesh.n_elements)
        self._n = mesh.n_elements
        self._muscle = scene_index[term.muscle]
        chosen = np.zeros(mesh.n_elements, dtype=bool)
        chosen[self._element] = True
        self._share = np.ones(len(self._element)) if term.weight is None else term.weight
        region = term.tissue.regions(mesh)
        used = [m for i, m in enumerate(term.tissue.materials) if i in region[chosen]]
        if any(material.relaxation is not None for material in used):
            raise SceneError(
                "the tissue that stiffens is viscoelastic, expected elastic materials: pass "
                "a tissue without relaxation to the term, whose addition is then elastic"
            )
        self._solid = CompiledSolid(term.tissue, layout, region, chosen)
        self._volume = None if term.kappa is None else CompiledElementVolume(term.kappa, layout)
        self._factor = term.factor

    def weights(self, control: Control) -> Array:
        """s_e - 1 of every element (n_elements,) [1], zero without an active muscle."""
        drive = self._share * control.activation[self._muscle]
        activation = np.bincount(self._element, drive, self._n)
        return (self._factor - 1.0) * np.minimum(activation, 1.0)

    def add(self, q: Array, control: Control, f: Array, K: Array | None = None) -> Contribution:
        """Subtract dE/dq from f, and add d2E/dq2 to K."""
        weight = self.weights(control)
        if not weight.any():
            return Contribution(0.0)
        evaluation = self._solid.add(q, control, f, K, weight)
        if self._volume is None:
            return evaluation
        pressure = self._volume.add(q, control, f, K, weight)
        return replace(evaluation, energy=evaluation.energy + pressure.energy)
