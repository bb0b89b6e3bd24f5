"""Search for the parameters of the published jaw with the smallest largest excess of its outcomes."""

import numpy as np
import pytest

from benchmarks.jaw_posterior import share
from benchmarks.jaw_search import LOW, NAMES, WIDE, nearest
from benchmarks.jaw_sets import WANTED

START = {"curved path": 0.9, **dict(zip(NAMES, (LOW + 0.9 * WIDE).tolist(), strict=True))}


def outcomes(own, gap=20.0):
    """Rest grows with the passive fraction, the opening falls with it; all others are as published."""
    u = (own["passive fraction"] - LOW[0]) / WIDE[0]
    found = {name: 0.5 * (low + high) for name, (low, high) in WANTED.items()}
    return found | {"rest": 3.0 + 10.0 * u, "open": 26.0 + gap * (1.0 - u)}


def test_two_outcomes_that_exclude_each_other_share_the_excess():
    """(10 u - 2)/0.4 = (8 - 20 u)/3.65, the units being 10 % of the middles, gives u = 0.2360."""
    found = nearest(outcomes, START)
    u = (8.0 / 3.65 + 5.0) / (25.0 + 20.0 / 3.65)
    assert found.far == pytest.approx(25.0 * u - 5.0, rel=1e-3)
    assert set(found.binding) == {"rest", "open"}
    assert found.own["passive fraction"] == pytest.approx(LOW[0] + WIDE[0] * u, rel=1e-3)
    assert found.own["curved path"] == 0.9
    assert nearest(outcomes, START, ("rest", "down")).far == 0.0


def test_outcomes_that_can_all_be_met_are():
    found = nearest(lambda own: outcomes(own, 12.0), START)
    assert found.far == 0.0 and not found.binding


def test_a_set_without_a_motion_is_never_the_nearest():
    def failing(own):
        u = (own["passive fraction"] - LOW[0]) / WIDE[0]
        return outcomes(own) if u > 0.5 else dict.fromkeys(WANTED, np.nan)

    found = nearest(failing, START)
    assert np.isfinite(found.far) and found.own["passive fraction"] > LOW[0] + 0.5 * WIDE[0]


def test_an_event_that_no_set_shows_has_a_bound():
    assert share(3, 100) == "0.03"
    assert share(0, 1000) == "< 0.003"  # rule of three
