"""Features compared with their definitions, by brute force or in closed form."""

import warnings

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st

from emgface.errors import FeatureWarning, SignalError
from emgface.signals.envelope import linear_envelope, muscle_activation, neural_activation
from emgface.signals.features import (
    baseline_rms,
    feature_of,
    mean_absolute_value,
    root_mean_square,
    willison_amplitude,
)
from emgface.signals.parameters import FeatureParameters
from emgface.signals.running import running_sum, running_willison
from tests.study.recordings import RATE, signal_of


def willison_by_definition(s, n_window, limit, inclusive=True) -> np.ndarray:
    """Eq. 7 as printed, two nested loops."""
    out = np.zeros(s.size - n_window + 1)
    for t in range(out.size):
        for n in range(1, n_window):
            step = abs(s[t + n - 1] - s[t + n])
            out[t] += step >= limit if inclusive else step > limit
    return out


@given(
    # Halves are exact in floating point, so steps equal to the threshold do occur.
    st.lists(st.integers(-4, 4).map(lambda k: 0.5 * k), min_size=2, max_size=60),
    st.data(),
    st.sampled_from([0.5, 1.0, 1.25]),
    st.booleans(),
)
@settings(max_examples=150, deadline=None)
def test_equation_7_willison_amplitude_equals_double_loop(values, data, limit, inclusive):
    s = np.asarray(values)
    n = data.draw(st.integers(2, s.size))
    out = running_willison(s, n, limit, inclusive=inclusive)
    np.testing.assert_array_equal(out, willison_by_definition(s, n, limit, inclusive))


def test_equation_7_on_noise_with_default_window():
    s = 20e-6 * np.random.default_rng(7).standard_normal(1500)
    feature = willison_amplitude(signal_of(s))
    np.testing.assert_array_equal(feature.values[0], willison_by_definition(s, 410, 10e-6))
    assert feature.attrs["units"] == "1"


@pytest.mark.parametrize("comparison, expected", [(">=", 100), (">", 0)])
def test_comparison_decides_where_steps_equal_the_threshold(comparison, expected):
    s = signal_of(np.tile([0.0, 0.5, 0.0, 0.25], 100), rate=1000.0)  # half of all steps are 0.5
    parameters = FeatureParameters(window=0.201, threshold=0.5, comparison=comparison)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FeatureWarning)
        assert set(feature_of(s, parameters).values[0]) == {expected}


def test_rounding_of_the_window_is_recorded():
    feature = root_mean_square(signal_of(np.random.default_rng(0).standard_normal(900)))
    assert feature.attrs["window"] == 0.2  # 409.6 samples
    assert feature.attrs["window_samples"] == 410
    assert feature.attrs["window_used"] == pytest.approx(410 / 2048)


def test_labels_place_the_window_at_start_centre_end():
    """A step is, on average, at the centre of the windows that count it."""
    s = np.zeros(2001)
    s[1000:] = 1.0  # the step is between samples 999 and 1000
    instants = {}
    for label in ("start", "centre", "end"):
        feature = willison_amplitude(signal_of(s, rate=1000.0), window=0.1, label=label)
        instants[label] = float(feature.time[feature.values[0] == 1].mean())
        assert feature.sizes["time"] == 2001 - 100 + 1
        assert int(feature.sum()) == 99
    assert instants["centre"] == pytest.approx(0.9995)
    assert instants["start"] == pytest.approx(0.9995 - 0.0495)
    assert instants["end"] == pytest.approx(0.9995 + 0.0495)


@given(
    st.lists(st.floats(0, 1e6, allow_subnormal=False), min_size=1, max_size=50),
    st.data(),
)
@settings(max_examples=100, deadline=None)
def test_running_sum_equals_direct_sum(values, data):
    x = np.asarray(values)
    n = data.draw(st.integers(1, x.size))
    out = running_sum(x, n)
    expected = [np.sum(x[t : t + n]) for t in range(out.size)]
    # Each sum has at most n additions of non-negative terms: relative error below n eps.
    np.testing.assert_allclose(out, expected, rtol=2 * n * np.finfo(float).eps, atol=0)


