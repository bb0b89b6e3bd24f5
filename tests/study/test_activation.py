"""From recording to activation: completeness, checks and errors."""

import json
import warnings

import numpy as np
import pytest
import xarray as xr

from emgface.errors import (
    ActivationError,
    ConfigurationError,
    FeatureWarning,
    SchemaError,
    SignalError,
    UnitsError,
)
from emgface.muscles import MODELLED, MUSCLES
from emgface.schema.validation import validate
from emgface.signals.activation import activation_of, check_activation, feature_range
from emgface.signals.parameters import SignalChain
from tests.study.recordings import DURATION, RATE, chain_of, recording_of


@pytest.mark.parametrize("stage", ["signal", "feature", "activation"])
@pytest.mark.parametrize("strategy", ["act_all", "act_3", "act_rel", "act_threshold"])
def test_activation_is_complete_and_checked(stage, strategy):
    chain = chain_of(mapping={"mapping_stage": stage})
    result = activation_of(recording_of(), chain, strategy=strategy)
    a = result["activation"]
    assert a.dims == ("muscle", "time") and a.sizes == {"muscle": 20, "time": 161}
    assert a.attrs["units"] == "1" and a["time"].attrs["units"] == "s"
    assert a.dtype == np.float64 and float(a.min()) >= 0.0 and float(a.max()) <= 1.0
    selected = result.attrs["selected"].split()
    on = [m for m in MUSCLES if float(a.sel(muscle=m).max()) > 0]
    assert on == [m for m in MUSCLES if m[:-2] in selected]
    assert result.attrs["strategy"] == strategy and result.attrs["instruction"] == "A"
    assert json.loads(result.attrs["parameters"])["mapping"]["mapping_stage"] == stage
    # Valid instants of a centred window: half a window after the start, to half before the end.
    assert a.time.values[0] == pytest.approx(409 / 2 / RATE)
    assert a.time.values[-1] == pytest.approx(DURATION - 1 / RATE - 409 / 2 / RATE)
    validate(result, "activation")


def test_little_in_common_of_semg_and_markers_is_a_warning():
    """As with half of the true sampling rate of the sEMG, or markers with another clock."""
    recording = recording_of()
    recording = recording.assign_coords(time_marker=np.linspace(0.0, DURATION, 251))
    with warnings.catch_warnings():
        warnings.simplefilter("error", FeatureWarning)
        activation_of(recording, SignalChain())
    wrong_rate = recording.assign_coords(time_marker=0.5 * recording["time_marker"])
    with pytest.warns(FeatureWarning, match=r"1.25 s in common, the only part that is used"):
        activation_of(wrong_rate, SignalChain())


def test_a_recording_without_samples_is_refused():
    with pytest.raises(SchemaError, match="no samples"):
        activation_of(recording_of().isel(time_emg=slice(0, 0)), SignalChain())


def test_attributes_survive_netcdf(tmp_path):
    result = activation_of(recording_of(), SignalChain(), strategy="act_3")
    result.to_netcdf(tmp_path / "activation.nc")
    back = xr.load_dataset(tmp_path / "activation.nc")
    xr.testing.assert_identical(back["activation"].drop_attrs(), result["activation"].drop_attrs())
    assert back.attrs["selected"] == result.attrs["selected"]
    assert back.attrs["window_samples"] == 410
    np.testing.assert_allclose(back.attrs["edge_gain"], -6.0206, atol=1e-4)
    assert SignalChain.model_validate_json(back.attrs["parameters"]) == SignalChain()


def test_stage_of_the_mapping_decides_whether_factors_survive():
    """Eq. 8 removes a factor applied before it: with features, LAO = LLSAN and OOM = OOP."""
    recording = recording_of()
    a = {
        stage: activation_of(recording, chain_of(mapping={"mapping_stage": stage}))["activation"]
        for stage in ("signal", "feature", "activation")
    }

    def signal(stage, name):
        return a[stage].sel(muscle=name).values

    for factor, derived, direct in (
        (0.75, "LAO_L", "LLSAN_L"),
        (0.75, "DLI_R", "DAO_R"),
        (0.2, "OOM_L", "OOP_L"),
    ):
        np.testing.assert_allclose(
            signal("feature", derived), signal("feature", direct), atol=1e-12
        )
        np.testing.assert_allclose(
            signal("activation", derived), factor * signal("activation", direct), atol=1e-12
        )
        assert np.abs(signal("signal", derived) - signal("signal", direct)).max() > 0.01


