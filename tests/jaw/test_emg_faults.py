"""Faulty recordings of a jaw: an error, a warning, or the correct excitation."""

import warnings

import numpy as np
import pytest
import xarray as xr

from emgface.anatomy.jaw.effort import tell_exchanged_sides
from emgface.anatomy.jaw.emg import excitation_of
from emgface.anatomy.jaw.recorded import score_motion, simulated_recording
from emgface.anatomy.jaw.run import run_task
from emgface.anatomy.jaw.series import excitation_in, started
from emgface.anatomy.jaw.tasks import JAW_TASKS
from emgface.anatomy.jaw.template import template_jaw
from emgface.choices import configure
from emgface.errors import FeatureWarning, JawError, MarkerError, SignalError
from emgface.signals.parameters import SignalChain

STEP = 5e-3
CHANNELS = ("TEM", "MAS", "DIG")


def chain(kind):
    given = {"feature": {"kind": kind}, "normalisation": {"outside": "clip"}}
    return configure(SignalChain, given, where="test")


@pytest.fixture(scope="module")
def recorded():
    """A motion, its recording, and one of maximum effort."""
    jaw = template_jaw(preset="woman")
    motions = [
        run_task(jaw, JAW_TASKS[name], step=STEP, check=False) for name in ("cycles", "effort")
    ]
    return motions[0], *(simulated_recording(motion, person=3) for motion in motions)


def scaled(recording, factor, channel=None):
    copied = recording.copy(deep=True)
    own = slice(None) if channel is None else copied["channel"].values == channel
    copied["emg"].values[own] *= factor
    return copied


def noisy(recording, channel):
    """The recording with a channel that holds the noise of a loose electrode alone."""
    copied = recording.copy(deep=True)
    noise = np.random.default_rng(5).standard_normal(copied.sizes["time_emg"])
    copied["emg"].values[copied["channel"].values == channel] = 5e-6 * noise
    return copied


def resampled(recording, rate):
    t = recording["time_emg"].values
    at = np.arange(t[0], t[-1], 1.0 / rate)
    emg = np.array([np.interp(at, t, row) for row in recording["emg"].values])
    coords = {"channel": recording["channel"].values, "time_emg": ("time_emg", at, {"units": "s"})}
    return xr.Dataset(
        {"emg": (("channel", "time_emg"), emg, {"units": "V"})}, coords, recording.attrs
    )


def test_sides_and_polarity_are_those_of_the_electrodes(recorded):
    """Exchanged labels exchange the sides of all excitations; a channel has no polarity."""
    _, own, effort = recorded
    u = excitation_of(own, chain("rms"), reference=[effort])["excitation"]
    both = [exchanged(r) for r in (own, effort)]
    excitation = excitation_of(both[0], chain("rms"), reference=both[1:])["excitation"]
    for exciter in ("t", "m", "ad"):
        np.testing.assert_allclose(
            excitation.sel(exciter=f"{exciter}_L"), u.sel(exciter=f"{exciter}_R"), atol=1e-12
        )
    upside = excitation_of(scaled(own, -1.0), chain("rms"), reference=[effort])["excitation"]
    np.testing.assert_allclose(upside, u, atol=1e-12)
    both = [scaled(r, 1e3) for r in (own, effort)]  # the same gain or unit of both
    excitation = excitation_of(both[0], chain("rms"), reference=both[1:])["excitation"]
    np.testing.assert_allclose(excitation, u, atol=1e-12)


def test_noise_is_not_amplified_to_effort(recorded):
    """A channel without contraction is at rest without a reference, and an invalid reference."""
    _, own, effort = recorded
    loose = noisy(own, "MAS_L")
    with pytest.warns(FeatureWarning, match=r"channel MAS_L: .* excitation is zero"):
        excitation = excitation_of(loose, chain("rms"))
    assert excitation.attrs["resting"] == "MAS_L"
    assert float(excitation["excitation"].sel(exciter="m_L").max()) == 0.0
    assert float(excitation["excitation"].sel(exciter="m_R").max()) > 0.9
    with pytest.raises(JawError, match=r"channel MAS_L is .* expected at least 2 times"):
        excitation_of(loose, chain("rms"), reference=[noisy(effort, "MAS_L")])


@pytest.mark.parametrize("kind", ["rms", "wamp"])
def test_other_units_and_gains_of_the_reference_are_refused(recorded, kind):
    """A reference 20 times too strong, and more, made every muscle silent without a word."""
    _, own, effort = recorded
    for factor in (20.0, 1e3):
        with pytest.raises(JawError, match=r"is at rest .* units and gains of both"):
            excitation_of(own, chain(kind), reference=[scaled(effort, factor)])
    with pytest.raises(JawError, match="in the median .* check the units"):
        excitation_of(scaled(own, 1e3), chain(kind), reference=[effort])
    with pytest.warns(FeatureWarning, match=r"relative to the other channels, in MAS_L \("):
        excitation_of(scaled(own, 10.0, "MAS_L"), chain("rms"), reference=[effort])


