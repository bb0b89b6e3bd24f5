"""Formants of tubes against closed forms and a published table."""

import numpy as np
import pytest
from scipy.optimize import brentq

from benchmarks.acoustic_shapes import AH, EE, TABLE, tubes
from emgface.acoustics import LOSSLESS, LineBranch, Medium, formants, lossless_formants, transfer
from emgface.acoustics.errors import AcousticsError


def test_a_uniform_tube_has_odd_multiples_of_a_quarter_wave():
    expected = 350.0 / (4 * 0.175) * np.arange(1, 10, 2)
    assert lossless_formants(np.full(35, 3e-4), 0.175) == pytest.approx(expected, rel=1e-9)
    assert lossless_formants([3e-4], 0.175) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize(("ratio", "front"), [(7.0, 0.5), (0.125, 0.4), (100.0, 0.3)])
def test_two_tubes_satisfy_their_closed_form(ratio, front):
    """tan(k l1) tan(k l2) = A2/A1; solved as a product without poles."""
    n, L = 20, 0.17
    l2 = front * L
    l1 = L - l2
    areas = np.where(np.arange(n) < round((1 - front) * n), 5e-5, 5e-5 * ratio)

    def equation(f):
        k = 2 * np.pi * f / 350.0
        return np.sin(k * l1) * np.sin(k * l2) - ratio * np.cos(k * l1) * np.cos(k * l2)

    grid = np.linspace(40.0, 5000.0, 5000)
    ends = np.flatnonzero(np.diff(np.sign(equation(grid))))
    expected = [brentq(equation, grid[k], grid[k + 1], xtol=1e-10) for k in ends]
    assert lossless_formants(areas, L) == pytest.approx(expected, abs=1e-6)


def test_a_branch_satisfies_the_closed_form_of_three_tubes():
    """S_b tan(k l_b) = S_f cot(k l_f) + S_n cot(k l_n) where three lossless tubes meet."""
    lb, lf, ln, Sb, Sf, Sn = 0.09, 0.08, 0.11, 3e-4, 5e-4, 2e-4
    areas = np.repeat([Sb, Sf], [9, 8])
    branch = LineBranch(np.full(5, Sn), ln, lb)

    def equation(f):
        b, q, n = (2 * np.pi * f / 350.0 * length for length in (lb, lf, ln))
        return (
            Sb * np.sin(b) * np.sin(q) * np.sin(n)
            - Sf * np.cos(b) * np.cos(q) * np.sin(n)
            - Sn * np.cos(b) * np.cos(n) * np.sin(q)
        )

    grid = np.linspace(41.0, 4999.0, 5000)
    ends = np.flatnonzero(np.diff(np.sign(equation(grid))))
    expected = [brentq(equation, grid[k], grid[k + 1], xtol=1e-10) for k in ends]
    resonances, _ = formants(areas, 0.17, medium=LOSSLESS, branch=branch)
    assert resonances == pytest.approx(expected, abs=1e-6)


def test_a_closed_velum_leaves_the_formants_of_the_mouth():
    branch = LineBranch(np.array([0.0, 2e-4, 3e-4]), 0.11, 0.085)
    mouth, _ = formants(*AH)
    assert np.abs(formants(*AH, branch=branch)[0][:, None] - mouth).min(axis=0).max() < 0.5


def test_radiation_lengthens_a_tube_by_8_r_over_3_pi():
    medium = Medium(friction=0.0, yielding=0.0)
    area, L = 5e-5, 0.17
    r = np.sqrt(area / np.pi)
    resonances = formants(np.full(4, area), L, medium=medium)[0][0]
    correction = 350.0 / (4.0 * resonances) - L
    assert correction == pytest.approx(8.0 * r / (3.0 * np.pi), rel=0.01)


def test_a_closed_tube_resonates_by_the_mass_of_its_walls():
    """omega^2 = rho c^2 C/(M A): the air is a spring, the wall a mass."""
    medium = Medium(friction=0.0, damping=0.0, stiffness=0.0)
    area = 4e-4
    areas = np.full(40, area)
    areas[-1] = 0.0
    expected = 350.0 / (2 * np.pi) * np.sqrt(1.14 * 2 * np.sqrt(np.pi * area) / (21.0 * area))
    resonances, width = formants(areas, 0.17, medium=medium)
    assert resonances[0] == pytest.approx(expected, rel=0.015)
    assert width[0] < 1.0


def test_every_formant_of_the_published_shapes(shared):
    given = tubes(shared)
    for name, (lossless, lossy) in TABLE.items():
        assert lossless_formants(*given[name])[:4] == pytest.approx(lossless, abs=1.0), name
        resonances, width = formants(*given[name])
        assert resonances[:4] == pytest.approx(lossy, rel=0.025), name
        assert (width > 0.0).all()
    for closed in ("12", "13", "15", "16", "17"):
        assert 190.0 < formants(*given[closed])[0][0] < 340.0


def test_peaks_of_the_transfer_function_lie_at_its_poles():
    f = np.arange(100.0, 4000.0, 1.0)
    H = np.abs(transfer(f, *EE))
    peaks = f[1:-1][(H[1:-1] > H[:-2]) & (H[1:-1] > H[2:])]
    resonances, width = formants(*EE)
    sharp = resonances[(width < 100.0) & (resonances < 3900.0)]
    assert np.abs(peaks[:, None] - sharp).min(axis=0).max() < 5.0
    assert np.abs(transfer(1.0, *EE))[0] == pytest.approx(1.0, abs=1e-3)


def test_direction_matters():
    assert abs(lossless_formants(*AH)[0] - lossless_formants(AH[0][::-1], AH[1])[0]) > 100.0


@pytest.mark.parametrize(
    ("areas", "length", "words"),
    [
        ([3.0, 4.0], 0.17, "convert cm"),
        ([np.nan, 1e-4], 0.17, "finite"),
        ([-1e-4, 1e-4], 0.17, "finite values from 0"),
        ([1e-4, 1e-4], 17.0, "check its unit"),
        ([], 0.17, "sections"),
    ],
)
def test_unusable_tubes_are_refused(areas, length, words):
    with pytest.raises(AcousticsError, match=words):
        formants(areas, length)


def test_frequencies_and_branches_are_checked():
    with pytest.raises(AcousticsError, match="above 0"):
        transfer([0.0], *AH)
    with pytest.raises(AcousticsError, match="within the"):
        transfer([100.0], *AH, branch=LineBranch(np.full(3, 1e-4), 0.1, 0.3))
