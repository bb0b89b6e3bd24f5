"""Sources of streamed sEMG: recordings played in real time, and streams of Lab Streaming Layer."""

import time
from collections.abc import Callable
from typing import Any, Final, Protocol

import numpy as np
import xarray as xr

from emgface.errors import ConfigurationError, SignalError
from emgface.reduced.model import Floats
from emgface.schema.units import DIVISORS, spelling
from emgface.signals.activation import emg_of
from emgface.signals.filters import sampling_rate
from emgface.signals.mapping import mapping_matrix

STREAM_TIMEOUT: Final = 5.0
"""Time in which a stream must be found [s]."""
STREAM_END: Final = 1.0
"""Time without samples after which a stream has ended [s]."""


class SignalSource(Protocol):
    """Interface of sources of samples at a rate [1/s], with the channel names of the montage."""

    rate: float
    channels: tuple[str, ...]

    def start(self) -> None:
        """Begin with the first frame at the present."""
        ...

    def now(self) -> float:
        """Return the time on the clock of the arrivals [s]."""
        ...

    def frame(self, k: int) -> tuple[Floats, float, int]:
        """Wait for the samples (n_channels, n) [V] of frame k.

        Returns samples, the time at which the last of them was there [s], and the number of samples
        lost before them. Raises SignalError if the stream has ended.
        """
        ...


def frames_of(recording: xr.Dataset, step: float) -> tuple[list[Floats], float, tuple[str, ...]]:
    """Samples (n_channels, k) [V] of every step of a recording, their rate, and the channels.

    Raises SchemaError or SignalError if there is no sEMG, it has gaps, or is shorter than a step.
    """
    emg = emg_of(recording).transpose("channel", "time_emg")
    rate = sampling_rate(emg["time_emg"])
    known = _known(map(str, emg["channel"].values), "the recording")
    values = emg.sel(channel=list(known)).values
    if not np.isfinite(values).all():
        raise SignalError(
            "the recording has gaps, expected a stream without gaps: interpolate them first"
        )
    ends = np.round(np.arange(1, int(values.shape[1] / rate / step) + 1) * step * rate).astype(int)
    if not len(ends):
        raise SignalError(
            f"the recording has {values.shape[1]} samples at {rate:g} Hz, expected at least those of a "
            f"step of {step:g} s: choose a longer one"
        )
    return np.split(values[:, : ends[-1]], ends[:-1], axis=1), rate, known


def _known(names: Any, what: str) -> tuple[str, ...]:
    """Channels of the montage among names; SignalError if there are none."""
    names, montage = list(names), set(map(str, mapping_matrix()["channel"].values))
    known = tuple(name for name in names if name in montage)
    twice = [name for name in known if known.count(name) > 1]
    if twice:
        raise SignalError(
            f"{what} has {known.count(twice[0])} channels {twice[0]}, expected one for each place: "
            "rename the others"
        )
    if not known:
        raise SignalError(
            f"{what} has the channels {', '.join(names) or 'without names'}, expected some of "
            f"{', '.join(sorted(montage))}: rename them, or use a mapping"
        )
    return known


class Played:
    """A recording that is played in real time and repeated."""

    def __init__(
        self,
        recording: xr.Dataset,
        step: float,
        clock: Callable[[], float] = time.perf_counter,
        wait: Callable[[float], None] = time.sleep,
    ) -> None:
        self._frames, self.rate, self.channels = frames_of(recording, step)
        self._step, self.now, self._wait, self._start = step, clock, wait, 0.0

    def start(self) -> None:
        """Begin now."""
        self._start = self.now()

    def frame(self, k: int) -> tuple[Floats, float, int]:
        """Samples of a frame, when its time has come; nothing is lost."""
        arrived = self._start + (k + 1) * self._step
        if (early := arrived - self.now()) > 0.0:
            self._wait(early)
        return self._frames[k % len(self._frames)], arrived, 0


