"""Lowering of sigma_max: the published 10 % rule as a policy outside the solver."""

import numpy as np
import pytest
import xarray as xr

from emgface.choices import configure
from emgface.face.motion import simulate_face
from emgface.face.sigma_max import lower_sigma_max
from emgface.face.simulation_parameters import SigmaMaxPolicy, SimulationParameters
from emgface.face.stability import stability_warning
from emgface.report.results import open_results
from emgface.study import skin
from emgface.study.run import run_study
from sim.errors import InvertedElement, NotConverged, SingularSystem, ToleranceMissed
from tests.study_run.conftest import MECHANICS
from tests.study_run.test_run import configured

PARAMETERS = configure(SimulationParameters, {"sigma_max": "published"})


def fails_above(limit: float, tried: list[float]):
    def simulate(parameters: SimulationParameters) -> xr.Dataset:
        tried.append(parameters.sigma_max)
        if parameters.sigma_max > limit:
            raise InvertedElement(3, -0.1, 0.2)
        return xr.Dataset(attrs={"sigma_max": parameters.sigma_max})

    return simulate


def test_sigma_max_falls_by_ten_per_cent_until_the_trial_succeeds() -> None:
    tried: list[float] = []
    lowered = lower_sigma_max(fails_above(220e3, tried), PARAMETERS)
    assert tried == pytest.approx([300e3, 270e3, 243e3, 218.7e3])
    assert lowered.attrs == {"sigma_max": tried[-1], "attempts": 4}


def test_a_successful_trial_is_not_changed() -> None:
    tried: list[float] = []
    assert lower_sigma_max(fails_above(1e9, tried), PARAMETERS).attrs["attempts"] == 1
    assert tried == [300e3]


def test_below_the_minimum_the_last_failure_is_raised_with_the_attempts() -> None:
    tried: list[float] = []
    parameters = PARAMETERS.model_copy(update={"sigma_max_policy": SigmaMaxPolicy(minimum=200e3)})
    with pytest.raises(InvertedElement) as caught:
        lower_sigma_max(fails_above(0.0, tried), parameters)
    assert tried == pytest.approx([300e3, 270e3, 243e3, 218.7e3])
    assert "lowered 3 times from 300 to 218.7 kPa" in caught.value.__notes__[0]


def test_a_step_that_does_not_converge_also_lowers_but_a_singular_matrix_does_not() -> None:
    calls: list[float] = []

    def once(parameters: SimulationParameters) -> xr.Dataset:
        calls.append(parameters.sigma_max)
        if len(calls) == 1:
            raise NotConverged((1.0, 0.5), 0.1, "iterations exhausted")
        return xr.Dataset()

    said: list[str] = []
    assert lower_sigma_max(once, PARAMETERS, report=said.append).attrs["attempts"] == 2
    assert calls == pytest.approx([300e3, 270e3])
    assert said == ["NotConverged at sigma_max = 300 kPa, trying 270 kPa"]

    def singular(parameters: SimulationParameters) -> xr.Dataset:
        raise SingularSystem("zero pivot")

    with pytest.raises(SingularSystem):
        lower_sigma_max(singular, PARAMETERS)


def test_a_loss_of_stability_before_a_lowering_is_reported_with_the_motion() -> None:
    def snapping(parameters: SimulationParameters) -> xr.Dataset:
        if parameters.sigma_max > 280e3:
            error = InvertedElement(3, -0.1, 0.2)
            error.add_note("the equilibrium lost stability between 0.1 and 0.15 s")
            raise error
        return xr.Dataset()

    said: list[str] = []
    motion = lower_sigma_max(snapping, PARAMETERS, report=said.append)
    assert "at sigma_max = 300 kPa (the equilibrium lost stability between 0.1" in said[0]
    assert stability_warning(motion).startswith("sigma_max was lowered after InvertedElement at")
    assert stability_warning(lower_sigma_max(fails_above(280e3, []), PARAMETERS)) == ""


def test_a_missed_accuracy_does_not_weaken_muscles() -> None:
    calls: list[float] = []

    def inaccurate(parameters: SimulationParameters) -> xr.Dataset:
        calls.append(parameters.sigma_max)
        raise ToleranceMissed(2e-5, 1e-5, 1e-5, 0.1)

    with pytest.raises(ToleranceMissed, match="lower accuracy"):
        lower_sigma_max(inaccurate, PARAMETERS)
    assert calls == [300e3]


@pytest.mark.filterwarnings("ignore::emgface.errors.FeatureWarning")
@pytest.mark.parametrize("scope", ["volunteer", "trial"])
def test_a_value_lowered_for_one_trial_holds_for_its_volunteer(
    laboratory, tmp_path, monkeypatch, scope
):
    """The first trial inverts an element above 85 kPa; the second would run with 100 kPa."""
    first: list[float] = []

    def fragile(face, activation, parameters, **rest):
        drive = float(activation.sum())
        first.append(drive)
        if drive == first[0] and parameters.sigma_max > 85e3:
            raise InvertedElement(1, -0.1, 0.3)
        return simulate_face(face, activation, parameters, **rest)

    monkeypatch.setattr(skin, "simulate_face", fragile)
    mechanics = MECHANICS | {"sigma_max": 100e3, "sigma_max_policy": {"scope": scope}}
    study = configured(laboratory, simulation=mechanics)
    cube = run_study(study, tmp_path / "out").cube
    assert (cube["status"] == "ok").all()
    used = sorted(cube["sigma_max"].values.ravel())
    shared = scope == "volunteer"
    np.testing.assert_allclose(used, [81e3, 81e3 if shared else 100e3], rtol=1e-12)
    results = open_results(tmp_path / "out")
    assert results.intake is not None
    shown = [results.trial(r.place, "act_rel").motion for r in results.intake.recordings]
    assert sorted(motion.attrs["sigma_max"] for motion in shown) == used
    calls = len(first)
    again = run_study(study, tmp_path / "out")
    assert not again.computed() and len(first) == calls  # the second run uses the stored results
