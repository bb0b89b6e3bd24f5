"""NetCDF files: complete or absent, and read back without change."""

import os
from collections.abc import Callable
from pathlib import Path

import netCDF4
import numpy as np
import pytest
import xarray as xr

from emgface.errors import DataError, SchemaError, UnitsError
from emgface.schema import netcdf
from emgface.schema.netcdf import read_netcdf, write_netcdf
from emgface.schema.validation import kinds, validate

Make = Callable[[str], xr.Dataset]


@pytest.mark.parametrize("kind", kinds())
def test_every_kind_is_read_back_identical(valid: Make, kind: str, tmp_path: Path) -> None:
    given = valid(kind)
    path = write_netcdf(given, tmp_path / "new folder" / f"{kind}.nc", kind)
    back = read_netcdf(path, kind)
    expected = validate(given, kind)
    xr.testing.assert_identical(back, expected)
    for name in expected.variables:
        ours, theirs = expected[name].dtype, back[name].dtype
        assert ours.kind == theirs.kind
        assert ours.kind == "U" or ours == theirs
    for name, value in expected.attrs.items():
        assert type(back.attrs[name]) is type(value)
    again = read_netcdf(write_netcdf(back, tmp_path / "again.nc", kind), kind)
    xr.testing.assert_identical(again, back)


def test_files_are_compressed_and_describe_themselves(trial: xr.Dataset, tmp_path: Path) -> None:
    path = write_netcdf(trial, tmp_path / "trial.nc", "recording")
    with netCDF4.Dataset(path) as opened:
        assert opened.Conventions == "CF-1.11"
        assert (opened.schema, opened.schema_version) == ("recording", 1)
        emg = opened["emg"]
        assert (emg.units, emg.long_name) == ("V", "surface EMG")
        assert emg.filters()["zlib"] and emg.filters()["shuffle"]
        assert opened["time_marker"].units == "s"


def test_attributes_that_netcdf_cannot_store_are_restored(valid: Make, tmp_path: Path) -> None:
    attrs = {
        "converged": True,
        "options": {"tolerance": 1e-6},
        "gravity": [0.0, 0.0, -9.81],
        "single": [1e-5],
        "nothing": None,
        "digits": "[1, 2]",
        "seed": 4,
    }
    given = valid("trajectory").assign_attrs(attrs)
    given["smallest_J"].attrs["bounds"] = [0.0, 1.0]
    given.attrs["seed"] = np.int64(4)
    path = write_netcdf(given, tmp_path / "t.nc", "trajectory")
    back = read_netcdf(path, "trajectory")
    assert {name: back.attrs[name] for name in attrs} == attrs
    assert back["smallest_J"].attrs["bounds"] == [0.0, 1.0]
    assert "json_attributes" not in back.attrs
    with netCDF4.Dataset(path) as opened:
        assert opened.json_attributes == "converged options gravity single nothing"
        assert opened.gravity == "[0.0, 0.0, -9.81]"


@pytest.mark.parametrize("part", [0.02, 0.3, 0.7, 0.99])
def test_a_truncated_file_is_refused(trial: xr.Dataset, tmp_path: Path, part: float) -> None:
    path = write_netcdf(trial, tmp_path / "trial.nc", "recording")
    whole = path.read_bytes()
    path.write_bytes(whole[: int(len(whole) * part)])
    with pytest.raises(DataError, match=r"^trial.nc begins like a netCDF file but cannot be read"):
        read_netcdf(path, "recording")


def test_a_damaged_block_is_refused(trial: xr.Dataset, tmp_path: Path) -> None:
    path = write_netcdf(trial, tmp_path / "trial.nc", "recording")
    whole = bytearray(path.read_bytes())
    middle = len(whole) // 2
    whole[middle : middle + 2000] = bytes(2000)
    path.write_bytes(whole)
    with pytest.raises(DataError, match="truncated or damaged"):
        read_netcdf(path, "recording")


@pytest.mark.parametrize("content", [b"", b"a,b,c\n1,2,3\n"])
def test_a_foreign_file_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "trial.nc"
    path.write_bytes(content)
    with pytest.raises(DataError, match=r"^trial.nc is not a netCDF file, it begins with b'"):
        read_netcdf(path, "recording")


def test_a_netcdf_file_of_another_program_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "climate.nc"
    xr.Dataset({"temperature": ("time", np.zeros(3), {"units": "K"})}).to_netcdf(path)
    with pytest.raises(SchemaError, match=r"^climate.nc: The recording has \d problems:"):
        read_netcdf(path, "recording")


def test_an_absent_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="No file .*trial.nc; expected a netCDF file"):
        read_netcdf(tmp_path / "trial.nc", "recording")


def test_a_faulty_dataset_does_not_change_the_old_file(trial: xr.Dataset, tmp_path: Path) -> None:
    path = write_netcdf(trial, tmp_path / "trial.nc", "recording")
    before = path.read_bytes()
    trial["emg"].attrs["units"] = "mV"
    with pytest.raises(UnitsError, match="emg is in 'mV'"):
        write_netcdf(trial, path, "recording")
    assert path.read_bytes() == before
    assert os.listdir(tmp_path) == ["trial.nc"]


def test_an_interrupted_write_does_not_change_the_old_file(
    trial: xr.Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_netcdf(trial, tmp_path / "trial.nc", "recording")
    before = path.read_bytes()

    def interrupted(self: xr.Dataset, target: Path, **options: object) -> None:
        Path(target).write_bytes(before[:100])
        raise KeyboardInterrupt

    monkeypatch.setattr(xr.Dataset, "to_netcdf", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_netcdf(trial, path, "recording")
    assert path.read_bytes() == before
    assert os.listdir(tmp_path) == ["trial.nc"]


def test_a_folder_that_cannot_be_made_is_named(trial: xr.Dataset, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("not a folder")
    with pytest.raises(DataError, match="Cannot write .*trial.nc: .*; expected a writable folder"):
        write_netcdf(trial, tmp_path / "file" / "trial.nc", "recording")


def test_writing_does_not_change_the_dataset(trial: xr.Dataset, tmp_path: Path) -> None:
    before = trial.copy(deep=True)
    write_netcdf(trial, tmp_path / "trial.nc", "recording")
    xr.testing.assert_identical(trial, before)


@pytest.mark.parametrize("numbers", [40, 60])
def test_arrays_are_refused_by_their_bytes_together(tmp_path, monkeypatch, numbers: int) -> None:
    """Two arrays of 8-byte numbers, and room for 800 bytes."""
    monkeypatch.setattr(netcdf, "ROOM", 800)
    monkeypatch.setattr(netcdf, "ROOM_PER_BYTE", 0)
    path = tmp_path / "a.nc"
    data = {name: ("n", np.zeros(numbers)) for name in ("one", "two")}
    xr.Dataset(data).to_netcdf(path)
    with netCDF4.Dataset(path) as opened:
        if numbers == 40:
            netcdf._check_sizes(path, opened)
        else:
            with pytest.raises(DataError, match="'two' has the shape"):
                netcdf._check_sizes(path, opened)
