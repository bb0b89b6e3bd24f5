"""Resampling compared with the frequency response of its kernels."""

import numpy as np
import pytest
import xarray as xr
from scipy.special import expit

from emgface.errors import SignalError
from emgface.signals.parameters import ResamplingParameters
from emgface.signals.resampling import resample, simulation_times


def moving(rate, duration, function) -> xr.DataArray:
    time = 0.25 + np.arange(int(duration * rate) + 1) / rate
    return xr.DataArray(
        function(time)[None], dims=("row", "time"), coords={"row": ["a"], "time": time}
    )


def test_flat_decimation_passes_slow_motion_and_removes_what_would_alias():
    """From 2000 Hz to 40 Hz: 3 Hz is kept, 37 Hz (its alias is 3 Hz) is removed."""
    times = np.linspace(0.5, 3.5, 121)
    slow = moving(2000.0, 4.0, lambda t: np.sin(2 * np.pi * 3 * t))
    fast = moving(2000.0, 4.0, lambda t: np.sin(2 * np.pi * 37 * t))
    # The stop-band of a Blackman window is 74 dB down, a factor of 2e-4.
    got = resample(slow, times).values[0]
    np.testing.assert_allclose(got, np.sin(2 * np.pi * 3 * times), atol=2e-4)
    assert np.abs(resample(fast, times).values[0]).max() < 2e-4


@pytest.mark.parametrize("frequency", [3.0, 20.0, 37.0])
def test_bounded_decimation_has_the_response_of_a_hann_window(frequency):
    """H(f) = sinc(2 f P) / (1 - (2 f P)^2) for half width P, 1/2 at 1/(2P)."""
    times = np.linspace(0.5, 3.5, 121)
    x = 2 * frequency / 40.0
    gain = 0.5 if x == 1.0 else np.sinc(x) / (1 - x**2)
    data = moving(2000.0, 4.0, lambda t: np.cos(2 * np.pi * frequency * (t - 0.5)))
    got = resample(data, times, bounded=True).values[0]
    np.testing.assert_allclose(got, gain * np.cos(2 * np.pi * frequency * (times - 0.5)), atol=1e-6)


def test_bounded_decimation_cannot_leave_the_range():
    step = moving(2000.0, 4.0, lambda t: (np.sin(40 * t) > 0).astype(float))
    times = np.linspace(0.25, 4.25, 161)
    got = resample(step, times, bounded=True)
    assert got.min() >= 0 and got.max() <= 1
    assert resample(step, times).max() > 1.001  # the flat kernel rings
    assert "hann" in got.attrs["antialias"]


def test_decimation_keeps_a_ramp_up_to_both_ends():
    """The odd reflection of a ramp is the ramp; the stop-band of the kernel transmits 2e-4 of a step."""
    ramp = moving(2000.0, 4.0, lambda t: 3.0 * t)
    times = np.linspace(0.25, 4.25, 161)
    np.testing.assert_allclose(resample(ramp, times).values[0], 3.0 * times, atol=2e-4 * 3.0 / 40)


def test_refinement_interpolates():
    smooth = moving(100.0, 2.0, lambda t: expit(10 * (t - 1)))
    times = np.linspace(0.25, 2.25, 999)
    np.testing.assert_allclose(
        resample(smooth, times).values[0], expit(10 * (times - 1)), atol=1e-5
    )
    linear = resample(smooth, times, bounded=True).values[0]
    assert linear.max() <= smooth.max() and np.abs(linear - expit(10 * (times - 1))).max() < 2e-3


def test_same_instants_give_the_same_data():
    data = moving(100.0, 1.0, np.cos)
    for bounded in (True, False):
        again = resample(data, data.time.values, bounded=bounded)
        np.testing.assert_allclose(again.values, data.values, atol=1e-14)


def test_resample_refuses_gaps_and_times_outside():
    data = moving(100.0, 1.0, np.cos)
    with pytest.raises(SignalError, match="not covered by data"):
        resample(data, np.linspace(0.0, 1.0, 11))
    with pytest.raises(SignalError, match="not finite"):
        resample(data.where(data.time != data.time[3]), np.linspace(0.3, 1.0, 11))


def test_simulation_times():
    times = simulation_times(0.1, 4.1, ResamplingParameters())
    assert times.size == 161 and times[0] == 0.1 and times[-1] == 4.1
    np.testing.assert_allclose(np.diff(times), 0.025, rtol=1e-12)
    times = simulation_times(0.0, 1.0, ResamplingParameters(period=0.3))
    np.testing.assert_allclose(times, [0.0, 0.3, 0.6, 0.9])
    with pytest.raises(SignalError, match="no data between"):
        simulation_times(1.0, 1.0, ResamplingParameters())
    with pytest.raises(SignalError, match="shorter than the sampling period"):
        simulation_times(0.0, 0.2, ResamplingParameters(period=0.3))
