"""Baselines, ceiling and skill compared with closed forms and with scores of simulated motions."""

import numpy as np
import pytest
import xarray as xr
from synthetic_cubes import cube
from synthetic_trajectories import there_and_back, trajectory

from analysis.align import align
from analysis.baselines import (
    BASELINE_VARIABLES,
    best_of,
    ceiling_of,
    has_baselines,
    mean_of,
    scored,
    skill_of,
    template_correlation,
    unexplained,
    with_baselines,
)
from analysis.errors import CubeError
from analysis.figures import baseline_plot
from analysis.scores import correlation_3d, score

OPTIONS = {"scaling": "length", "smallest_motion": 1e-9}


@pytest.mark.parametrize("form", ["consistent", "as_printed"])
@pytest.mark.parametrize("course", [None, there_and_back])
def test_a_baseline_is_scored_as_a_simulated_motion_is(form: str, course) -> None:
    """Same alignment and same rho as for a simulated motion."""
    measured = trajectory(shift=0.07, noise=2e-4, amplitude=4e-3)
    still = measured["position"].values[5]  # only noise
    still[:] = still[:, :1] + np.random.default_rng(8).normal(0, 2e-4, still.shape)
    predicted = trajectory(noise=1e-4, seed=5) if course is None else trajectory(course, noise=1e-4)
    predicted["position"].values[3] = predicted["position"].values[3, :, :1]  # it does not move
    expected = score(align(measured, predicted, **OPTIONS), predicted, form=form)
    rho, ratio = scored(measured, predicted, OPTIONS, form)
    np.testing.assert_allclose(rho, expected["rho"].values, atol=1e-12)
    np.testing.assert_allclose(ratio, expected["amplitude_ratio"].values, rtol=1e-12)
    assert np.isnan(rho[[3, 5]]).all() and ratio[3] == 0.0 and np.isfinite(rho[1:3]).all()


def test_invisible_ends_are_constant_in_a_prediction_and_omitted_in_a_measurement() -> None:
    """A repetition without its first frames keeps its duration, so that it is not stretched."""
    whole, cut = trajectory(noise=1e-6), trajectory(noise=1e-6, seed=4)
    cut["position"].values[:, :, :6] = np.nan
    for measured, predicted in ((whole, cut), (cut, whole)):
        rho, _ = scored(measured, predicted, OPTIONS)
        assert (rho > 0.999).all()


def test_motions_that_cannot_be_aligned_have_no_rho() -> None:
    rho, ratio = scored(trajectory(), trajectory(amplitude=0.0), OPTIONS)
    assert rho.shape == (10,) and np.isnan(rho).all() and np.isnan(ratio).all()


def common_and_own(rng, count: int, q: float, n: int = 20_000) -> np.ndarray:
    """`count` series of unit variance, any two of which correlate with q."""
    common = rng.normal(size=n)
    return np.sqrt(q) * common + np.sqrt(1 - q) * rng.normal(size=(count, n))


@pytest.mark.parametrize("q", [0.3, 0.9])
@pytest.mark.parametrize("others", [1, 3, 8])
def test_template_of_more_people_correlates_better(q: float, others: int) -> None:
    series = common_and_own(np.random.default_rng(1), others + 1, q)
    correlation = np.corrcoef(series[0], series[1:].mean(axis=0))[0, 1]
    assert template_correlation(q, others) == pytest.approx(correlation, abs=0.02)


@pytest.mark.parametrize("q", [0.2, 0.7, 0.95])
def test_ceiling_is_the_correlation_with_the_mean_of_infinitely_many(q: float) -> None:
    series = common_and_own(np.random.default_rng(2), 400, q, n=4000)
    pairs = np.mean([np.corrcoef(series[0], series[k])[0, 1] for k in range(1, 400)])
    many = np.corrcoef(series[0], series[1:].mean(axis=0))[0, 1]
    assert float(ceiling_of(np.array(pairs))) == pytest.approx(many, abs=0.02)
    assert template_correlation(q, 10**9) == pytest.approx(float(ceiling_of(np.array(q))))


def test_ceiling_from_noisy_repetitions_of_a_motion() -> None:
    """With marker noise only, the motion without noise scores the ceiling of two repetitions."""
    clean, noise = trajectory(amplitude=2e-3), 1e-3
    v, w = (trajectory(amplitude=2e-3, noise=noise, seed=k)["position"] for k in (1, 2))
    promised = ceiling_of(correlation_3d(v, w).values).mean()
    assert promised == pytest.approx(float(correlation_3d(v, clean["position"]).mean()), abs=0.02)
    assert np.isnan(ceiling_of(np.array([np.nan]))).all() and ceiling_of(np.array([-0.4])) == 0


def test_skill_between_template_and_ceiling() -> None:
    rho = np.array([0.90, 0.95, 0.97, 1.00, 0.85])
    skill = skill_of(rho, np.full(5, 0.90), np.full(5, 0.97))
    np.testing.assert_allclose(skill, [0, 5 / 7, 1, 10 / 7, -5 / 7])
    assert np.isnan(skill_of(*np.array([[0.9], [0.95], [0.95]]))).all()
    assert np.isnan(skill_of(*np.array([[0.9], [0.95], [0.94]]))).all()


