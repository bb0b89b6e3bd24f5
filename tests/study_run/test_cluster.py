"""Workers of a dask.distributed scheduler; skipped where the package is not installed."""

from pathlib import Path

import numpy as np
import pytest

from emgface.errors import ConfigurationError, ExecutionError
from emgface.run.cluster import DaskWorkers
from emgface.run.runner import run_jobs
from tests.study_run.test_parallel import begin, die_once, fail_at_two, square


def installed() -> bool:
    try:
        import distributed  # noqa: F401
    except ImportError:
        return False
    return True


needed = pytest.mark.skipif(not installed(), reason="the extra 'distributed' is not installed")


@pytest.mark.skipif(installed(), reason="the package distributed is installed")
def test_a_scheduler_without_the_package_is_refused_with_the_extra_to_install() -> None:
    with pytest.raises(ConfigurationError, match=r"emgface\[distributed\]"):
        DaskWorkers("tcp://127.0.0.1:1")


@needed
def test_a_scheduler_that_does_not_answer_is_named() -> None:
    with pytest.raises(ExecutionError, match="no scheduler answers at tcp://127.0.0.1:1 "):
        DaskWorkers("tcp://127.0.0.1:1", timeout=0.2)


@needed
def test_a_file_of_a_scheduler_names_its_address(tmp_path: Path) -> None:
    file = tmp_path / "scheduler.json"
    for text in (None, "{", "{}", "[1]"):
        if text is not None:
            file.write_text(text)
        with pytest.raises(ConfigurationError, match="scheduler.json contains no address"):
            DaskWorkers(str(file))
    file.write_text('{"address": "tcp://127.0.0.1:1"}')
    with pytest.raises(ExecutionError, match="no scheduler answers at tcp://127.0.0.1:1 "):
        DaskWorkers(str(file), timeout=0.2)


@needed
@pytest.mark.slow
def test_jobs_are_done_by_workers_that_may_die_and_the_loss_of_the_scheduler_is_an_error(
    tmp_path: Path,
) -> None:
    from distributed import LocalCluster

    cluster = LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None, silence_logs=50
    )
    workers = DaskWorkers(cluster.scheduler_address)
    try:
        results = dict(run_jobs(square, range(6), workers, begin=begin, arguments=(100,)))
        assert {k: result[0] for k, result in results.items()} == {k: k**2 + 100 for k in range(6)}
        with pytest.raises(ZeroDivisionError):
            dict(run_jobs(fail_at_two, range(4), workers, begin=begin, arguments=(0,)))
        jobs = [str(tmp_path / name) for name in ("a", "b")]
        again = dict(run_jobs(die_once, jobs, workers, begin=begin, arguments=(0,)))
        assert len(again) == 2 and all(np.array(list(again.values())) > 0)
        cluster.close()
        with pytest.raises(ExecutionError, match="does not answer any more"):
            dict(run_jobs(square, range(6), workers, begin=begin, arguments=(0,)))
    finally:
        workers.end()
        cluster.close()


@needed
def test_a_scheduler_without_workers_is_reported_once() -> None:
    """A study that waits for the first worker would otherwise look like one that computes."""
    from distributed import LocalCluster

    with LocalCluster(n_workers=0, processes=False, dashboard_address=":0") as cluster:
        workers = DaskWorkers(cluster.scheduler_address)
        with pytest.warns(UserWarning, match="has no workers: jobs wait until one joins") as warned:
            for _ in range(2):
                workers._counted = -1e9
                assert workers.threads == 0
        workers.end()
    assert len([w for w in warned if "no workers" in str(w.message)]) == 1


def test_an_open_port_is_warned_of() -> None:
    from emgface.run.cluster import open_port

    for address in (
        "tcp://10.0.0.4:8786",
        "tcp://node7:8786",
        "tcp://[2001:db8::1]:8786",
        "ws://a:1",
    ):
        assert "everybody who reaches its port can execute code" in open_port(address)
    for address in (
        "tcp://127.0.0.1:8786",
        "tcp://[::1]:8786",
        "tls://10.0.0.4:8786",
        "inproc://a",
    ):
        assert open_port(address) == ""
