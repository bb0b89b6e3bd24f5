"""Examples of the page of commands, executed one after the other as they are printed."""

import os
import shlex
import shutil
from pathlib import Path

import pytest
from typer.testing import CliRunner

from emgface.anatomy.jaw.template import template_jaw
from emgface.cli import app
from emgface.fit.bones import points_of_jaw
from emgface.schema.netcdf import read_netcdf
from tests.api.test_kinds import examples

NOT_HERE = {
    "import": "files of a published model",
    "map": "a C3D file, as `test_command_files`",
    "convert": "a C3D file",
    "cut": "a session with events",
    "segment": "an image; tests/fit/test_images.py",
    "treat": "tests/treatment",
    "compare": "tests/treatment",
    "dose": "tests/treatment",
    "reduce": "tests/reduced",
    "tabulate": "tests/jaw",
    "sweep": "tests/head",
    "live": "serves until it is interrupted; tests/view",
    "demo": "the main job of the README",
    "invert": "tests/inverse",
    "record": "a motion of a jaw; tests/jaw",
    "study": "tests/study_run/test_cli.py",
    "volunteers": "simulates for minutes; tests/study_run/test_cli.py",
    "report": "tests/study_run/test_cli.py",
}
"""Commands whose examples need other files or minutes, and where they run."""

ORDER = ["check", "inventory", "features", "describe", "activate", "simulate", "score", "show", "build",
         "fit", "sound", "schema"]  # fmt: skip


def test_examples_run_as_they_are_printed(
    laboratory: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every example runs here, or the table says where its command does.

    Of `fit`, that of a jaw runs here, and that of a face in tests/fit.
    """
    lines = {shlex.split(line)[1]: shlex.split(line)[1:] for line in examples()}
    assert set(lines) == {*ORDER, *NOT_HERE}

    (tmp_path / "recordings").mkdir()
    for path in (laboratory / "recordings").glob("*_B_*.nc"):
        shutil.copy(path, tmp_path / "recordings")
    shutil.copy(path, tmp_path / "trial.nc")
    shutil.copy(laboratory / "face.nc", tmp_path)
    points = points_of_jaw(template_jaw(seed=8))
    rows = [f"{name},{','.join(f'{1e3 * x:.3f}' for x in point)}" for name, point in points.items()]
    (tmp_path / "jaw.csv").write_text("\n".join(["name,x_mm,y_mm,z_mm", *rows]))
    emg = read_netcdf(path, "recording")["emg"].transpose("time_emg", "channel")
    emg.to_pandas().rename_axis("time").to_csv(tmp_path / "emg.csv")
    monkeypatch.chdir(tmp_path)
    for name in ORDER:
        result = CliRunner().invoke(app, lines[name])
        assert result.exit_code == 0, (name, result.output, result.exception)
        if name == "score":  # without --face, the head markers are those of the template
            assert "of the face" not in result.output
            given = [word for word in lines[name] if word not in ("--face", "face.nc")]
            again = CliRunner().invoke(app, given)
            assert "the motion belongs to the face 'slab'" in " ".join(again.output.split())
        if "--out" in lines[name]:
            out = tmp_path / lines[name][lines[name].index("--out") + 1]
            assert os.path.getsize(out) > 0, name


def test_a_damaged_file_does_not_end_a_check(laboratory: Path, tmp_path: Path) -> None:
    """Neither among recordings nor among models; every other file is examined."""
    trial = next((laboratory / "recordings").glob("*_B_*.nc"))
    cut, face = tmp_path / "cut.nc", laboratory / "face.nc"
    for whole in (trial, face):
        cut.write_bytes(whole.read_bytes()[:3000])
        result = CliRunner().invoke(app, ["check", str(cut), str(face), str(trial)])
        text = " ".join(result.output.split())
        assert result.exit_code == 2 and "cut.nc" in text
        assert "face.nc:" in text and "1 of 2 recordings can be used" in text


def test_a_duration_is_refused_where_the_file_has_its_own_times(
    laboratory: Path, tmp_path: Path
) -> None:
    trial = next((laboratory / "recordings").glob("*_B_*.nc"))
    line = ["simulate", str(trial), "--model", str(laboratory / "face.nc"), "--duration", "0.1"]
    result = CliRunner().invoke(app, [*line, "--out", str(tmp_path / "m.nc")])
    assert result.exit_code != 0 and not (tmp_path / "m.nc").exists()
    assert "cannot be applied" in str(result.exception) + result.output
