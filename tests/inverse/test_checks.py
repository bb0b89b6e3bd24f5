"""Table of the checks of the inverse: fast checks are met, and a miss is told as one."""

import numpy as np
import pytest

from benchmarks import inverse_checks
from benchmarks.inverse_checks import limited, main, run
from benchmarks.inverse_coverage import Trial, factor, of_factors, of_trials


def test_fast_checks_are_met():
    found = run("1,6")
    assert {one.check[0] for one in found} == {"1", "6"}
    assert all(one.passed for one in found), [one for one in found if not one.passed]


def test_null_directions_contain_the_error_of_redundant_muscles():
    found = inverse_checks.null_directions()
    assert found.passed and "14 null directions" in found.check


def test_a_value_above_its_limit_is_a_miss(monkeypatch, capsys):
    assert limited("", 1.0, 1.0).passed and not limited("", 1.1, 1.0).passed
    assert not limited("", float("nan"), 1.0).passed
    monkeypatch.setattr(inverse_checks, "cost", lambda: iter([limited("7 cost", 2.5, 2.0)]))
    main(None, "4,7")
    told = capsys.readouterr().out
    assert "| 7 cost | at most 2 | 2.5 | **no** |" in told
    assert "not run, no recordings |  |" in told


def test_a_factor_repairs_intervals_that_are_too_narrow_by_it():
    """Truth from 0 to twice the upper bound: half is inside, and 0.9 with a factor of 1.8."""
    rng = np.random.default_rng(0)

    def drawn(name: str, n: int = 4000) -> Trial:
        zero, high = np.zeros(n), np.full(n, 0.3)
        return Trial(name, zero, zero, high, 2.0 * high * rng.random(n))

    trials = [drawn(name) for name in ("S01_A_1", "S01_D_1", "S02_A_1", "S02_D_1")]
    assert of_trials(trials)["all"].values == pytest.approx(0.5, abs=0.03)
    assert factor(trials, active=False) == pytest.approx(1.8, abs=0.03)
    found = of_factors(trials)
    assert len(found) == 4
    assert found.loc[[0, 2], "all"].values == pytest.approx(0.9, abs=0.02)
