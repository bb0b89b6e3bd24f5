"""Elements with laws of the strain tensor, for the second element loop."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from sim._kernels import tensor_solid as kernel
from sim._kernels.element import Part
from sim._kernels.scatter import Places
from sim._kernels.tensor_solid import TensorLawTable
from sim.errors import SceneError
from sim.scene import Index
from sim.state import Array
from sim.terms.material import Material


def tensor_laws(materials: Sequence[Material], region: Index) -> TensorLawTable:
    """Tabulate the laws of materials; rows of those of the first element loop are unused."""
    forms = [m.tensor_form or (0, 0, ()) for m in materials]
    p = np.zeros((len(materials), max(len(form[2]) for form in forms)))
    for row, form in zip(p, forms, strict=True):
        row[: len(form[2])] = form[2]
    return TensorLawTable(
        region,
        np.array([form[0] for form in forms]),
        np.array([form[1] for form in forms]),
        p,
        np.array([m.bulk_code for m in materials]),
        np.array([m.kappa for m in materials], dtype=np.float64),
    )


class TensorElements:
    """Elements of one part under laws of the strain tensor.

    `axes` (n_elements, 3, 3) have the material axes of all elements in the columns.
    """

    def __init__(
        self, part: Part, places: Places, axes: Array | None, laws: TensorLawTable
    ) -> None:
        n = len(part.element)
        self.part, self._places, self._laws = part, places, laws
        chosen = np.broadcast_to(np.eye(3), (n, 3, 3)) if axes is None else axes[part.element]
        self._axes = np.ascontiguousarray(chosen)
        self.scale = np.ones(n)
        """Factor on the stress of the law, one per element."""
        self.history = np.zeros((0, 0, 0))
        """Constant stress over a step (n, n_points, 6) [Pa], or no rows."""

    @property
    def n_points(self) -> int:
        """Quadrature points of an element."""
        return len(self.part.slope) // 3

    def evaluate(self, q: Array, *rest: Any) -> None:
        """Add forces and stiffness, and write energies into the array of all elements.

        rest : fibres, activation, weights, True to compute the stiffness, and the four results.
        """
        own = self._places, self._axes, self.scale, self.history, self._laws
        kernel.evaluate(q, self.part, *own, *rest)

    def law_stress(self, q: Array) -> Array:
        """Elastic stress of the law alone at every Gauss point (n, n_points, 6) [Pa]."""
        out = np.empty((len(self.part.element), self.n_points, 6))
        kernel.law_stress(q, self.part, self._axes, self._laws, out)
        return out


def rotations(axes: Array, wanted: Index) -> Array:
    """Proper orthogonal axes nearest to those given (n_elements, 3, 3), at the chosen elements.

    Raises SceneError if axes are far from orthonormal or left-handed.
    """
    matrices = axes[wanted]
    finite = np.isfinite(np.sum(matrices, axis=(1, 2)))
    U, _, Vt = np.linalg.svd(np.where(finite[:, None, None], matrices, np.eye(3)))
    nearest = U @ Vt
    off = np.abs(nearest - matrices).max(axis=(1, 2))
    good = finite & (off < 1e-2) & (np.linalg.det(nearest) > 0.0)
    if not good.all():
        bad = int(np.argmin(good))
        raise SceneError(
            f"the material axes of element {wanted[bad]} are {matrices[bad].tolist()}, expected three "
            "orthonormal, right-handed columns"
        )
    out = np.broadcast_to(np.eye(3), axes.shape).copy()
    out[wanted] = nearest
    return out
