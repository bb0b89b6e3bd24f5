"""Processes for independent jobs: all results are returned, and all processes end."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from emgface.errors import WorkerDied
from emgface.run.runner import BLAS, ELEMENTS, kept_processes, run_jobs, share_of_threads

ROOT = Path(__file__).resolve().parents[2]
_offset = 0


def begin(offset: int) -> None:
    global _offset
    _offset = offset


def square(number: int) -> tuple[int, int, list[str | None]]:
    return number**2 + _offset, os.getpid(), [os.environ.get(name) for name in (*BLAS, ELEMENTS)]


def fail_at_two(number: int) -> int:
    if number == 2:
        raise ZeroDivisionError
    return number


def mark_and_wait(folder: str) -> None:
    (Path(folder) / str(os.getpid())).touch()
    time.sleep(120)


def test_every_job_is_done_once_in_another_process_of_one_thread() -> None:
    before = {name: os.environ.get(name) for name in (*BLAS, ELEMENTS)}
    results = dict(run_jobs(square, range(6), 2, begin=begin, arguments=(100,)))
    assert {index: result[0] for index, result in results.items()} == {
        number: number**2 + 100 for number in range(6)
    }
    assert os.getpid() not in {result[1] for result in results.values()}
    expected = ["1"] * len(BLAS) + [str(share_of_threads(2))]
    assert all(result[2] == expected for result in results.values())
    assert {name: os.environ.get(name) for name in before} == before


def test_kept_processes_serve_several_calls_and_begin_for_each() -> None:
    with kept_processes(2, ("json",)):
        calls = [
            dict(run_jobs(square, range(4), 2, begin=begin, arguments=(offset,)))
            for offset in (100, 200)
        ]
    for offset, results in zip((100, 200), calls, strict=True):
        assert {k: result[0] for k, result in results.items()} == {
            k: k**2 + offset for k in range(4)
        }
    assert len({result[1] for results in calls for result in results.values()}) <= 2


def meet_and_wait(job: tuple[str, str, float]) -> int:
    """Wait until both groups have begun, then for a time."""
    folder, group, seconds = job
    (Path(folder) / group).touch()
    while len(list(Path(folder).iterdir())) < 2:
        time.sleep(0.01)
    time.sleep(seconds)
    return os.getpid()


def test_a_process_continues_with_its_group(tmp_path: Path) -> None:
    """The first process to end its job passes over a job of the group that the other has begun."""
    jobs = [(str(tmp_path), *job) for job in (("a", 0.0), ("b", 1.0), ("b", 0.0), ("a", 0.0))]
    results = dict(
        run_jobs(meet_and_wait, jobs, 2, begin=begin, arguments=(0,), group=lambda job: job[1])
    )
    assert results[3] == results[0] != results[1]


def test_a_failure_of_a_job_reaches_the_caller() -> None:
    with pytest.raises(ZeroDivisionError):
        dict(run_jobs(fail_at_two, range(4), 2, begin=begin, arguments=(0,)))


def die_once(path: str) -> int:
    """Kill this process at the first call of a job."""
    if Path(path).name == "deadly" or not Path(path).exists():
        Path(path).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return os.getpid()


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
def test_the_job_of_a_process_that_died_is_repeated_and_then_given_up(tmp_path: Path) -> None:
    jobs = [str(tmp_path / name) for name in ("a", "deadly", "b")]
    (tmp_path / "b").touch()
    lost: list[str] = []

    def given_up(job: str, error: WorkerDied) -> int:
        lost.append(job)
        return -1

    results = dict(run_jobs(die_once, jobs, 2, begin=begin, arguments=(0,), lost=given_up))
    assert lost == [jobs[1]] and results[1] == -1
    assert results[0] > 0 and results[2] > 0
    with pytest.raises(WorkerDied, match="out of memory"):
        dict(run_jobs(die_once, jobs[1:2], 2, begin=begin, arguments=(0,)))


@pytest.mark.parametrize("workers", [1, 2])
def test_no_job_begins_after_a_request_to_stop(workers: int) -> None:
    begun: list[int] = []

    def starting(index: int) -> bool:
        begun.append(index)
        return len(begun) < 4

    results = dict(
        run_jobs(square, range(9), workers, begin=begin, arguments=(0,), starting=starting)
    )
    assert sorted(results) == [0, 1, 2] and begun == [0, 1, 2, 3]


def is_running(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGKILL], ids=["interrupted", "killed"])
def test_workers_end_with_their_parent(tmp_path: Path, how: signal.Signals) -> None:
    program = (
        "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "from emgface.run.runner import run_jobs\n"
        "from tests.study_run.test_parallel import begin, mark_and_wait\n"
        "if __name__ == '__main__':\n"
        f"    list(run_jobs(mark_and_wait, [{str(tmp_path)!r}] * 2, 2, begin=begin, "
        "arguments=(0,)))\n"
    )
    script = tmp_path / "parent.py"
    script.write_text(program)
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    parent = subprocess.Popen([sys.executable, script], env=environment, stderr=subprocess.DEVNULL)
    try:
        workers: list[int] = []
        for _ in range(600):
            workers = [int(path.name) for path in tmp_path.iterdir() if path.name.isdigit()]
            if len(workers) == 2:
                break
            time.sleep(0.1)
        assert len(workers) == 2, "the workers did not begin within a minute"
        parent.send_signal(how)
        assert parent.wait(timeout=60) != 0
        for _ in range(300):
            if not any(map(is_running, workers)):
                break
            time.sleep(0.1)
        assert not any(map(is_running, workers))
    finally:
        parent.kill()
