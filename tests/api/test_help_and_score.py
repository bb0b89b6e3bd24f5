"""Help of functions that are packages, and scores of recordings without markers."""

import inspect

import numpy as np
import pytest
import xarray as xr

import emgface as ef
from emgface.errors import MarkerError
from emgface.face.measured import measured_during
from emgface.muscles import LIP_MARKERS
from emgface.signals.parameters import HeadFrameParameters


@pytest.mark.parametrize("name", sorted(ef.__all__))
def test_the_help_of_every_function_describes_its_parameters(name):
    """Of `face`, `fit` and `study` it was that of the package."""
    function = getattr(ef, name)
    text = inspect.getdoc(function)
    assert text and "Returns\n-------" in text
    for parameter in inspect.signature(function).parameters:
        assert parameter in text


def recording(markers):
    t = np.arange(0.0, 1.0, 0.01)
    emg = xr.DataArray(np.zeros((1, 100)), dims=("channel", "time_emg"))
    data = xr.Dataset({"emg": emg})
    if markers:
        position = np.zeros((len(markers), 3, 100))
        data["position"] = ("marker", "axis", "time_marker"), position
        data = data.assign_coords(marker=markers, axis=list("xyz"), time_marker=t)
    return data


def motion(**attrs):
    t = np.arange(0.0, 1.0, 0.01)
    return xr.Dataset(coords={"time": t}, attrs=attrs)


@pytest.mark.parametrize("markers", [(), LIP_MARKERS[:-1], ("nose",)])
def test_a_recording_without_lip_markers_has_no_score(markers):
    begun = motion(recorded_start=0.0, recorded_pace=1.0)
    with pytest.raises(MarkerError, match="no lip marker .*expected all of them"):
        measured_during(recording(list(markers)), begun, xr.Dataset(), HeadFrameParameters())


def test_a_motion_without_recording_has_no_score():
    given = recording(list(LIP_MARKERS))
    with pytest.raises(MarkerError, match="does not state recorded_start and|recorded_start, rec"):
        measured_during(given, motion(), xr.Dataset(), HeadFrameParameters())
