"""Findings on features that count few steps or consist of noise, and the thresholds that serve."""

import numpy as np
import pytest
import xarray as xr
from pydantic import ValidationError

from emgface.recordings.findings import findings_in
from emgface.signals.activation import activation_of
from emgface.signals.doubtful import SERVES, SMALL_COUNT_SHARE, WEAK, doubtful_rows, rest_rms
from emgface.signals.feature_parameters import FeatureParameters
from emgface.signals.features import feature_of, willison_amplitude
from tests.study.recordings import chain_of, recording_of

RATE = 2048.0


def noise(rng, rest: float, ratio: float, samples: int = 8192) -> xr.DataArray:
    """White noise [V] of the size `rest`, `ratio` times as large in the second quarter."""
    size = np.full(samples, rest)
    size[samples // 4 : samples // 2] *= ratio
    values = size * rng.standard_normal(samples)
    time = np.arange(samples) / RATE
    return xr.DataArray(
        values[None], {"muscle": ["ZYG_L"], "time_emg": ("time_emg", time, {"units": "s"})},
        ("muscle", "time_emg"), attrs={"units": "V"},
    )  # fmt: skip


@pytest.mark.parametrize("ratio", [WEAK * 1.1, 3.0, 10.0])
@pytest.mark.parametrize("rest", [0.3e-6, 2e-6])
def test_the_threshold_that_is_named_serves(ratio: float, rest: float) -> None:
    """With 50 times the threshold, the count is small; with the one named, its range is larger."""
    signal = noise(np.random.default_rng(1), rest, ratio)
    high = 3.2 * np.sqrt(2) * ratio * rest
    (doubtful,) = doubtful_rows(willison_amplitude(signal, threshold=high), signal)
    assert (
        doubtful.code == "narrow_count"
        and doubtful.name == "ZYG_L"
        and "would serve" in doubtful.sentence
    )
    serves = float(doubtful.values["serves"])
    assert serves == pytest.approx(SERVES * np.sqrt(2) * rest, rel=0.1)
    again = willison_amplitude(signal, threshold=serves)
    assert float(again.max() - again.min()) > SMALL_COUNT_SHARE * 409
    assert doubtful_rows(again, signal) == []


@pytest.mark.parametrize("ratio", [1.0, 1.5])
def test_noise_has_no_threshold_that_serves(ratio: float) -> None:
    signal = noise(np.random.default_rng(2), 1e-6, ratio)
    for threshold in (0.1e-6, 1e-6, 5e-6):
        (doubtful,) = doubtful_rows(willison_amplitude(signal, threshold=threshold), signal)
        assert doubtful.code == "weak_burst"
        assert float(doubtful.values["ratio"]) == pytest.approx(ratio, rel=0.25)
    rms = feature_of(signal, FeatureParameters(kind="rms"))
    assert [one.code for one in doubtful_rows(rms, signal)] == ["weak_burst"]


def test_a_constant_row_is_stated_elsewhere() -> None:
    signal = noise(np.random.default_rng(2), 0.0, 1.0)
    with pytest.warns(UserWarning, match="zero in every window"):
        feature = willison_amplitude(signal)
    assert doubtful_rows(feature, signal) == []


def test_the_adaptive_threshold_follows_the_noise_at_rest() -> None:
    """A multiple of the RMS at rest; the feature of a recording in other units is the same."""
    signal = noise(np.random.default_rng(3), 1e-6, 8.0)
    assert float(rest_rms(signal, 0.2, RATE)[0]) == pytest.approx(1e-6, rel=0.1)
    parameters = FeatureParameters(threshold_rest=1.5)
    assert parameters.threshold is None
    feature = feature_of(signal, parameters)
    expected = 1.5 * float(rest_rms(signal, 0.2, RATE)[0])
    assert feature.attrs["threshold"] == pytest.approx([expected], rel=1e-12)
    larger = feature_of((1e3 * signal).assign_attrs(units="V"), parameters)
    np.testing.assert_array_equal(feature.values, larger.values)
    with pytest.raises(ValidationError, match="exactly one of threshold"):
        FeatureParameters(
            threshold_rest=1.5, threshold_baseline=2.0, baseline_start=0.0, baseline_stop=1.0
        )


def test_an_activation_states_the_findings_on_its_muscles_only() -> None:
    """A weak zygomaticus is found where it is selected, with a threshold; findings are stored."""
    recording = recording_of()
    recording["emg"].loc["ZYG_L"] *= 0.04
    chain = chain_of(feature={"threshold": 12e-6}, normalisation={"silent": "zero"})
    result = activation_of(recording, chain, strategy="act_rel", instruction="D")
    findings = {(f.code, f.name) for f in findings_in(result)}
    other = activation_of(recording, chain, strategy="act_rel", instruction="C")
    assert not any(name == "ZYG_L" for _, name in {(f.code, f.name) for f in findings_in(other)})
    assert any(name == "ZYG_L" for _, name in findings), findings
    adaptive = chain_of(feature={"threshold_rest": 1.0, "threshold": None})
    assert adaptive.feature.threshold_rest == 1.0
    result = activation_of(recording, adaptive, strategy="act_rel", instruction="D")
    assert ("narrow_count", "ZYG_L") not in {(f.code, f.name) for f in findings_in(result)}


def test_the_report_counts_the_trials_with_a_doubtful_feature() -> None:
    from emgface.report.contents import features

    reasons = ["", "check: narrow count (OOM_L, ZYG_R)", "x; check: weak burst (OOM_L)"]
    reasons.append("check: narrow count (OOM_L)")
    cube = xr.Dataset(
        {
            "reason": ("trial", [*reasons, "check: narrow count (DAO_L)"]),
            "status": ("trial", ["ok"] * 4 + ["failed:X"]),
        }
    )
    narrow, weak = features(cube)
    assert (
        narrow.startswith("In 2 of 4 scored trials") and "first of all OOM_L, named in 2" in narrow
    )
    assert weak.startswith("In 1 of 4 scored trials")
    assert features(cube.isel(trial=[0])) == []
