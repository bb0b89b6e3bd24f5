"""Filter and resampling compared with frequency responses and closed forms."""

import warnings

import numpy as np
import pytest
import scipy.signal
import xarray as xr

from emgface.errors import FeatureWarning, SignalError
from emgface.signals.filters import (
    bandpass,
    constant_rows,
    row_dim,
    sampling_rate,
)
from emgface.signals.parameters import FilterParameters
from tests.study.recordings import RATE, signal_of


def measured_gain(frequency, parameters) -> float:
    """Gain in dB of the middle of a long sine, by projection on sine and cosine."""
    t = np.arange(int(8 * RATE)) / RATE
    filtered = bandpass(signal_of(np.sin(2 * np.pi * frequency * t)), parameters).values[0]
    middle = slice(int(2 * RATE), int(6 * RATE))  # whole periods for every whole frequency
    projection = np.mean(filtered[middle] * np.exp(-2j * np.pi * frequency * t[middle]))
    return 20 * np.log10(2 * abs(projection))


@pytest.mark.parametrize("phase, gain", [("causal", -3.0103), ("zero", -6.0206)])
def test_gain_at_the_edges(phase, gain):
    """A Butterworth edge has |H|^2 = 1/2: -3 dB in one pass, -6 dB in two."""
    parameters = FilterParameters(phase=phase)
    filtered = bandpass(signal_of(np.random.default_rng(0).standard_normal(4096)), parameters)
    assert filtered.attrs["edge_gain"] == pytest.approx([gain, gain], abs=1e-4)
    for edge in (15.0, 500.0):
        assert measured_gain(edge, parameters) == pytest.approx(gain, abs=1e-3)


@pytest.mark.parametrize("phase, passes", [("causal", 1), ("zero", 2)])
def test_gain_over_the_band_is_the_butterworth_response(phase, passes):
    """|H|^2 = 1 / (1 + W^(2n)), W = (w^2 - w1 w2) / (w (w2 - w1)), w = tan(pi f / rate)."""
    for frequency in (8.0, 30.0, 100.0, 400.0, 700.0):
        w, w1, w2 = np.tan(np.pi * np.array([frequency, 15.0, 500.0]) / RATE)
        W = (w**2 - w1 * w2) / (w * (w2 - w1))
        expected = -10 * passes * np.log10(1 + W**8)
        assert measured_gain(frequency, FilterParameters(phase=phase)) == pytest.approx(
            expected, abs=1e-3
        )


def test_design_order_four_has_eight_poles():
    filtered = bandpass(
        signal_of(np.random.default_rng(0).standard_normal(4096)),
        (FilterParameters(phase="causal")),
    )
    b, a = scipy.signal.butter(4, (15, 500), "bandpass", fs=RATE)
    assert a.size - 1 == 8
    raw = signal_of(np.random.default_rng(0).standard_normal(4096)).values[0]
    start = scipy.signal.lfilter_zi(b, a) * raw[0]
    expected, _ = scipy.signal.lfilter(b, a, raw, zi=start)
    # The direct form is less accurate than second-order sections.
    np.testing.assert_allclose(filtered.values[0], expected, atol=1e-6)


def test_zero_phase_keeps_a_burst_in_place_and_causal_delays_it():
    """The centre of energy moves by the group delay, averaged with |Y(f)|^2."""
    t = np.arange(4096) / RATE
    burst = np.exp(-(((t - 1.0) / 0.02) ** 2)) * np.cos(2 * np.pi * 80 * (t - 1.0))
    zero = bandpass(signal_of(burst), FilterParameters(phase="zero")).values[0]
    causal = bandpass(signal_of(burst), FilterParameters(phase="causal")).values[0]
    centre = [np.sum(t * y**2) / np.sum(y**2) for y in (zero, causal)]
    assert centre[0] == pytest.approx(1.0, abs=1e-6)
    frequency = np.fft.rfftfreq(t.size, 1 / RATE)[10:-1]  # 5 Hz up, all of its energy
    b, a = scipy.signal.butter(4, (15, 500), "bandpass", fs=RATE)
    _, delay = scipy.signal.group_delay((b, a), w=frequency, fs=RATE)
    power = np.abs(np.fft.rfft(causal)[10:-1]) ** 2
    assert centre[1] - 1.0 == pytest.approx(np.sum(delay * power) / np.sum(power) / RATE, rel=1e-3)
    assert centre[1] - 1.0 > 1 / RATE
    # The causal output before a change does not depend on what comes after it.
    later = burst.copy()
    later[3000:] += 1.0
    again = bandpass(signal_of(later), FilterParameters(phase="causal")).values[0]
    np.testing.assert_array_equal(again[:3000], causal[:3000])


@pytest.mark.parametrize("phase", ["zero", "causal"])
def test_offset_of_the_amplifier_leaves_no_transient(phase):
    s = signal_of(np.full((1, 2048), 0.3))
    filtered = bandpass(s, FilterParameters(phase=phase))
    np.testing.assert_allclose(filtered.values, 0.0, atol=1e-12)