def test_a_quiet_signal_after_a_burst_keeps_its_precision():
    """A running sum that subtracts old samples would have an error of about 1e-16 x 1e12 here."""
    x = np.full(3000, 1e-8)
    x[500:600] = 1e4
    feature = root_mean_square(signal_of(x), window=100 / RATE)
    np.testing.assert_allclose(feature.values[0, 700:], 1e-8, rtol=1e-13)


def test_rms_and_mav_of_a_sine_over_whole_periods():
    t = np.arange(4000) / 1000.0
    s = signal_of(3e-5 * np.sin(2 * np.pi * 50 * t), rate=1000.0)
    rms = root_mean_square(s, window=0.2)
    mav = mean_absolute_value(s, window=0.2)
    np.testing.assert_allclose(rms.values, 3e-5 / np.sqrt(2), rtol=1e-12)
    # sum |sin(k pi/10)| over a period of 20 samples = 2 cot(pi/20)
    np.testing.assert_allclose(mav.values, 3e-5 * 2 / np.tan(np.pi / 20) / 20, rtol=1e-12)
    assert rms.attrs["units"] == mav.attrs["units"] == "V"


def test_envelope_of_a_rectified_sine_is_its_mean():
    t = np.arange(8192) / RATE
    s = signal_of(1e-4 * np.sin(2 * np.pi * 128 * t))
    envelope = linear_envelope(s, cutoff=6.0)
    # 16 samples per period: mean |sin| = 2 cot(pi/16) / 16; ripple at 256 Hz is 1e-6 of it.
    middle = envelope.values[0, 2000:6000]
    np.testing.assert_allclose(middle, 1e-4 * 2 / np.tan(np.pi / 16) / 16, rtol=1e-5)


def test_neural_activation_obeys_its_recursion():
    """Buchanan: u(t) = alpha e(t-d) - beta1 u(t-1) - beta2 u(t-2)."""
    rng = np.random.default_rng(3)
    e = np.abs(rng.standard_normal(400))
    envelope = signal_of(e, rate=1000.0).rename(time_emg="time")
    u = neural_activation(envelope, delay=0.012, C1=-0.6, C2=0.3).values[0]
    beta1, beta2 = -0.6 + 0.3, -0.6 * 0.3
    alpha = 1 + beta1 + beta2
    before = [e[0], e[0]]  # rest in the first value
    expected = []
    for k in range(e.size):
        driven = e[max(k - 12, 0)]
        expected.append(alpha * driven - beta1 * before[-1] - beta2 * before[-2])
        before.append(expected[-1])
    np.testing.assert_allclose(u, expected, rtol=1e-12)


def test_neural_activation_has_unit_gain_and_delay():
    e = np.zeros(4000)
    e[1000:] = 2.0
    envelope = signal_of(e, rate=1000.0).rename(time_emg="time")
    u = neural_activation(envelope, delay=0.05, C1=-0.9, C2=-0.9).values[0]
    assert np.all(u[:1050] == 0) and u[1050] > 0
    assert u[-1] == pytest.approx(2.0, rel=1e-12)


@pytest.mark.parametrize("C1, C2", [(-1.0, -0.5), (0.2, 1.0), (np.nan, 0.0)])
def test_unstable_recursion_is_refused(C1, C2):
    envelope = signal_of(np.ones(10)).rename(time_emg="time")
    with pytest.raises(SignalError, match="not stable"):
        neural_activation(envelope, C1=C1, C2=C2)


