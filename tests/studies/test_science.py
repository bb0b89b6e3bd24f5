"""Means over volunteers and the series of worlds of the science page."""

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from scipy.stats import binomtest, nct, t, ttest_1samp

from studies.science.__main__ import replaced
from studies.science.strength import per_volunteer as of_strength
from studies.science.strength import stress_of_equal_motion, wilson
from studies.science.subset import mean_interval, mean_text, smallest_change
from studies.science.worlds import PERSON, TRUE, WORLDS, effects, per_volunteer, reading

RHO = np.array([0.62, 0.71, 0.55, 0.80, 0.66, 0.74])


def test_the_interval_is_that_of_students_t_over_volunteers() -> None:
    exact = ttest_1samp(RHO, 0.0).confidence_interval(0.95)
    mean, low, high = mean_interval(np.append(RHO, np.nan))
    assert mean == pytest.approx(RHO.mean())
    assert (low, high) == pytest.approx((exact.low, exact.high))
    assert mean_text(RHO) == f"0.68 ({exact.low:.2f} to {exact.high:.2f})"
    assert mean_text(RHO[:4]) == "0.67"  # no interval from so few volunteers


def test_the_smallest_change_has_the_stated_power() -> None:
    """Power of the two-sided t test by the noncentral distribution."""
    n = len(RHO)
    shift, edge = smallest_change(RHO) / RHO.std(ddof=1) * np.sqrt(n), t.ppf(0.975, n - 1)
    assert nct.sf(edge, n - 1, shift) + nct.cdf(-edge, n - 1, shift) == pytest.approx(0.8, abs=0.03)
    assert np.isnan(smallest_change(RHO[:4]))


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
    table = pd.DataFrame(rows)
    levels = per_volunteer(table, "median rho")
    changes = effects(levels)
    assert list(changes["act_3"]) == 2 * ["+0.00 (+0.00 to +0.00)"] + 2 * ["-0.10 (-0.10 to -0.10)"]
    assert set(changes[TRUE]) == {"+0.00 (+0.00 to +0.00)"}
    text = reading(levels, per_volunteer(table, "median shift [s]")["act_3"].median(axis=1))
    assert "changes from 0 to -40 ms" in text
    assert "is 0.00 to 0.00 by a mismatch of the recording and 0.00 to 0.00 by" in text


@pytest.mark.parametrize(("count", "total"), [(0, 18), (3, 18), (9, 18), (18, 18)])
def test_the_interval_of_a_share_is_that_of_wilson(count: int, total: int) -> None:
    exact = binomtest(count, total).proportion_ci(0.95, method="wilson")
    assert wilson(count, total) == pytest.approx((exact.low, exact.high), abs=1e-6)


def test_equal_motion_is_found_for_a_power_law() -> None:
    """Ratio (s / s0)^0.4 with s0 of 80, 125 and 1000 kPa: the geometric mean of s0 is 215 kPa."""
    levels, own = np.array([50e3, 100e3, 200e3, 300e3]), np.array([80e3, 125e3, 1000e3])
    ratio = (levels[:, None] / own) ** 0.4
    shape = (len(levels), len(own), 1, 1)
    cube = xr.Dataset(
        {
            "amplitude_ratio": (("simulation_sigma_max", "volunteer", "trial", "marker"),
                                ratio.reshape(shape)),
            "rho": (("simulation_sigma_max", "volunteer", "trial", "marker"), np.full(shape, 0.5)),
            "status": (("simulation_sigma_max", "volunteer", "trial"), np.full(shape[:3], "ok")),
            "sigma_max": (("simulation_sigma_max", "volunteer", "trial"),
                          np.broadcast_to(levels[:, None, None], shape[:3]).copy()),
        },
        coords={"simulation_sigma_max": levels, "volunteer": ["a", "b", "c"]},
    )  # fmt: skip
    cube["sigma_max"][3, 2, 0] = 270e3
    cube["status"][0, 0, 0] = "failed:InvertedElement"
    swept = of_strength(cube, "slab")
    assert swept["lowered"].sum() == 1 and swept["failed"].sum() == 1
    equal, reached = stress_of_equal_motion(swept)
    assert equal == pytest.approx(np.exp(np.log(own).mean())) and reached == 2


def test_sections_replace_those_of_the_same_heading() -> None:
    page = "# Page\n\nhead\n\n## One\n\nold\n\n## Two\n\nkept\n\n## Cost\n\nminutes\n"
    made = replaced(page, ["## One\n\nnew\n", "## Three\n\nadded\n"])
    heads = [line for line in made.splitlines() if line.startswith("#")]
    assert heads == ["# Page", "## One", "## Two", "## Three", "## Cost"]
    assert "old" not in made and "new" in made and "kept" in made and made.endswith("minutes\n")
    assert replaced(made, ["## Three\n\nadded\n"]) == made
