"""Probe of lips in contact: depths, gaps, opening and oscillations."""

import time

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from emgface.face.lip_shape import lip_opening
from emgface.face.lips import lip_surface
from emgface.face.parts import LIPS
from emgface.face.penetration import Penetration
from sim import State
from sim.probes import Contacts, Variable
from sim.state import Control, StepReport
from sim.system import System

Floats = NDArray[np.float64]


def to_and_fro(path: Floats) -> float:
    """Largest back-and-forth motion of a coordinate in a path, shape (times, points, 3) [m].

    For each coordinate it is the smaller of the sums of its positive and of its negative
    increments: 0 for monotone motion, and n times the amplitude for n oscillations.
    """
    moves = np.diff(path, axis=0)
    up, down = (np.maximum(sign * moves, 0.0).sum(axis=0) for sign in (1.0, -1.0))
    return float(np.minimum(up, down).max(initial=0.0))


class LipProbe:
    """Depths, smallest gap computed by contact and opening [m], speed of the fastest lip node [m/s].

    `period` is the time between measurements of the depths, which cost as much as a step; NaN in
    between [s]. `seconds` is the processor time of the probe itself [s], and `path` contains the
    positions (n, 3) of the lip nodes [m] by time [s].
    """

    def __init__(self, face: xr.Dataset, penetration: Penetration, period: float) -> None:
        self._depth, self._period = penetration, period
        self._nodes = np.unique(np.concatenate([lip_surface(face, lip) for lip in LIPS]))
        self._face = face[["lip_opening_node"]]
        self.seconds = 0.0
        self.path: dict[float, Floats] = {}

    def variables(self) -> tuple[Variable, ...]:
        """Names and units of the five quantities."""
        names = ("depth_lips", "depth_teeth", "gap", "opening")
        return (*(Variable(name, "m") for name in names), Variable("speed", "m/s"))

    def record(
        self, system: System, state: State, control: Control, report: StepReport | None
    ) -> tuple[float, ...]:
        """Measure a state; without contact the gap is NaN."""
        start = time.process_time()
        touches = system.contact is not None
        gaps = Contacts().record(system, state, control, report)[1] if touches else np.nan
        self.path[round(state.t, 9)] = state.q[self._nodes]
        turns = state.t / self._period
        due = abs(turns - round(turns)) < 1e-6
        values = (
            self._depth.lips(state.q) if due else np.nan,
            self._depth.teeth(state.q) if due else np.nan,
            float(np.fmin.reduce(np.atleast_1d(gaps))),
            lip_opening(self._face, state.q),
            float(np.linalg.norm(state.v[self._nodes], axis=1).max()),
        )
        self.seconds += time.process_time() - start
        return values