def test_linear_features_agree_whether_mapped_before_or_after():
    """The mapping of one channel to one muscle commutes with a homogeneous feature."""
    recording = recording_of()
    rms = {"kind": "rms"}
    signal = activation_of(recording, chain_of(feature=rms, mapping={"mapping_stage": "signal"}))
    feature = activation_of(recording, chain_of(feature=rms, mapping={"mapping_stage": "feature"}))
    for name in ("LAO_L", "LLSAN_L", "DLI_R", "MEN_R"):
        np.testing.assert_allclose(
            signal["activation"].sel(muscle=name),
            feature["activation"].sel(muscle=name),
            atol=1e-9,
        )


@pytest.mark.parametrize("kind", ["rms", "mav", "envelope"])
def test_other_features_recover_the_amplitude_better_than_chance(kind):
    recording = recording_of(duration=4.0)
    a = activation_of(recording, chain_of(feature={"kind": kind}))["activation"]
    for k, channel in ((0, "OOS_L"), (13, "MEN_R")):
        if channel[:-2] not in MODELLED:
            continue
        peak = np.linspace(0.3, 0.7, 14)[k] * 4.0
        expected = np.exp(-(((a.time.values - peak) / 0.3) ** 2))
        assert np.corrcoef(a.sel(muscle=channel).values, expected)[0, 1] > 0.9


def test_envelope_applies_the_muscle_shape_after_normalisation():
    recording = recording_of()
    curved = activation_of(recording, chain_of(feature={"kind": "envelope", "A": -3.0}))
    linear = activation_of(recording, chain_of(feature={"kind": "envelope", "A": 0.0}))
    assert curved.attrs["A"] == -3.0
    c, u = curved["activation"].values, linear["activation"].values
    # A concave shape is above the diagonal, and so are its resampled means.
    assert np.all(c >= u - 1e-12) and np.max(c - u) > 0.2


def test_session_range_keeps_a_weak_trial_weak():
    """A weak trial reaches 1 if normalised over the trial, but not over the session."""
    loud, weak = recording_of(0), recording_of(1, gain=0.4, repetition=2)
    rms = {"kind": "rms"}
    chain = chain_of(feature=rms, normalisation={"reach": "session"})
    session = feature_range([loud, weak], chain)
    assert session.attrs["recordings"] == 2 and session.attrs["volunteer"] == "V1"
    a = {
        name: activation_of(trial, chain, session=session)["activation"]
        for name, trial in (("loud", loud), ("weak", weak))
    }
    own = activation_of(weak, chain_of(feature=rms))["activation"]
    assert float(own.max("time").min()) > 0.95
    assert float(a["loud"].max("time").min()) > 0.95
    # Amplitude 0.4 of the strong trial, within the standard deviation of a 0.2 s RMS (about 5 %).
    peaks = a["weak"].max("time").values
    assert np.all((peaks > 0.3) & (peaks < 0.55))


def test_session_extremes_are_those_of_the_trials():
    trials = [recording_of(k) for k in range(3)]
    for stage, dim in (("signal", "muscle"), ("activation", "channel")):
        chain = chain_of(mapping={"mapping_stage": stage}, normalisation={"reach": "session"})
        whole = feature_range(trials, chain)
        single = [feature_range([trial], chain) for trial in trials]
        for name, extreme in (("minimum", np.min), ("maximum", np.max)):
            expected = extreme([one[name].values for one in single], axis=0)
            np.testing.assert_array_equal(whole[name].values, expected)
            assert whole[name].dims == (dim,)
        result = activation_of(trials[0], chain, session=whole)
        assert float(result["activation"].max()) <= 1.0


def test_reference_that_is_too_weak():
    rms = {"kind": "rms"}
    chain = chain_of(feature=rms, normalisation={"reach": "reference"})
    reference = feature_range([recording_of(3, gain=0.5)], chain)
    with pytest.raises(ActivationError, match="exceeds the range of the reference"):
        activation_of(recording_of(), chain, reference=reference)
    clipping = chain_of(feature=rms, normalisation={"reach": "reference", "outside": "clip"})
    result = activation_of(recording_of(), clipping, reference=reference)
    assert 0 < result.attrs["clipped_fraction"] < 1


def test_ranges_that_do_not_match_are_refused():
    chain = chain_of(normalisation={"reach": "session"})
    with pytest.raises(ConfigurationError, match="requires its minimum and maximum, found none"):
        activation_of(recording_of(), chain)
    other = feature_range([recording_of()], chain_of(feature={"kind": "rms"}))
    with pytest.raises(ConfigurationError, match="mapping parameters that differ"):
        activation_of(recording_of(), chain, session=other)
    foreign = feature_range([recording_of(volunteer="V2")], chain)
    with pytest.raises(ConfigurationError, match="of volunteer 'V2', the recording of 'V1'"):
        activation_of(recording_of(), chain, session=foreign)
    with pytest.raises(ConfigurationError, match="several volunteers"):
        feature_range([recording_of(), recording_of(volunteer="V2")], chain)
    with pytest.raises(SignalError, match="no recording specified"):
        feature_range([], chain)


