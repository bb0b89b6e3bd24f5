"""Numbers of the steps of a live face: their log as a dataset, and the frame that a page receives."""

import json
from array import array
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from emgface.pictures.encoding import quanta
from emgface.view.moving import Moved

Floats = NDArray[np.float64]

MOST_ROWS: Final = 1_000_000  #: largest number of steps in the log, 2.8 h of steps of 10 ms
FRAME_NUMBERS: Final = ("time", "latency", "computing", "bound", "distance", "trusted", "smallest_J",
                        "lost", "late", "pace")  # fmt: skip
"""Numbers at the start of a frame, in single precision; activations and positions follow."""

FRAME_UNITS: Final = {"time": "s", "latency": "s", "computing": "s", "bound": "m"}  #: of others: 1


@dataclass
class Log:
    """Steps of a live face: activations, markers and `FRAME_NUMBERS`, 0.5 kB for each step."""

    muscles: tuple[str, ...]
    markers: tuple[str, ...]
    notes: list[tuple[float, str]] = field(default_factory=list)
    _numbers: "array[float]" = field(default_factory=lambda: array("d"))

    def add(self, row: Floats, activation: Floats, position: Floats) -> None:
        """Add a step; the oldest are dropped beyond `MOST_ROWS`."""
        whole = np.concatenate([row, activation, np.ravel(position)])
        self._numbers.frombytes(whole.tobytes())
        if len(self._numbers) > MOST_ROWS * len(whole):
            del self._numbers[: MOST_ROWS // 10 * len(whole)]

    @property
    def _table(self) -> Floats:
        width = len(FRAME_NUMBERS) + len(self.muscles) + 3 * len(self.markers)
        # A copy: while an array lends its memory, nothing can be added to it.
        return np.array(self._numbers).reshape(-1, width)

    @property
    def last(self) -> float:
        """Time of the last step [s], 0 before the first."""
        return float(self.rows[-1, 0]) if len(self._numbers) else 0.0

    @property
    def rows(self) -> Floats:
        """Numbers of `FRAME_NUMBERS` of every step (steps, numbers)."""
        return self._table[:, : len(FRAME_NUMBERS)]

    def dataset(self, attrs: Mapping[str, Any]) -> xr.Dataset:
        """Activation (muscle, time) [1] and markers (marker, axis, time) [m], with the numbers."""
        parts = np.cumsum([len(FRAME_NUMBERS), len(self.muscles)])
        rows, activation, position = np.split(self._table, parts, axis=1)
        units = {n: FRAME_UNITS.get(n, "1") for n in FRAME_NUMBERS}
        named = {
            n: ("time", rows[:, k], {"units": units[n]})
            for k, n in enumerate(FRAME_NUMBERS)
            if n != "time"
        }
        position = position.reshape(-1, len(self.markers), 3)
        return xr.Dataset(
            {
                "activation": (("muscle", "time"), activation.T, {"units": "1"}),
                "position": (
                    ("marker", "axis", "time"),
                    position.transpose(1, 2, 0),
                    {"units": "m"},
                ),
                **named,
            },
            coords={
                "muscle": list(self.muscles),
                "marker": list(self.markers),
                "axis": ["x", "y", "z"],
                "time": ("time", rows[:, 0], {"units": "s"}),
            },
            attrs={**attrs, "origin": "simulated", "notes": json.dumps(self.notes)},
        )


def frame_of(row: Floats, activation: Floats, moved: Moved, centre: Floats) -> bytes:
    """Numbers and activations in single precision, then `quanta` about a centre (3,) [m]."""
    numbers = np.concatenate([row, activation]).astype("<f4").tobytes()
    return numbers + quanta(moved.skin - centre) + quanta(moved.markers - centre)
