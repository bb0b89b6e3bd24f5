"""Temporary files: those of killed processes are removed, those of running ones are kept."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from emgface.errors import DataError
from emgface.files import (
    _machine,
    _remove_parts_of_killed,
    is_part,
    new_folder,
    new_part,
    replace_file,
)

WRITES = """
import signal, sys, time
from pathlib import Path
from emgface.cli.machine import unwind_when_terminated
from emgface.files import replace_file
for name in ("SIGTERM", "SIGHUP"):  # tests may run under nohup, which ignores SIGHUP
    if hasattr(signal, name):
        signal.signal(getattr(signal, name), signal.SIG_DFL)
unwind_when_terminated()
def write(part):
    part.write_text("half")
    print("begun", flush=True)
    time.sleep(60)
replace_file(Path(sys.argv[1]), write)
"""


def writer(path: Path) -> "subprocess.Popen[str]":
    """Process that has begun to write a file."""
    child = subprocess.Popen(
        [sys.executable, "-P", "-c", WRITES, path], stdout=subprocess.PIPE, text=True
    )
    assert child.stdout is not None and child.stdout.readline() == "begun\n"
    return child


def parts(folder: Path) -> list[Path]:
    return [path for path in folder.iterdir() if is_part(path)]


@pytest.mark.skipif(sys.platform == "win32", reason="processes cannot be asked whether they exist")
def test_the_part_of_a_killed_process_is_removed_by_the_next(tmp_path: Path) -> None:
    killed, running = writer(tmp_path / "a.txt"), writer(tmp_path / "b.txt")
    killed.kill()
    killed.wait()
    assert len(parts(tmp_path)) == 2
    _remove_parts_of_killed.cache_clear()
    replace_file(tmp_path / "c.txt", lambda part: part.write_text("whole"))
    left = [path.name for path in parts(tmp_path)]
    assert len(left) == 1 and f"-{running.pid}-" in left[0]
    running.kill()
    running.wait()
    _remove_parts_of_killed.cache_clear()
    replace_file(tmp_path / "a.txt", lambda part: part.write_text("whole"))
    assert parts(tmp_path) == []
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.txt", "c.txt"]


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
@pytest.mark.parametrize("name", ["SIGTERM", "SIGHUP"])
def test_a_terminated_process_removes_its_part(name: str, tmp_path: Path) -> None:
    child = writer(tmp_path / "a.txt")
    child.send_signal(getattr(signal, name))
    assert child.wait(timeout=30) == 128 + getattr(signal, name)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(sys.platform == "win32", reason="processes cannot be asked whether they exist")
def test_other_files_are_kept(tmp_path: Path) -> None:
    """Those of other machines, links, and what only resembles a part."""
    gone = 2**22 + 5  # beyond the largest number of a process
    (tmp_path / f".a.emgface-{_machine()}-{gone}-01234567.part").touch()
    kept = [
        f".a.emgface-00000000-{gone}-01234567.part", ".a.part", "a.emgface-x.part", ".nc.12.ab.part",
        f".a.emgface-{_machine()}-{os.getpid()}-01234567.part",
    ]  # fmt: skip
    for name in kept:
        (tmp_path / name).touch()
    link = tmp_path / f".b.emgface-{_machine()}-{gone}-01234567.part"
    link.symlink_to(tmp_path / kept[0])
    _remove_parts_of_killed.cache_clear()
    new_part(tmp_path / "a")
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted([*kept, link.name])


def test_a_folder_appears_when_it_is_complete(tmp_path: Path) -> None:
    def fill(folder: Path) -> None:
        (folder / "one").write_text("1")
        assert not (tmp_path / "new").exists()

    new_folder(tmp_path / "new", fill)
    assert [p.name for p in (tmp_path / "new").iterdir()] == ["one"]
    with pytest.raises(DataError, match="exists"):
        new_folder(tmp_path / "new", fill)

    def fails(folder: Path) -> None:
        (folder / "one").write_text("1")
        raise OSError(28, "No space left on device")

    with pytest.raises(OSError, match="No space"):
        new_folder(tmp_path / "other", fails)
    assert [p.name for p in tmp_path.iterdir()] == ["new"]
