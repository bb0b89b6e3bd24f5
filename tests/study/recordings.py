"""Recordings used by several tests of the signal chain."""

import numpy as np
import xarray as xr

from emgface.choices import configure
from emgface.muscles import CHANNELS
from emgface.signals.parameters import SignalChain

RATE = 2048.0
DURATION = 2.5


def signal_of(values, rate=RATE) -> xr.DataArray:
    """Channels of given values, (channels, samples) or (samples,) [V]."""
    values = np.atleast_2d(np.asarray(values, dtype=float))
    coords = {
        "channel": [f"M{k}" for k in range(values.shape[0])],
        "time_emg": np.arange(values.shape[1]) / rate,
    }
    return xr.DataArray(values, coords, ("channel", "time_emg"), attrs={"units": "V"})


def recording_of(seed=0, *, gain=1.0, duration=DURATION, **attrs) -> xr.Dataset:
    """Noise with a varying amplitude, later and larger in each further channel."""
    rng = np.random.default_rng(seed)
    time = np.arange(int(duration * RATE)) / RATE
    peak = np.linspace(0.3, 0.7, len(CHANNELS))[:, None] * duration
    strength = np.linspace(80e-6, 200e-6, len(CHANNELS))[:, None]
    amplitude = 2e-6 + strength * np.exp(-(((time - peak) / 0.3) ** 2))
    emg = gain * amplitude * rng.standard_normal((len(CHANNELS), time.size))
    return xr.Dataset(
        {"emg": (("channel", "time_emg"), emg, {"units": "V"})},
        coords={"channel": list(CHANNELS), "time_emg": ("time_emg", time, {"units": "s"})},
        attrs={
            "volunteer": "V1",
            "instruction": "A",
            "repetition": 1,
            "origin": "simulated",
            **attrs,
        },
    )


def chain_of(**tables) -> SignalChain:
    return configure(SignalChain, tables)
