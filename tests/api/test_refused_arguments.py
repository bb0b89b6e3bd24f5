"""Arguments of `emgface` that another dataset, an infinite time or a negative seed makes useless."""

import numpy as np
import pytest
import xarray as xr
from scipy.io import wavfile

import emgface as ef
from emgface.acoustics.errors import AcousticsError
from emgface.errors import ActivationError, EmgfaceError
from emgface.face.control import control_of
from emgface.face.motion import require_rest
from emgface.face.simulation_parameters import SimulationParameters
from emgface.inverse.markers import wanted_positions
from emgface.signals.parameters import HeadFrameParameters


@pytest.fixture(scope="module")
def face():
    return ef.face(resolution="coarse")


def drive(face, times) -> xr.DataArray:
    muscles = face["muscle"].values
    coords = {"time": ("time", np.asarray(times), {"units": "s"}), "muscle": muscles}
    return xr.DataArray(np.zeros((len(times), len(muscles))), coords, ("time", "muscle"))


@pytest.mark.parametrize("times", [[0.0, 0.1, np.inf], [-np.inf, 0.0, 0.1], [0.0, np.nan, 0.2]])
def test_times_of_an_activation_are_finite(face, times):
    with pytest.raises(EmgfaceError, match="expected finite times"):
        ef.simulate(drive(face, times), face, accuracy="draft")


def test_an_equilibrium_is_the_result_of_an_equilibrium(face):
    with pytest.raises(EmgfaceError, match="passed as an equilibrium, expected node_position"):
        require_rest(face, face, SimulationParameters())


@pytest.mark.parametrize("seed", [-1, 1.5, "a", np.nan, True])
def test_a_seed_is_a_whole_number(seed):
    with pytest.raises(EmgfaceError, match="the seed is"):
        ef.face(resolution="coarse", seed=seed)
    with pytest.raises(AcousticsError, match="the seed is"):
        ef.sound(duration=0.02, seed=seed)


def test_an_inversion_needs_markers(face):
    recording, time = xr.Dataset(), np.zeros(1)
    with pytest.raises(EmgfaceError, match="no position of markers"):
        wanted_positions(recording, np.zeros((10, 3)), face, HeadFrameParameters(), time, 0.0)


WRONG = [None, "1", True, np.nan, np.inf, -1.0, 0.0, 1e12, [1.0]]


@pytest.mark.parametrize("value", WRONG, ids=repr)
@pytest.mark.parametrize("name", ["rate", "duration", "tension", "pitch"])
def test_a_number_of_a_sound_is_one_that_can_be_computed(name, value):
    if name == "duration" and value is None:
        pytest.skip("no duration is that of the motion")
    source = {"pitch": "rosenberg"}.get(name, "folds")
    given = {"source": source, "duration": 0.01} | {name: value}
    with pytest.raises(AcousticsError, match="expected"):
        ef.sound(vowel="a", **given)


@pytest.mark.parametrize("value", [None, "1", True, np.nan, np.inf, -1.0, 1e12, [1.0]], ids=repr)
def test_a_lung_pressure_is_one_of_a_person(value):
    with pytest.raises(AcousticsError, match="expected a number|check its unit"):
        ef.sound(vowel="a", duration=0.01, lung=value)


def test_a_source_is_named_or_has_sound(tmp_path):
    with pytest.raises(EmgfaceError, match="the source is of type int"):
        ef.sound(vowel="a", source=3)
    for values in (np.zeros(100), np.full(100, np.nan)):
        wavfile.write(tmp_path / "flow.wav", 8000, values.astype(np.float32))
        with pytest.raises(EmgfaceError, match="is silent or contains values"):
            ef.sound(vowel="a", source=str(tmp_path / "flow.wav"), duration=0.01)


@pytest.mark.parametrize("timing", ["normalised", "recorded"])
def test_samples_that_become_outputs_are_equally_spaced(timing):
    """Samples at 0, 0.1 and 1 s were simulated as if the second lay in the middle."""
    times = np.array([0.0, 0.1, 1.0])
    given = xr.DataArray(
        [[0.0], [0.5], [1.0]], {"time": times, "muscle": ["ZYG_L"]}, ("time", "muscle")
    )
    parameters = SimulationParameters(timing=timing)
    if timing == "recorded":
        control, duration, _ = control_of(given, ["ZYG_L"], parameters)
        np.testing.assert_array_equal(control.time, times)
        assert duration == pytest.approx(1.0)
        return
    with pytest.raises(ActivationError, match="0.1 to 0.9 s apart, expected equal intervals"):
        control_of(given, ["ZYG_L"], parameters)
    even = given.assign_coords(time=[0.0, 0.5, 1.0])
    assert control_of(even, ["ZYG_L"], parameters)[2] > 1.0
