"""Times of the parts of the science page: workers count, and stored results are no cost of a part."""

import os
import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest

from studies.science import spent
from studies.science.setup import plan

BURN = "import time; t = time.process_time()\nwhile time.process_time() - t < {}: pass"
NESTED = f"import subprocess, sys; subprocess.run([sys.executable, '-c', {BURN.format(0.5)!r}])"


@pytest.fixture
def store(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(plan, "store", tmp_path)
    return tmp_path


def test_the_time_of_descendants_is_counted() -> None:
    """A process started by a process that is still running, as workers are by their server."""
    before = spent.processor_time()
    alive = NESTED + "\nprint('done', flush=True); sys.stdin.read()"
    with subprocess.Popen(
        [sys.executable, "-c", alive], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as child:
        assert child.stdout is not None and child.stdout.readline().strip() == b"done"
        after = spent.processor_time()
        assert child.stdin is not None
        child.stdin.close()
    if spent.PROCESSES.is_dir():
        assert after[1] - before[1] >= 0.45
    assert after[0] - before[0] < 0.45


def test_the_command_itself_is_distinguished_from_its_workers(store: Path) -> None:
    with spent.timed("part"):
        exec(BURN.format(0.3))
    seconds = spent.times(store)
    assert seconds.loc["part", "own"] >= 0.25 and seconds.loc["part", "workers"] < 0.1


def test_later_runs_with_stored_results_are_not_the_cost_of_a_part(store: Path) -> None:
    rows = [
        ("a", 10.0, 1.0, 5.0, 0),  # interrupted: its results are used by the next run
        ("b", 7.0, 2.0, 3.0, 1),
        ("a", 20.0, 1.0, 9.0, 1),
        ("a", 2.0, 0.5, 0.1, 1),  # from stored results
        ("b", 1.0, 0.5, 0.0, 1),
        ("c", 5.0, 1.0, 1.0, 0),  # never finished
    ]
    pd.DataFrame(rows).to_csv(store / "times.csv", index=False, header=False)
    seconds = spent.times(store)
    assert seconds.loc["a"].tolist() == [30.0, 2.0, 14.0]
    assert seconds.loc["b"].tolist() == [7.0, 2.0, 3.0]
    assert "c" not in seconds.index
    assert spent.on_two_cores(seconds) == pytest.approx((4.0 + 0.5 * 17.0) / 60.0)


def test_an_interrupted_part_is_marked(store: Path) -> None:
    with pytest.raises(KeyboardInterrupt), spent.timed("part"):
        raise KeyboardInterrupt
    assert spent.times(store).empty
    with spent.timed("part"):
        pass
    assert spent.times(store).index.tolist() == ["part"]


def test_times_of_a_store_replace_those_of_their_parts_only(store: Path, tmp_path: Path) -> None:
    out = tmp_path / "page"
    out.mkdir()
    stored = pd.DataFrame(
        {"wall": [1.0, 2.0], "own": [1.0, 2.0], "workers": [0.0, 0.0]}, ["a", "b"]
    )
    stored.rename_axis("part").to_csv(out / "cost.csv")
    pd.DataFrame([("b", 9.0, 8.0, 7.0, 1), ("c", 3.0, 2.0, 1.0, 1)]).to_csv(
        store / "times.csv", index=False, header=False
    )
    seconds = spent.measured(out)
    assert seconds.index.tolist() == ["a", "b", "c"]
    assert seconds["own"].tolist() == [1.0, 8.0, 2.0]
    assert pd.read_csv(out / "cost.csv", index_col="part")["own"].tolist() == [1.0, 8.0, 2.0]
    assert os.listdir(out) == ["cost.csv"]
