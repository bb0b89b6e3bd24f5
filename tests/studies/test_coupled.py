"""Published statements about a coupled head, tested against tables of sweeps."""

from pathlib import Path

import pandas as pd
import pytest

from studies.coupled.__main__ import EXPERIMENTS, TESTS, page
from studies.coupled.findings import Results, Value, every, findings


def test_differences_within_the_error_decide_nothing() -> None:
    assert Value(2.0, 0.1).above(Value(1.0, 0.2)) is True
    assert Value(1.0, 0.1).above(Value(2.0, 0.2)) is False
    assert Value(2.0, 0.6).above(Value(1.0, 0.5)) is None
    assert Value(float("nan"), 0.0).above(Value(1.0, 0.0)) is None
    assert every(True, None) is None and every(True, None, False) is False and every(True) is True


@pytest.mark.parametrize("name", TESTS)
def test_no_difference_reproduces_no_statement_of_a_direction(name: str) -> None:
    """With equal outcomes of all runs, no direction is reproduced; absolute limits may be met."""
    runs = EXPERIMENTS[name].runs
    columns = [c for c in EXPERIMENTS[name].shown if c.endswith(("mm", "mm2"))]
    columns += ["lower_incisor_up_mm", "opening_mm", "width_mm"]
    table = pd.DataFrame({"name": [run.name for run in runs], **dict.fromkeys(columns, 2.0)})
    tested = list(TESTS[name](Results(table.assign(**{f"{c}_step_error": 0.1 for c in columns}))))
    assert tested and not any(one.holds for one in tested)


@pytest.mark.parametrize(("area", "holds"), [(162.0, False), (23.0, True), (0.5, False)])
def test_a_fricative_is_a_slit(area: float, holds: bool) -> None:
    """A lip at the teeth below a wide or a closed opening is no fricative."""
    names = [run.name for run in EXPERIMENTS["labials"].runs]
    table = pd.DataFrame({"name": names, "area_mm2": 52.0, "lower_to_teeth_mm": 0.1})
    table.loc[table["name"] == "own fricative", "area_mm2"] = area
    verdicts = {one.statement: one.holds for one in findings("labials", table)}
    assert (
        verdicts["Fricative: a slit, lower lip within 1 mm of the upper incisors (own levels)"]
        is holds
    )


def test_the_page_is_that_of_its_tables(root: Path) -> None:
    assert page() == (root / "docs" / "coupled" / "README.md").read_text("utf-8")
