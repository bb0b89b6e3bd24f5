"""Excitations and motion of a small jaw; no published files are needed."""

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from typer.testing import CliRunner

import sim
from emgface.anatomy.jaw.outcomes import point_displacement, separation
from emgface.anatomy.jaw.run import run_task, simulate_jaw
from emgface.anatomy.jaw.series import ramps, read_excitation, read_probe, read_probes
from emgface.anatomy.jaw.tasks import JAW_TASKS, HeadTurn, JawTask, task_of
from emgface.cli import app
from emgface.cli.simulate import tell_motion
from emgface.errors import FeatureWarning, JawError
from emgface.schema.netcdf import read_netcdf, write_netcdf
from tests.jaw.small import small_jaw

PROBE = "0 1000000000 0.5\nCubic 1 explicit\n{}\n"


def probe_file(folder, rows, name="lsm.txt"):
    path = folder / name
    path.write_text(PROBE.format("\n".join(f"{t}  {y}" for t, y in rows)))
    return path


def test_cubic_series_pass_their_rows_with_the_slope_of_the_chord(tmp_path):
    path = probe_file(tmp_path, [(0.2, 0.0), (0.4, 0.3), (1.0, 0.1), (1.4, 0.1)])
    at = np.array([0.1, 0.2, 0.5, 0.7])  # times are scaled by a half
    np.testing.assert_allclose(read_probe(path, at), [0.0, 0.3, 0.1, 0.1], atol=1e-15)
    h = 1e-6
    below, above = read_probe(path, np.array([0.2 - h, 0.2 + h]))
    assert (above - below) / (2 * h) == pytest.approx(
        0.1 / 0.4, abs=100 * h
    )  # the second derivative jumps there
    np.testing.assert_allclose(read_probe(path, np.array([0.05, 2.0])), [0.0, 0.1], atol=1e-15)


def test_series_of_another_program_are_interpolated_as_by_that_program(shared, recorded):
    """Excitations of a recorded chewing cycle; those of groups are negative there, and zero here."""
    case, arrays = recorded("larynx_rightchew_probes")
    folder = shared / "artisynth_models" / "jaw_larynx" / "probes" / "rightchew"
    probes = read_probes(folder).values
    for muscle, exciter in (("lsm", "sm_L"), ("rat", "at_R"), ("lip", "ip_L"), ("rpm", "my_R")):
        theirs = arrays["muscle_excitation"][:, case["muscles"].index(muscle)]
        ours = probes[exciter][::5]
        where = (theirs != 0.0) | (ours > 0.0)
        np.testing.assert_allclose(ours[where], theirs[where], atol=1e-8)


def test_negative_excitations_are_clipped_and_reported(tmp_path):
    table = pd.DataFrame({"time": [0.0, 0.1], "bi_all": [-0.02, 0.4], "close_L": [0.3, 0.9]})
    table.to_csv(tmp_path / "drive.csv", index=False)
    a, negative = read_excitation(tmp_path / "drive.csv").activation(small_jaw())
    assert negative == -0.02
    np.testing.assert_allclose(a.sel(muscle="close_L"), [0.3, 1.0])  # 0.4 + 0.9 is limited
    np.testing.assert_allclose(a.sel(muscle="close_R"), [0.0, 0.4])
    a.to_dataset(name="activation").to_netcdf(tmp_path / "drive.nc")
    again = read_excitation(tmp_path / "drive.nc")
    np.testing.assert_allclose(again.values["close_R"], [0.0, 0.4])


@pytest.mark.parametrize(
    ("time", "said"),
    [
        ([0.0, 0.5, 0.4, 1.0], r"do not ascend, 0.4 s follows 0.5 s in row 3"),
        ([0.0, 0.5, 0.5], "0.5 s follows 0.5 s"),
        ([0.0], "contains 1 instants, expected at least two"),
        (list(range(0, 1001, 10)), "every 10 s.*times in milliseconds by 1000"),
        (
            [0, 100, 300, 1000],
            "4 instants every 200 s, expected at most 5 s: divide times in milli",
        ),
    ],
)
def test_times_that_cannot_be_seconds_are_refused(time, said, tmp_path):
    table = pd.DataFrame({"time": time, "bi_all": 0.1})
    table.to_csv(tmp_path / "drive.csv", index=False)
    with pytest.raises(JawError, match=said):
        read_excitation(tmp_path / "drive.csv")


def test_a_dense_series_in_milliseconds_is_reported(tmp_path):
    """At 10 kHz its intervals of 0.1 are those of a slow series in seconds."""
    time = np.arange(0.0, 500.0, 0.1)
    pd.DataFrame({"time": time, "bi_all": 0.1}).to_csv(tmp_path / "drive.csv", index=False)
    with pytest.warns(
        FeatureWarning, match="an instant every 0.1 s: check that its times are in s"
    ):
        read_excitation(tmp_path / "drive.csv")


def test_an_absent_file_of_excitations_is_named(tmp_path):
    for name in ("absent.csv", "absent.nc"):
        with pytest.raises(JawError, match=f"No file .*{name}; expected"):
            read_excitation(tmp_path / name)


def test_a_late_start_is_reported_and_milliseconds_of_files_are_converted(tmp_path):
    table = pd.DataFrame({"time": [0.3, 0.6], "bi_all": [0.2, 0.4]})
    table.to_csv(tmp_path / "drive.csv", index=False)
    with pytest.warns(FeatureWarning, match="begins at 0.3 s: its first values are used"):
        given = read_excitation(tmp_path / "drive.csv")
    a, _ = given.activation(small_jaw())
    late = a.assign_coords(time=("time", 1e3 * a["time"].values, {"units": "ms"}))
    late.to_dataset(name="activation").to_netcdf(tmp_path / "drive.nc")
    with pytest.warns(FeatureWarning):
        np.testing.assert_allclose(read_excitation(tmp_path / "drive.nc").time, [0.3, 0.6])
    late["time"].attrs["units"] = "mV"
    late.to_dataset(name="activation").to_netcdf(tmp_path / "drive2.nc")
    with pytest.raises(JawError, match="not a unit of time"):
        read_excitation(tmp_path / "drive2.nc")


