"""Targets of the forces of joint rows at the end of a step, such as those of bite and joints."""

from dataclasses import dataclass

import numpy as np

from sim.errors import SceneError
from sim.inverse.targets import check_target, interpolated
from sim.scene import Index
from sim.state import Array
from sim.system import System


@dataclass(frozen=True, eq=False)
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
        for name in self.rows:
            if name not in names:
                raise SceneError(
                    f"RowForceTarget: the scene has no row {name!r}, expected one of "
                    f"{', '.join(names) or 'none, because it has no joints'}"
                )
        return np.array([names.index(name) for name in self.rows], dtype=np.int64)

    def wanted(self, t: float) -> Array:
        """Interpolated forces (k,)."""
        return interpolated(self.time, self.force, t)
