"""Outcome of tasks of the imported model and published numbers."""

import pandas as pd
import pytest
from typer.testing import CliRunner

from emgface.anatomy.jaw.outcomes import outcome
from emgface.anatomy.jaw.run import run_task
from emgface.anatomy.jaw.tasks import JAW_TASKS
from emgface.cli import app
from emgface.schema.netcdf import write_netcdf


@pytest.mark.parametrize(("force", "stored", "static"), [(1.14, 12.75, 14.1), (4.56, 33.59, 35.3)])
def test_pull_on_the_incisor_lowers_it_as_stored(published, force, stored, static):
    """Within 2 mm of the stored result of the program, 0.1 mm of a static solution of the same model."""
    measures = outcome(run_task(published("fixed"), JAW_TASKS["pull"], load=(0.0, 0.0, -force)))
    assert measures["end_down"] == pytest.approx(stored, abs=2.0)
    assert measures["end_down"] == pytest.approx(static, abs=0.1)
    assert abs(measures["end_right"]) < 1e-3


def test_wide_opening_has_the_published_gape(published):
    """Stavness et al. 2006, section 3.1: 38 mm in the text, 35 mm in figure 4."""
    measures = outcome(run_task(published("larynx"), JAW_TASKS["open"]))
    assert 35.0 <= measures["gape"] <= 39.0


def test_tasks_run_without_the_muscles_that_a_fixed_hyoid_lacks(published, shared, tmp_path):
    """Published series and tasks drive infrahyoid muscles, of which the table names the absent ones."""
    series = shared / "artisynth_models" / "jaw_larynx" / "probes" / "leftchew"
    jaw, out, moved = (tmp_path / name for name in ("jaw.nc", "table.csv", "moved.nc"))
    write_netcdf(published("fixed"), jaw, "jaw_model")
    command = [
        "jaw",
        "tasks",
        str(jaw),
        "--series",
        str(series),
        "--step",
        "0.005",
        "--out",
        str(out),
    ]
    run = CliRunner().invoke(app, command)
    assert run.exit_code == 0, run.output
    table = pd.read_csv(out).set_index("task")
    assert set(table.index) == set(JAW_TASKS)
    assert "bi_infrahyoid" in table.loc["gape", "without"]
    assert table["without"].isna()["open"]
    assert 10.0 < table.loc["chew", "down"] < 30.0
    for options, run in (
        ([str(out), "--set", "morsel=L"], "are settings of a task"),
        (["open", "--set", f"series={series}"], "the task 'open' has no series"),
        (["rest", "--set", f"series={series}"], "the task 'rest' has no series"),
    ):  # neither was used, without a word
        given = ["simulate", *options, "--model", str(jaw), "--out", str(tmp_path / "m.nc")]
        result = CliRunner().invoke(app, given)
        assert result.exit_code == 2 and run in " ".join(
            result.output.replace("\u2502", "").split()
        )
