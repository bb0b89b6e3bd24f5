"""Functions `check`, `build`, `invert`, `sound` and `report` of ``import emgface as ef``."""

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import emgface as ef
from emgface.acoustics import formants
from emgface.errors import ConfigurationError, DataError
from emgface.muscles import CHANNELS


def recording(channels=CHANNELS):
    time = np.arange(4096) / 2048
    emg = 1e-4 * np.random.default_rng(0).standard_normal((len(channels), len(time)))
    return xr.Dataset(
        {"emg": (("channel", "time_emg"), emg, {"units": "V"})},
        {"channel": list(channels), "time_emg": ("time_emg", time, {"units": "s"})},
        {"volunteer": "S01", "instruction": "A", "repetition": 1, "origin": "simulated"},
    )


def test_a_recording_without_markers_can_be_activated_but_not_scored():
    tables = ef.check(recording())
    every = tables["channels and markers"]
    assert set(every["name"]) == set(CHANNELS)
    steps = tables["later steps"].set_index("step")["reason"]
    assert "activate" not in steps and "no marker positions" in steps["score"]


def test_a_flat_channel_is_a_problem():
    data = recording()
    data["emg"][0] = 0.0
    assert found_problem(ef.check(data), CHANNELS[0])
    assert not found_problem(ef.check(recording()), CHANNELS[0])


def found_problem(tables: dict[str, pd.DataFrame], name: str) -> bool:
    return any(name in text for text in tables["problems"]["problem"])


def test_a_generated_model_is_written_and_checked(tmp_path):
    jaw = ef.build("jaw", preset="woman", out=tmp_path / "jaw.nc")
    again = ef.read(tmp_path / "jaw.nc")
    np.testing.assert_array_equal(again["body_mass"], jaw["body_mass"])
    tables = ef.check(tmp_path / "jaw.nc")
    assert "muscles" in tables["model"]["description"][0]
    with pytest.raises(ConfigurationError, match="no kind 'nose', expected one of face"):
        ef.build("nose")


def test_measures_of_a_person_are_those_of_the_model():
    jaw = ef.build("jaw", preset="woman", measures={"condyle_width": "103mm"})
    condyles = jaw["point_position"].sel(point=["condyle_L", "condyle_R"]).values
    assert float(np.ptp(condyles[:, 0])) == pytest.approx(0.103, abs=1e-6)


def test_a_parameter_that_an_inversion_does_not_have_is_refused():
    with pytest.raises(ConfigurationError, match="no parameter speed of an inversion"):
        ef.invert(recording(), speed=3)


def test_formants_of_a_vowel_are_those_of_its_tube():
    tract = ef.sound(vowel="a", source=None)
    assert "sound" not in tract
    exact = formants(tract["area"].values[0], float(tract["length"][0]))[0]
    frequencies = tract["formant_frequency"].values[0]
    np.testing.assert_allclose(frequencies, exact[: len(frequencies)], rtol=1e-6)
    with pytest.raises(ConfigurationError, match="a wave file needs a source"):
        ef.sound(source=None, wave="a.wav")


def test_a_voice_is_written(tmp_path):
    voiced = ef.sound(vowel="a", duration=0.2, wave=tmp_path / "a.wav")
    assert float(np.abs(voiced["sound"]).max()) > 0.0
    assert (tmp_path / "a.wav").stat().st_size > 0.2 * 44_100 * 2


def test_a_report_needs_a_study(tmp_path):
    with pytest.raises(DataError):
        ef.report(tmp_path)
