"""Template of infinitely many volunteers: closed form, and motions with a known common part."""

import numpy as np
import pytest

from analysis.baseline_tables import what_rho_means
from analysis.baselines import template_correlation, unlimited_template


@pytest.mark.parametrize("volunteers", [1, 2, 5, 11, 50])
@pytest.mark.parametrize("ratio", [0.0, 0.1, 0.56, 3.0])
def test_closed_form(volunteers, ratio):
    finite = 1.0 / np.sqrt((1.0 + ratio) * (1.0 + ratio / volunteers))
    assert unlimited_template(finite, volunteers) == pytest.approx(
        1.0 / np.sqrt(1.0 + ratio), rel=1e-12
    )


@pytest.mark.parametrize("likeness", [0.05, 0.5, 0.99])
def test_it_is_the_limit_of_the_correlation_of_templates(likeness):
    finite = template_correlation(likeness, 7)
    limit = template_correlation(likeness, 10**12)
    assert unlimited_template(finite, 7) == pytest.approx(limit, rel=1e-9)


def test_limits():
    assert unlimited_template(1.0, 5) == 1.0
    assert unlimited_template(0.76, 5) == pytest.approx(0.801, abs=5e-4)
    assert np.isnan(unlimited_template(np.nan, 5)) and np.isnan(unlimited_template(0.5, 0))
    np.testing.assert_array_equal(unlimited_template(np.array([0.0, -0.3]), 5), [0.0, -0.3])
    assert unlimited_template(0.7, 10**9) == pytest.approx(0.7, abs=1e-8)
    assert unlimited_template(0.7, 1) == pytest.approx(np.sqrt(0.7), rel=1e-12)


def centred(values):
    return values - values.mean(axis=-1, keepdims=True)


def correlation(a, b):
    a, b = centred(a), centred(b)
    return (a * b).sum(-1) / np.sqrt((a * a).sum(-1) * (b * b).sum(-1))


@pytest.mark.parametrize("volunteers", [5, 6, 12])
def test_a_prediction_without_emg_gains_nothing_over_the_limit(volunteers):
    """500 studies of persons with a common and an individual part of equal and of half its size.

    The gain of the common part (no EMG, no person) over the finite template is positive in every
    world and that of the closed form; over the limit it is within 0.01 of zero. A prediction that
    contains 30 % of the individual part exceeds the limit, so that the test can come out otherwise.
    """
    rng = np.random.default_rng(volunteers)
    samples, studies = 400, 500
    for size in (1.0, 0.5):
        common = rng.normal(size=(studies, 1, samples))
        own = np.sqrt(size) * rng.normal(size=(studies, volunteers, samples))
        measured = common + own
        others = (measured.sum(1, keepdims=True) - measured) / (volunteers - 1)
        finite = correlation(measured, others).mean(1)
        limit = unlimited_template(finite, volunteers - 1)
        free = correlation(measured, common).mean(1)
        specific = correlation(measured, common + 0.3 * own).mean(1)
        expected = (1.0 + size) ** -0.5 * (1.0 - (1.0 + size / (volunteers - 1)) ** -0.5)
        assert (free - finite).mean() == pytest.approx(expected, abs=0.01)
        assert expected > 0.01
        assert abs((free - limit).mean()) < 0.01
        assert (specific - limit).mean() > 0.05


def test_the_sentence_states_what_no_common_motion_reaches():
    import xarray as xr

    from analysis.statistics.skill import CORRELATIONS, GAINS

    values = dict.fromkeys(CORRELATIONS, 0.5) | {
        "template_rho": 0.76,
        "template_limit": float(unlimited_template(0.76, 5)),
        "ceiling": 0.99,
        "repeat_rho": 0.98,
    }
    limits = xr.Dataset(
        {name: ("strategy", [value]) for name, value in values.items()}
        | {name: ("strategy", [0.1]) for name in GAINS}
        | {f"{name}_interval": (("strategy", "bound"), [[0.0, 0.2]]) for name in GAINS}
        | {
            "trials": ("strategy", [10]),
            "volunteers": ("strategy", [6]),
            "template_volunteers": 5.0,
        },
        {"strategy": ["act_all"], "bound": ["lower", "upper"]},
        {"level": 0.95, "instructions": 6},
    )
    text = " ".join(what_rho_means(limits))
    assert "specific to the person" not in text
    assert "would score about 0.80" in text and "Of a rho of 0.90, 0.10 cannot be reached" in text
    assert "does not show that the EMG contributed" in " ".join(what_rho_means(limits, 0.79))
