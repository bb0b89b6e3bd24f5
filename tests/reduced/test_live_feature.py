"""The live feature of signals with an offset, faults, constant channels and short recordings."""

import numpy as np
import pytest
import xarray as xr

from emgface.errors import SignalError
from emgface.muscles import CHANNELS, MUSCLES
from emgface.reduced.live import CausalFeature, heard, span_of, weights_of
from emgface.reduced.stream import frames_of

RATE, STEP = 2048, 0.01


def recording(seconds: float = 1.0, offset: float = 0.0) -> xr.Dataset:
    """Noise of every channel that is strong between 0.4 and 0.6 s, on a constant voltage [V]."""
    t = np.arange(round(RATE * seconds)) / RATE
    level = 2e-6 + 1e-4 * (np.abs(t - 0.5) < 0.1)
    emg = offset + level * np.random.default_rng(3).standard_normal((len(CHANNELS), len(t)))
    return xr.Dataset(
        {"emg": (("channel", "time_emg"), emg, {"units": "V"})},
        {"channel": list(CHANNELS), "time_emg": ("time_emg", t, {"units": "s"})},
    )


def levels(given: xr.Dataset) -> np.ndarray:
    """Activations (frames, muscles) of a recording that is its own range."""
    between = heard(given, STEP, MUSCLES)
    frames, rate, channels = frames_of(given, STEP)
    feature = CausalFeature(rate, weights_of(channels, MUSCLES))
    return np.array([(feature(one) - between[0]) / span_of(between) for one in frames])


@pytest.mark.parametrize("offset", [1e-3, -0.05, 0.3])
def test_the_constant_voltage_of_an_amplifier_changes_no_activation(offset):
    """Without this, the step at the start is the largest feature, and all motion vanishes."""
    np.testing.assert_allclose(levels(recording(offset=offset)), levels(recording()), atol=1e-6)


def test_at_rest_the_activation_is_near_zero_and_in_effort_one():
    """A window that is not complete yet would make the least feature too small."""
    active = levels(recording())
    assert active.max() == pytest.approx(1.0)
    assert np.abs(active[12:38]).max() < 0.01


def test_a_faulty_sample_on_a_constant_voltage_is_no_burst():
    given = recording(offset=0.05)
    frames, rate, channels = frames_of(given, STEP)
    weights = weights_of(channels, MUSCLES)
    clean, hurt = CausalFeature(rate, weights), CausalFeature(rate, weights)
    for k, frame in enumerate(frames[:35]):
        damaged = frame.copy()
        if k in (0, 20):
            damaged[:, :3] = np.nan
        wanted, feature = clean(frame), hurt(damaged)
    np.testing.assert_allclose(feature, wanted, rtol=0.3)


@pytest.mark.parametrize("value", [0.0, 0.05, -1.0])
def test_constant_channels_leave_their_muscles_at_rest(value):
    given = recording()
    given["emg"].loc[{"channel": "MEN_L"}] = value
    still = np.isinf(span_of(heard(given, STEP, MUSCLES)))
    assert still[MUSCLES.index("MEN_L")] and not still[MUSCLES.index("MEN_R")]
    assert np.abs(levels(given)[:, MUSCLES.index("MEN_L")]).max() == 0.0


@pytest.mark.parametrize(
    ("seconds", "sentence"),
    [(0.002, "has 4 samples at 2048 Hz, expected at least"), (0.08, "lasts 0.08 s, expected more")],
)
def test_short_recordings_are_refused(seconds, sentence):
    with pytest.raises(SignalError, match=sentence):
        heard(recording(seconds), STEP, MUSCLES)
