"""Intervals and calibration of the sEMG: closed forms, known gains, and refusals."""

import numpy as np
import pytest
import xarray as xr

from emgface.errors import ConfigurationError, DataError
from emgface.face.motion import settle_face, simulate_face
from emgface.face.simulation_parameters import SimulationParameters
from emgface.inverse.assumptions import Assumptions, emg_precision, marker_precision
from emgface.inverse.calibrate import calibrate, volunteer_of
from emgface.inverse.calibration import Calibration
from emgface.inverse.parameters import InverseParameters, form_of
from emgface.inverse.refine import intervals
from emgface.inverse.regression import common_delay, profile, regressed
from emgface.inverse.signals import estimated_activation
from emgface.muscles import LIP_MARKERS, MUSCLES
from emgface.schema.validation import validate
from emgface.signals.parameters import SignalChain
from sim.inverse import PointTarget
from tests.inverse.recordings import recording_of


def test_the_interval_of_a_muscle_that_may_be_silent_begins_at_zero():
    rng = np.random.default_rng(0)
    low, high = intervals(rng.exponential(0.1, (4000, 1)))
    assert low[0] == 0.0 and high[0] == pytest.approx(0.1 * np.log(10.0), rel=0.05)
    # between two knots the activation is a mean, which is never 0
    low, high = intervals(rng.exponential(0.1, (4000, 2)).mean(axis=1, keepdims=True))
    assert low[0] == 0.0 and high[0] == pytest.approx(0.1945, rel=0.05)
    low, high = intervals(rng.normal(0.5, 0.1, (4000, 1)))
    assert (low[0], high[0]) == pytest.approx((0.3355, 0.6645), abs=0.02)


def test_a_lasting_error_counts_once_within_its_memory():
    target = PointTarget(np.array([0]), np.zeros(1), np.full((1, 1, 3), 4e-3), 1e-3)
    rest = np.zeros((1, 3))
    assumed = Assumptions(model_error=0.0)
    assert marker_precision(assumed, target, rest, 5e-4, 0.01) == pytest.approx(4.0)
    assumed = Assumptions(model_error=0.25, model_memory=0.3)
    assert marker_precision(assumed, target, rest, 0.0, 0.01) == pytest.approx(1.0 / 30.0)
    precision = emg_precision(assumed, np.full(3, 0.5), np.array([0.0, 2.0, np.inf]), 0.02)
    assert precision == pytest.approx([0.0, 2.0 / (0.25 * 10.0), 1e4])


def test_known_gain_delay_and_error_are_estimated():
    rng = np.random.default_rng(1)
    t = np.arange(0.0, 12.0, 0.01)

    def e(delay: float) -> np.ndarray:
        return np.clip(np.sin(2.0 * np.pi * (t - delay)), 0.0, 1.0)

    a = 0.35 * e(0.055) + 0.05 * rng.standard_normal(len(t))
    one = profile(e, a, np.zeros(len(t)), 0.05, 1.0)
    gain, delay, error = regressed(one, (0.04, 0.02), len(t), 1.0)
    assert gain == pytest.approx(0.35, abs=0.01) and delay == pytest.approx(0.055, abs=0.006)
    assert error == pytest.approx(0.05, rel=0.1)


def test_a_muscle_that_the_motion_does_not_determine_keeps_its_gain():
    half = np.full(50, 0.5)
    one = profile(lambda _: half, 0.5 * half, half**3 / 2.0, 0.25, 20.0)
    gain, delay, error = regressed(one, (0.04, 0.02), 50, 20.0)
    assert gain == pytest.approx(0.5) and delay == pytest.approx(0.04)
    assert error == pytest.approx(0.25)


def test_muscles_determine_the_delay_of_a_person_together():
    """Each of them alone would leave the delay nearer to the value assumed before, 40 ms."""
    rng, t = np.random.default_rng(2), np.arange(0.0, 1.8, 0.01)
    profiles = []
    for k in range(12):
        centre = 0.6 + 0.05 * k

        def e(delay: float, centre=centre) -> np.ndarray:
            return np.exp(-(((t - delay - centre) / 0.15) ** 2))

        a = 0.3 * e(0.065) + 0.02 * rng.standard_normal(len(t))
        profiles.append(profile(e, a, np.full(len(t), 0.02**2), 0.04, 20.0))
    person = common_delay([one.cost for one in profiles])
    alone = [regressed(one, (0.04, 0.02), len(t), 20.0)[1] for one in profiles]
    assert person == pytest.approx(0.065, abs=0.006) and np.mean(alone) < 0.06
    own = [regressed(one, (person, 0.01), len(t), 20.0)[1] for one in profiles]
    assert np.mean(own) == pytest.approx(0.065, abs=0.005)


