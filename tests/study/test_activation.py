"""From recording to activation: Eqs 2-8, strategies, normalisation reach, failures."""

import json
import warnings

import numpy as np
import pytest
import xarray as xr

from emgface.activation import activation_of, check_activation, feature_range
from emgface.choices import configure
from emgface.errors import (
    ActivationError,
    ConfigurationError,
    FeatureWarning,
    SchemaError,
    SignalError,
    UnitsError,
)
from emgface.features import feature_of
from emgface.mapping import map_channels, mapping_matrix
from emgface.muscles import CHANNELS, INSTRUCTIONS, MODELLED, MUSCLES, RELEVANT
from emgface.normalisation import normalise
from emgface.parameters import NormalisationParameters, SignalChain, StrategyParameters
from emgface.schema import validate
from emgface.signals import bandpass
from emgface.strategies import bilateral_mean, bilateral_variance, select_muscles

RATE = 2048.0
DURATION = 2.5


def recording_of(seed=0, *, gain=1.0, duration=DURATION, **attrs) -> xr.Dataset:
    """Noise whose amplitude rises and falls, later and stronger from channel to channel."""
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


def quantity_of(**values) -> xr.DataArray:
    """One sample per channel; left as given, right ten times as much."""
    data = [values[c[:-2]] * (1 if c.endswith("_L") else 10) for c in CHANNELS]
    return xr.DataArray(
        np.array(data, dtype=float)[:, None],
        dims=("channel", "time"),
        coords={"channel": list(CHANNELS), "time": [0.0]},
    )


MEASURED = quantity_of(OOS=1.0, OOI=2.0, RIS=4.0, ZYG=8.0, LLSAN=16.0, DAO=32.0, MEN=64.0)


def muscle(mapped, name) -> list[float]:
    return [float(mapped.sel(muscle=f"{name}_{side}")[0]) for side in "LR"]


def test_equation_2_orbicularis_oris_peripheralis():
    assert muscle(map_channels(MEASURED), "OOP") == pytest.approx([1.5, 15.0])


def test_equation_3_orbicularis_oris_marginalis_text_and_printed():
    assert muscle(map_channels(MEASURED), "OOM") == pytest.approx([0.3, 3.0])  # 0.10 (1 + 2)
    printed = map_channels(MEASURED, "as_printed")
    assert muscle(printed, "OOM") == pytest.approx([0.35, 3.5])  # 0.10 (OOP 1.5 + OOI 2)
    oop, oom = muscle(map_channels(MEASURED), "OOP"), muscle(map_channels(MEASURED), "OOM")
    assert oom == pytest.approx([0.2 * value for value in oop])  # a fifth, as the text says


def test_equation_4_buccinator():
    assert muscle(map_channels(MEASURED), "BUC") == pytest.approx([6.0, 60.0])


def test_equation_5_levator_anguli_oris():
    assert muscle(map_channels(MEASURED), "LAO") == pytest.approx([12.0, 120.0])


def test_equation_6_depressor_labii_inferioris():
    assert muscle(map_channels(MEASURED), "DLI") == pytest.approx([24.0, 240.0])


def test_direct_muscles_and_order():
    mapped = map_channels(MEASURED)
    for name in ("ZYG", "RIS", "LLSAN", "DAO", "MEN"):
        expected = [float(MEASURED.sel(channel=f"{name}_{side}")[0]) for side in "LR"]
        assert muscle(mapped, name) == expected
    assert tuple(mapped["muscle"].values) == MUSCLES
    assert mapping_matrix().shape == (20, 14)


def test_mapping_does_not_depend_on_the_order_of_channels():
    shuffled = MEASURED.isel(channel=np.random.default_rng(0).permutation(14))
    np.testing.assert_array_equal(map_channels(shuffled).values, map_channels(MEASURED).values)
    extra = xr.concat([shuffled, shuffled[:1].assign_coords(channel=["EKG"])], dim="channel")
    np.testing.assert_array_equal(map_channels(extra).values, map_channels(MEASURED).values)


def test_equation_7_is_the_feature_of_the_chain():
    """The printed double sum on the filtered, mapped signal, at three windows."""
    recording = recording_of()
    chain = SignalChain()
    s = map_channels(bandpass(recording["emg"], chain.filter)).values
    feature = feature_of(map_channels(bandpass(recording["emg"], chain.filter)), chain.feature)
    for t in (0, 1234, feature.sizes["time"] - 1):
        g = [sum(abs(row[t + n - 1] - row[t + n]) >= 10e-6 for n in range(1, 410)) for row in s]
        np.testing.assert_array_equal(feature.values[:, t], g)


