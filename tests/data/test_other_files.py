"""Files that refer to others: HDF5 links, virtual and external data, sidecars, absent values."""

import warnings
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
import xarray as xr

from emgface.errors import DataError, EmgfaceError
from emgface.recordings.dataset import read_recording, write_recording
from emgface.recordings.describe import describe
from emgface.schema.netcdf import read_netcdf
from tests.data.conftest import recording
from tests.data.test_brainvision import make as make_brainvision

N, CHANNELS = 400, 2


def _secret(folder: Path) -> Path:
    path = folder / "elsewhere" / "secret.bin"
    path.parent.mkdir(exist_ok=True)
    np.arange(float(N * CHANNELS)).tofile(path)
    with h5py.File(path.with_suffix(".h5"), "w") as opened:
        opened["x"] = np.ones((N, CHANNELS))
    return path


def external_storage(opened: h5py.File, folder: Path) -> None:
    path = _secret(folder)
    opened.create_dataset("emg", (N, CHANNELS), "f8", external=[(path, 0, 8 * N * CHANNELS)])


def external_link(opened: h5py.File, folder: Path) -> None:
    opened["emg"] = h5py.ExternalLink(str(_secret(folder).with_suffix(".h5")), "/x")


def virtual(opened: h5py.File, folder: Path) -> None:
    layout = h5py.VirtualLayout((N, CHANNELS), "f8")
    layout[:] = h5py.VirtualSource(_secret(folder).with_suffix(".h5"), "x", (N, CHANNELS))
    opened.create_virtual_dataset("emg", layout)


def virtual_without_source(opened: h5py.File, folder: Path) -> None:
    layout = h5py.VirtualLayout((N, CHANNELS), "f8")
    layout[:] = h5py.VirtualSource("absent.h5", "x", (N, CHANNELS))
    opened.create_virtual_dataset("emg", layout)


def soft_link_out(opened: h5py.File, folder: Path) -> None:
    opened["other"] = h5py.ExternalLink(str(_secret(folder).with_suffix(".h5")), "/")
    opened["emg"] = h5py.SoftLink("/other/x")


def soft_circle(opened: h5py.File, folder: Path) -> None:
    opened["emg"] = h5py.SoftLink("/other")
    opened["other"] = h5py.SoftLink("/emg")


def never_written(opened: h5py.File, folder: Path) -> None:
    opened.create_dataset("emg", (N, CHANNELS), "f8", fillvalue=5e-5)


def partly_written(opened: h5py.File, folder: Path) -> None:
    stored = opened.create_dataset("emg", (N, CHANNELS), "f8", chunks=(50, CHANNELS))
    stored[:200] = 1e-5


MADE: dict[str, Callable[[h5py.File, Path], None]] = {
    f.__name__: f
    for f in (external_storage, external_link, virtual, virtual_without_source, soft_link_out,
              soft_circle, never_written, partly_written)
}  # fmt: skip


@pytest.mark.parametrize("suffix", [".h5", ".mat", ".nc"])
@pytest.mark.parametrize("name", MADE)
def test_data_of_other_files_and_absent_data_are_refused(
    name: str, suffix: str, tmp_path: Path
) -> None:
    """In HDF5, MATLAB 7.3 and netCDF files alike."""
    path = tmp_path / f"a{suffix}"
    with h5py.File(path, "w", userblock_size=512 if suffix == ".mat" else 0) as opened:
        MADE[name](opened, tmp_path)
    if suffix == ".mat":
        data = bytearray(path.read_bytes())
        data[:10] = b"MATLAB 7.3"
        path.write_bytes(data)
    with pytest.raises(DataError, match=r"expected (data in the file|all of them)|cannot be read"):
        if suffix == ".nc":
            read_netcdf(path, "recording")
        else:
            sidecar = tmp_path / "a.toml"
            sidecar.write_text(
                f'schema = "recording"\n[emg]\nfile = "{path.name}"\nvariable = "emg"\nrate = 100\n'
                'unit = "V"\n'
            )
            read_recording(sidecar)
    if suffix != ".nc":
        with pytest.raises(DataError):
            describe(path)


def test_a_soft_link_within_the_file_is_followed(tmp_path: Path) -> None:
    values = np.random.default_rng(1).normal(size=(N, CHANNELS))
    with h5py.File(tmp_path / "a.h5", "w") as opened:
        opened["raw/emg"] = values
        opened["emg"] = h5py.SoftLink("/raw/emg")
    (tmp_path / "a.toml").write_text(
        'schema = "recording"\n[emg]\nfile = "a.h5"\nvariable = "emg"\nrate = 100\nunit = "V"\n'
    )
    np.testing.assert_array_equal(read_recording(tmp_path / "a.toml").emg, values.T)


