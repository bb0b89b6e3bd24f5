"""Table of the checks of the inverse: fast checks are met, and a miss is told as one."""

from benchmarks import inverse_checks
from benchmarks.inverse_checks import limited, main, run


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
