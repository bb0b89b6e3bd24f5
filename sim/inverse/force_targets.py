"""Targets of forces at the end of a step: of joint rows, such as a bite, and of contacts."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from sim.checks import real_numbers
from sim.errors import SceneError
from sim.inverse.response import Response
from sim.inverse.targets import check_target, interpolated
from sim.joints.contract import REACTIONS
from sim.scene import Index
from sim.state import Array, State
from sim.system import System


class ForceTarget(Protocol):
    """Interface of targets that are forces; `size` as of `Target`."""

    @property
    def size(self) -> float:
        """Unit of the residuals."""
        ...

    def indices(self, system: System) -> Index:
        """Numbers (k,) of the forces in the scene."""
        ...

    def wanted(self, t: float) -> Array:
        """Wanted forces (k,) at a time [s]; NaN where nothing is measured."""
        ...

    def response(self, linear: Response, muscles: Index) -> tuple[Array, Array]:
        """Forces (k,) and derivatives (k, n_muscles) of a step."""
        ...

    def reached(self, system: System, state: State, muscles: Index) -> Array:
        """Forces (k,) at the end of a step."""
        ...


@dataclass(frozen=True, eq=False)
@real_numbers
class RowForceTarget:
    """Forces of named rows of joints at the end of a step [N].

    The force of an inequality is 0 while it is open, so that it has no derivative there: a bite force
    becomes a target when the teeth touch, and positions must bring them together.
    """

    rows: tuple[str, ...]  #: names of rows, as in ``system.rows.names``
    time: Array  #: (n,) ascending [s]
    force: Array  #: (n, k) wanted [N, or N m of a row of a rotation], NaN where it is not measured
    size: float = 1.0  #: standard deviation [N], the unit of the residuals

    def __post_init__(self) -> None:
        check_target("RowForceTarget", self.time, self.force, self.size)
        if self.force.shape[1:] != (len(self.rows),):
            raise SceneError(
                f"RowForceTarget: forces of shape {self.force.shape}, expected (time, {len(self.rows)})"
            )

    def indices(self, system: System) -> Index:
        """Numbers (k,) of the rows; SceneError names one that the scene does not have."""
        names = () if system.rows is None else system.rows.names
        return _numbers(self.rows, names, "RowForceTarget: the scene has no row", "joints")

    def wanted(self, t: float) -> Array:
        """Interpolated forces (k,)."""
        return interpolated(self.time, self.force, t)

    def response(self, linear: Response, muscles: Index) -> tuple[Array, Array]:
        """Forces (k,) of the rows and their derivatives."""
        return linear.force[muscles], linear.force_slope[muscles]

    def reached(self, system: System, state: State, muscles: Index) -> Array:
        """Forces (k,) that the step left."""
        return state.memory[REACTIONS][muscles]


@dataclass(frozen=True, eq=False)
@real_numbers
class ContactForceTarget:
    """Sums of the normal forces of pairings of `ConstraintContact` at the end of a step [N].

    A pairing that is open has neither force nor derivative: positions must close it first. Vertices of
    both surfaces of a pairing have rows, whose forces are added.
    """

    pairings: tuple[str, ...]  #: names, as in ``system.contact.names``
    time: Array  #: (n,) ascending [s]
    force: Array  #: (n, k) wanted [N], NaN where it is not measured
    size: float = 0.1  #: standard deviation [N], the unit of the residuals

    def __post_init__(self) -> None:
        check_target("ContactForceTarget", self.time, self.force, self.size)
        if self.force.shape[1:] != (len(self.pairings),):
            raise SceneError(
                f"ContactForceTarget: forces of shape {self.force.shape}, expected (time, "
                f"{len(self.pairings)})"
            )

    def indices(self, system: System) -> Index:
        """Numbers (k,) of the pairings; SceneError for unknown ones, and for scenes with joints."""
        if system.rows is not None:
            raise SceneError(
                "forces of contact are not targets in a scene with joints, whose rows are solved with "
                "them: leave the joints or the target out"
            )
        names = () if system.contact is None else system.contact.names
        return _numbers(
            self.pairings, names, "ContactForceTarget: the scene has no pairing", "contact"
        )

    def wanted(self, t: float) -> Array:
        """Interpolated forces (k,)."""
        return interpolated(self.time, self.force, t)

    def response(self, linear: Response, muscles: Index) -> tuple[Array, Array]:
        """Forces (k,) of the pairings and their derivatives."""
        return linear.contact_forces[muscles], linear.contact_slope[muscles]

    def reached(self, system: System, state: State, muscles: Index) -> Array:
        """Forces (k,) that the step left."""
        assert system.contact is not None  # `indices` refuses others
        return system.contact.normal_forces(state.memory)[muscles]


def _numbers(wanted: Sequence[str], names: Sequence[str], absent: str, source: str) -> Index:
    """Numbers (k,) of names; SceneError states an absent one and those that exist."""
    for name in wanted:
        if name not in names:
            raise SceneError(
                f"{absent} {name!r}, expected one of "
                f"{', '.join(names) or f'none, because it has no {source}'}"
            )
    return np.array([names.index(name) for name in wanted], dtype=np.int64)