@pytest.mark.parametrize("rate", [100.0, 999.0, 1000.0])
def test_a_band_beyond_the_rate_is_narrowed_with_a_warning(rate):
    """The filter is that of the narrower band, whose edges are recorded."""
    s = signal_of(np.random.default_rng(0).standard_normal(5000), rate=rate)
    high = 0.9 * (rate / 2.0)
    with pytest.warns(
        FeatureWarning, match=rf"ends at {high:g} Hz instead of 500 Hz, .* at {rate:g} Hz"
    ):
        narrowed = bandpass(s, FilterParameters())
    named = bandpass(s, FilterParameters(high=high))
    np.testing.assert_array_equal(narrowed.values, named.values)
    assert (narrowed.attrs["filter_low"], narrowed.attrs["filter_high"]) == (15.0, high)
    assert narrowed.attrs["edge_gain"] == pytest.approx([-6.02, -6.02], abs=0.05)


def test_a_band_within_the_rate_is_used_as_it_is():
    s = signal_of(np.random.default_rng(0).standard_normal(5000), rate=2048.0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert bandpass(s, FilterParameters()).attrs["filter_high"] == 500.0


@pytest.mark.parametrize("rate", [20.0, 33.0, 66.0])
def test_a_rate_that_leaves_less_than_an_octave_is_refused(rate):
    s = signal_of(np.random.default_rng(0).standard_normal(5000), rate=rate)
    with pytest.raises(SignalError, match=r"at least an octave .* above 66.6667 Hz"):
        bandpass(s, FilterParameters())


def test_gap_names_channel_start_and_length():
    values = np.random.default_rng(0).standard_normal((3, 4096))
    values[2, 2048:2068] = np.nan
    with pytest.raises(SignalError, match=r"channel M2 has a gap of 0.009766 s .* t = 1 s"):
        bandpass(signal_of(values), FilterParameters())
    values[0, 5] = np.inf
    with pytest.raises(SignalError, match=r"channel M0 has a gap .*1 samples"):
        bandpass(signal_of(values), FilterParameters())


def test_gap_up_to_the_end():
    values = np.random.default_rng(0).standard_normal((1, 4096))
    values[0, 4000:] = np.nan
    with pytest.raises(SignalError, match="96 samples without"):
        bandpass(signal_of(values), FilterParameters())


def test_recording_shorter_than_the_extension():
    s = signal_of(np.random.default_rng(0).standard_normal(400))
    with pytest.raises(SignalError, match=r"400 samples\) is shorter than the filter's extension"):
        bandpass(s, FilterParameters())
    assert bandpass(s, FilterParameters(phase="causal")).sizes["time_emg"] == 400


def test_sampling_that_is_not_uniform():
    time = np.arange(100) / 1000.0
    time[50:] += 0.001  # one sample lost
    with pytest.raises(SignalError, match=r"not uniform at t = 0.049 s"):
        sampling_rate(time)
    with pytest.raises(SignalError, match="expected ascending times"):
        sampling_rate(time[::-1])
    with pytest.raises(SignalError, match="at least 2"):
        sampling_rate(np.array([0.0]))
    assert sampling_rate(np.round(np.arange(2048) / 2048, 6)) == pytest.approx(2048, rel=1e-5)


def test_wrong_dims():
    with pytest.raises(SignalError, match="found dims"):
        row_dim(xr.DataArray(np.zeros((2, 2)), dims=("channel", "sample")))


def test_constant_rows():
    values = np.random.default_rng(0).standard_normal((4, 100))
    values[1] = 0.0
    values[3] = 0.1 + 0.2
    assert constant_rows(signal_of(values)) == ("M1", "M3")


@pytest.mark.parametrize("rounding", [-1e-4, -1e-9, -5e-16, 0.0, 5e-16, 1e-9, 1e-4])
def test_a_rate_of_twice_the_upper_edge_up_to_rounding_is_filtered(rounding: float) -> None:
    """Cut trials of a recording at 1000 Hz have a rate of 1000.0000000000005 Hz by their times."""
    time = np.arange(2000) / (1000.0 * (1.0 + rounding))
    signal = xr.DataArray(
        1e-5 * np.random.default_rng(0).standard_normal((1, time.size)),
        {"channel": ["ZYG_L"], "time_emg": ("time_emg", time, {"units": "s"})},
        ("channel", "time_emg"), attrs={"units": "V"},
    )  # fmt: skip
    with pytest.warns(FeatureWarning, match="instead of 500 Hz"):
        filtered = bandpass(signal, FilterParameters())
    assert np.isfinite(filtered).all() and 0.5e-5 < float(filtered.std()) < 1.1e-5
    assert filtered.attrs["filter_high"] == pytest.approx(450.0, rel=1e-3)
