"""Excursions of lips compared with published ones, and what is concluded from them."""

import numpy as np
import pandas as pd
import pytest

from emgface.face.simulation_parameters import SimulationParameters
from studies.science.excursions import INSTRUCTIONS, POINTS, PUBLISHED, compared, drawn, reading
from studies.science.strength import DECISION

MEAN = next(one for one in PUBLISHED if one.mean is not None)


def moved(low: float, high: float, used: float = 300e3) -> pd.DataFrame:
    """Excursions `low` at 100 and `high` at 300 kPa of every point in every instruction [mm]."""
    rows = [
        {
            "face": "slab", "instruction": instruction, "sigma_max [Pa]": stress,
            "used [Pa]": min(stress, used), **{f"{point} [mm]": value for point in POINTS},
        }
        for instruction in INSTRUCTIONS
        for stress, value in ((100e3, low), (300e3, high))
    ]  # fmt: skip
    return pd.DataFrame(rows)


@pytest.mark.parametrize(
    ("low", "high", "nearer"),
    [(8.0, 10.0, "300 kPa"), (14.0, 30.0, "100 kPa"), (13.0, 15.5, "100 kPa")],
)
def test_the_stress_nearer_to_the_published_mean_is_reported(
    low: float, high: float, nearer: str
) -> None:
    table = compared(moved(low, high))
    assert table[table["point"] == MEAN.point]["nearer"].tolist() == [nearer]


@pytest.mark.parametrize(
    ("low", "high", "within"),
    [(5.0, 9.0, "both"), (5.0, 13.0, "100 kPa"), (1.0, 5.0, "300 kPa"), (1.0, 13.0, "neither")],
)
def test_a_published_range_decides_only_between_inside_and_outside(
    low: float, high: float, within: str
) -> None:
    table = compared(moved(low, high))
    assert table[table["point"] == "upper lip"]["nearer"].tolist() == [within]


def test_a_lowered_stress_is_reported() -> None:
    assert "not lowered in any" in reading(moved(8.0, 10.0))
    assert "lowered in slab A at 300 kPa" in reading(moved(8.0, 10.0, used=243e3))
    assert drawn(moved(8.0, 10.0)).axes[0].get_ylabel().endswith("[mm]")


def test_the_stated_default_is_that_of_a_study() -> None:
    default = SimulationParameters().sigma_max
    assert f"published start of {default / 1e3:.0f} kPa" in DECISION
    assert all(np.isfinite([one.low, one.high]).all() and one.source for one in PUBLISHED)