def test_equation_8_min_max():
    g = xr.DataArray(
        [[2.0, 6.0, 4.0], [-1.0, 0.0, 3.0]],
        dims=("muscle", "time"),
        coords={"muscle": ["a", "b"], "time": [0.0, 1.0, 2.0]},
    )
    got = normalise(g, None, NormalisationParameters())
    np.testing.assert_allclose(got.values, [[0.0, 1.0, 0.5], [0.0, 0.25, 1.0]], rtol=1e-15)


def test_equation_8_over_a_given_range():
    g = xr.DataArray(
        [[2.0, 6.0]], dims=("muscle", "time"), coords={"muscle": ["a"], "time": [0.0, 1.0]}
    )
    extent = xr.Dataset(
        {"minimum": ("muscle", [0.0]), "maximum": ("muscle", [8.0])}, {"muscle": ["a"]}
    )
    session = NormalisationParameters(reach="session")
    np.testing.assert_allclose(normalise(g, extent, session).values, [[0.25, 0.75]])
    with pytest.raises(ActivationError, match=r"muscle a is 1.5 at t = 1 s.*exceeds.*session"):
        normalise(g, extent / 2, session)
    clipped = normalise(g, extent / 2, NormalisationParameters(reach="session", outside="clip"))
    np.testing.assert_allclose(clipped.values, [[0.5, 1.0]])
    assert clipped.attrs["clipped_fraction"] == 0.5


def test_equation_8_is_0_over_0_for_a_constant_feature():
    g = xr.DataArray(
        [[2.0, 2.0], [0.0, 1.0]],
        dims=("muscle", "time"),
        coords={"muscle": ["a", "b"], "time": [0.0, 1.0]},
    )
    with pytest.raises(SignalError, match="muscle a is constant over the trial, so Eq. 8 is 0/0"):
        normalise(g, None, NormalisationParameters())
    tolerant = normalise(g, None, NormalisationParameters(silent="zero"))
    np.testing.assert_array_equal(tolerant.values, [[0.0, 0.0], [0.0, 1.0]])
    assert tolerant.attrs["silent"] == "a"


def feature_with(variances: dict[str, float], left_share=0.5) -> xr.DataArray:
    """Feature whose bilateral mean has the given variances: a sampled square wave."""
    wave = np.tile([1.0, -1.0], 8)
    rows = [2 * left_share * np.sqrt(variances.get(m, 0.0)) * wave for m in MODELLED]
    rows += [2 * (1 - left_share) * np.sqrt(variances.get(m, 0.0)) * wave for m in MODELLED]
    return xr.DataArray(
        np.array(rows) + 3.0,
        dims=("muscle", "time"),
        coords={"muscle": list(MUSCLES), "time": np.arange(16.0)},
    )


def test_bilateral_mean_and_variance():
    feature = feature_with({"BUC": 4.0, "MEN": 1.0}, left_share=0.9)
    np.testing.assert_allclose(bilateral_mean(feature).sel(muscle="BUC").values[:2], [5.0, 1.0])
    variance = bilateral_variance(feature)
    assert float(variance.sel(muscle="BUC")) == pytest.approx(4.0)
    assert float(variance.sel(muscle="MEN")) == pytest.approx(1.0)
    # Sides that move in opposite directions cancel in the mean.
    feature.loc["BUC_R"] = 6.0 - feature.sel(muscle="BUC_L").values
    assert float(bilateral_variance(feature).sel(muscle="BUC")) == pytest.approx(0.0, abs=1e-15)


def test_act_3_selects_the_largest_variances_and_breaks_ties_in_fixed_order():
    few = StrategyParameters()
    feature = feature_with({"DAO": 9.0, "ZYG": 1.0, "OOM": 4.0, "MEN": 0.5})
    assert select_muscles(feature, "act_3", None, few) == ("DAO", "OOM", "ZYG")
    tied = feature_with({"MEN": 4.0, "DLI": 1.0, "LAO": 1.0, "OOP": 1.0})
    assert select_muscles(tied, "act_3", None, few) == ("MEN", "LAO", "OOP")
    assert select_muscles(tied, "act_3", None, StrategyParameters(n=1)) == ("MEN",)


@pytest.mark.parametrize("instruction", list(INSTRUCTIONS))
def test_act_rel_is_table_1(instruction):
    selected = select_muscles(feature_with({}), "act_rel", instruction, StrategyParameters())
    assert set(selected) == set(RELEVANT[instruction])


def test_act_threshold_selects_relative_to_the_most_active():
    feature = feature_with({"DAO": 16.0, "ZYG": 4.1, "OOM": 3.9})  # deviations 4, 2.02, 1.97
    half = StrategyParameters(threshold=0.5)
    assert select_muscles(feature, "act_threshold", None, half) == ("ZYG", "DAO")
    low = StrategyParameters(threshold=0.1)
    assert select_muscles(feature, "act_threshold", None, low) == ("ZYG", "OOM", "DAO")


