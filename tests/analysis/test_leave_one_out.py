"""Leave-one-out results compared with the test of the other volunteers."""

import numpy as np
import pytest
from synthetic_scores import fail, of_differences

from analysis.statistics.leave_one_out import leave_one_volunteer_out
from analysis.statistics.paired import compare
from analysis.statistics.sign_flip import sign_flip
from analysis.statistics.simulated import simulated_scores


def test_same_as_the_test_on_the_rest() -> None:
    cube = fail(simulated_scores(5), volunteer="v4", strategy="act_rel")
    effects = leave_one_volunteer_out(compare(cube))
    for volunteer in cube["volunteer"].values:
        rest = sign_flip(compare(cube.drop_sel(volunteer=volunteer)))
        ours = effects.sel(volunteer=volunteer)
        kept = np.isfinite(ours["estimate_without"].values)
        assert list(kept) == [True, volunteer != "v4", volunteer != "v4"]
        np.testing.assert_allclose(ours["estimate_without"][kept], rest["estimate"][kept])
        np.testing.assert_allclose(ours["p_without"][kept], rest["p"][kept])
    bounds = effects["estimate_without"]
    np.testing.assert_allclose(effects["interval"].sel(bound="lower"), bounds.min("volunteer"))
    np.testing.assert_allclose(effects["p"], effects["p_without"].max("volunteer"))
    assert list(effects["n"].values) == [6, 5, 5]


def test_an_effect_of_a_single_volunteer_is_found() -> None:
    effects = leave_one_volunteer_out(compare(of_differences([-0.1, -0.1, -0.1, 1.5])))
    assert float(effects["sign_changes"][0]) == 1
    assert (
        "with the largest change without v4; the sign changes without 1"
        in effects.attrs["sentence"]
    )
    assert float(effects["smallest_p"][0]) == pytest.approx(0.25)
