"""Baselines of a study on a slab of tissue: contributing volunteers, and stored results."""

import shutil
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from analysis.baselines import BASELINE_VARIABLES, scored
from analysis.registration import mean_motion
from emgface.choices import configure
from emgface.face.measured import measured_during
from emgface.face.simulation_parameters import SimulationParameters
from emgface.recordings.dataset import read_recording, write_recording
from emgface.report.results import open_results
from emgface.schema.netcdf import read_netcdf
from emgface.study.configuration import StudyConfiguration
from emgface.study.run import run_study
from emgface.volunteers.simulate import make_volunteers
from tests.study_run.conftest import MECHANICS

pytestmark = [
    pytest.mark.slow,
    pytest.mark.filterwarnings("ignore::emgface.errors.FeatureWarning"),
]


@pytest.fixture(scope="module")
def three(slab: xr.Dataset, laboratory: Path, tmp_path_factory):
    """Three recordings of S01 (B twice, E), and S02, S03 that move as S01 in other sizes."""
    folder = tmp_path_factory.mktemp("three")
    shutil.copytree(laboratory / "recordings", folder / "recordings")
    made = make_volunteers(
        slab, folder / "second", n=1, repetitions=2, instructions=("B",), seed=2,
        parameters=configure(SimulationParameters, MECHANICS),
    )  # fmt: skip
    write_recording(read_recording(made[1]), folder / "recordings" / "S01_B_2.nc")
    for volunteer, factor in (("S02", 1.5), ("S03", 0.8)):
        for instruction in "BE":
            one = read_recording(laboratory / "recordings" / f"S01_{instruction}_1.nc")
            # All markers are scaled by the same factor, so that the head remains a rigid body.
            middle = one["position"].mean(["time_marker", "marker"])
            larger = (middle + factor * (one["position"] - middle)).transpose(*one["position"].dims)
            one["position"] = larger.assign_attrs(one["position"].attrs)
            path = folder / "recordings" / f"{volunteer}_{instruction}_1.nc"
            write_recording(one.assign_attrs(volunteer=volunteer), path)
    study = configure(
        StudyConfiguration,
        {
            "strategies": ["act_rel"],
            "recordings": {"folder": str(folder / "recordings")},
            "face": {"path": str(laboratory / "face.nc")},
            "signals": {"normalisation": {"silent": "zero"}, "resampling": {"steps": 40}},
            "simulation": MECHANICS | {"sigma_max": 100e3},
        },
    )
    return study, run_study(study, folder / "study"), folder / "study"


def test_every_baseline_is_in_the_cube(three) -> None:
    cube = read_netcdf(three[1].path, "cube")
    assert {*BASELINE_VARIABLES, "skill_reason"} <= {*cube.data_vars}
    assert cube["template_rho"].dims == ("volunteer", "instruction", "repetition", "marker")
    for name in ("template_rho", "wrong_rho", "onset_error", "asymmetry_simulated"):
        first = cube[name].sel(repetition=1)
        assert (
            np.isfinite(first).any("marker").all()
            if "marker" in first.dims
            else (np.isfinite(first).all())
        ), name
    b = cube.sel(volunteer="S01", instruction="B")
    for name in ("repeat_rho", "ceiling", "shuffled_rho", "within_rho"):
        assert np.isfinite(b[name]).any("marker").all(), name
        assert not np.isfinite(cube[name].sel(volunteer="S02")).any(), name
    reasons = set(cube["skill_reason"].sel(volunteer="S02", repetition=1).values.ravel())
    assert reasons == {"no other repetition"}


def test_baselines_require_no_simulation_and_are_stored(three) -> None:
    study, result, out = three
    motions = [event for event in result.computed() if event.stage == "motion"]
    assert len(motions) <= 7  # one for each trial at most
    stages = [event.stage for event in result.computed()]
    assert stages.count("typical") == 2 * stages.count("baselines") == 12
    again = run_study(study, out)
    assert again.computed() == []
    xr.testing.assert_identical(again.cube, result.cube)


def test_a_changed_alignment_computes_baselines_again(three) -> None:
    study, _, out = three
    other = study.model_copy(
        update={"alignment": study.alignment.model_copy(update={"least_gain": 0.1})}
    )
    stages = {event.stage for event in run_study(other, out).computed()}
    assert stages == {"aligned", "scores", "typical", "baselines"}


def test_templates_and_nulls_are_those_of_the_analysis(three) -> None:
    """Template of S02: mean of S01 (mean of two repetitions) and S03; its null is its motion of E."""
    study, result, out = three
    results = open_results(out)
    options = results.laboratory.alignment
    measured = {
        place: measured_during(
            trial.recording.dataset, trial.motion, results.laboratory.face, study.signals.head_frame
        )
        for place in (("S01", "B", 1), ("S01", "B", 2), ("S02", "B", 1), ("S03", "B", 1))
        for trial in [results.trial(place, "act_rel")]
    }
    scores = result.cube.sel(volunteer="S02", instruction="B", repetition=1).squeeze("strategy")
    own = measured["S02", "B", 1]
    wrong, _ = scored(own, results.trial(("S02", "E", 1), "act_rel").motion, options)
    np.testing.assert_allclose(scores["wrong_rho"], wrong, atol=1e-9)
    np.testing.assert_allclose(scores["wrong_rho_max"], wrong, atol=1e-9)
    first = mean_motion([measured["S01", "B", 1], measured["S01", "B", 2]], options)
    third = mean_motion([measured["S03", "B", 1]], options)
    rho, ratio = scored(own, mean_motion([first, third], options), options)
    np.testing.assert_allclose(scores["template_rho"], rho, atol=1e-9)
    np.testing.assert_allclose(scores["template_amplitude_ratio"], ratio, atol=1e-9)
    driven = [
        mean_motion([results.trial(p, "act_rel").motion["position"] for p in places], options)
        for places in ([("S01", "B", 1), ("S01", "B", 2)], [("S03", "B", 1)])
    ]
    lips = mean_motion(driven, options).sel(marker=scores["marker"].values)
    np.testing.assert_allclose(scores["others_rho"], scored(own, lips, options)[0], atol=1e-9)
    with_own = mean_motion([first, third, mean_motion([own], options)], options)
    assert np.nanmax(np.abs(scored(own, with_own, options)[0] - rho)) > 1e-4
    assert (result.cube["template_volunteers"] == 2).all()
