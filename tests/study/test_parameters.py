"""Parameters of the study file: published defaults, and messages of errors."""

import json

import pytest
from pydantic import ValidationError

from emgface.choices import configure, parameter_table
from emgface.errors import ConfigurationError
from emgface.signals.parameters import (
    FeatureParameters,
    FilterParameters,
    ResamplingParameters,
    SignalChain,
)


def test_defaults_are_those_of_the_paper():
    chain = SignalChain()
    assert (chain.filter.order, chain.filter.low, chain.filter.high) == (4, 15.0, 500.0)
    assert (chain.feature.kind, chain.feature.window) == ("wamp", 0.2)
    assert chain.feature.comparison == ">=" and chain.feature.threshold == 10e-6
    assert chain.normalisation.reach == "trial"
    assert chain.strategy.n == 3 and chain.resampling.steps == 160


def test_round_trip_through_json():
    chains = [
        SignalChain(),
        configure(
            SignalChain,
            {
                "feature": {
                    "threshold_baseline": 3.0,
                    "baseline_start": 0.0,
                    "baseline_stop": 1.0,
                },
                "resampling": {"period": 0.01},
            },
        ),
    ]
    for chain in chains:
        assert SignalChain.model_validate(json.loads(chain.model_dump_json())) == chain
        without_none = chain.model_dump(exclude_none=True)  # as a study file writes it
        assert SignalChain.model_validate(without_none) == chain


def test_parameters_are_frozen():
    with pytest.raises(ValidationError, match="frozen"):
        FilterParameters().low = 20.0


def test_unknown_name_gets_the_nearest_valid_one():
    with pytest.raises(ConfigurationError, match=r"'feature.tresholds', did you mean 'threshold'"):
        configure(SignalChain, {"feature": {"tresholds": 1e-5}}, where="study.toml [signals]")
    with pytest.raises(ConfigurationError, match=r"study.toml: unknown .*'filtr'.* 'filter'"):
        configure(SignalChain, {"filtr": {}}, where="study.toml")
    with pytest.raises(ConfigurationError, match="valid names are .*high, low, order, phase"):
        configure(SignalChain, {"filter": {"zzzzz": 1}})


@pytest.mark.parametrize(
    "model, values, message",
    [
        (FilterParameters, {"low": 600.0}, "low = 600 Hz is not below high = 500 Hz"),
        (FilterParameters, {"low": -1.0}, "'low' = -1.0: input should be greater than 0"),
        (FilterParameters, {"phase": "both"}, "'phase' = 'both'.*'zero' or 'causal'"),
        (FilterParameters, {"low": float("nan")}, "finite number"),
        (FeatureParameters, {"C1": -1.0}, "'C1' = -1.0: input should be greater than -1"),
        (FeatureParameters, {"A": 0.5}, "'A' = 0.5"),
        (FeatureParameters, {"threshold_baseline": 3.0}, "requires a rest interval"),
        (FeatureParameters, {"threshold": None}, "exactly one of threshold"),
        (
            FeatureParameters,
            {"threshold_baseline": 3.0, "threshold": 1e-5},
            "exactly one of threshold",
        ),
        (FeatureParameters, {"baseline_start": 2.0, "baseline_stop": 1.0}, "exchange them"),
        (ResamplingParameters, {"steps": 100, "period": 0.01}, "exactly one of steps"),
    ],
)
def test_refusals(model, values, message):
    with pytest.raises(ConfigurationError, match=message):
        configure(model, values)


def test_every_parameter_states_unit_and_source():
    table = parameter_table(SignalChain())
    assert len(table) > 25
    assert (table["unit"] != "").all() and (table["source"] != "").all()
    row = table.set_index("parameter").loc["feature.threshold"]
    assert row["unit"] == "V" and "10 mV" in row["note"] and row["value"] == 10e-6
    description = FeatureParameters.model_fields["threshold"].description
    assert description is not None and "Unit: V." in description and "Source: Eskes" in description
