"""Files that cannot be written: the number of the error decides what is reported."""

import errno
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from emgface.errors import DataError
from emgface.files import replace_file, write_text

MESSAGES = {
    errno.ENOSPC: "the disk is full",
    errno.EFBIG: "it exceeds the limit of the size of files",
    errno.EDQUOT: "the quota of the disk is used up",
    errno.EACCES: "no permission to write",
    errno.EPERM: "no permission to write",
    errno.EROFS: "Read-only file system",
    errno.ENAMETOOLONG: "File name too long",
    errno.EIO: "Input/output error",
}


def refused(folder: Path, error: Exception) -> str:
    def write(path: Path) -> None:
        raise error

    with pytest.raises(DataError) as raised:
        replace_file(folder / "a.nc", write)
    assert not list(folder.iterdir())
    return str(raised.value)


@pytest.mark.parametrize("number", MESSAGES, ids=errno.errorcode.get)
def test_each_number_has_its_reason(number: int, tmp_path: Path) -> None:
    message = refused(tmp_path, OSError(number, os.strerror(number)))
    assert MESSAGES[number] in message and ("disk is full" in message) == (number == errno.ENOSPC)


@pytest.mark.parametrize("error", [OSError(errno.EACCES, "denied"), RuntimeError("HDF error")])
def test_the_netcdf_library_reports_a_full_disk_otherwise(
    error: Exception, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    usage = shutil.disk_usage(tmp_path)
    monkeypatch.setattr(shutil, "disk_usage", lambda folder: usage._replace(free=0))
    assert "the disk is full" in refused(tmp_path, error)


WRITERS = {
    "text": "write_text(folder / 'a.txt', 'x' * 400_000)",
    "result": "store_netcdf(xr.Dataset({'a': ('x', np.arange(50_000.0))}), folder / 'a.nc')",
    "journal": "Journal(folder, {}).write('note', text='x' * 400_000)",
}


@pytest.mark.skipif(sys.platform == "win32", reason="no limit of the size of files")
@pytest.mark.parametrize("writer", WRITERS)
def test_the_limit_of_the_size_of_files_is_the_stated_reason(tmp_path: Path, writer: str) -> None:
    program = f"""
import resource
from pathlib import Path
import numpy as np
import xarray as xr
from emgface.errors import EmgfaceError
from emgface.files import write_text
from emgface.run.journal import Journal
from emgface.run.store import store_netcdf
folder = Path({str(tmp_path)!r})
resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, resource.RLIM_INFINITY))
try:
    {WRITERS[writer]}
except EmgfaceError as error:
    print(error)
"""
    output = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    ).stdout
    assert (
        "exceeds the limit of the size of files of 100000 bytes" in output and "ulimit -f" in output
    )
    assert "disk" not in output and "space" not in output


def test_an_error_of_another_cause_is_passed_on(tmp_path: Path) -> None:
    def write(path: Path) -> None:
        raise RuntimeError("other")

    with pytest.raises(RuntimeError, match="other"):
        replace_file(tmp_path / "a.nc", write)


@pytest.mark.skipif(not Path("/proc/self").is_dir(), reason="no file system of processes")
def test_a_file_system_without_size_is_not_full() -> None:
    with pytest.raises(DataError, match="Cannot write") as raised:
        write_text(Path("/proc/a.txt"), "x")
    assert "disk is full" not in str(raised.value)