def known(**attrs) -> Calibration:
    values = {name: ("muscle", np.full(20, 0.1)) for name in ("gain", "delay", "error")}
    data = xr.Dataset(values, coords={"muscle": list(MUSCLES)})
    units = {"gain": "1", "delay": "s", "error": "1", "minimum": "1/s", "maximum": "1/s"}
    data["estimated"] = ("muscle", np.ones(20, dtype=np.int64), {"units": "1"})
    data["minimum"], data["maximum"] = data["gain"] * 0.0, data["gain"] * 10.0
    for name, unit in units.items():
        data[name].attrs["units"] = unit
    given = {
        "volunteer": "S01", "trials": 2, "sigma_max": 1e5, "model_error": 0.2,
        "range_parameters": "{}", "origin": "simulated",
    }  # fmt: skip
    return Calibration(data.assign_attrs(given | attrs))


@pytest.mark.filterwarnings("ignore::emgface.errors.FeatureWarning")
def test_a_calibration_of_a_face_finds_the_gain_of_its_trial(coarse):
    """Markers of the face itself, moved by both ZYG, whose sEMG precedes it.

    The feature is not proportional to the activation: the gain expected is that of its regression.
    """
    simulation = SimulationParameters(
        solver="linearly_implicit", gravity=False, contact={"method": "none"}, output=0.03
    )
    rest, recording = settle_face(coarse, simulation), recording_of(coarse)
    true = recording["true_activation"].rename(time_true="time")
    moved = simulate_face(coarse, true, simulation, settled=rest)["position"]
    x = moved.sel(marker=list(LIP_MARKERS)).transpose("marker", "axis", "time")
    x = x.interp(time=recording["time_marker"].values, kwargs={"fill_value": "extrapolate"})
    recording["position"].loc[{"marker": list(LIP_MARKERS)}] = x.values
    calibrated = calibrate(
        [recording], coarse, simulation,
        parameters=InverseParameters(iterations=4, assumed=Assumptions(spacing=0.15)),
    )  # fmt: skip
    validate(calibrated.data, "emg_calibration")
    chain, session = calibrated.applied(SignalChain(), simulation.sigma_max, recording)
    emg = estimated_activation(recording, chain, "assisted", session)["activation"]
    gain, moving = calibrated.data["gain"], ["ZYG_L", "ZYG_R"]
    for muscle in moving:
        delay = float(calibrated.data["delay"].sel(muscle=muscle))
        a = true.sel(muscle=muscle).interp(time=emg["time"].values + delay).fillna(0.0).values
        e = emg.sel(muscle=muscle).values
        assert float(gain.sel(muscle=muscle)) == pytest.approx(a @ e / (e @ e), rel=0.1)
    others = gain.sel(muscle=calibrated.data["estimated"] == 1).drop_sel(muscle=moving)
    assert float(others.max()) < 0.25 * float(gain.sel(muscle=moving).min())
    assert calibrated.model_error < 0.1


def test_a_calibration_fits_its_volunteer_and_its_strength_only():
    validate(known().data, "emg_calibration")
    recording = xr.Dataset(attrs={"volunteer": "S01"})
    chain, session = known().applied(SignalChain(), 1e5, recording)
    assert chain.normalisation.reach == "session" and chain.normalisation.outside == "clip"
    assert float(session["maximum"].max()) == pytest.approx(1.0)
    with pytest.raises(ConfigurationError, match="is of volunteer 'S01', the recording of 'S02'"):
        known().applied(SignalChain(), 1e5, xr.Dataset(attrs={"volunteer": "S02"}))
    with pytest.raises(ConfigurationError, match="gains are relative to it: calibrate again"):
        known().applied(SignalChain(), 2e5, recording)


def test_impossible_requests_are_refused():
    with pytest.raises(DataError, match="no calibration trial"):
        calibrate([], xr.Dataset())
    for anonymous in ({}, {"volunteer": ""}):
        with pytest.raises(DataError, match="name no volunteer"):
            volunteer_of([xr.Dataset(attrs=anonymous)])
    copies = [xr.Dataset({"emg": ("t", [1.0, 2.0])}, attrs={"volunteer": "S01"})] * 2
    with pytest.raises(DataError, match="recordings 1 and 2 of the calibration contain the same"):
        calibrate(copies, xr.Dataset())
    two = [xr.Dataset(attrs={"volunteer": name}) for name in ("S01", "S02")]
    with pytest.raises(DataError, match="S01, S02: calibrate each separately"):
        calibrate(two, xr.Dataset())
    with pytest.raises(ConfigurationError, match="form 'both' is unknown"):
        form_of("both", contact=False)
    with pytest.raises(ConfigurationError, match="no derivatives with contact"):
        form_of("trajectory", contact=True)