@pytest.mark.parametrize("in_groups", [False, True])
def test_many_variables_that_expand_together_are_refused(in_groups: bool, tmp_path: Path) -> None:
    """Each of them is within the limit of one variable."""
    path = write_recording(recording().isel(time_emg=slice(0, 64)), tmp_path / "a.nc")
    with h5py.File(path, "a") as opened:
        for k in range(40):
            name = f"g{k}/x" if in_groups else f"x{k}"
            opened.create_dataset(
                name, data=np.zeros(4_000_000), chunks=(1_000_000,), compression=9
            )
    with pytest.raises(DataError, match="expands|no larger than the file"):
        read_netcdf(path, "recording")


TABLE = "E1,E2\n" + "\n".join(f"{k * k % 17}.5,{-(k % 7)}.5" for k in range(30)) + "\n"


@pytest.mark.parametrize("named", ["../a.csv", "{outside}/a.csv", "in/../../a.csv", "link.csv"])
@pytest.mark.parametrize("part", ["emg", "position"])
def test_a_sidecar_reads_only_files_in_its_folder(named: str, part: str, tmp_path: Path) -> None:
    folder = tmp_path / "from somebody"
    (folder / "in").mkdir(parents=True)
    (tmp_path / "a.csv").write_text(TABLE)
    (folder / "link.csv").symlink_to(tmp_path / "a.csv")
    sidecar = folder / "a.toml"
    name = named.format(outside=tmp_path)
    sidecar.write_text(
        f'schema = "recording"\n[{part}]\nfile = "{name}"\nrate = 100.0\nunit = "mV"\n'
    )
    with pytest.raises(DataError, match="expected a file in its folder"):
        read_recording(sidecar)
    (folder / "in" / "b.csv").write_text(TABLE)
    sidecar.write_text('schema = "recording"\n[emg]\nfile = "in/b.csv"\nrate = 100\nunit = "mV"\n')
    assert read_recording(sidecar).sizes["channel"] == 2


@pytest.mark.parametrize("suffix", [".eeg", ".vmrk"])
def test_a_header_reads_only_files_in_its_folder(suffix: str, tmp_path: Path) -> None:
    """A path in the header is reduced to its name; a link leads nowhere else."""
    folder = tmp_path / "in"
    folder.mkdir()
    header = make_brainvision(folder)
    target = header.with_suffix(suffix)
    target.rename(tmp_path / target.name)
    target.symlink_to(tmp_path / target.name)
    with pytest.raises(DataError, match="expected a file in its folder"):
        read_recording(header)


def test_a_sidecar_is_drafted_only_where_it_can_be_read(tmp_path: Path) -> None:
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "a.csv").write_text(TABLE)
    (tmp_path / "other").mkdir()
    with pytest.raises(DataError, match="expected a sidecar in the folder of the file"):
        describe(tmp_path / "data" / "a.csv", sidecar_folder=tmp_path / "other", rate=100.0)
    above = describe(tmp_path / "data" / "a.csv", sidecar_folder=tmp_path, rate=100.0, unit="mV")
    (tmp_path / "a.toml").write_text(above)
    assert read_recording(tmp_path / "a.toml").sizes["channel"] == 2


@pytest.mark.parametrize("columns", [3000, 200_000])
def test_a_table_of_thousands_of_columns_is_refused_at_once(columns: int, tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    row = ",".join("1.5" for _ in range(columns))
    labels = ",".join(f"c{k}" for k in range(columns))
    path.write_text(f"{labels}\n{row}\n{row}\n")
    sidecar = tmp_path / "a.toml"
    sidecar.write_text('schema = "recording"\n[emg]\nfile = "a.csv"\nrate = 100\nunit = "mV"\n')
    with pytest.raises(DataError, match=f"{columns} columns; expected at most"):
        read_recording(sidecar)
    with pytest.raises(DataError, match="expected at most"):
        describe(path)
    with h5py.File(tmp_path / "b.h5", "w") as opened:
        opened["emg"] = np.zeros((3, columns))
    sidecar.write_text(
        'schema = "recording"\n[emg]\nfile = "b.h5"\nvariable = "emg"\nrate = 100\nunit = "mV"\n'
    )
    with pytest.raises(DataError, match="expected at most"):
        read_recording(sidecar)


def test_whole_recordings_are_still_read(tmp_path: Path) -> None:
    whole = recording()
    path = write_recording(whole, tmp_path / "a.nc")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        xr.testing.assert_allclose(read_recording(path)["emg"], whole["emg"])
    assert issubclass(DataError, EmgfaceError)
