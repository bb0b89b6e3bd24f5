"""Springs and dampers along lines between nodes or points inside elements."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.checks import real_numbers
from sim.errors import SceneError
from sim.laws.line import ConstantForce
from sim.mesh import Mesh
from sim.scene import Index, Layout, Term
from sim.state import Array
from sim.terms.line_muscle import CompiledLineMuscles, LineMuscles
from sim.terms.strands import LineFibre


@dataclass(frozen=True, eq=False)
@real_numbers
class AxialSprings(Term):
    """Springs and dampers along polylines, E = stiffness/2 (L - L_rest)^2 and f = -damping dL/dt.

    Raises
    ------
    SceneError
        As `LineMuscles`, or the number of rest lengths differs from that of the paths.
    """

    #: sequence of arrays, nodes (k,) or rest positions (k, 3) [m] as of `LineFibre`
    paths: Sequence[NDArray[Any]]
    #: of each [N/m], [N s/m]
    stiffness: float
    damping: float = 0.0
    #: lengths (n,) without force [m]; by default those of the scene at rest
    rest: Array | None = None

    def __post_init__(self) -> None:
        if self.rest is not None and np.shape(self.rest) != (len(self.paths),):
            raise SceneError(
                f"AxialSprings: {np.shape(self.rest)} rest lengths for {len(self.paths)}"
            )
        _ = self._lines

    @property
    def _lines(self) -> LineMuscles:
        fibres = tuple(LineFibre(0, path) for path in self.paths)
        slack = ConstantForce(0.0)
        return LineMuscles(("spring",), fibres, slack, self.stiffness, self.damping)

    def pair_keys(self, mesh: Mesh) -> Index:
        """Node pairs of each path."""
        return self._lines.pair_keys(mesh)

    def compile(self, layout: Layout) -> CompiledLineMuscles:
        """Lay the paths out."""
        compiled = self._lines.compile(replace(layout, muscles=()))
        if self.rest is not None:
            compiled.table = compiled.table._replace(rest=np.asarray(self.rest, dtype=np.float64))
        return compiled
