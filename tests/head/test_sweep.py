"""Sweeps: errors of the step, continuation, plans and their refusals."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from typer.testing import CliRunner

from emgface.anatomy.head.build import build_head
from emgface.anatomy.head.model import Head, write_head
from emgface.anatomy.head.sweep import PlannedRun, Setting, outcomes, read_sweep_plan, sweep
from emgface.cli import app
from emgface.errors import ConfigurationError, FaceError, HeadError
from emgface.run.state import read_state

JAW = Setting(parts=("jaw",), duration=0.08, rise=0.04, step=1e-2)
RUNS = (
    PlannedRun("open", {"bi_open": 0.3}),
    PlannedRun("left", {"ip_L": 0.3}),
    PlannedRun("right", {"ip_R": 0.3}),
)


@pytest.fixture(scope="module")
def jaw() -> Head:
    return build_head(["jaw"], preset="man", resolution=400)


def test_step_error_is_the_distance_to_half_the_step(jaw: Head) -> None:
    """With half of the step the error is about half, as that of a method of first order."""
    rows = [
        sweep(RUNS[:1], Setting(**{**JAW.__dict__, "step": step})).iloc[0]
        for step in (2e-3, 1e-3, 5e-4)
    ]
    value = [row["lower_incisor_up_mm"] for row in rows]
    error = [row["lower_incisor_up_mm_step_error"] for row in rows]
    assert value[0] < -1.0  # an opener lowers the incisor, in millimetres
    assert error[1] == pytest.approx(abs(value[1] - value[0]), rel=1e-9)
    assert 1.5 < error[1] / error[2] < 2.7


def test_a_failed_run_states_its_reason_once(jaw: Head) -> None:
    """0.05 s are not a whole number of outputs, one every two steps of 10 ms."""
    end = str(sweep(RUNS[:1], replace(JAW, duration=0.05), head=jaw)["end"].iloc[0])
    assert end.startswith("ControlError: duration 0.05 s") and end.count("ControlError") == 1


def test_muscles_of_one_side_mirror_those_of_the_other(jaw: Head) -> None:
    def sideways(motion, head):
        x = motion["position"].sel(marker="lower_incisor").transpose("time", "axis").values
        return {**outcomes(motion, head), "side_mm": 1e3 * (x[-1] - x[0])[0]}

    swept = sweep(RUNS[1:], JAW, head=jaw, measure=sideways).to_dict("list")
    # a lateral pterygoid draws its condyle forward, and the incisor to the other side (+x is right)
    left, right = swept["side_mm"]
    assert left > 0.1
    assert left == pytest.approx(-right, abs=1e-9)
    for name in ("lower_incisor_forward_mm", "lower_incisor_up_mm"):
        assert swept[name][0] == pytest.approx(swept[name][1], abs=1e-9)


def test_an_interrupted_sweep_continues(jaw: Head, tmp_path: Path) -> None:
    table, measured = tmp_path / "table.csv", list[str]()

    def once(motion, head):
        if len(measured) == 4:  # two motions a run
            raise KeyboardInterrupt
        measured.append("run")
        return outcomes(motion, head)

    with pytest.raises(KeyboardInterrupt):
        sweep(RUNS, JAW, head=jaw, table=table, measure=once)
    assert list(pd.read_csv(table)["name"]) == ["open", "left"]
    state = read_state(tmp_path / "table")
    assert state.runs[-1].state == "interrupted" and state.status == {"ok": 2}
    measured.clear()
    swept = sweep(RUNS, JAW, head=jaw, table=table, measure=once)
    assert len(measured) == 2
    measured[:] = ["run"] * 5  # beyond the interruption
    whole = sweep(RUNS, JAW, head=jaw, measure=once)
    pd.testing.assert_frame_equal(swept, whole)
    # another setting, head of the same name, or measure computes all of them again
    measured.clear()
    sweep(RUNS[:1], Setting(**{**JAW.__dict__, "rise": 0.05}), head=jaw, table=table, measure=once)
    assert len(measured) == 2
    measured.clear()
    other = replace(jaw, parts={"jaw": jaw.parts["jaw"].assign_attrs(source="another")})
    sweep(RUNS[:1], JAW, head=other, table=table, measure=once)
    assert len(measured) == 2
    assert sweep(RUNS[:1], JAW, head=jaw, table=table)["key"][0] != whole["key"][0]


def test_rows_do_not_depend_on_the_number_of_workers(jaw: Head, tmp_path: Path) -> None:
    alone = sweep(RUNS[:2], JAW, head=jaw)
    both = sweep(RUNS[:2], JAW, head=jaw, table=tmp_path / "table.csv", workers=2)
    pd.testing.assert_frame_equal(both, alone)
    assert read_state(tmp_path / "table").status == {"ok": 2}


def test_plan_of_a_command_and_its_refusals(jaw: Head, tmp_path: Path) -> None:
    plan, out = tmp_path / "plan.csv", tmp_path / "table.csv"
    plan.write_text("name,bi_open,contact,tongue.sigma_max,ring.OOP\na,0.3,none,2e5,\n,,,,deep\n")
    first, second = read_sweep_plan(plan)
    assert first == PlannedRun("a", {"bi_open": 0.3}, {}, {"sigma_max": 2e5}, {}, ())
    assert second == PlannedRun("run 2", {}, {}, {}, {"OOP": "deep"}, None)
    for text, words in (("bi_open\n3\n", "level from 0 to 1"), ("bi_open\n", "no rows")):
        plan.write_text(text)
        with pytest.raises(HeadError, match=words):
            read_sweep_plan(plan)
    with pytest.raises(HeadError, match="is not a plan"):
        read_sweep_plan(tmp_path / "absent.csv")
    for run, error, words in (
        (PlannedRun("a", {"bi_nose": 0.1}), HeadError, "no exciter 'bi_nose'"),
        (PlannedRun("a", {}, rings={"OOP": "deep"}), HeadError, "expected a generated head"),
        (PlannedRun("a", {}, contacts=("lip-lip",)), HeadError, "no contact 'lip-lip'"),
        (PlannedRun("a", {}, face={"stiff": 2.0}), ConfigurationError, "stiffening"),
    ):
        with pytest.raises(error, match=words):
            sweep([run], JAW, head=jaw)
    with pytest.raises(FaceError, match="at least one layer"):
        sweep(
            [PlannedRun("a", {}, rings={"OOP": "marginal"})],
            Setting(parts=("face",), resolution=400),
        )
    plan.write_text("bi_open\n0.3\n")
    head = write_head(jaw, tmp_path / "head.nc")
    options = ["--head", str(head), "--out", str(out), "--duration", "0.04", "--workers", "1"]
    result = CliRunner().invoke(app, ["sweep", str(plan), *options])
    assert result.exit_code == 0 and "1 runs, 0 failed" in result.output, result.output
    assert pd.read_csv(out)["end"].tolist() == ["reached"]


def test_the_speed_at_the_end_is_that_of_the_last_step():
    """A marker that speeds up: 1 mm in the last step of 10 ms, less before."""
    position = np.zeros((4, 1, 3))
    position[:, 0, 2] = [0.0, 0.1e-3, 0.3e-3, 1.3e-3]
    motion = xr.Dataset(
        {"position": (("time", "marker", "axis"), position)},
        {"time": [0.0, 0.01, 0.03, 0.04], "marker": ["tip"]},
    )
    results = outcomes(motion, Head(xr.Dataset(), {}))
    assert results == pytest.approx({"tip_forward_mm": 0.0, "tip_up_mm": 1.3, "speed_mm_s": 100.0})
