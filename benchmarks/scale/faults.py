"""Faults during studies of stub trials, and whether anything is lost or wrong afterwards.

After every fault the same command is repeated, and the outcomes and stored results of all trials
are compared with those of an undisturbed run.
"""

import json
import os
import re
import shutil
import signal
import subprocess
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import xarray as xr

from benchmarks.scale import stub
from benchmarks.scale.cluster import StartedByHand
from emgface.children import child_environment, python_command
from emgface.run.digest import dataset_digest
from emgface.run.journal import Entry, read_trial
from emgface.run.lines import lines, run_files, written
from emgface.run.store import damage_of

TRIALS, SECONDS = 24, 0.1
NOBODY = 65534

Fault = Callable[[Path], str]


def start(folder: Path, *options: str) -> subprocess.Popen[str]:
    """Start a study of stub trials in another process."""
    words = ("-W", "ignore", "-m", "benchmarks.scale.stub", str(folder), str(TRIALS))
    return subprocess.Popen(
        python_command(*words, "--seconds", str(SECONDS), *options),
        env=child_environment(), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip


def here(folder: Path) -> None:
    """Run or repeat the same study in this process."""
    stub.run(folder, TRIALS, 1, SECONDS)


def finish(process: subprocess.Popen[str]) -> tuple[int, str]:
    """Exit code of a process and its last message, an error of this package if there is one."""
    _, said = process.communicate(timeout=300)
    messages = [line for line in said.splitlines() if line.strip()]
    errors = [line for line in messages if re.match(r"[A-Z]\w+Error: ", line)]
    return process.returncode, [*messages, *errors][-1] if messages else ""


def recorded(folder: Path) -> int:
    """Number of trials in the journal."""
    return sum(line["event"] == "trial" for path in run_files(folder) for _, line in lines(path))


def wait_for(folder: Path, trials: int) -> None:
    """Wait until the journal contains some trials."""
    deadline = time.monotonic() + 120
    while recorded(folder) < trials and time.monotonic() < deadline:
        time.sleep(0.05)


def content(folder: Path) -> dict[str, Any]:
    """Scores of all trials and the digests of their valid results, by label."""
    contents: dict[str, Any] = {}
    for path in run_files(folder):
        for offset, line in lines(path):
            if line["event"] == "trial":
                entry = Entry.from_line(path, offset, line)
                trial = read_trial(entry)
                stage, digest = entry.files[0][:2] if entry.files else ("", "")
                file = folder / "store" / stage / f"{digest}.nc"
                whole = bool(stage) and damage_of(file) is None
                scores = None if trial.scores is None else trial.scores["rho"].values.tobytes()
                contents[trial.label] = (
                    trial.status,
                    scores,
                    dataset_digest(xr.load_dataset(file)) if whole else "",
                )
    return contents


def killed_worker(folder: Path) -> str:
    """Kill one of two processes of a study."""
    process = start(folder, "--workers", "2")
    wait_for(folder, 3)
    for path in Path("/proc").iterdir():
        parent = path / "stat"
        try:
            fields = parent.read_text().rpartition(")")[2].split()
            command = (path / "cmdline").read_text()
        except (OSError, ValueError):
            continue
        if "forkserver" in command and int(fields[1]) in _children(process.pid):
            os.kill(int(path.name), signal.SIGKILL)
            break
    return "exit {}, {}".format(*finish(process))


def _children(pid: int) -> set[int]:
    task = Path(f"/proc/{pid}/task/{pid}/children")
    return set(map(int, task.read_text().split()))


def killed_driver(folder: Path) -> str:
    """Kill the process of the study three times."""
    for k in range(3):
        process = start(folder)
        wait_for(folder, 4 * (k + 1))
        process.send_signal(signal.SIGKILL)
        process.communicate()
    return f"{recorded(folder)} trials recorded"


def terminated_driver(folder: Path) -> str:
    """Send SIGTERM once."""
    process = start(folder, "--workers", "2")
    wait_for(folder, 4)
    process.send_signal(signal.SIGTERM)
    code, said = finish(process)
    return f"exit {code}, {said}"


def terminated_twice(folder: Path) -> str:
    """Send SIGTERM twice."""
    process = start(folder, "--workers", "2")
    wait_for(folder, 4)
    for _ in range(2):
        process.send_signal(signal.SIGTERM)
        time.sleep(0.05)
    return f"exit {finish(process)[0]} at once"


def killed_scheduler(folder: Path) -> str:
    """Kill the scheduler and its workers; the repetition uses a new scheduler."""
    with StartedByHand(folder, 2) as started:
        process = start(folder, "--scheduler", started.address)
        wait_for(folder, 3)
        assert started.scheduler is not None
        started.scheduler.kill()
        return "exit {}, {}".format(*finish(process))


def killed_dask_worker(folder: Path) -> str:
    """Kill one of two dask workers, which its nanny starts again."""
    with StartedByHand(folder, 2, port=18787, nanny=False) as started:
        process = start(folder, "--scheduler", started.address)
        wait_for(folder, 3)
        started.workers[0].kill()
        return "exit {}, {}".format(*finish(process))


def full_disk(folder: Path) -> str:
    """Run on a file system of 200 kB, which is then copied to a larger one."""
    small = folder.with_name("small_disk")
    small.mkdir(exist_ok=True)
    mount = ["mount", "-t", "tmpfs", "-o", "size=200k", "tmpfs", str(small)]
    if subprocess.run(mount, capture_output=True).returncode:
        return "not tested: no permission to mount a file system"
    try:
        text = "exit {}, {}".format(*finish(start(small / "study")))
        shutil.copytree(small / "study", folder)
    finally:
        subprocess.run(["umount", str(small)], check=True)
    return text


def read_only(folder: Path) -> str:
    """Run on a file system that becomes read-only."""
    here(folder)
    shutil.rmtree(folder / "runs")
    for path in sorted((folder / "store" / "motion").iterdir())[:8]:
        path.unlink()
    if subprocess.run(["mount", "--bind", str(folder), str(folder)]).returncode:
        return "not tested: no permission to mount a file system"
    try:
        subprocess.run(["mount", "-o", "remount,ro,bind", str(folder)], check=True)
        return "exit {}, {}".format(*finish(start(folder)))
    finally:
        subprocess.run(["umount", str(folder)], check=True)


def folder_as_result(folder: Path) -> str:
    """Put a folder in the place of a result, and remove it after the next run."""
    here(folder)
    shutil.rmtree(folder / "runs")
    victim = next((folder / "store" / "motion").glob("*.nc"))
    victim.unlink()
    victim.mkdir()
    text = "exit {}, {}".format(*finish(start(folder)))
    victim.rmdir()
    return text


def unreadable(folder: Path) -> str:
    """Remove the permission to read a result and forget the journal, as an ordinary user."""
    here(folder)
    shutil.rmtree(folder / "runs")
    if os.getuid() == 0:
        for path in (folder, *folder.rglob("*")):
            os.chown(path, NOBODY, NOBODY)
    victim = next((folder / "store" / "motion").glob("*.nc"))
    victim.chmod(0)
    user = ["--user", str(NOBODY)] if os.getuid() == 0 else []
    text = "exit {}, {}".format(*finish(start(folder, *user)))
    victim.chmod(0o644)
    return text


def corrupted_result(folder: Path) -> str:
    """Change a byte of one result, truncate another and delete a third."""
    here(folder)
    first, second, third = sorted((folder / "store" / "motion").glob("*.nc"))[:3]
    data = bytearray(first.read_bytes())
    data[len(data) // 2] ^= 0xFF
    first.write_bytes(bytes(data))
    second.write_bytes(second.read_bytes()[:1000])
    third.unlink()
    return "three results damaged"


def corrupted_journal(folder: Path) -> str:
    """Change a byte of a line and cut the last ones."""
    here(folder)
    path = run_files(folder)[0]
    data = bytearray(path.read_bytes())
    data[len(data) // 3] ^= 0xFF
    path.write_bytes(bytes(data[: 3 * len(data) // 4]))
    return f"{TRIALS - recorded(folder)} of {TRIALS} lines lost"


def other_journal(folder: Path) -> str:
    """Let the journal be that of another version."""
    here(folder)
    (path,) = run_files(folder)
    made = [json.loads(line) for line in path.read_bytes().splitlines()]
    other = [{k: v for k, v in line.items() if k != "check"} | {"format": 0} for line in made]
    path.write_bytes(b"".join(map(written, other)))
    return "journal ignored"


def clock_jumped(folder: Path, seconds: float) -> str:
    """Change the time of all files of an interrupted study."""
    process = start(folder)
    wait_for(folder, 8)
    process.send_signal(signal.SIGKILL)
    process.communicate()
    then = time.time() + seconds
    for path in folder.rglob("*"):
        os.utime(path, (then, then))
    return f"{recorded(folder)} trials are kept"


def two_runs(folder: Path) -> str:
    """Run the same study twice at once, in one folder."""
    pair = [start(folder, "--workers", "2") for _ in range(2)]
    return "exits {}".format(" and ".join(str(finish(process)[0]) for process in pair))


FAULTS: dict[str, Fault] = {
    "local worker killed (-9)": killed_worker,
    "study killed (-9), three times": killed_driver,
    "SIGTERM": terminated_driver,
    "SIGTERM twice": terminated_twice,
    "dask scheduler killed": killed_scheduler,
    "dask worker killed": killed_dask_worker,
    "disk full": full_disk,
    "file system read-only": read_only,
    "folder in the place of a result": folder_as_result,
    "result not readable": unreadable,
    "results damaged, truncated, deleted": corrupted_result,
    "journal damaged and cut": corrupted_journal,
    "journal of another version": other_journal,
    "clock jumped back by a day": partial(clock_jumped, seconds=86400.0),
    "clock jumped forward by a day": partial(clock_jumped, seconds=-86400.0),
    "two runs at once": two_runs,
}


def faults(folder: Path) -> list[dict[str, Any]]:
    """Cause every fault, repeat the command, and compare with an undisturbed run."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    here(folder / "whole")
    whole = content(folder / "whole")
    assert len(whole) == TRIALS, "the undisturbed run is incomplete"
    rows: list[dict[str, Any]] = []
    for number, (name, fault) in enumerate(FAULTS.items()):
        place = folder / str(number)
        text = fault(place)
        before = recorded(place)
        here(place)
        same = content(place) == whole
        rows.append({
            "fault": name, "then": text.replace(str(folder.resolve()), "").replace(str(folder), ""),
            "trials recorded": before,
            "all trials as undisturbed, bit for bit": "yes" if same else "NO",
        })  # fmt: skip
        print(rows[-1], flush=True)
    return rows