def test_interval_is_that_of_emg_and_markers_together():
    recording = recording_of()
    recording = recording.assign_coords(time_marker=np.arange(101) / 100.0 + 0.5)
    time = activation_of(recording, SignalChain())["time"].values
    assert time[0] == 0.5 and time[-1] == pytest.approx(1.5)
    late = recording.assign_coords(time_marker=np.arange(101) / 100.0 + 9.5)
    with (
        pytest.warns(FeatureWarning, match="have nothing in common"),
        pytest.raises(SignalError, match="recorded at the same time"),
    ):
        activation_of(late, SignalChain())


def test_constant_channel():
    recording = recording_of()
    recording["emg"].loc["RIS_R"] = 0.3
    with pytest.raises(SignalError, match="channel RIS_R holds one value throughout"):
        activation_of(recording, SignalChain())
    tolerant = chain_of(normalisation={"silent": "zero"}, feature={"kind": "rms"})
    result = activation_of(recording, tolerant)
    assert not result["activation"].sel(muscle="RIS_R").any()
    # BUC of that side is estimated from its other channel.
    assert float(result["activation"].sel(muscle="BUC_R").max()) > 0.9
    assert result.attrs["silent"].split() == ["RIS_R"]


def test_threshold_in_millivolts_warns_and_then_fails_on_0_over_0():
    """The printed unit: every Willison amplitude is zero."""
    chain = chain_of(feature={"threshold": 10e-3})
    with pytest.warns(FeatureWarning, match="zero in every window"):
        with pytest.raises(SignalError, match="no step of muscle ZYG_L, .* lower the threshold"):
            activation_of(recording_of(), chain)


def test_a_muscle_at_rest_fails_only_on_request():
    recording = recording_of()
    recording["emg"].loc["LLSAN_L"] *= 0.01  # an intact electrode with two microvolts
    with pytest.warns(FeatureWarning, match="LAO_L is zero"):
        result = activation_of(recording, SignalChain())
    assert not result["activation"].sel(muscle=["LLSAN_L", "LAO_L"]).any()
    assert result.attrs["resting"].split() == ["LLSAN_L", "LAO_L"]
    strict = chain_of(normalisation={"resting": "error"})
    with pytest.warns(FeatureWarning):
        with pytest.raises(SignalError, match="no step of muscle LLSAN_L, LAO_L reaches"):
            activation_of(recording, strict)


def test_missing_channel_wrong_unit_no_emg():
    recording = recording_of()
    with pytest.raises(SchemaError, match="missing channels OOI_L, MEN_R "):
        activation_of(recording.drop_sel(channel=["OOI_L", "MEN_R"]), SignalChain())
    with pytest.raises(SchemaError, match="expected emg"):
        activation_of(recording.drop_vars("emg"), SignalChain())
    recording["emg"].attrs["units"] = "mV"
    with pytest.raises(UnitsError, match="'mV', expected 'V'"):
        activation_of(recording, SignalChain())


def test_gap_rate_and_length_reach_the_caller():
    gap = recording_of()
    gap["emg"].loc["ZYG_L"][100:103] = np.nan
    with pytest.raises(SignalError, match="channel ZYG_L has a gap"):
        activation_of(gap, SignalChain())
    with pytest.warns(FeatureWarning, match="ends at 230.4 Hz instead of 500 Hz"):
        slow = activation_of(recording_of().isel(time_emg=slice(None, None, 4)), SignalChain())
    assert slow.attrs["filter_high"] == pytest.approx(230.4)
    with pytest.raises(SignalError, match="at least an octave of the pass-band"):
        activation_of(recording_of().isel(time_emg=slice(None, None, 40)), SignalChain())
    with pytest.raises(SignalError, match="shorter than"):
        activation_of(recording_of(duration=0.15), SignalChain())


@pytest.mark.parametrize("value", [-0.01, 1.01, np.nan, np.inf])
def test_activation_outside_0_to_1(value):
    a = xr.DataArray(
        [[0.0, 1.0], [0.5, value]],
        dims=("muscle", "time"),
        coords={"muscle": ["ZYG_L", "MEN_L"], "time": [0.0, 0.25]},
    )
    with pytest.raises(ActivationError, match="muscle MEN_L is .* at t = 0.25 s"):
        check_activation(a)
    check_activation(a[:1])


def test_recording_is_left_as_it_was():
    recording = recording_of()
    before = recording.copy(deep=True)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        activation_of(recording, SignalChain())
    xr.testing.assert_identical(recording, before)


def test_millivolts_declared_for_microvolts_are_reported():
    recording = recording_of()
    recording["emg"] = (recording["emg"] * 1e3).assign_attrs(units="V")
    with pytest.warns(FeatureWarning, match="varies by .* V after the filter, .* check the unit"):
        activation_of(recording, SignalChain())