def test_muscle_activation_shape():
    u = xr.DataArray(np.linspace(0, 1, 11), dims="time")
    for A in (-3.0, -1.5, -1e-9, 0.0):
        a = muscle_activation(u, A).values
        assert a[0] == 0 and a[-1] == pytest.approx(1.0, abs=1e-15)
        assert np.all(np.diff(a) > 0)
    np.testing.assert_allclose(muscle_activation(u, -1e-9).values, u.values, atol=1e-9)
    half = float(muscle_activation(u, -2.0)[5])
    assert half == pytest.approx((np.exp(-1) - 1) / (np.exp(-2) - 1))
    with pytest.raises(SignalError, match="between -3 and 0"):
        muscle_activation(u, 1.0)


def test_feature_that_is_zero_warns_with_a_threshold_that_works():
    s = 1e-6 * np.random.default_rng(1).standard_normal(3000)
    with pytest.warns(FeatureWarning, match="M0 is zero in every window") as caught:
        willison_amplitude(signal_of(s), threshold=10e-3)
    text = str(caught[0].message)
    suggested = float(text.split("near ")[1].split(" V")[0])
    feature = willison_amplitude(signal_of(s), threshold=suggested)
    # The median step: about half of all steps count.
    np.testing.assert_allclose(feature.mean() / 409, 0.5, atol=0.05)


def test_saturated_feature_warns():
    s = np.random.default_rng(1).standard_normal(3000)
    with pytest.warns(FeatureWarning, match="saturated at 409"):
        willison_amplitude(signal_of(s), threshold=1e-9)


def test_threshold_as_multiple_of_baseline_rms():
    rng = np.random.default_rng(5)
    s = rng.standard_normal((2, 4096)) * np.array([[1e-6], [4e-6]])
    signal = signal_of(s)
    inside = slice(0, 1025)  # 0 to 0.5 s, both ends included
    rms = np.sqrt(np.mean(s[:, inside] ** 2, axis=1))
    np.testing.assert_allclose(baseline_rms(signal, (0.0, 0.5)).values, rms, rtol=1e-12)
    parameters = FeatureParameters(threshold_baseline=1.5, baseline_start=0.0, baseline_stop=0.5)
    feature = feature_of(signal, parameters)
    for k in range(2):
        expected = willison_by_definition(s[k], 410, 1.5 * rms[k])
        np.testing.assert_array_equal(feature.values[k], expected)


def test_baseline_outside_the_recording_or_silent():
    signal = signal_of(np.ones(2048))
    with pytest.raises(SignalError, match="not within the recording"):
        baseline_rms(signal, (0.5, 3.0))
    with pytest.raises(SignalError, match="M0 is exactly zero over the baseline"):
        baseline_rms(signal * 0, (0.0, 0.5))


@pytest.mark.parametrize("kind", ["wamp", "rms", "mav"])
def test_recording_shorter_than_the_window(kind):
    signal = signal_of(np.random.default_rng(0).standard_normal(409))
    with pytest.raises(SignalError, match=r"409 samples\) is shorter than the window of 0.2 s"):
        feature_of(signal, FeatureParameters(kind=kind))


def test_window_of_one_sample_has_no_step():
    signal = signal_of(np.ones(100))
    with pytest.raises(SignalError, match="contains 1 samples"):
        willison_amplitude(signal, window=1 / RATE)


@pytest.mark.parametrize("kind", ["wamp", "rms", "mav", "envelope"])
def test_gap_is_named(kind):
    s = np.random.default_rng(0).standard_normal((2, 4096))
    s[1, 1024:1034] = np.nan
    with pytest.raises(SignalError, match=r"channel M1 has a gap of 0.004883 s \(10 samples"):
        feature_of(signal_of(s), FeatureParameters(kind=kind))


def test_features_work_on_muscles_as_on_channels():
    signal = signal_of(np.random.default_rng(0).standard_normal((3, 4096)))
    for kind in ("wamp", "rms", "mav", "envelope"):
        parameters = FeatureParameters(kind=kind, threshold=1.0)
        a = feature_of(signal, parameters)
        b = feature_of(signal.rename(channel="muscle"), parameters)
        np.testing.assert_array_equal(a.values, b.values)
        assert b.dims == ("muscle", "time")
