"""Findings about a recording reach activation, motion, scores and the report of a study."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import emgface as ef
from emgface.errors import SignalError
from emgface.muscles import CHANNELS
from emgface.recordings.findings import Finding, findings_in, with_findings
from emgface.recordings.repeated import for_activation, for_scores, headline, sentences
from emgface.signals.activation import feature_range
from emgface.signals.parameters import SignalChain
from emgface.study.configuration import StudyConfiguration

RATE = 2000


def recording_at(rate: float, seconds: float = 3.0, seed: int = 0) -> xr.Dataset:
    rng = np.random.default_rng(seed)
    time = np.arange(round(rate * seconds)) / rate
    # Noise below 400 Hz, the same at every rate, so that only the sampling differs.
    frequency = np.fft.rfftfreq(time.size, 1 / rate)
    spectrum = rng.normal(size=(14, 1200)) + 1j * rng.normal(size=(14, 1200))
    wide = np.zeros((14, frequency.size), complex)
    wide[:, 60:1200] = spectrum[:, 60:1200] * np.exp(-frequency[60:1200] / 160.0)
    emg = np.fft.irfft(wide, time.size, axis=1)
    emg *= 2e-5 / emg.std() * (0.2 + np.exp(-(((time - 1.5) / 0.4) ** 2)))
    return xr.Dataset(
        {"emg": (("channel", "time_emg"), emg, {"units": "V"})},
        {"channel": list(CHANNELS), "time_emg": ("time_emg", time, {"units": "s"})},
        {"origin": "measured", "volunteer": "V1", "instruction": "A", "repetition": 1},
    )


def rectified() -> xr.Dataset:
    recording = recording_at(RATE)
    emg = recording["emg"].copy()
    emg[3] = np.abs(emg[3])
    return recording.assign(emg=emg)


def test_activation_and_motion_repeat_and_store_what_the_check_finds() -> None:
    name = CHANNELS[3]
    with pytest.warns(match=f"channel {name}: is never negative and touches zero"):
        activation = ef.activate(rectified(), strategy="act_all")
    findings = [(f.code, f.name) for f in findings_in(activation) if f.kind != "muscle"]
    assert findings == [("rectified", name)]
    clean = ef.activate(recording_at(RATE), strategy="act_all")
    assert not [f for f in findings_in(clean) if f.kind != "muscle"]
    short = activation.isel(time=slice(0, 4))
    face = ef.face()
    with pytest.warns(match=f"channel {name}: is never negative"):
        motion = ef.simulate(short, face, accuracy="draft", contact={"method": "none"})
    assert findings_in(motion) == findings_in(activation)


def test_findings_survive_files_of_every_stage(tmp_path: Path) -> None:
    from emgface.schema.netcdf import read_netcdf, write_netcdf

    with pytest.warns(match="is never negative"):
        activation = ef.activate(rectified(), strategy="act_all")
    write_netcdf(activation, tmp_path / "a.nc", "activation")
    assert findings_in(read_netcdf(tmp_path / "a.nc", "activation")) == findings_in(activation)


def test_only_findings_on_what_is_used_are_repeated() -> None:
    findings = [
        Finding("bad", "channel", "ZYG_L", {"by": "a table", "why": ""}),
        Finding("bad", "channel", "Knee", {"by": "a table", "why": ""}),
        Finding("interpolated", "marker", "nasion", {"share": 0.1, "frames": 3, "by": "residuals"}),
        Finding("interpolated", "marker", "heel", {"share": 0.1, "frames": 3, "by": "residuals"}),
        Finding("rate", "marker", "", {"used_by": "a", "used": 1.0, "other_by": "b", "other": 2.0,
                                       "seconds": 3.0}),
    ]  # fmt: skip
    given = with_findings(recording_at(RATE), findings)
    assert [(f.code, f.name) for f in for_activation(given)] == [("bad", "ZYG_L")]
    assert [(f.code, f.name) for f in for_scores(given)] == [
        ("interpolated", "nasion"),
        ("rate", ""),
    ]
    assert headline(for_scores(given)) == "check: interpolated (nasion), rate"
    assert sentences(for_activation(given)) == [
        "channel ZYG_L: marked as bad in a table: treated as missing"
    ]


@pytest.mark.parametrize("other", [1000.0, 4000.0])
def test_a_range_of_another_rate_is_refused_where_it_changes_the_feature(other: float) -> None:
    chain = StudyConfiguration().signals.model_copy(deep=True)
    values = chain.model_dump()
    values["normalisation"]["reach"] = "reference"
    for kind, refused in (("wamp", True), ("rms", other < RATE)):
        values["feature"] = {"kind": kind}
        chosen = SignalChain.model_validate(values)
        extent = feature_range([recording_at(other)], chosen)
        options = {"feature": {"kind": kind}, "reference": extent, "strategy": "act_all",
                   "normalisation": {"outside": "clip", "reach": "reference"}}  # fmt: skip
        if refused:
            with pytest.raises(SignalError, match=f"are sampled at {other:g} and 2000 Hz"):
                ef.activate(recording_at(RATE), **options)
            with pytest.raises(SignalError, match="are sampled at"):
                feature_range([recording_at(other), recording_at(RATE)], chosen)
        else:
            ef.activate(recording_at(RATE), **options)


def test_a_trial_of_a_study_states_the_findings() -> None:
    from emgface.report.study_tables import _failures

    cube = xr.Dataset(
        {
            "rho": (("volunteer", "instruction", "repetition", "strategy", "marker"),
                    np.full((1, 1, 1, 1, 1), 0.9)),
            "status": (("volunteer", "instruction", "repetition", "strategy"), [[[["ok"]]]]),
            "reason": (("volunteer", "instruction", "repetition", "strategy"),
                       [[[["check: rectified (ZYG_L)"]]]]),
        },
        {"volunteer": ["V1"], "instruction": ["A"], "repetition": [1], "strategy": ["act_all"],
         "marker": ["corner_left"]},
    )  # fmt: skip
    (failure,) = _failures(cube)
    assert failure.endswith("ok: check: rectified (ZYG_L)")
