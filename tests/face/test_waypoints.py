"""Way points: motions that branch bit for bit, and folders that are refused."""

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

import emgface as ef
from emgface.cli import app
from emgface.errors import ConfigurationError, DataError
from emgface.face.file import save_face
from emgface.face.waypoints import INDEX, Branch, WayPoints
from emgface.schema.netcdf import read_netcdf, write_netcdf
from sim import SceneError

EVERY, LAST = 0.03, 0.12
CHOICES = {"accuracy": "draft", "sigma_max": 50e3, "output": 0.01}


def drive(face, level=0.3, late=None):
    """Left muscles rise until 0.06 s, then to another level."""
    time = np.array([0.0, 0.06, LAST])
    rows = [
        [0.0, level, late or level] if str(m).endswith("_L") else [0.0] * 3
        for m in face["muscle"].values
    ]
    return xr.Dataset(
        {"activation": (("muscle", "time"), np.array(rows), {"units": "1"})},
        {"muscle": list(map(str, face["muscle"].values)), "time": ("time", time, {"units": "s"})},
        {"origin": "simulated"},
    )


@pytest.fixture(scope="module")
def parent(coarse, tmp_path_factory):
    folder = tmp_path_factory.mktemp("motion") / "waypoints"
    return ef.simulate(drive(coarse), coarse, waypoints=(folder, EVERY), **CHOICES), folder


@pytest.mark.parametrize("at", [0.03, 0.06, 0.09])
def test_a_branch_repeats_the_rest_of_its_motion(coarse, parent, at):
    """With contact, and with further way points."""
    whole, folder = parent
    again = ef.simulate(drive(coarse), coarse, branch=(folder, at), **CHOICES)
    rest = whole.sel(time=slice(at - 1e-9, None))
    np.testing.assert_array_equal(again["time"].values, rest["time"].values)
    for name in ("position", "lip_opening", "kinetic_energy"):
        np.testing.assert_array_equal(again[name].values, rest[name].values, name)
    assert again.attrs["branched_at"] == pytest.approx(at)
    assert len(again.attrs["branched_from"]) == 64


def test_another_activation_changes_only_what_follows(coarse, parent):
    whole, folder = parent
    other = ef.simulate(drive(coarse, late=0.6), coarse, branch=(folder, 0.06), **CHOICES)
    rest = whole["position"].sel(time=slice(0.06 - 1e-9, None)).transpose("time", "marker", "axis")
    changed = np.abs(other["position"].transpose("time", "marker", "axis").values - rest.values)
    assert changed[0].max() == 0.0 and changed[-1].max() > 1e-4


def test_a_way_point_of_another_scene_is_refused(coarse, parent):
    _, folder = parent
    with pytest.raises(SceneError, match="belongs to another scene"):
        ef.simulate(drive(coarse), coarse, branch=(folder, 0.06), **CHOICES | {"sigma_max": 60e3})


def test_a_motion_does_not_replace_the_way_points_from_which_it_begins(coarse, parent):
    _, folder = parent
    before = sorted(path.name for path in folder.iterdir())
    with pytest.raises(ConfigurationError, match="expected another one for its own way points"):
        ef.simulate(
            drive(coarse), coarse, branch=(folder, 0.06), waypoints=(folder, EVERY), **CHOICES
        )
    assert sorted(path.name for path in folder.iterdir()) == before
    short = drive(coarse).isel(time=slice(None, 2))
    with pytest.raises(
        ConfigurationError, match=r"branches at 0.09 s, .* before its end at 0.06 s"
    ):
        ef.simulate(short, coarse, branch=(folder, 0.09), **CHOICES)


def test_folders_that_are_no_way_points_are_refused(parent, tmp_path):
    _, folder = parent
    with pytest.raises(
        DataError, match=r"no way point at 0.05 s, expected one of 0.03, 0.06, 0.09"
    ):
        Branch.from_folder(folder, 0.05)
    with pytest.raises(DataError, match="no list of way points"):
        Branch.from_folder(tmp_path, 0.05)
    for text in (
        "every = 'x'",
        "every = 0.1\npoints = 3",
        "a = [",
        "every = 0.1\n[[points]]\ntime = 1.0",
    ):
        (tmp_path / INDEX).write_text(text)
        with pytest.raises(DataError, match="no list of way points"):
            Branch.from_folder(tmp_path, 0.05)
    (tmp_path / INDEX).write_text((folder / INDEX).read_text())
    (tmp_path / "0.060000.nc").write_bytes((folder / "0.060000.nc").read_bytes()[:-1] + b"x")
    with pytest.raises(DataError, match="is not the way point that was written"):
        Branch.from_folder(tmp_path, 0.06)
    with pytest.raises(DataError, match="is not the way point that was written"):
        Branch.from_folder(tmp_path, 0.03)  # its file is absent


def test_way_points_leave_other_files_alone(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(
        ConfigurationError, match="contains notes.txt, expected a new or empty folder"
    ):
        WayPoints(tmp_path, 0.1).clear()
    assert (tmp_path / "notes.txt").read_text() == "mine"
    with pytest.raises(ConfigurationError, match="do not fit outputs every 0.02 s"):
        WayPoints(tmp_path, 0.03).outputs(0.02)
    with pytest.raises(ConfigurationError, match="do not fit outputs"):
        WayPoints(tmp_path, 0.0).outputs(0.02)


def test_the_command_writes_way_points_and_branches(coarse, tmp_path):
    save_face(coarse, tmp_path / "face.nc")
    write_netcdf(drive(coarse), tmp_path / "a.nc", "activation")
    common = ["simulate", str(tmp_path / "a.nc"), "--face", str(tmp_path / "face.nc"), "--accuracy",
              "draft", "--sigma-max", "50e3", "--no-contact"]  # fmt: skip
    folder, runner = str(tmp_path / "w"), CliRunner()
    first = [
        *common,
        "--out",
        str(tmp_path / "m.nc"),
        "--waypoints",
        folder,
        "--waypoint-every",
        "0.06",
    ]
    result = runner.invoke(app, first)
    assert result.exit_code == 0, result.output
    second = [*common, "--out", str(tmp_path / "b.nc"), "--branch", folder, "--branch-at", "0.06"]
    result = runner.invoke(app, second)
    assert result.exit_code == 0, result.output
    whole, branch = (read_netcdf(tmp_path / n, "trajectory") for n in ("m.nc", "b.nc"))
    rest = whole["position"].sel(time=slice(0.06 - 1e-9, None))
    np.testing.assert_array_equal(branch["position"].values, rest.values)
