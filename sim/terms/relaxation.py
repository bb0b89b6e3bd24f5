"""Internal stresses of viscoelastic elements, and their effect over a step."""

from collections.abc import Sequence

import numpy as np

from sim.scene import Index
from sim.state import Array
from sim.terms.material import Material
from sim.terms.tensor_elements import TensorElements


class Relaxation:
    """History of viscoelastic elements: elastic stress and one stress per relaxation time.

    The memory of a step is an array (n_gauss_points, 1 + n_times, 6) [Pa]: S_e, then H_i, both as in
    `sim.laws.Prony`; unused times of a material are zero. `region` (n_elements,) is an index into
    materials.
    """

    def __init__(
        self, elements: Sequence[TensorElements], region: Index, materials: Sequence[Material]
    ) -> None:
        self.elements = tuple(elements)
        self._prony = [m.relaxation for m in materials]
        self._times = max(len(p.tau) for p in self._prony if p is not None)
        self._rows = [region[e.part.element] for e in self.elements]
        self._shapes = [(len(e.part.element), e.n_points) for e in self.elements]
        self._g = np.zeros((len(materials), self._times))
        for row, p in zip(self._g, self._prony, strict=True):
            if p is not None:
                row[: len(p.g)] = p.g
        self._memory: list[Array] = []
        self._e = self._a = np.zeros_like(self._g)

    def begin(self, q: Array, memory: Array | None, h: float) -> None:
        """Set scale and history of the elements for a step of length h [s] from positions q."""
        self._e, self._a = np.zeros_like(self._g), np.zeros_like(self._g)
        for e, a, p in zip(self._e, self._a, self._prony, strict=True):
            if p is not None:
                e[: len(p.g)], a[: len(p.g)] = p.decay(h)
        self._memory = self._divided(memory) if memory is not None else self._at_rest(q)
        for elements, past, rows in zip(self.elements, self._memory, self._rows, strict=True):
            g, e, a = self._g[rows], self._e[rows], self._a[rows]
            elements.scale = 1.0 - g.sum(axis=1) + (g * a).sum(axis=1)
            elements.history = np.einsum("em,epmi->epi", g * e, past[:, :, 1:]) - np.einsum(
                "e,epi->epi", (g * a).sum(axis=1), past[:, :, 0]
            )

    def end(self, q: Array) -> Array:
        """History after a step that ends at positions q."""
        new: list[Array] = []
        for elements, past, rows in zip(self.elements, self._memory, self._rows, strict=True):
            e, a = self._e[rows][:, None, :, None], self._a[rows][:, None, :, None]
            stress = elements.law_stress(q)[:, :, None]
            H: Array = e * past[:, :, 1:] + a * (stress - past[:, :, :1])
            new.append(np.concatenate([stress, H], axis=2).reshape(-1, 1 + self._times, 6))
        return np.concatenate(new)

    def _divided(self, memory: Array) -> list[Array]:
        ends = np.cumsum([n * points for n, points in self._shapes])
        pieces = np.split(memory, ends[:-1])
        return [m.reshape(*s, -1, 6) for m, s in zip(pieces, self._shapes, strict=True)]

    def _at_rest(self, q: Array) -> list[Array]:
        memory: list[Array] = []
        for elements, shape in zip(self.elements, self._shapes, strict=True):
            past = np.zeros((*shape, 1 + self._times, 6))
            past[:, :, 0] = elements.law_stress(q)
            memory.append(past)
        return memory
