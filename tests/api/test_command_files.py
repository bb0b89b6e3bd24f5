"""No command replaces a file that it reads, or writes two results to one file."""

import inspect
import os
import re
import typing
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from emgface.cli import app
from emgface.cli.written import FOLDER_PARAMETERS, WRITTEN_OPTIONS
from emgface.errors import DataError
from emgface.files import new_files
from emgface.schema.netcdf import write_netcdf
from tests.api.test_command_numbers import commands

READ = set(
    """
    activation after areas baseline before bone branch calibrate calibration clicks compare curves
    events face fiducials folder folders forget frame head_path inner labels landmarks mapping
    mixing model model_path motion on_face path paths plan range_ recording recordings reduced
    reference sidecars skin spread store study surface trajectory workspace
    """.split()
)
"""Parameters of commands that are paths and are not written."""


def paths():
    for path, callback in commands(app):
        hints = typing.get_type_hints(callback)
        names = [name for name, hint in hints.items() if "Path" in str(hint)]
        yield " ".join(path), callback, names


def pairs():
    for command, callback, names in paths():
        for out in (name for name in names if name in WRITTEN_OPTIONS):
            for source in (name for name in names if name not in WRITTEN_OPTIONS):
                yield pytest.param(callback, out, source, id=f"{command} {out} {source}")


def test_every_path_of_a_command_is_known_as_read_or_written():
    names_of_paths = {name for _, _, names in paths() for name in names}
    assert names_of_paths == READ | set(WRITTEN_OPTIONS)
    assert not READ & set(WRITTEN_OPTIONS)


@pytest.mark.parametrize(("callback", "out", "source"), list(pairs()))
@pytest.mark.parametrize("kind", ["name", "link", "several"])
def test_a_command_refuses_to_write_what_it_reads(callback, out, source, kind, tmp_path):
    given = tmp_path / "given.nc"
    given.write_bytes(b"recording")
    target = given
    if kind == "link":
        target = tmp_path / "link.nc"
        os.link(given, target)
    values = {source: [tmp_path / "absent.nc", given] if kind == "several" else given, out: target}
    every = dict.fromkeys(inspect.signature(callback).parameters) | values
    with pytest.raises(typer.BadParameter, match="is a file that the command reads"):
        callback(**every)
    assert given.read_bytes() == b"recording"


def test_the_input_of_simulate_is_not_replaced(tmp_path):
    """It is a file or a text, such as levels of muscles."""
    given = tmp_path / "activation.nc"
    given.write_bytes(b"activation")
    for option in ("--out", "--page", "--movie"):
        result = CliRunner().invoke(app, ["simulate", str(given), option, str(given)])
        assert result.exit_code == 2 and "command reads" in " ".join(result.output.split())
    assert given.read_bytes() == b"activation"


def test_one_file_is_not_written_twice(tmp_path):
    (tmp_path / "r.nc").write_bytes(b"recording")
    line = ["activate", str(tmp_path / "r.nc"), "--out", str(tmp_path / "a.nc")]
    result = CliRunner().invoke(app, [*line, "--plot", str(tmp_path / "." / "a.nc")])
    assert result.exit_code == 2
    assert not (tmp_path / "a.nc").exists()


@pytest.mark.parametrize("name", ["a.csv", "a", "a.mat", "a.nc.txt"])
def test_netcdf_is_written_under_its_suffix_only(name, tmp_path):
    with pytest.raises(DataError, match="expected '.nc'"):
        write_netcdf(None, tmp_path / name, "recording")


def test_a_conversion_never_replaces_its_recording(tmp_path):
    source = tmp_path / "V1_A_1.nc"
    source.write_bytes(b"recording")
    other = tmp_path / "V1_A_2.nc"
    other.write_bytes(b"earlier result")
    with pytest.raises(DataError, match="would be replaced by what is computed from it"):
        new_files({other: "", source: ""}, replace=True, sources=[Path(source)])
    new_files({other: ""}, replace=True, sources=[source])


def test_parameters_that_name_a_folder_are_those_whose_help_says_so():
    """A folder for ParaView was refused when the command that had written it was repeated."""
    named = {}
    for command, callback, names in paths():
        hints = typing.get_type_hints(callback, include_extras=True)
        for name in (name for name in names if name in WRITTEN_OPTIONS):
            text = next(str(one.help) for one in hints[name].__metadata__ if hasattr(one, "help"))
            named[command, name] = bool(re.match("(New f|F)older|.*or the folder", text))
    assert {key: key[1] in FOLDER_PARAMETERS for key in named} == named


DATA = {
    "out_path",
    "out_folder",
    "out_files",
    "wave",
    "cube",
    "log",
}  # options that write data, sounds or pages by their suffix


@pytest.mark.parametrize(
    ("callback", "out"),
    [
        pytest.param(callback, name, id=f"{command} {name}")
        for command, callback, names in paths()
        for name in names
        if name in WRITTEN_OPTIONS and name not in DATA
    ],
)
def test_a_table_or_page_is_not_written_under_the_suffix_of_data(callback, out, tmp_path):
    """It is refused before the command runs, and no file that exists is replaced."""
    target = tmp_path / "face.nc"
    target.write_bytes(b"model")
    every = dict.fromkeys(inspect.signature(callback).parameters) | {out: target}
    with pytest.raises(typer.BadParameter, match=r"is a table|has the suffix of a file of data"):
        callback(**every)
    assert target.read_bytes() == b"model"


@pytest.mark.parametrize("name", ["dose", "dose.txt", "dose.html"])
def test_tables_end_in_csv(name, tmp_path):
    """The folder of the cases of a dose has its name without suffix."""
    result = CliRunner().invoke(app, ["dose", "--out", str(tmp_path / name)])
    assert result.exit_code == 2 and "ends in .csv" in " ".join(result.output.split())
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("callback", "out"),
    [
        pytest.param(callback, name, id=f"{command} {name}")
        for command, callback, names in paths()
        for name in names
        if name in WRITTEN_OPTIONS and name not in FOLDER_PARAMETERS
    ],
)
def test_a_folder_in_the_place_of_a_file_is_refused_before_the_command_runs(
    callback, out, tmp_path
):
    """A simulation ended with this message after minutes, and a picture with that of its format."""
    folder = tmp_path / "there.csv"
    folder.mkdir()
    every = dict.fromkeys(inspect.signature(callback).parameters) | {out: folder}
    with pytest.raises(typer.BadParameter, match="is a folder, expected the name of a file"):
        callback(**every)
