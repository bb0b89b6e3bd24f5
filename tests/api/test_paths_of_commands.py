"""A name that the encoding of file names lacks is refused before a file is opened or written."""

import inspect
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import typer
import xarray as xr

import emgface as ef
from emgface.anatomy.jaw.series import read_excitation
from emgface.errors import DataError, EmgfaceError
from emgface.face.file import load_face
from emgface.files import expressible, replace_file
from emgface.models.kinds import levels_of, names_file
from emgface.recordings.dataset import read_recording, readers
from emgface.run.store import Store
from emgface.schema.netcdf import kind_of, read_netcdf
from tests.api.test_command_files import paths

STRANGE = "M\udcfcller"  #: bytes of Latin-1, as Python reads them where names are in UTF-8

CALLS = {
    "kind": kind_of,
    "netcdf": lambda path: read_netcdf(path, "recording"),
    "face": load_face,
    "excitation": read_excitation,
    "check": ef.check,
    "read": ef.read,
    "store": lambda path: Store(path.parent / STRANGE),
    "write": lambda path: replace_file(path, lambda part: part.write_text("new")),
    **{suffix: read_recording for suffix in readers()},
}


@pytest.mark.skipif(sys.platform != "linux", reason="names of files are bytes on Linux only")
@pytest.mark.parametrize("name", list(CALLS))
def test_a_strange_name_is_not_called_damage(name: str, tmp_path: Path) -> None:
    path = tmp_path / f"{STRANGE}{name if name.startswith('.') else '.nc'}"
    path.write_bytes(b"old")
    with pytest.raises(EmgfaceError, match="encoding of file names") as raised:
        CALLS[name](path)
    assert "damaged" not in str(raised.value)
    assert str(raised.value).isascii()  # it can be printed anywhere
    assert path.read_bytes() == b"old"
    assert len(list(tmp_path.iterdir())) == 1


@pytest.mark.parametrize(
    ("callback", "parameter"),
    [
        pytest.param(callback, name, id=f"{command} {name}")
        for command, callback, names in paths()
        for name in names
    ],
)
@pytest.mark.parametrize("name", [STRANGE, "a\0b"])
def test_every_path_of_a_command_is_expressible(callback, parameter, name) -> None:
    every = dict.fromkeys(inspect.signature(callback).parameters) | {parameter: Path(name)}
    with pytest.raises(typer.BadParameter, match="encoding of file names"):
        callback(**every)


def test_another_locale_states_how_to_read_the_name(tmp_path: Path) -> None:
    """ASCII lacks a letter of a name; the message says what to set."""
    (tmp_path / "Müller.nc").write_bytes(b"")
    plain = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    code = "import sys; from emgface.files import expressible; expressible(sys.argv[1])"
    result = subprocess.run(
        [sys.executable, "-c", code, tmp_path / "Müller.nc"],
        env=os.environ | plain, capture_output=True, check=False,
    )  # fmt: skip
    assert b"DataError" in result.stderr and b"PYTHONUTF8=1" in result.stderr
    whole = subprocess.run(
        [sys.executable, "-c", code, tmp_path / "Müller.nc"],
        env=os.environ | plain | {"PYTHONUTF8": "1"}, capture_output=True, check=False,
    )  # fmt: skip
    assert whole.returncode == 0


def test_levels_of_many_muscles_are_no_name_of_a_file(tmp_path, monkeypatch) -> None:
    """A text of more than 255 bytes cannot be a name, which the system answers with an error."""
    text = ",".join(f"MUSCLE_{k}=0.{k:03d}" for k in range(60))
    assert len(text) > 255 and not names_file(text)
    assert len(levels_of(text, 0.3)) == 60
    monkeypatch.chdir(tmp_path)
    (tmp_path / "rest").mkdir()
    assert not names_file("rest")  # a folder of the same name is no file of excitations
    assert names_file("absent.nc")


@pytest.mark.parametrize("name", ["a" * 251 + ".nc", "ü" * 120 + ".nc", "-o.nc", "a\nb.nc", " .nc"])
def test_names_that_a_system_allows_are_written_and_read(name: str, tmp_path: Path) -> None:
    """The temporary file has a longer name, except where there is no room for it."""
    path = tmp_path / name
    data = xr.Dataset({"x": ("i", np.arange(3.0))})
    replace_file(path, lambda part: data.to_netcdf(part, engine="netcdf4"))
    xr.testing.assert_identical(xr.load_dataset(path), data)
    assert [p.name for p in tmp_path.iterdir()] == [name]
    with pytest.raises(DataError):
        expressible(tmp_path / "a\0b")
