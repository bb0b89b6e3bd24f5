"""Every step of the accessor ``emg`` equals that of the signal chain."""

import copy
import inspect
import pickle
import warnings

import numpy as np
import pytest
import xarray as xr

import emgface  # noqa: F401  # registers the accessor
from emgface._xarray import _FORMER
from emgface.errors import ConfigurationError, SchemaError, SignalError
from emgface.muscles import RELEVANT
from emgface.signals.accessor import Steps
from emgface.signals.activation import activation_of, feature_before_normalisation, feature_range
from emgface.signals.features import feature_of
from emgface.signals.filters import bandpass
from emgface.signals.parameters import FeatureParameters, FilterParameters
from tests.study.recordings import chain_of, recording_of


@pytest.fixture(scope="module")
def recording():
    return recording_of()


@pytest.mark.parametrize("filtering", [{}, {"low": 30.0, "order": 2}, {"phase": "causal"}])
def test_bandpass_is_that_of_the_chain(recording, filtering):
    wanted = bandpass(recording["emg"], FilterParameters(**filtering))
    for given in (recording, recording["emg"]):
        filtered = given.semg.bandpass(**filtering)
        np.testing.assert_array_equal(filtered.values, wanted.values)
        assert filtered.attrs["filter_low"] == wanted.attrs["filter_low"]


@pytest.mark.parametrize(
    "kind, choices",
    [
        ("wamp", {"threshold": 2e-5, "window": 0.1}),
        ("wamp", {"threshold_baseline": 3.0, "baseline_start": 0.0, "baseline_stop": 0.2}),
        ("rms", {"label": "end"}),
        ("mav", {}),
        ("envelope", {"delay": 0.02}),
    ],
)
@pytest.mark.parametrize("phase", ["zero", "causal"])
def test_features_are_those_of_the_chain(recording, kind, choices, phase):
    filtered = recording["emg"].semg.bandpass(phase=phase)
    wanted = feature_of(filtered, FeatureParameters(kind=kind, **choices), phase=phase)
    xr.testing.assert_identical(getattr(filtered.semg, kind)(**choices), wanted)


@pytest.mark.parametrize("stage", ["signal", "feature", "activation"])
def test_chained_steps_give_the_activation(recording, stage):
    """For each `mapping_stage`; with envelope and shape for one of them."""
    steps = ["bandpass", "wamp", "normalise", "resample"]
    steps.insert(1 + ["signal", "feature", "activation"].index(stage), "muscles")
    chain = chain_of(mapping={"mapping_stage": stage}, resampling={"steps": 100})
    chained = recording
    for step in steps:
        chained = getattr(chained.semg, step)(**({"steps": 100} if step == "resample" else {}))
    wanted = activation_of(recording, chain, strategy="act_all")["activation"]
    np.testing.assert_allclose(chained["time"], wanted["time"], rtol=0, atol=0)
    np.testing.assert_array_equal(chained.values, wanted.values)


def test_chained_envelope_gives_the_activation(recording):
    chain = chain_of(feature={"kind": "envelope", "A": -2.0})
    wanted = activation_of(recording, chain, strategy="act_all")["activation"]
    envelope = recording.semg.bandpass().semg.muscles().semg.envelope()
    resampled = envelope.semg.normalise().semg.shape(A=-2.0).semg.resample()
    np.testing.assert_array_equal(resampled.values, wanted.values)


def test_normalisation_over_a_session(recording):
    chain = chain_of(normalisation={"reach": "session", "outside": "clip"})
    weak = recording_of(1, gain=0.5)
    extent = feature_range([recording, weak], chain)
    feature, _ = feature_before_normalisation(weak, chain)
    resampled = feature.semg.normalise(extent, outside="clip").semg.resample()
    wanted = activation_of(weak, chain, strategy="act_rel", session=extent)["activation"]
    relevant = [m for m in wanted["muscle"].values if m[:-2] in RELEVANT["A"]]
    np.testing.assert_array_equal(resampled.sel(muscle=relevant), wanted.sel(muscle=relevant))


def test_a_step_carries_what_identifies_the_trial(recording):
    assert recording.semg.bandpass().semg.rms().attrs["origin"] == "simulated"
    assert recording.semg.bandpass().attrs["volunteer"] == "V1"


def test_the_variable_of_a_recording_is_an_array(recording):
    variable = recording["emg"]
    assert isinstance(recording.emg, xr.DataArray)
    assert np.asarray(recording.emg).shape == variable.shape
    for array, wanted in (
        (recording.emg, variable),
        (recording.emg * 1e6, variable * 1e6),
        (recording.emg.sel(channel="ZYG_L"), variable.sel(channel="ZYG_L")),
        (np.abs(recording.emg), np.abs(variable)),
        (recording.assign(emg=2.0 * recording.emg).emg, 2.0 * variable),
        (pickle.loads(pickle.dumps(recording.emg)), variable),
        (copy.deepcopy(recording.emg), variable),
    ):
        xr.testing.assert_identical(array, wanted)
    assert type(recording.emg * 1e6) is xr.DataArray
    assert "bandpass" in repr(recording.semg) and "(channel: 14" in repr(recording.semg)
    with pytest.raises(AttributeError, match="has no attribute 'wimp'"):
        recording["emg"].semg.wimp  # noqa: B018
    with pytest.raises(AttributeError, match="has no attribute 'emg'"):
        recording.drop_vars("emg").emg  # noqa: B018
    assert not hasattr(recording.drop_vars("emg"), "emg")


def test_the_former_name_of_the_accessor_warns_for_one_release(recording):
    with pytest.warns(DeprecationWarning, match=r"write \.semg"):
        old = recording.emg.bandpass(low=20.0)
    xr.testing.assert_identical(old, recording.semg.bandpass(low=20.0))
    assert old.attrs["origin"] == "simulated"
    with pytest.warns(DeprecationWarning, match=r"write \.semg"):
        xr.testing.assert_identical(old.emg.wamp(), old.semg.wamp())
    steps = [name for name in vars(Steps) if not name.startswith("_")]
    assert set(_FORMER[1:]) == {name for name in steps if name not in ("shape", "resample")}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        recording.emg.mean()


def test_steps_name_their_choices(recording):
    parameters = inspect.signature(recording.semg.bandpass).parameters
    assert parameters["low"].default == 15.0 and "phase" in parameters
    with pytest.raises(ConfigurationError, match="did you mean 'low'"):
        recording.semg.bandpass(lo=20.0)


def test_muscles_of_a_recording_of_some_channels(recording):
    part = recording.sel(channel=["ZYG_L", "RIS_L"])
    feature = part.semg.bandpass().semg.muscles(["ZYG_L", "BUC_L"])
    whole = recording.semg.bandpass().semg.muscles()
    np.testing.assert_allclose(
        feature.values, whole.sel(muscle=feature["muscle"]).values, rtol=1e-12
    )
    with pytest.raises(SchemaError, match="no channel of the muscles"):
        part.semg.bandpass().semg.muscles()


def test_variables_that_are_not_signals_are_refused(recording):
    with pytest.raises(SchemaError, match="expected emg"):
        xr.Dataset({"a": ("x", [1.0])}).semg.bandpass()
    with pytest.raises(SignalError, match="expected a feature over 'time'"):
        recording.semg.resample()