def test_skill_is_the_share_of_avoidable_squared_error() -> None:
    """Murphy 1988: 1 - (error - least error)/(error of the baseline - least error)."""
    rng = np.random.default_rng(0)
    target = rng.normal(size=300)

    def unit(x):
        return (x - x.mean()) / np.linalg.norm(x - x.mean())

    made = [unit(target + level * rng.normal(size=300)) for level in (0.5, 1.0, 0.1)]
    rho = [float(unit(target) @ one) for one in made]
    error = [float(((unit(target) - one) ** 2).sum()) for one in made]
    expected = 1 - (error[0] - error[2]) / (error[1] - error[2])
    assert float(skill_of(*(np.array(r) for r in rho))) == pytest.approx(expected, abs=1e-12)


def test_unexplained_amplitude_of_a_correlation() -> None:
    rng = np.random.default_rng(0)
    v, w = common_and_own(rng, 2, 0.9)
    slope = v @ w / (w @ w)
    assert unexplained(0.9) == pytest.approx(np.std(v - slope * w) / np.std(v), abs=0.02)


def test_means_and_best_of_predictions() -> None:
    rhos = [np.array([0.2, np.nan]), np.array([0.4, 0.6]), np.array([np.nan, np.nan])]
    np.testing.assert_allclose(mean_of(rhos, 2), [0.3, 0.6])
    np.testing.assert_allclose(best_of(rhos, 2), [0.4, 0.6])
    assert np.isnan(mean_of([], 2)).all() and np.isnan(best_of([], 2)).all()


def filled(data: xr.Dataset, **values: float) -> dict[str, xr.DataArray]:
    return {
        name: xr.DataArray(
            np.full([data.sizes[dim] for dim in BASELINE_VARIABLES[name][0]], value),
            dims=BASELINE_VARIABLES[name][0],
            coords={dim: data[dim] for dim in BASELINE_VARIABLES[name][0]},
        )
        for name, value in values.items()
    }


def test_a_cube_with_baselines_keeps_its_scores_and_gives_the_reason_of_missing_skill() -> None:
    data = cube()
    added = filled(data, template_rho=0.5, ceiling=0.9, template_volunteers=np.inf)
    added["template_rho"][0, 0, 0] = np.nan
    added["ceiling"][0, 0, 1] = np.nan
    added["ceiling"][0, 1, 0] = 0.4
    extended = with_baselines(data, added)
    xr.testing.assert_identical(extended[list(data.data_vars)], data)
    assert {*extended.data_vars} == {*data.data_vars, *BASELINE_VARIABLES, "skill_reason"}
    why = extended["skill_reason"]
    assert set(why.values[0, 0, 0]) == {"no other volunteer"}
    assert why.values[0, 0, 1].tolist() == ["no other repetition"] * 3
    assert why.values[0, 1, 0].tolist() == ["ceiling not above the template"] * 3
    lost = data["status"] != "ok"
    assert set(why.values[lost.values]) == {"rho is undefined"}
    assert ((why == "") == np.isfinite(extended["skill"])).all()
    rho = data["rho"].sel(volunteer="v2", instruction="B", repetition=1, strategy="act_3")
    one = extended["skill"].sel(volunteer="v2", instruction="B", repetition=1, strategy="act_3")
    assert float(one) == pytest.approx((float(rho.mean()) - 0.5) / 0.4)
    assert has_baselines(extended) and not has_baselines(data)


def test_skill_compares_the_same_markers() -> None:
    """A marker without rho is also omitted from template and ceiling."""
    data = cube()
    added = filled(data, template_rho=0.5, ceiling=0.9, template_volunteers=np.inf)
    added["template_rho"][..., 1] = -1.0
    extended = with_baselines(data, added)["skill"].values[0, 0, 0, 0]  # its marker 1 has no rho
    rho = data["rho"].values[0, 0, 0, 0, [0, 2]].mean()
    assert extended == pytest.approx((rho - 0.5) / 0.4)


def test_unknown_baselines_are_refused() -> None:
    data = cube()
    with pytest.raises(CubeError, match="'?best'? is not a baseline"):
        with_baselines(data, {"best": data["rho"]})
    with pytest.raises(CubeError, match="template_rho has dims"):
        with_baselines(data, {"template_rho": data["rho"]})
    assert not has_baselines(with_baselines(data, {}))


@pytest.mark.parametrize("absent", [None, "ceiling"])
def test_the_figure_spans_the_range_from_template_to_ceiling(absent: str | None) -> None:
    data = cube()
    added = filled(data, template_rho=0.5, ceiling=0.9, template_volunteers=np.inf)
    if absent is not None:
        added[absent][:] = np.nan
    figure = baseline_plot(with_baselines(data, added))
    levels = {"template_rho": 0.5, "ceiling": 0.9}
    expected = {value for name, value in levels.items() if name != absent}
    for panel, shown in zip(figure.axes[:2], (lambda v: v, lambda v: 1.0 - v), strict=True):
        lines = [line.get_xydata() for line in panel.lines if len(line.get_xdata()) == 2]
        wide = [xy for xy in lines if np.ptp(xy[:, 0]) == pytest.approx(0.9)]
        assert {round(float(y), 9) for xy in wide for y in xy[:, 1]} == {
            round(shown(v), 9) for v in expected
        }