def test_free_fall_ends_at_the_teeth_and_muscles_hold_the_weight():
    """Symmetric drive moves symmetrically; forces are those of the law at the recorded lengths."""
    jaw = small_jaw()
    drive = ramps({"bi_all": [(0.0, 0.3)]})
    motion = simulate_jaw(jaw, drive, duration=0.1, step=5e-3)
    assert motion.attrs["origin"] == "simulated"
    for side in "LR":  # the teeth stay in contact, the jaw slides freely along them
        assert np.abs(point_displacement(motion, f"bite_{side}")[:, 2]).max() < 1e-9
    assert np.abs(point_displacement(motion, "lower_incisor")[:, 0]).max() < 1e-9
    row = motion.sel(muscle="close_L")
    law = sim.Peck(10.0, stretch_max=1.3)
    rest = float(row["muscle_length"][0])
    _, expected, _ = law.evaluate(row["muscle_length"].values, rest, row["activation"].values)
    np.testing.assert_allclose(row["muscle_force"][-1], expected[-1], rtol=1e-3)
    open_ = simulate_jaw(jaw, ramps({"bi_all": [(0.0, 0.0)]}), duration=0.1, step=5e-3)
    assert point_displacement(open_, "lower_incisor")[-1, 2] < -1.0
    pulled = run_task(jaw, JAW_TASKS["pull"], duration=0.1, step=5e-3)
    drop = [point_displacement(m, "lower_incisor")[-1, 2] for m in (open_, pulled)]
    assert drop[1] < drop[0] - 0.5
    assert separation(open_)[-1] > 1.0


def test_rotation_of_the_head_lifts_the_front_and_is_removed_from_displacements():
    turn = HeadTurn(np.radians(15.0), np.array([0.0, -0.06, 0.02]))
    position, q = turn(0.2)
    assert q[1] == pytest.approx(np.sin(np.radians(7.5)))
    w, r = q[0], q[1:]
    chin = np.array([0.0, 0.05, 0.0])
    t = 2.0 * np.cross(r, chin)
    assert (position + chin + w * t + np.cross(r, t))[2] > chin[2] + 0.02
    np.testing.assert_allclose(turn(0.0)[0], 0.0, atol=1e-18)
    motion = run_task(
        small_jaw(), JawTask("", 0.02, {"bi_all": [(0.0, 0.5)]}, head=15.0), step=5e-3
    )
    assert np.abs(point_displacement(motion, "upper_incisor")).max() < 1e-9


def test_command_moves_a_jaw_by_a_table(tmp_path):
    write_netcdf(small_jaw(), tmp_path / "jaw.nc", "jaw_model")
    (tmp_path / "drive.csv").write_text("time,bi_all\n0,-0.1\n0.02,0.2\n")
    files = [str(tmp_path / name) for name in ("jaw.nc", "drive.csv", "out.nc")]
    command = [
        "jaw",
        "run",
        files[0],
        "--excitation",
        files[1],
        "--out",
        files[2],
        "--step",
        "0.005",
    ]
    result = CliRunner().invoke(app, command)
    assert result.exit_code == 0, result.output
    assert "down to -0.1, were set to zero" in result.output.replace("\n", " ")
    motion = read_netcdf(files[2], "jaw_motion")
    assert (motion.attrs["task"], motion.attrs["origin"]) == ("drive", "simulated")
    assert float(motion["time"][-1]) == pytest.approx(0.02)


def test_invalid_tasks_are_refused_with_a_reason(tmp_path):
    jaw = small_jaw()
    with pytest.raises(JawError, match=r"no exciter is called 'open'.*, expected one of"):
        simulate_jaw(jaw, ramps({"open": [(0.0, 1.0)]}), duration=0.01)
    with pytest.raises(JawError, match="rises to 50, expected a fraction"):
        simulate_jaw(jaw, ramps({"bi_all": [(0.0, 50.0)]}), duration=0.01)
    with pytest.raises(JawError, match="no task is called 'sing'"):
        task_of("sing")
    with pytest.raises(JawError, match="muscle law 'soft', expected one of peck"):
        simulate_jaw(jaw, ramps({"bi_all": [(0.0, 1.0)]}), duration=0.01, law="soft")
    with pytest.raises(JawError, match="contains no excitation series"):
        read_probes(tmp_path)
    (tmp_path / "lsm.txt").write_text("0 1 1\nQuintic 1 explicit\n0 0\n")
    with pytest.raises(JawError, match="is not an excitation series"):
        read_probes(tmp_path)
    (tmp_path / "drive.csv").write_text("t,bi_all\n0,1\n")
    with pytest.raises(JawError, match="expected a table with a column time"):
        read_excitation(tmp_path / "drive.csv")
    assert {"rest", "close", "open", "protrude", "lateral", "clench", "chew", "swallow"} <= set(
        JAW_TASKS
    )


def test_a_loss_of_stability_is_reported(capsys):
    lost = {"unstable_from_s": 0.12, "unstable_until_s": 0.2}
    for attrs, reported in (({}, False), (lost, True)):
        motion = xr.Dataset(attrs={"clipped_excitation": 0.0, "task": "chew", **attrs})
        tell_motion(motion, "chew.nc", "jaw")
        assert ("lost stability between 0.12 and 0.2 s" in capsys.readouterr().err) == reported
