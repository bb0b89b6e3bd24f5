"""Conclusions under every choice: medians, order, gain and flagged trials against hand calculation."""

import numpy as np
import pytest
import xarray as xr

from analysis.axes import combine_cubes
from analysis.cube import build_cube
from analysis.robustness import levels_of, robustness, robustness_sentences, robustness_table
from tests.analysis.synthetic_cubes import MARKERS, results


def cube_with(rho: dict[str, float]) -> xr.Dataset:
    """Cube whose scored markers have the rho of their strategy, plus 0.01 for the second volunteer."""
    cube = build_cube(
        results(), volunteers=("v1", "v2"), instructions=("A", "B"), repetitions=(1, 2),
        strategies=("act_all", "act_3", "act_rel"), markers=MARKERS, origin="simulated",
    )  # fmt: skip
    level = xr.DataArray([rho[s] for s in cube["strategy"].values], dims="strategy")
    more = xr.DataArray([0.0, 0.01], dims="volunteer")
    values = (level + more).broadcast_like(cube["rho"]).transpose(*cube["rho"].dims)
    return cube.assign(rho=values.where(cube["rho"].notnull()))


@pytest.fixture(scope="module")
def varied() -> xr.Dataset:
    first = cube_with({"act_all": 0.4, "act_3": 0.8, "act_rel": 0.7})
    second = cube_with({"act_all": 0.4, "act_3": 0.5, "act_rel": 0.6})
    return combine_cubes({(100e3,): first, (300e3,): second}, {"stress": [100e3, 300e3]})


def test_medians_and_order_of_every_level(varied: xr.Dataset) -> None:
    verdicts = robustness(varied, draws=100)
    assert verdicts["axis"].values.tolist() == ["reference", "stress"]
    assert verdicts["level"].values.tolist() == ["", "300000"]
    at = verdicts.isel(choice=0).sel(strategy="act_rel")
    scored = varied["rho"].isel(stress=0).sel(strategy="act_rel").values
    assert float(at["median"]) == pytest.approx(np.median(scored[np.isfinite(scored)]))
    assert verdicts["rank"].isel(choice=0).values.tolist() == [3.0, 1.0, 2.0]
    assert verdicts["rank"].isel(choice=1).values.tolist() == [3.0, 2.0, 1.0]
    sentences = robustness_sentences(verdicts)
    assert sentences[0] == (
        "Order of the medians at the reference: act_3 > act_rel > act_all. It changes with stress = "
        "300000: act_rel > act_3 > act_all."
    )
    assert "act_3 0.5" in sentences[1] and "to 0.8" in sentences[1]
    assert len(robustness_table(verdicts).rows) == 2 * 3


def test_an_order_that_holds_is_said_to_hold(varied: xr.Dataset) -> None:
    same = varied.copy(deep=True)
    same["rho"].values[1] = same["rho"].values[0]
    sentences = robustness_sentences(robustness(same, draws=100))
    assert sentences[0].endswith("It is the same under every choice.")


def test_trials_with_flagged_alignments_are_left_out_at_the_reference(varied: xr.Dataset) -> None:
    bad = varied.copy(deep=True)
    bad["weak_match"] = xr.zeros_like(bad["shift"])
    bad["weak_match"].loc[{"stress": 100e3, "volunteer": "v2", "strategy": "act_3"}] = 1.0
    bad["rho"].loc[{"stress": 100e3, "volunteer": "v2", "strategy": "act_3"}] = -0.9
    places = levels_of(bad)
    assert list(places)[-1] == ("flagged alignments", "left out")
    verdicts = robustness(bad, draws=100)
    with_all, without = (verdicts.isel(choice=k).sel(strategy="act_3") for k in (0, -1))
    assert float(without["median"]) == pytest.approx(0.8)
    assert float(with_all["median"]) < 0.75
    assert int(without["trials"]) < int(with_all["trials"])
    # a trial whose time steps are inaccurate is no flag of the alignment
    other = varied.assign(inaccurate=xr.ones_like(varied["shift"]))
    assert ("flagged alignments", "left out") not in levels_of(other)


def test_the_gain_states_its_side_of_the_template(varied: xr.Dataset) -> None:
    verdicts = robustness(varied, draws=100)
    assert not np.isfinite(verdicts["gain"]).any()  # a cube without baselines
    bounds = np.array(
        [[[0.1, 0.2], [-0.2, -0.1], [-0.1, 0.1]], [[-0.1, 0.2], [-0.2, -0.1], [0.1, 0.2]]]
    )
    sides = verdicts.assign(gain_interval=verdicts["gain_interval"].copy(data=bounds))
    text = " ".join(robustness_sentences(sides))
    first, second, third = "act_all: at the reference", "act_3: at the reference", "act_rel: at the"
    assert f"{first}, rho is above that of a template without EMG; this changes with" in text
    assert f"{second}, rho is below that of a template without EMG, and so it is under" in text
    assert f"{third} reference, rho is not distinguishable from" in text
