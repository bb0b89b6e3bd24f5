"""Reduced face that follows a stream of sEMG: causal filter, feature, activation, step, markers."""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
import pandas as pd
import xarray as xr
from scipy.signal import butter, sosfilt

from emgface.errors import SignalError
from emgface.reduced.model import Floats, ReducedFace
from emgface.signals.activation import emg_of
from emgface.signals.filters import sampling_rate
from emgface.signals.mapping import mapping_matrix
from sim import Control, State, Workspace
from sim.reduced import FusedEuler
from sim.reduced.fused import OMITTED

BAND: Final = (20.0, 450.0)
"""Pass-band [Hz] of the causal filter, a Butterworth filter of second order."""
WINDOW: Final = 0.1
"""Window of the root mean square [s], which ends at the present."""


@dataclass
class CausalFeature:
    """Root mean square of filtered and mapped channels over the window that ends at each frame.

    Attributes
    ----------
    rate : float
        Samples per second.
    weights : (n_muscles, n_channels) of Eqs 2-6 of Eskes et al. 2017.
    """

    rate: float
    weights: Floats
    _memory: Floats = field(init=False)
    _squares: Floats = field(init=False)

    def __post_init__(self) -> None:
        """Begin with silence."""
        self._filter = butter(2, BAND, "bandpass", fs=self.rate, output="sos")
        self._memory = np.zeros((len(self._filter), self.weights.shape[1], 2))
        self._squares = np.zeros((len(self.weights), round(WINDOW * self.rate)))

    def __call__(self, samples: Floats) -> Floats:
        """Feature (n_muscles,) [V] after some more samples (n_channels, k) [V]."""
        filtered, self._memory = sosfilt(self._filter, samples, axis=1, zi=self._memory)
        squares = (self.weights @ filtered) ** 2
        self._squares = np.concatenate([self._squares, squares], axis=1)[:, squares.shape[1] :]
        return np.sqrt(self._squares.mean(axis=1))


def frames_of(
    recording: xr.Dataset, step: float, muscles: Sequence[str]
) -> tuple[list[Floats], float, Floats]:
    """Samples (n_channels, k) [V] of every step of a recording, their rate, and the mapping.

    Raises SchemaError or SignalError if there is no sEMG, or it has gaps.
    """
    emg = emg_of(recording).transpose("channel", "time_emg")
    rate = sampling_rate(emg["time_emg"])
    weights = mapping_matrix()
    known = [c for c in map(str, emg["channel"].values) if c in weights["channel"].values]
    values = emg.sel(channel=known).values
    if not np.isfinite(values).all():
        raise SignalError("the recording has gaps, expected a stream without: fill them first")
    ends = np.round(np.arange(1, int(values.shape[1] / rate / step) + 1) * step * rate).astype(int)
    chosen = weights.sel(channel=known, muscle=list(muscles)).values
    return np.split(values[:, : ends[-1]], ends[:-1], axis=1), rate, chosen


@dataclass
class LiveFace:
    """Reduced face that takes one step per frame.

    Attributes
    ----------
    reduced : ReducedFace
    step : float
        Time between frames [s].
    """

    reduced: ReducedFace
    step: float

    def __post_init__(self) -> None:
        """Begin at rest."""
        face, r = self.reduced.face, self.reduced.moving
        self._system = self.reduced.model.system
        self._work = Workspace(self._system)
        self._state: State = self.reduced.equilibrium
        nodes = face["marker_node"].values.astype(np.int64)
        self._markers, self._n = self.reduced.markers, len(nodes)
        self._omitted, self._estimate = self.reduced.modes[nodes][..., r:], 0.0

    def __call__(self, activation: Floats) -> tuple[Floats, float, float]:
        """Markers (n, 3) [m] after one step, the bound of their error [m], and the distance [1]."""
        now = Control(activation)
        integrator = FusedEuler(self.reduced.contact)
        self._state, _ = integrator.step(self._system, self._state, now, self.step, self._work)
        attrs = self.reduced.dataset.attrs
        moved = self._omitted @ self._state.memory[OMITTED][0]
        self._estimate = max(self._estimate, float(np.linalg.norm(moved, axis=1).max()))
        bound = attrs["error_factor"] * (self._estimate + attrs["error_floor"])
        distance = float(self.reduced.distances(activation[None])[0])
        (markers,) = self._markers.record(self._system, self._state, now, None)
        return np.asarray(markers)[: self._n], bound, distance


def live(
    recording: xr.Dataset,
    reduced: ReducedFace,
    *,
    seconds: float,
    step: float = 0.01,
    clock: Callable[[], float] = time.perf_counter,
    wait: Callable[[float], None] = time.sleep,
) -> Iterator[tuple[Floats, Floats, dict[str, float]]]:
    """Play a recording in real time, repeated up to a duration, and move the face with it.

    The features are divided by their range over one earlier pass of the recording and limited to
    0-1. Yields the activation (n_muscles,), the markers (n, 3) [m] and a row of the log for each
    frame: time, latency from the arrival of its last sample to the markers, computing time [s],
    bound of the error [m], distance, 1 if the frame is trusted.
    """
    frames, rate, weights = frames_of(recording, step, reduced.model.system.muscles)
    first = CausalFeature(rate, weights)
    heard = np.array([first(frame) for frame in frames])
    low, high = heard.min(axis=0), heard.max(axis=0)
    span = np.where(high > low, high - low, 1.0)
    feature, face = CausalFeature(rate, weights), LiveFace(reduced, step)
    largest = reduced.dataset.attrs["largest_distance"]
    face(np.zeros(len(low)))  # loads the kernel before the clock starts
    start = clock()
    for k in range(round(seconds / step)):
        arrived = start + (k + 1) * step
        if (early := arrived - clock()) > 0.0:
            wait(early)
        begun = clock()
        activation = np.clip((feature(frames[k % len(frames)]) - low) / span, 0.0, 1.0)
        markers, bound, distance = face(activation)
        done = clock()
        yield (
            activation,
            markers,
            {
                "time": (k + 1) * step,
                "latency": done - arrived,
                "computing": done - begun,
                "bound": bound,
                "distance": distance,
                "trusted": float(distance <= largest),
            },
        )


def summary(log: pd.DataFrame, step: float) -> dict[str, float]:
    """Latency [s] (median, 95th percentile, largest), its jitter, and late frames of a log.

    A frame is late if its markers follow the arrival of its last sample by more than a step.
    """
    latency = log["latency"]
    return {
        "frames": float(len(log)),
        "median latency": float(latency.median()),
        "95 % latency": float(latency.quantile(0.95)),
        "largest latency": float(latency.max()),
        "jitter": float(latency.std()),
        "median computing": float(log["computing"].median()),
        "late frames": float((latency > step).sum()),
        "frames not trusted": float((log["trusted"] == 0.0).sum()),
    }
