"""Equivalence against statsmodels and the normal theory."""

import numpy as np
import pytest
from statsmodels.stats.weightstats import ttost_paired
from synthetic_scores import of_differences

from analysis.errors import StatisticsError
from analysis.statistics.equivalence import equivalence
from analysis.statistics.paired import compare

VALUES = [0.05, -0.1, 0.12, 0.02, -0.04, 0.08]


@pytest.mark.parametrize("margin", [0.05, 0.1, 0.3])
def test_against_statsmodels(margin: float) -> None:
    tested = equivalence(compare(of_differences(VALUES)), margin=margin)
    p, above, below = ttost_paired(np.array(VALUES), np.zeros(6), -margin, margin)
    assert float(tested["p"][0]) == pytest.approx(p, rel=1e-9)
    assert float(tested["p_above"][0]) == pytest.approx(above[1], rel=1e-9)
    assert float(tested["p_below"][0]) == pytest.approx(below[1], rel=1e-9)
    lower, upper = tested["interval"].values[0]
    inside = -margin < lower and upper < margin
    assert inside == (p < 0.05) == ("b - a: equivalent within" in tested.attrs["sentence"])


def test_no_equivalence_is_not_reported_as_a_difference() -> None:
    text = equivalence(compare(of_differences(VALUES)), margin=0.05).attrs["sentence"]
    assert "not significantly equivalent" in text
    assert "differ" not in text


def test_gross_departure_from_normality_is_doubtful() -> None:
    tested = equivalence(compare(of_differences([0.0, 0.01, 0.0, 0.01, 0.0, 2.0])), margin=0.1)
    assert str(tested["verdict"].sel(assumption="mean differences are normal").values[0]) == (
        "doubtful"
    )


@pytest.mark.parametrize("margin", [0.0, -0.1, np.nan, np.inf])
def test_margin_must_be_given(margin: float) -> None:
    with pytest.raises(StatisticsError, match="margin of equivalence"):
        equivalence(compare(of_differences(VALUES)), margin=margin)
    with pytest.raises(TypeError):
        equivalence(compare(of_differences(VALUES)))
