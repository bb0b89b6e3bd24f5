"""Recordings whose signals contradict each other are reported, and others are not."""

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

from emgface.face.motion import settle_face
from emgface.face.simulation_parameters import SimulationParameters
from emgface.inverse.doubts import agreement_of, doubts, signs
from emgface.inverse.parameters import InverseParameters
from emgface.inverse.problem import Problem, pose_problem
from emgface.inverse.run import invert
from emgface.muscles import CHANNELS
from emgface.signals.parameters import SignalChain
from sim.inverse import PointTarget
from tests.inverse.recordings import recording_of

SIMULATION = SimulationParameters(
    solver="linearly_implicit",
    gravity=False,
    contact={"method": "none"},
    output=0.04,
    sigma_max=115e3,
)
pytestmark = pytest.mark.filterwarnings("ignore::emgface.errors.FeatureWarning")


@pytest.fixture(scope="module")
def posed(coarse):
    """Function that poses a recording on a face."""
    rest = settle_face(coarse, SIMULATION)

    def posed_problem(recording: xr.Dataset) -> Problem:
        return pose_problem(
            recording, coarse, SIMULATION, SignalChain(), InverseParameters(), settled=rest
        )

    return posed_problem


@pytest.fixture
def recording(coarse):
    return recording_of(coarse)


def doubt_text(posed, recording, measured=True) -> str:
    signs_read = signs(posed(recording), recording, measured)
    usual = {"sigma_max": 115e3, "rest_ratio": 0.0, "misfit_ratio": 0.1}
    return " ".join(doubts(xr.Dataset(attrs=usual | signs_read)))


def one_sided(recording: xr.Dataset) -> xr.Dataset:
    """Only the left corner moves, by the left ZYG."""
    rng, other = np.random.default_rng(1), recording.copy(deep=True)
    still = other["position"].sel(marker="corner_right").values[:, :10].mean(axis=1, keepdims=True)
    other["position"].loc[{"marker": "corner_right"}] = still + 1e-4 * rng.standard_normal((3, 121))
    other["emg"].loc[{"channel": "ZYG_R"}] = 1e-5 * rng.standard_normal(other.sizes["time_emg"])
    return other


def test_a_trial_without_contradiction_has_no_doubts(posed, recording):
    assert doubt_text(posed, recording) == "" == doubt_text(posed, one_sided(recording))


@pytest.mark.parametrize(("shift", "when"), [(0.4, "before"), (-0.4, "after")])
def test_an_sEMG_that_is_shifted_in_time_is_reported(posed, recording, shift, when):
    recording["emg"] = recording["emg"].roll(time_emg=round(shift * 2048))
    text = doubt_text(posed, recording)
    assert f"s {when} the sEMG, expected 0 to 0.2 s after it" in text
    assert doubt_text(posed, recording, measured=False) == ""


def test_a_delay_at_which_sEMG_and_motion_do_not_agree_is_reported(posed, recording):
    """Milliseconds for seconds, and a delay of half the trial; the usual delay is not mentioned."""
    problem, usual = posed(recording), {"rest_ratio": 0.0, "misfit_ratio": 0.1}
    for delay, words in ((0.04, ""), (0.6, "used 0.6 s later"), (9.0, "used 9 s later")):
        attrs = usual | signs(problem, recording, True, delay)
        text = " ".join(doubts(xr.Dataset(attrs=attrs)))
        assert words in text and bool(words) == bool(text)


def test_an_sEMG_of_noise_is_reported(posed, recording):
    rng = np.random.default_rng(2)
    recording["emg"][:] = 2e-4 * rng.standard_normal(recording["emg"].shape)
    assert "no muscle is quiet for a quarter of the trial" in doubt_text(posed, recording)


def test_exchanged_sides_of_a_movement_to_one_side_are_reported(posed, recording):
    names = [c[:-1] + {"L": "R", "R": "L"}[c[-1]] for c in CHANNELS]
    other = one_sided(recording).assign_coords(channel=names)
    assert "follow the mouth corners of the other side" in doubt_text(posed, other)


def test_noise_in_place_of_a_recording_gives_no_activation_and_is_reported(coarse, recording):
    """The null hypothesis: neither markers nor sEMG contain anything."""
    rng = np.random.default_rng(3)
    still = recording["position"].values[:, :, :10].mean(axis=2, keepdims=True)
    recording["position"][:] = still + 1e-4 * rng.standard_normal(recording["position"].shape)
    recording["emg"][:] = 2e-4 * rng.standard_normal(recording["emg"].shape)
    inverse = invert(recording, coarse, SIMULATION, parameters=InverseParameters(form="step"))
    assert float(inverse["activation"].max()) < 0.15
    text = " ".join(doubts(inverse))
    assert "of their motion: activations do not follow from this trial" in text
    assert "the face does not follow the markers" in text


def test_the_lag_is_that_of_the_largest_correlation():
    t = 0.02 * np.arange(100)
    bump = np.exp(-(((t - 0.8) / 0.15) ** 2))
    later = np.where(t > 1.5, np.nan, np.exp(-(((t - 0.92) / 0.15) ** 2)))  # lost markers
    r, lag = agreement_of(bump, later, 0.02)
    assert r == pytest.approx(1.0, abs=1e-6) and lag == pytest.approx(0.12)
    assert agreement_of(0.0 * bump, later, 0.02) == (0.0, 0.0)


def test_markers_that_are_all_lost_for_a_while_are_compared_elsewhere(posed, recording):
    problem = posed(recording)
    target = problem.target
    x = target.position.copy()
    x[5:9] = np.nan
    lost = replace(problem, target=PointTarget(target.nodes, target.time, x, target.size))
    signs_read = signs(lost, recording, True)
    assert np.isfinite(signs_read["emg_agreement"]) and np.isfinite(signs_read["noise_ratio"])