def test_unknown_strategy_and_instruction():
    feature = feature_with({})
    with pytest.raises(ConfigurationError, match="unknown strategy 'act_al', did you mean"):
        select_muscles(feature, "act_al", None, StrategyParameters())
    for instruction in ("G", None):
        with pytest.raises(ConfigurationError, match="has no row in the table"):
            select_muscles(feature, "act_rel", instruction, StrategyParameters())


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
    """Eq. 8 removes a factor applied before it: of features, LAO = LLSAN and OOM = OOP."""
    recording = recording_of()
    a = {
        stage: activation_of(recording, chain_of(mapping={"mapping_stage": stage}))["activation"]
        for stage in ("signal", "feature", "activation")
    }

    def of(stage, name):
        return a[stage].sel(muscle=name).values

    for factor, derived, direct in (
        (0.75, "LAO_L", "LLSAN_L"),
        (0.75, "DLI_R", "DAO_R"),
        (0.2, "OOM_L", "OOP_L"),
    ):
        np.testing.assert_allclose(of("feature", derived), of("feature", direct), atol=1e-12)
        np.testing.assert_allclose(
            of("activation", derived), factor * of("activation", direct), atol=1e-12
        )
        assert np.abs(of("signal", derived) - of("signal", direct)).max() > 0.01


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
    # A concave shape lies above the diagonal; resampling means of it stay above as well.
    assert np.all(c >= u - 1e-12) and np.max(c - u) > 0.2


def test_session_range_keeps_a_weak_trial_weak():
    """Over the trial a whisper reaches 1; over the session it does not."""
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
    # Amplitude 0.4 of the loud trial, give or take the spread of a 0.2 s RMS (about 5 %).
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


def test_ranges_that_do_not_fit():
    chain = chain_of(normalisation={"reach": "session"})
    with pytest.raises(ConfigurationError, match="needs its minimum and maximum, found none"):
        activation_of(recording_of(), chain)
    other = feature_range([recording_of()], chain_of(feature={"kind": "rms"}))
    with pytest.raises(ConfigurationError, match="other filter, feature or mapping parameters"):
        activation_of(recording_of(), chain, session=other)
    foreign = feature_range([recording_of(volunteer="V2")], chain)
    with pytest.raises(ConfigurationError, match="of volunteer 'V2', the recording of 'V1'"):
        activation_of(recording_of(), chain, session=foreign)
    with pytest.raises(ConfigurationError, match="several volunteers"):
        feature_range([recording_of(), recording_of(volunteer="V2")], chain)
    with pytest.raises(SignalError, match="no recording given"):
        feature_range([], chain)


def test_interval_is_that_of_emg_and_markers_together():
    recording = recording_of()
    recording = recording.assign_coords(time_marker=np.arange(101) / 100.0 + 0.5)
    time = activation_of(recording, SignalChain())["time"].values
    assert time[0] == 0.5 and time[-1] == pytest.approx(1.5)
    late = recording.assign_coords(time_marker=np.arange(101) / 100.0 + 9.5)
    with pytest.raises(SignalError, match="recorded at the same time"):
        activation_of(late, SignalChain())


def test_constant_channel():
    recording = recording_of()
    recording["emg"].loc["RIS_R"] = 0.3
    with pytest.raises(SignalError, match="channel RIS_R holds one value throughout"):
        activation_of(recording, SignalChain())
    tolerant = chain_of(normalisation={"silent": "zero"}, feature={"kind": "rms"})
    result = activation_of(recording, tolerant)
    assert not result["activation"].sel(muscle="RIS_R").any()
    # BUC of that side still follows its other channel.
    assert float(result["activation"].sel(muscle="BUC_R").max()) > 0.9
    assert result.attrs["silent"].split() == ["RIS_R"]


def test_threshold_in_millivolts_warns_and_then_fails_on_0_over_0():
    """The printed unit: every Willison amplitude is zero."""
    chain = chain_of(feature={"threshold": 10e-3})
    with pytest.warns(FeatureWarning, match="zero in every window"):
        with pytest.raises(SignalError, match="no step of muscle ZYG_L, .* lower the threshold"):
            activation_of(recording_of(), chain)


def test_muscle_at_rest_is_no_failure_unless_it_is_to_be():
    recording = recording_of()
    recording["emg"].loc["LLSAN_L"] *= 0.01  # a living electrode, two microvolts
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
    with pytest.raises(SignalError, match="half the sampling rate of 512 Hz"):
        activation_of(recording_of().isel(time_emg=slice(None, None, 4)), SignalChain())
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
