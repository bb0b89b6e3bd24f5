"""Run times of steps in units U, and their comparison with stored values."""

import numpy as np
import pandas as pd
import pytest

import sim
from benchmarks import speed
from benchmarks.speed import FIRST, LAST, Run, chosen, rising, stored, timed
from tests.bodies import crossed_muscles, grid, solid_system


def test_the_values_are_of_the_later_steps():
    seconds = np.ones(LAST)
    seconds[0], seconds[FIRST - 1] = 9.0, 9.0
    row = Run(tuple(seconds)).row(unit=0.5)
    assert row["first U"] == 18.0 and row["median U"] == 2.0 and row["median ms"] == 1000.0
    assert row["mean U"] == pytest.approx(2.0 * (LAST - FIRST + 9.0) / (LAST - FIRST + 1))


def test_every_step_of_a_motion_is_timed():
    mesh = grid((2, 2, 2))
    fixed = sim.Fixed(np.flatnonzero(mesh.X[:, 2] == 0.0))
    system = solid_system(mesh, muscles=crossed_muscles(mesh), reductions=(fixed,))
    method = sim.LinearlyImplicitEuler()
    run = timed(system, rising(system, system.muscles[0], 0.1), 0.005, method, 1)
    assert len(run.seconds) == LAST and min(run.seconds) > 0.0


def test_stored_values_are_those_of_the_same_unit(tmp_path, monkeypatch):
    monkeypatch.setattr(speed, "STORED", tmp_path / "speed.csv")
    assert stored("published") == {}
    rows = pd.DataFrame({"case": ["one", "two"], "median U": [1.0, 2.0]})
    speed._store(rows, "published")
    speed._store(rows.assign(**{"median U": 5.0}), "generated")
    speed._store(rows.iloc[:1].assign(**{"median U": 3.0}), "published")
    assert stored("published") == {"one": 3.0, "two": 2.0}
    assert stored("generated") == {"one": 5.0, "two": 5.0}


def test_cases_are_chosen_by_their_beginning():
    assert chosen("3b the same with contact", ())
    assert chosen("3b the same with contact", ("1", "3b"))
    assert not chosen("3a hard, trapezoidal", ("1", "3b"))


def test_the_memory_of_a_case_is_that_of_a_process_of_its_own():
    """A large array of this process does not count."""
    constrained = np.ones(2**27)  # 1 GiB
    assert speed.largest_memory() > 1024.0
    assert 100.0 < speed.memory_of(speed.FREE, False, 1) < 1024.0
    assert constrained.all()
