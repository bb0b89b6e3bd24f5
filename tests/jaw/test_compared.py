"""A motion of a jaw compared with a recording: path, scores, baselines and page."""

import numpy as np
import pytest
from typer.testing import CliRunner

from analysis.tables import Table
from emgface.anatomy.jaw.compared import JawComparison, compare_with_recording
from emgface.anatomy.jaw.recorded import (
    LARGEST_SHIFT,
    in_skull_of,
    score_motion,
    simulated_recording,
)
from emgface.anatomy.jaw.run import run_task
from emgface.anatomy.jaw.tasks import JAW_TASKS, JawTask
from emgface.anatomy.jaw.template import template_jaw
from emgface.cli import app
from emgface.recordings.dataset import write_recording
from emgface.schema.netcdf import write_netcdf
from tests.jaw.small import small_jaw


@pytest.fixture(scope="module")
def truth():
    return run_task(template_jaw(preset="woman"), JAW_TASKS["cycles"], step=5e-3, check=False)


@pytest.fixture(scope="module")
def recording(truth):
    return simulated_recording(truth)


def test_scores_stand_next_to_those_of_motions_that_must_be_worse(truth, recording):
    """Recorded with noise of 0.1 mm, the motion itself scores 1, the others as computed by hand."""
    driven = truth.assign_attrs(recorded_start=0.0)
    still = driven.copy(deep=True)
    still["position"].values[:] = driven["position"].values[..., :1]
    compared = compare_with_recording(recording, driven, {"still": still})
    rows = {row[0]: row[2:] for row in compared.scores.rows}
    rho, ratio, rmse, shift = rows["simulated"]
    assert rho > 0.999
    assert ratio == pytest.approx(1.0, abs=0.01)
    assert rmse < 0.25e-3
    assert abs(shift) < 5e-3
    assert rows["the same, backwards in time"][0] < 0.5
    x = in_skull_of(truth, "lower_incisor")
    away = np.sqrt(((x - x.mean(axis=0)) ** 2).sum(axis=1).mean())
    assert rows["none (the point rests)"][2] == pytest.approx(away, rel=0.02)
    assert np.isnan(rows["still"][0])
    assert "has an equally high score" not in compared.scores.note
    apart = compared.path.sel(marker="lower_incisor").values.T - x
    assert np.sqrt(np.nanmean((apart**2).sum(axis=1))) == pytest.approx(rmse, rel=1e-6)
    assert np.isfinite(apart).mean() > 0.98


def test_a_driven_motion_is_not_matched_with_another_repetition(truth, recording):
    """Delayed by the 0.9 s between both openings it still correlates with 1, at the wrong time."""
    late = truth.copy(deep=True)
    late["position"].values[..., 180:] = truth["position"].values[..., :-180]
    late["position"].values[..., :180] = truth["position"].values[..., :1]
    scores = score_motion(recording, late.assign_attrs(recorded_start=0.0))
    assert abs(float(scores["shift"])) <= LARGEST_SHIFT + 1e-9
    assert float(scores["rho"][0]) < 0.7


def test_the_recorded_point_turns_with_the_head():
    """A point that was recorded relative to the skull is drawn where the turned skull carries it."""
    motion = run_task(small_jaw(), JawTask("", 0.3, {"bi_all": [(0.0, 0.0)]}, head=15.0), step=5e-3)
    x = in_skull_of(motion, "lower_incisor")
    path = motion["position"].sel(marker=["lower_incisor"]).transpose("marker", "axis", "time")
    drawn = JawComparison(path.copy(data=x.T[None]), Table("", (), (), "")).at(motion)
    k = motion["marker"].values.tolist().index("lower_incisor")
    room = motion["position"].sel(marker="lower_incisor").transpose("time", "axis").values
    np.testing.assert_allclose(drawn[:, k], room, atol=1e-12)
    assert np.abs(room - x).max() > 5e-3
    assert np.isnan(np.delete(drawn, k, axis=1)).all()


def test_commands_show_and_score_with_a_recording(tmp_path, truth, recording):
    write_netcdf(truth, tmp_path / "motion.nc", "jaw_motion")
    write_netcdf(truth, tmp_path / "exchanged.nc", "jaw_motion")
    write_recording(recording, tmp_path / "trial.nc")
    files = {
        name: str(tmp_path / name) for name in ("motion.nc", "exchanged.nc", "trial.nc", "s.nc")
    }
    beside_it = ["--baseline", files["exchanged.nc"]]
    show = ["jaw", "show", files["motion.nc"]]
    for command in (
        ["score", files["trial.nc"], files["motion.nc"], "--out", files["s.nc"], *beside_it],
        [*show, "--recording", files["trial.nc"], *beside_it],
    ):
        result = CliRunner().invoke(app, command)
        assert result.exit_code == 0, result.output
        text = (
            result.output + (tmp_path / "motion.html").read_text()
            if "show" in command
            else result.output
        )
        for row in ("backwards in time", "exchanged", "the point rests", "was not estimated"):
            assert row in " ".join(text.split())
    page = (tmp_path / "motion.html").read_text()
    assert "recorded point" in page
    assert '"measured": null' not in page
    result = CliRunner().invoke(app, [*show, *beside_it])
    assert result.exit_code == 2
    assert "expected the motion of a jaw and its recording" in " ".join(result.output.split())


def test_a_movement_that_is_the_same_backwards_is_reported(truth):
    """One symmetric opening says nothing about its course, however high its score is."""
    motion = truth.copy(deep=True).assign_attrs(recorded_start=0.0)
    t = motion["time"].values
    bump = np.exp(-0.5 * ((t - t.mean()) / 0.2) ** 2)
    rest = truth["position"].values[..., :1]
    motion["position"].values[:] = rest - 1e-2 * bump * np.array([0.0, 0.5, 1.0])[:, None]
    assert (
        "backwards in time has an equally high score"
        in compare_with_recording(simulated_recording(motion), motion).scores.note
    )
