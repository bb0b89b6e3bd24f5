"""Acceptance checks of the imported model: their table, and the parts that take a moment."""

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

from benchmarks import jaw_published
from emgface.anatomy.jaw import run
from emgface.anatomy.jaw.run import REST_SPEED, run_task
from emgface.anatomy.jaw.tasks import JAW_TASKS
from emgface.cli import app
from emgface.schema.netcdf import write_netcdf
from tests.jaw.small import small_jaw


def test_the_table_has_one_row_for_every_check_in_the_order_of_the_checks(monkeypatch):
    """A variant without an outcome has an empty cell."""
    monkeypatch.setattr(
        jaw_published,
        "models",
        lambda: dict.fromkeys(("planar, hyoid fixed", "curved, hyoid free")),
    )
    monkeypatch.setattr(
        jaw_published,
        "free_body",
        lambda jaw: [{"check": "1 energy", "planar, hyoid fixed": "1e-9"}],
    )
    results = {"planar, hyoid fixed": {"6 b": 1.0, "2 a": "x"}, "curved, hyoid free": {"2 z": 3.0}}
    monkeypatch.setattr(jaw_published, "in_variant", lambda jaw, name: results[name])
    monkeypatch.setattr(jaw_published, "chewing_with_stored_parameters", lambda: {"5 chew": 2.0})
    table = jaw_published.checks()
    assert table["check"].tolist() == ["1 energy", "2 a", "2 z", "5 chew", "6 b"]
    assert list(table.iloc[1])[2:] == ["x", "", "", "-", "computed"]
    assert not table.isna().to_numpy().any()


def test_a_free_mandible_keeps_energy_and_momentum(published):
    """1e-8 over a second is wanted; an inertia of the wrong frame would change the order too."""
    results = {
        row["check"]: row["planar, hyoid fixed"]
        for row in jaw_published.free_body(published("fixed"))
    }
    assert 0.0 < float(results["1 energy over 1 s, relative"]) < 1e-8
    assert float(results["1 angular momentum over 1 s, relative"]) < 1e-8
    assert float(results["1 order of RK4 with rotation"]) == pytest.approx(4.0, abs=0.1)


def test_right_chewing_is_the_mirror_image_if_the_bodies_are(published):
    """1e-6 mm is wanted: the centre of the imported hyoid lies 1.4 um off the midline."""
    jaw = published("larynx")
    error = jaw_published.mirror_error(jaw_published.symmetric(jaw), 0.3, step=5e-3)
    assert error < 1e-8
    assert jaw_published.mirror_error(jaw, 0.3, step=5e-3) > 10.0 * error


def test_the_stored_pull_is_compared_on_the_branch_of_its_force(shared, published):
    """Stored places at 3.42 N differ by 0.7 mm between both branches; ours by as much."""
    time, force, stored = jaw_published.stored_pull()
    assert force.max() == pytest.approx(5.25, abs=0.01) and time[np.argmax(force)] == 4.6
    known = jaw_published.on_branches(stored)
    # table of the specification: -26.57 up and 12.0 back at 3.42 N, which is the rising branch
    np.testing.assert_allclose(known["rising"][2, 1:], [-12.0, -26.57], atol=0.05)
    lag = (known["falling"] - known["rising"])[2, 2]
    assert lag == pytest.approx(-0.74, abs=0.02)
    moved = jaw_published.ramp(published("fixed"))
    ours = jaw_published.on_branches(moved)
    assert (ours["falling"] - ours["rising"])[2, 2] == pytest.approx(lag, abs=0.1)
    assert jaw_published.misses(stored)["rms over the ramp"] == 0.0
    differences = jaw_published.misses(moved)
    assert max(abs(differences[f"up, {branch}"]) for branch in known) < 2.0


def test_a_task_that_ends_at_rest_is_continued_until_it_does(published):
    """After 2 s, the stated duration, the free hyoid moved at 0.09 mm/s."""
    motion = run_task(published("larynx"), JAW_TASKS["rest"], step=5e-3, check=False)
    assert motion.attrs["end_speed"] < REST_SPEED
    assert float(motion["time"][-1]) == 4.0
    short = run_task(published("larynx"), JAW_TASKS["rest"], duration=1.0, step=5e-3, check=False)
    assert short.attrs["end_speed"] > 10.0 * REST_SPEED
    assert "end_speed" not in run_task(published("fixed"), JAW_TASKS["open"], check=False).attrs


def test_a_jaw_that_still_moves_at_the_end_is_reported(published, tmp_path):
    path = tmp_path / "jaw.nc"
    write_netcdf(published("larynx"), path, "jaw_model")
    command = ["jaw", "run", str(path), "--task", "rest", "--duration", "0.2", "--out"]
    result = CliRunner().invoke(app, [*command, str(tmp_path / "rest.nc")])
    assert result.exit_code == 0, result.output
    assert "At the end, 0.2 s, a point still moves at" in " ".join(result.output.split())


def test_a_jaw_that_never_rests_is_not_simulated_for_ever(monkeypatch):
    """Both signs of a velocity count; 16 s is the longest rest."""
    asked = list[float]()

    def moving(jaw, excitation, *, duration, **_):
        asked.append(duration)
        x = -1e-3 * np.arange(3.0)[:, None, None] * np.ones((1, 1, 3))
        return xr.Dataset({"position": (("time", "marker", "axis"), x)}, {"time": [0.0, 0.5, 1.0]})

    monkeypatch.setattr(run, "simulate_jaw", moving)
    motion = run_task(small_jaw(), JAW_TASKS["rest"])
    assert asked == [2.0, 4.0, 8.0, 16.0]
    assert motion.attrs["end_speed"] == pytest.approx(2e-3 * 3**0.5)
