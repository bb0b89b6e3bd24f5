"""Table of the checks of a fit: what counts as met, and checks with closed forms."""

import math

import pytest

from benchmarks.fit_checks import Row, closed_forms, damaged, probe_coverage, stacks_and_labels


def test_a_row_is_met_on_its_own_side_only_and_never_without_a_number() -> None:
    assert Row(1, "error", 0.2, 0.2).met and not Row(1, "error", 0.21, 0.2).met
    assert Row(4, "Dice", 0.95, 0.95, True).met and not Row(4, "Dice", 0.9, 0.95, True).met
    for least in (True, False):
        row = Row(2, "unknown", math.nan, 0.0, least)
        assert not row.met and row.cells()["met"] == "MISSED"
    assert Row(4, "Dice", 0.96, 0.95, True).cells()["wanted"] == "at least 0.95"


def test_intervals_of_a_strip_cover_the_truth_as_stated() -> None:
    (row,) = probe_coverage(40)
    assert row.met, row


def test_stacks_of_a_phantom_and_their_labels_are_met() -> None:
    pytest.importorskip("SimpleITK")
    rows = stacks_and_labels()
    assert len(rows) == 3 and all(row.met for row in rows), rows


def test_a_wrong_end_of_one_input_misses_the_check() -> None:
    assert damaged(lambda inputs: 0, 5)[0].met
    assert not damaged(lambda inputs: 1, 5)[0].met


def test_closed_forms_and_the_published_motion_are_met(shared, monkeypatch) -> None:
    monkeypatch.setenv("EMGFACE_SHARED", str(shared))
    rows = closed_forms(starts=2)
    assert len(rows) == 4 and all(row.met for row in rows), rows


def test_a_wrong_motion_misses_the_check(shared, monkeypatch) -> None:
    """Negative control: a similarity with an error of a micrometre."""
    import benchmarks.fit_checks as module

    monkeypatch.setenv("EMGFACE_SHARED", str(shared))
    right = module.similarity

    def wrong(*given, **named):
        transform = right(*given, **named)
        return type(transform)(transform.scale, transform.rotation, transform.shift + 1e-6)

    monkeypatch.setattr(module, "similarity", wrong)
    rows = closed_forms(starts=1)
    assert [row.met for row in rows[:2]] == [True, False]
