"""Means over volunteers and the series of worlds of the science page."""

import numpy as np
import pandas as pd
import pytest
from scipy.stats import ttest_1samp

from studies.science.subset import mean_interval, told
from studies.science.worlds import PERSON, TRUE, WORLDS, effects, per_volunteer, reading

RHO = np.array([0.62, 0.71, 0.55, 0.80, 0.66, 0.74])


def test_the_interval_is_that_of_students_t_over_volunteers() -> None:
    exact = ttest_1samp(RHO, 0.0).confidence_interval(0.95)
    mean, low, high = mean_interval(np.append(RHO, np.nan))
    assert mean == pytest.approx(RHO.mean())
    assert (low, high) == pytest.approx((exact.low, exact.high))
    assert told(RHO) == f"0.68 ({exact.low:.2f} to {exact.high:.2f})"
    assert told(RHO[:4]) == "0.67"  # no interval from so few volunteers


def test_effects_of_worlds_are_paired() -> None:
    """Every volunteer loses 0.1 with a mismatched person; the spread of volunteers is larger."""
    rows = [
        {
            "world": world,
            "strategy": strategy,
            "volunteer": f"S{k}",
            "median rho": rho - (0.1 if set(PERSON) <= set(kinds) and strategy == "act_3" else 0.0),
            "median shift [s]": -0.04 if "delay" in kinds else 0.0,
        }
        for world, kinds in WORLDS.items()
        for strategy in ("act_3", TRUE)
        for k, rho in enumerate(RHO)
    ]
    found = pd.DataFrame(rows)
    levels = per_volunteer(found, "median rho")
    changes = effects(levels)
    assert list(changes["act_3"]) == 2 * ["+0.00 (+0.00 to +0.00)"] + 2 * ["-0.10 (-0.10 to -0.10)"]
    assert set(changes[TRUE]) == {"+0.00 (+0.00 to +0.00)"}
    text = reading(levels, per_volunteer(found, "median shift [s]")["act_3"].median(axis=1))
    assert "changes from 0 to -40 ms" in text