def test_counts_are_not_compared_over_rates_and_units(recorded):
    """The Willison amplitude of another rate or unit is refused; the RMS of another rate is the same."""
    _, own, effort = recorded
    with pytest.raises(JawError, match="1000 Hz and a reference at 2048 Hz"):
        excitation_of(resampled(own, 1000.0), chain("wamp"), reference=[effort])
    both = [scaled(r, 1e3) for r in (own, effort)]
    with pytest.raises(JawError, match="threshold is exceeded at rest"):
        excitation_of(both[0], chain("wamp"), reference=both[1:])
    u, other = (
        excitation_of(r, chain("rms"), reference=[e])["excitation"].sel(exciter="ad_L").values
        for r, e in ((own, effort), (resampled(own, 4096.0), resampled(effort, 4096.0)))
    )
    n = min(len(u), len(other))
    np.testing.assert_allclose(other[:n], u[:n], atol=0.01)


def test_gaps_units_and_positions_that_no_jaw_has_are_refused(recorded):
    motion, own, effort = recorded
    broken = own.copy(deep=True)
    broken["emg"].values[0, 500:600] = np.nan
    with pytest.raises(SignalError, match="channel TEM_L has a gap of 0.04883 s"):
        excitation_of(broken, chain("rms"), reference=[effort])
    u = excitation_of(own, chain("rms"), reference=[effort])
    percent = u.assign(excitation=(100.0 * u["excitation"]).assign_attrs(units="%"))
    with pytest.raises(JawError, match=r"unit of excitation is '%', expected 1"):
        excitation_in(percent)
    far = own.copy(deep=True)
    far["position"].values[:] *= 1e3
    with pytest.raises(MarkerError, match=r"lower_incisor moves by .* m, expected less than 0.2 m"):
        score_motion(far, motion)


def exchanged(recording):
    other = {f"{c}_{a}": f"{c}_{b}" for c in CHANNELS for a, b in ("LR", "RL")}
    return recording.assign_coords(channel=[other[str(c)] for c in recording["channel"].values])


def test_sides_that_are_exchanged_in_one_file_are_reported(recorded):
    """The motion then scored 0.89 instead of 0.91; exchanged in both files, nothing shows it."""
    _, own, effort = recorded
    for a, b in ((own, exchanged(effort)), (exchanged(own), effort)):
        with pytest.warns(FeatureWarning, match="left and right seem to be exchanged"):
            excitation_of(a, chain("rms"), reference=[b])
    for a, b in ((own, effort), (exchanged(own), exchanged(effort))):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            excitation_of(a, chain("rms"), reference=[b])


def test_levels_of_one_sided_movements_are_no_exchange():
    """Electrodes of one side pick up twice as much; muscles of the other side work thrice as hard."""
    names = [f"{c}_{s}" for s in "LR" for c in CHANNELS]
    gain = np.array([1.0, 2.0, 0.7, 1.5, 1.0, 1.0])
    own = np.array([0.3, 0.2, 0.4, 0.1, 0.3, 0.4]) * gain
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        tell_exchanged_sides(names, np.tile(own, (3, 1)), [np.tile(gain, (3, 1))])
        tell_exchanged_sides(names[:3], np.tile(own[:3], (3, 1)), [np.tile(gain[:3], (3, 1))])
    wrong = 0.3 * gain[[3, 4, 5, 0, 1, 2]]
    with pytest.warns(FeatureWarning, match="TEM 2.25, MAS 0.25, DIG 2.04 times as strong"):
        tell_exchanged_sides(names, np.tile(wrong, (3, 1)), [np.tile(gain, (3, 1))])


def test_another_rate_than_that_of_the_willison_threshold_is_reported(recorded):
    """With 1000 Hz in both files the motion scored 0.11 instead of 0.92 at 2048 Hz."""
    _, own, effort = recorded
    low = [resampled(r, 1000.0) for r in (own, effort)]
    with pytest.warns(
        FeatureWarning, match=r"10 uV .* 2048 Hz, .* at 1000 Hz, 0.49 times as often"
    ):
        excitation_of(low[0], chain("wamp"), reference=low[1:])
    with pytest.warns(FeatureWarning, match="at 4096 Hz, 2 times as often: steps are smaller"):
        excitation_of(resampled(own, 4096.0), chain("wamp"), reference=[resampled(effort, 4096.0)])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", "the pass-band ends at 450 Hz")
        excitation_of(own, chain("wamp"), reference=[effort])
        excitation_of(low[0], chain("rms"), reference=low[1:])


def test_a_published_series_of_one_instant_is_read():
    assert started("a.txt", ["1.5", "1.5", "1"], np.zeros(1)) == [1.5]
    with pytest.raises(JawError, match="do not ascend"):
        started("a.txt", ["1.5", "1.4", "1"], np.zeros(1))
