"""A process that is killed at any time leaves complete results or none."""

import os
import random
import signal
import time
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from emgface.run.store import Stage, Store

COUNT, KILLS = 25, 6
STAGE = Stage("counting", ("emgface.run.store",))


def work(folder: Path) -> list[str]:
    """Compute absent results, whose contents follow from their numbers."""
    store = Store(folder, report=lambda text: None)
    for number in range(COUNT):

        def compute(number: int = number) -> xr.Dataset:
            values = np.random.default_rng(number).normal(size=4000)
            return xr.Dataset({"x": ("i", values)}, attrs={"number": number})

        result = store.get_or_compute(STAGE, {"number": str(number)}, {}, compute)
        assert result.dataset.attrs["number"] == number
    return [event.outcome for event in store.events]


def kill_after(child: int, folder: Path, more: int, rng: random.Random) -> int:
    """Kill a process shortly after a further number of results; return its status."""
    wanted = len(list(folder.rglob("*.json"))) + more
    while len(list(folder.rglob("*.json"))) < wanted:
        ended, status = os.waitpid(child, os.WNOHANG)
        if ended:
            return status
    time.sleep(rng.uniform(0.0, 2e-3))
    os.kill(child, signal.SIGKILL)
    return os.waitpid(child, 0)[1]


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs to fork a process")
@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
def test_killed_at_random_the_store_is_never_corrupt(tmp_path: Path) -> None:
    """`python -m benchmarks scale OUT kills` tests whole studies in the same way."""
    assert work(tmp_path / "whole") == ["computed"] * COUNT
    rng = random.Random(3)
    killed = 0
    for _ in range(KILLS):
        child = os.fork()
        if child == 0:
            work(tmp_path / "killed")
            os._exit(0)
        # By progress and not by time, because a machine may be slow and some results must be
        # complete.
        status = kill_after(child, tmp_path / "killed", rng.randrange(1, COUNT // KILLS), rng)
        killed += os.WIFSIGNALED(status)
        for path in (tmp_path / "killed").rglob("*.nc"):
            number = int(xr.load_dataset(path).attrs["number"])
            same = tmp_path / "whole" / path.relative_to(tmp_path / "killed")
            xr.testing.assert_identical(xr.load_dataset(path), xr.load_dataset(same))
            assert 0 <= number < COUNT
    assert killed >= 3
    outcomes = work(tmp_path / "killed")
    assert len(outcomes) == COUNT and outcomes.count("reused") >= KILLS
    names = {path.relative_to(tmp_path / "whole") for path in (tmp_path / "whole").rglob("*.nc")}
    paths = {path.relative_to(tmp_path / "killed") for path in (tmp_path / "killed").rglob("*.nc")}
    assert paths == names
    for name in names:
        xr.testing.assert_identical(
            xr.load_dataset(tmp_path / "whole" / name), xr.load_dataset(tmp_path / "killed" / name)
        )
