"""Every step of the accessor ``emg`` equals that of the signal chain."""

import inspect

import numpy as np
import pytest
import xarray as xr

import emgface  # noqa: F401  # registers the accessor
from emgface.errors import ConfigurationError, SchemaError, SignalError
from emgface.muscles import RELEVANT
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
        found = given.emg.bandpass(**filtering)
        np.testing.assert_array_equal(found.values, wanted.values)
        assert found.attrs["filter_low"] == wanted.attrs["filter_low"]


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
    filtered = recording["emg"].emg.bandpass(phase=phase)
    wanted = feature_of(filtered, FeatureParameters(kind=kind, **choices), phase=phase)
    xr.testing.assert_identical(getattr(filtered.emg, kind)(**choices), wanted)


@pytest.mark.parametrize("stage", ["signal", "feature", "activation"])
def test_chained_steps_give_the_activation(recording, stage):
    """For each `mapping_stage`; with envelope and shape for one of them."""
    steps = ["bandpass", "wamp", "normalise", "resample"]
    steps.insert(1 + ["signal", "feature", "activation"].index(stage), "muscles")
    chain = chain_of(mapping={"mapping_stage": stage}, resampling={"steps": 100})
    found = recording
    for step in steps:
        found = getattr(found.emg, step)(**({"steps": 100} if step == "resample" else {}))
    wanted = activation_of(recording, chain, strategy="act_all")["activation"]
    np.testing.assert_allclose(found["time"], wanted["time"], rtol=0, atol=0)
    np.testing.assert_array_equal(found.values, wanted.values)


def test_chained_envelope_gives_the_activation(recording):
    chain = chain_of(feature={"kind": "envelope", "A": -2.0})
    wanted = activation_of(recording, chain, strategy="act_all")["activation"]
    envelope = recording.emg.bandpass().emg.muscles().emg.envelope()
    found = envelope.emg.normalise().emg.shape(A=-2.0).emg.resample()
    np.testing.assert_array_equal(found.values, wanted.values)


def test_normalisation_over_a_session(recording):
    chain = chain_of(normalisation={"reach": "session", "outside": "clip"})
    weak = recording_of(1, gain=0.5)
    extent = feature_range([recording, weak], chain)
    feature, _ = feature_before_normalisation(weak, chain)
    found = feature.emg.normalise(extent, outside="clip").emg.resample()
    wanted = activation_of(weak, chain, strategy="act_rel", session=extent)["activation"]
    relevant = [m for m in wanted["muscle"].values if m[:-2] in RELEVANT["A"]]
    np.testing.assert_array_equal(found.sel(muscle=relevant), wanted.sel(muscle=relevant))


def test_a_step_carries_what_identifies_the_trial(recording):
    assert recording.emg.bandpass().emg.rms().attrs["origin"] == "simulated"
    assert recording.emg.bandpass().attrs["volunteer"] == "V1"


def test_other_attributes_are_those_of_the_variable(recording):
    assert recording.emg.sizes == recording["emg"].sizes
    assert recording.emg.sel(channel="ZYG_L").dims == ("time_emg",)
    assert "bandpass" in repr(recording.emg) and "(channel: 14" in repr(recording.emg)
    with pytest.raises(AttributeError, match="no step 'wimp'"):
        recording["emg"].emg.wimp  # noqa: B018


def test_steps_name_their_choices(recording):
    parameters = inspect.signature(recording.emg.bandpass).parameters
    assert parameters["low"].default == 15.0 and "phase" in parameters
    with pytest.raises(ConfigurationError, match="did you mean 'low'"):
        recording.emg.bandpass(lo=20.0)


def test_muscles_of_a_recording_of_some_channels(recording):
    part = recording.sel(channel=["ZYG_L", "RIS_L"])
    found = part.emg.bandpass().emg.muscles(["ZYG_L", "BUC_L"])
    whole = recording.emg.bandpass().emg.muscles()
    np.testing.assert_allclose(found.values, whole.sel(muscle=found["muscle"]).values, rtol=1e-12)
    with pytest.raises(SchemaError, match="no channel of the muscles"):
        part.emg.bandpass().emg.muscles()


def test_variables_that_are_not_signals_are_refused(recording):
    with pytest.raises(SchemaError, match="expected emg"):
        xr.Dataset({"a": ("x", [1.0])}).emg.bandpass()
    with pytest.raises(SignalError, match="expected a feature over 'time'"):
        recording.emg.resample()
