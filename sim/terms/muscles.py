"""Muscle fibres in the elements of a solid."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from sim._kernels.laws import FibreTable
from sim.assembly import grouped
from sim.checks import real_numbers
from sim.errors import SceneError
from sim.indices import count_of, indices, kept_until_known
from sim.laws import Blemker, FibreLaw
from sim.laws.fibre import N_FIBRE
from sim.scene import Index
from sim.state import Array


@dataclass(frozen=True, eq=False)
@real_numbers
class Muscles:
    """Fibres in elements: one row per element of a muscle; an element may have several."""

    names: tuple[str, ...]
    element: Index  #: (k,) element index of the row, or a mask (n_elements,) of a single row each
    muscle: Index  #: (k,) index into names; every muscle has an element
    direction: Array  #: (k, 3) rest direction a0; normalised on compiling
    #: FibreLaw, or one per name
    law: FibreLaw | Sequence[FibreLaw] = field(default_factory=Blemker)
    #: (k,) fraction of the element filled by the muscle, a factor on its energy [1]; None is 1
    weight: Array | None = None

    def __post_init__(self) -> None:
        place = "a row of muscles"
        object.__setattr__(self, "element", kept_until_known(place, "element", self.element))
        muscle = indices(place, "muscle", self.muscle, len(self.names))
        object.__setattr__(self, "muscle", muscle)
        object.__setattr__(self, "direction", np.asarray(self.direction, dtype=np.float64))
        k = count_of(self.element)
        if self.muscle.shape != (k,) or self.direction.shape != (k, 3):
            raise SceneError(
                f"the sizes of the muscle arrays differ: {k} elements, {self.muscle.shape} muscles, "
                f"{self.direction.shape} directions, expected ({k},) and ({k}, 3)"
            )
        empty = np.setdiff1d(np.arange(len(self.names)), self.muscle)
        if empty.size:
            raise SceneError(f"muscle {self.names[empty[0]]} has no element")
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
                    f"the sizes of the muscle arrays differ: {k} elements, "
                    f"{self.weight.shape} weights, expected ({k},)"
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


def no_fibres(n_elements: int) -> FibreTable:
    """No fibre in any element."""
    index, start = np.zeros(0, dtype=np.int64), np.zeros(n_elements + 1, dtype=np.int64)
    return FibreTable(start, index, np.zeros((0, 3)), np.zeros(0), index, np.zeros((0, N_FIBRE)))


def fibre_table(
    muscles: Muscles, n_elements: int, scene_muscles: tuple[str, ...], F0: Array | None
) -> FibreTable:
    """Group the rows of muscles by element.

    The directions in the mesh are transformed to the state before the prestretch F0 (n_elements, 3,
    3), if given.
    """
    n = n_elements
    element = indices("a muscle", "element", muscles.element, n)
    order, start = grouped(element, n)
    scene_index = np.array([scene_muscles.index(name) for name in muscles.names])
    direction = muscles.direction[order]
    if F0 is not None:
        own = F0[element[order]]
        direction = np.linalg.solve(own, direction[..., None])[..., 0]
    direction = direction / np.linalg.norm(direction, axis=1, keepdims=True)
    weight = np.ones(len(order)) if muscles.weight is None else muscles.weight[order]
    code = np.zeros(len(scene_muscles), dtype=np.int64)
    p = np.zeros((len(scene_muscles), N_FIBRE))
    for index, law in zip(scene_index, muscles.laws(), strict=True):
        code[index] = law.code
        p[index, : len(law.parameters())] = law.parameters()
    return FibreTable(
        start,
        scene_index[muscles.muscle[order]],
        np.ascontiguousarray(direction),
        np.ascontiguousarray(weight, dtype=np.float64),
        code,
        p,
    )
