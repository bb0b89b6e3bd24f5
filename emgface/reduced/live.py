"""Reduced face that follows a stream of sEMG: causal filter, feature, activation, step, markers."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
import pandas as pd
import xarray as xr
from scipy.signal import butter, sosfilt, sosfilt_zi

from emgface.errors import SignalError
from emgface.reduced.model import Floats, ReducedFace
from emgface.reduced.stream import SignalSource, frames_of
from emgface.reduced.trained import response_size
from emgface.signals.mapping import mapping_matrix
from sim import Control, State, Workspace
from sim.reduced import FusedEuler
from sim.reduced.fused import OMITTED

LIVE_BAND: Final = (20.0, 450.0)
"""Pass-band [Hz] of the causal filter, a Butterworth filter of second order."""
#: largest voltage of an amplifier [V]; others are faults of a transmission
LARGEST_VOLTAGE: Final = 10.0
LIVE_WINDOW: Final = 0.1
"""Window of the root mean square [s], which ends at the present."""


SAME_FEATURE: Final = 1e-9
"""Difference of features up to which they are rounding of a constant signal and not sEMG [V]."""


@dataclass
class CausalFeature:
    """Root mean square of filtered and mapped channels over the window that ends at each frame.

    ``rate`` is in samples per second; ``weights`` (n_muscles, n_channels) are those of Eqs 2-6 of
    Eskes et al. 2017.
    """

    rate: float
    weights: Floats
    _memory: Floats = field(init=False)
    _squares: Floats = field(init=False)
    _last: Floats | None = field(init=False, default=None)

    def __post_init__(self) -> None:
        """Begin with silence."""
        if self.rate <= 2.0 * LIVE_BAND[1]:
            raise SignalError(
                f"the sEMG has {self.rate:g} samples per second, expected more than "
                f"{2.0 * LIVE_BAND[1]:g} because of its filter of {LIVE_BAND[0]:g} to "
                f"{LIVE_BAND[1]:g} Hz: record with a higher sampling rate"
            )
        self._filter = butter(2, LIVE_BAND, "bandpass", fs=self.rate, output="sos")
        self._memory = np.zeros((len(self._filter), self.weights.shape[1], 2))
        self._squares = np.zeros((len(self.weights), round(LIVE_WINDOW * self.rate)))

    def __call__(self, samples: Floats) -> Floats:
        """Feature (n_muscles,) [V] after some more samples (n_channels, k) [V].

        Values that are not finite or beyond `LARGEST_VOLTAGE` count as the one before: the filter would
        keep them for ever. It begins as if the first value had been there before, so that the constant
        voltage of an amplifier is no burst.
        """
        samples = self._repaired(samples)
        filtered, self._memory = sosfilt(self._filter, samples, axis=1, zi=self._memory)
        squares = (self.weights @ filtered) ** 2
        self._squares = np.concatenate([self._squares, squares], axis=1)[:, squares.shape[1] :]
        return np.sqrt(self._squares.mean(axis=1))

    def _repaired(self, samples: Floats) -> Floats:
        """Samples in which the last usable value replaces those that are not usable."""
        usable = np.abs(samples) <= LARGEST_VOLTAGE  # False for NaN
        if self._last is None and samples.shape[1]:
            first = samples[np.arange(len(samples)), usable.argmax(axis=1)]
            self._last = np.where(usable.any(axis=1), first, 0.0)
            self._memory = sosfilt_zi(self._filter)[:, None, :] * self._last[:, None]
        if self._last is None:
            return samples
        whole = np.concatenate([self._last[:, None], samples], axis=1)
        at = np.where(usable, np.arange(1, whole.shape[1]), 0)
        kept = np.take_along_axis(whole, np.maximum.accumulate(at, axis=1), axis=1)
        self._last = kept[:, -1]
        return kept


@dataclass
class LiveFace:
    """Reduced face that takes one step [s] per frame."""

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
        self._before = np.zeros(len(self._system.muscles))

    @property
    def coordinates(self) -> Floats:
        """Coordinates (modes,) of the displacement in the moving modes [sqrt(kg) m]."""
        return self._state.q.reshape(-1)[: self.reduced.moving]

    def __call__(self, activation: Floats) -> tuple[Floats, float, float, bool]:
        """Advance by one step.

        Returns the markers (n, 3) [m], the bound of their error [m], the distance of the activation
        [1], and True if it and its change since the last step are within the range of the training.
        """
        now = Control(activation)
        integrator = FusedEuler(self.reduced.contact)
        self._state, _ = integrator.step(self._system, self._state, now, self.step, self._work)
        attrs = self.reduced.dataset.attrs
        moved = self._omitted @ self._state.memory[OMITTED][0]
        self._estimate = max(self._estimate, float(np.linalg.norm(moved, axis=1).max()))
        bound = attrs["error_factor"] * (self._estimate + attrs["error_floor"])
        trained, change = self.reduced.trained, (activation - self._before)[None]
        distance = float(trained.distances(activation[None])[0])
        jump = float(response_size(change, trained.response)[0])
        self._before = activation
        (markers,) = self._markers.record(self._system, self._state, now, None)
        inside = distance <= trained.distance and jump <= trained.change
        return np.asarray(markers)[: self._n], bound, distance, inside


def heard(
    recording: xr.Dataset, step: float, muscles: Sequence[str], channels: Sequence[str] = ()
) -> tuple[Floats, Floats]:
    """Least and largest feature (n_muscles,) [V] over one pass of a recording, of complete windows.

    Raises SchemaError or SignalError if there is no sEMG, it has gaps, it is not longer than a window,
    or its channels are not those of the source, if these are given.
    """
    frames, rate, names = frames_of(recording, step)
    if channels and (other := sorted(set(names) ^ set(channels))):
        raise SignalError(
            f"source and recording of the range differ in the channels {', '.join(other)}, expected the "
            "same ones in both: choose another --range"
        )
    feature = CausalFeature(rate, weights_of(names, muscles))
    values = np.array([feature(frame) for frame in frames])[round(LIVE_WINDOW / step) :]
    if not len(values):
        raise SignalError(
            f"the recording of the range lasts {len(frames) * step:g} s, expected more than the window "
            f"of {LIVE_WINDOW:g} s, over which a feature is computed: choose a longer one"
        )
    return values.min(axis=0), values.max(axis=0)


def span_of(between: tuple[Floats, Floats]) -> Floats:
    """Differences (n_muscles,) [V] of the least and the largest feature; inf where it is constant."""
    low, high = between
    return np.where(high - low > SAME_FEATURE, high - low, np.inf)


def weights_of(channels: Sequence[str], muscles: Sequence[str]) -> Floats:
    """Weights (n_muscles, n_channels) of Eqs 2-6 for known channels."""
    chosen = mapping_matrix().sel(channel=list(channels), muscle=list(muscles))
    return chosen.transpose("muscle", "channel").values


def live(
    source: SignalSource,
    reduced: ReducedFace,
    between: tuple[Floats, Floats],
    *,
    seconds: float,
    step: float = 0.01,
) -> Iterator[tuple[Floats, Floats, dict[str, float]]]:
    """Move the face with a stream of sEMG, in real time.

    The features are divided by their range `between` (`heard`) and limited to 0-1. Yields the
    activation (n_muscles,), the markers (n, 3) [m] and a row of the log for each frame: time, latency
    from the arrival of its last sample to the markers, computing time [s], number of samples lost
    before it, bound of the error [m], distance, 1 if the frame is trusted. Errors as of the source.
    """
    low, span = between[0], span_of(between)
    weights = weights_of(source.channels, reduced.model.system.muscles)
    feature, face = CausalFeature(source.rate, weights), LiveFace(reduced, step)
    face(np.zeros(len(low)))  # loads the kernel before the clock starts
    source.start()
    for k in range(round(seconds / step)):
        samples, arrived, lost = source.frame(k)
        begun = source.now()
        activation = np.clip((feature(samples) - low) / span, 0.0, 1.0)
        markers, bound, distance, inside = face(activation)
        done = source.now()
        yield (
            activation,
            markers,
            {
                "time": (k + 1) * step,
                "latency": done - arrived,
                "computing": done - begun,
                "lost": float(lost),
                "bound": bound,
                "distance": distance,
                "trusted": float(inside),
            },
        )


def live_summary(log: pd.DataFrame, step: float) -> dict[str, float]:
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
        "lost samples": float(log["lost"].sum()),
        "frames not trusted": float((log["trusted"] == 0.0).sum()),
    }
