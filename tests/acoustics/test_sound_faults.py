"""Sounds that would be wrong without a word: other wave formats, short sources, closures, late times."""

import numpy as np
import pytest
from scipy.io import wavfile
from typer.testing import CliRunner

import emgface as ef
from emgface.acoustics import rosenberg
from emgface.anatomy.airway.area_function import area_function, ideal_vowel, read_areas, with_lips
from emgface.anatomy.airway.sound import (
    sample_rate,
    sound_doubts,
    source_of,
    synthesise,
    with_formants,
    write_wave,
)
from emgface.cli import app
from emgface.errors import DataError, FeatureWarning

RATE = 8000
FLOW = rosenberg(np.arange(RATE // 10) / RATE, pitch=100.0, peak=1.0)
FORMATS = {
    "uint8": (128.0 + 127.0 * FLOW).round().astype(np.uint8),
    "int16": (32767.0 * FLOW).round().astype(np.int16),
    "int32": (2147483647.0 * FLOW).round().astype(np.int32),
    "float32": FLOW.astype(np.float32),
    "float64": FLOW,
    "two equal channels": np.stack([FLOW, FLOW], axis=1),
}


def of_folds(**options):
    return {"lung": 785.0, "pitch": 100.0, "tension": 1.0} | options


@pytest.mark.parametrize("name", FORMATS)
def test_a_flow_is_the_same_in_every_format_of_wave_files(name, tmp_path):
    wavfile.write(tmp_path / "flow.wav", RATE, FORMATS[name])
    flow = source_of(str(tmp_path / "flow.wav"), 0.1, **of_folds()).values
    assert flow == pytest.approx(3e-4 * FLOW, abs=3e-4 / 127.0)


def test_channels_that_differ_are_refused(tmp_path):
    wavfile.write(tmp_path / "two.wav", RATE, np.stack([0.0 * FLOW, FLOW], axis=1))
    with pytest.raises(DataError, match="2 channels that differ, expected the flow of the glottis"):
        source_of(str(tmp_path / "two.wav"), 0.1, **of_folds())


def test_a_source_that_ends_before_the_sound_is_stated(tmp_path):
    wavfile.write(tmp_path / "flow.wav", RATE, FORMATS["int16"])
    with pytest.warns(FeatureWarning, match=r"ends at 0\.1 s, before the sound of 0\.2 s"):
        source_of(str(tmp_path / "flow.wav"), 0.2, **of_folds())


def test_rows_of_a_changing_shape_and_moving_tracts_are_not_taken_for_one(tmp_path):
    table = tmp_path / "moving.csv"
    table.write_text("label,time_s,A0_cm2,A1_cm2,length_m\na,0,1,2,0.17\nb,0.1,2,1,0.16\n")
    with pytest.raises(DataError, match="column time_s, whose rows are instants of one shape"):
        read_areas(table, "b")
    with pytest.raises(DataError, match="the tract has 2 instants .* expected one"):
        with_lips(read_areas(table), np.full(2, 1e-4), np.zeros(2), np.arange(2.0))


@pytest.mark.parametrize("start", [0.0, 1e5, 1.7e9])
def test_the_rate_of_a_sound_does_not_depend_on_its_first_time(start, tmp_path):
    vowel = ideal_vowel("a")
    areas = np.repeat(vowel["area"].values, 2, axis=0)
    tract = area_function(areas, np.repeat(vowel["length"].values, 2), start + np.array([0.0, 0.1]))
    sound = synthesise(tract, "rosenberg")
    assert sample_rate(sound) == 44_100
    assert wavfile.read(write_wave(sound, tmp_path / "a.wav"))[0] == 44_100


@pytest.mark.parametrize(
    ("areas", "options", "words"),
    [
        ([1.0, 2.0, 3.0, 2.0], {}, []),
        ([1.0, 2.0, 3.0, 0.0], {}, ["closed at 1 of 1 instants", "does not exceed 0.002 Pa"]),
        ([1.0, 2.0, 3.0, 2.0], {"lung": 8.0}, ["does not exceed 0.002 Pa"]),
    ],
)  # fmt: skip
def test_closures_and_silence_are_stated(areas, options, words):
    tract = area_function(1e-4 * np.array([areas]), np.array([0.17]), np.zeros(1))
    said = sound_doubts(synthesise(with_formants(tract), duration=0.3, **options))
    assert len(said) == len(words)
    assert all(word in one for word, one in zip(words, said, strict=True))


def test_commands_and_functions_state_them(tmp_path):
    with pytest.warns(FeatureWarning, match="does not exceed"):
        ef.sound(vowel="a", duration=0.2, lung=8.0)
    table = tmp_path / "closed.csv"
    table.write_text("A0_cm2,A1_cm2,A2_cm2,length_m\n1,2,0,0.17\n")
    done = CliRunner().invoke(app, ["sound", "formants", "--areas", str(table)])
    assert done.exit_code == 0, done.output
    assert "the tract is closed at 1 of 1 instants" in " ".join(done.output.split())