class Streamed:
    """A stream of the Lab Streaming Layer, found by its name.

    Its channels are known by the labels and units of its description. The times of the samples are
    those of the sender on the clock of this computer, so that a latency includes the transport.
    Raises ConfigurationError if the package pylsl is not installed, and SignalError if no stream
    has this name, it has no sampling rate, or no channel or unit is known.
    """

    def __init__(self, name: str, step: float) -> None:
        try:
            import pylsl
            import pylsl.util
        except ImportError as error:
            raise ConfigurationError(
                "a stream requires the package pylsl, which is not installed: install "
                "'emgface[stream]', or play a recording"
            ) from error
        streams = pylsl.resolve_byprop("name", name, minimum=1, timeout=STREAM_TIMEOUT)
        if not streams:
            raise SignalError(
                f"no stream {name!r} was found within {STREAM_TIMEOUT:g} s, expected one of the "
                "Lab Streaming Layer in this network: start it, and check its name"
            )
        self._inlet = pylsl.StreamInlet(
            streams[0], max_buflen=10, processing_flags=pylsl.proc_clocksync, recover=False
        )
        self._pull, self.now, self._name = self._inlet.pull_chunk, pylsl.local_clock, name
        self._lost_error = pylsl.util.LostError
        described = self._inlet.info(timeout=STREAM_TIMEOUT)
        self.rate = float(described.nominal_srate())
        if self.rate <= 0.0:
            raise SignalError(f"stream {name!r} has no sampling rate, expected a regular one")
        labels, units = _described(described)
        self.channels = _known(labels, f"stream {name!r}")
        self._count = len(labels)
        self._columns = [labels.index(c) for c in self.channels]
        self._factor = np.array([_volts(name, c, units[labels.index(c)]) for c in self.channels])
        self._step, self._before, self._taken = step, np.nan, 0

    def start(self) -> None:
        """Forget what arrived before."""
        self._inlet.open_stream(timeout=STREAM_TIMEOUT)
        self._inlet.flush()
        self._before, self._taken = np.nan, 0

    def frame(self, k: int) -> tuple[Floats, float, int]:
        """Samples of a frame, when they have arrived."""
        end = round((k + 1) * self._step * self.rate)
        rows: list[list[float]] = []
        times: list[float] = []
        while len(rows) < end - self._taken:
            try:
                more, at = self._pull(timeout=STREAM_END, max_samples=end - self._taken - len(rows))
            except self._lost_error:
                more, at = [], []
            if not at:
                raise SignalError(
                    f"stream {self._name!r} has sent no samples for {STREAM_END:g} s, expected "
                    f"{self.rate:g} a second: check the sender; the log contains the frames before"
                )
            new = [list(one) for one in more or []]
            if other := {len(one) for one in new} - {self._count}:
                raise SignalError(
                    f"stream {self._name!r} has sent samples of {min(other)} channels, expected "
                    f"{self._count} as described: its channels have changed, start again"
                )
            rows += new
            times += at
        expected = 0.0 if np.isnan(self._before) else (times[-1] - self._before) * self.rate
        self._before, self._taken = times[-1], end
        # Times of senders jitter by some samples; a loss is longer than half of a frame.
        lost = round(expected) - len(rows)
        lost = lost if lost > 0.5 * self._step * self.rate else 0
        return np.array(rows)[:, self._columns].T * self._factor[:, None], times[-1], lost


def _described(info: Any) -> tuple[list[str], list[str]]:
    """Labels and units of the channels of a stream, empty where they are not described."""
    labels, units = [], []
    channel = info.desc().child("channels").child("channel")
    for _ in range(info.channel_count()):
        labels.append(channel.child_value("label"))
        units.append(channel.child_value("unit"))
        channel = channel.next_sibling()
    return labels, units


def _volts(stream: str, channel: str, unit: str) -> float:
    """Factor from the unit of a channel to volts; SignalError if it is unknown."""
    divisor = DIVISORS["V"].get(spelling(unit))
    if divisor is None:
        raise SignalError(
            f"stream {stream!r}: channel {channel} has the unit {unit!r}, expected V, mV or uV: state "
            "it in the description of the stream"
        )
    return 1.0 / divisor
