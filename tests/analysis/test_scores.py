"""Eqs 11-13 of Eskes et al. 2017 compared with loops, and invariances of scores."""

import math

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from synthetic_trajectories import once, there_and_back, trajectory

from analysis.align import align
from analysis.errors import TrajectoryError
from analysis.scores import amplitude_ratio, correlation_3d, rmse, score, undefined_reason


def array(values: np.ndarray) -> xr.DataArray:
    """Values of shape (axis, time) or (marker, axis, time) [m]."""
    dims = ("marker", "axis", "time")[-values.ndim :]
    return xr.DataArray(values, dims=dims, attrs={"units": "m"})


def curve(seed: int, n: int = 40) -> xr.DataArray:
    return array(np.random.default_rng(seed).normal(size=(3, n)))


def mean_11(v: np.ndarray) -> list[float]:
    n = v.shape[1]
    return [math.fsum(v[axis]) / n for axis in range(3)]


def sigma_12(v: np.ndarray) -> float:
    n, mean = v.shape[1], mean_11(v)
    squares = [(v[axis, i] - mean[axis]) ** 2 for axis in range(3) for i in range(n)]
    return math.sqrt(math.fsum(squares) / (n - 1))


def rho_13(v: np.ndarray, w: np.ndarray) -> float:
    n = v.shape[1]
    products = math.fsum(v[axis, i] * w[axis, i] for axis in range(3) for i in range(n)) / n
    means = math.fsum(a * b for a, b in zip(mean_11(v), mean_11(w), strict=True))
    return (products - means) / (sigma_12(v) * sigma_12(w))


def test_equation_11_a_common_offset_is_the_mean() -> None:
    """A constant offset changes only the mean of Eq. 11."""
    v, w = curve(1), curve(2)
    mean = xr.DataArray(mean_11(v.values), dims="axis")
    centred = (v - mean).assign_attrs(units="m")
    assert np.abs(np.array(mean_11(centred.values))).max() < 1e-16
    assert float(correlation_3d(centred, w)) == pytest.approx(
        float(correlation_3d(v, w)), abs=1e-14
    )
    assert float(rmse(v, v + mean)) == pytest.approx(0.0, abs=1e-15)


def test_equation_12_ratio_of_standard_deviations() -> None:
    v, w = curve(1), 0.3 * curve(2).assign_attrs(units="m")
    w.attrs["units"] = "m"
    expected = sigma_12(w.values) / sigma_12(v.values)
    assert float(amplitude_ratio(v, w)) == pytest.approx(expected, rel=1e-14)


@pytest.mark.parametrize("seed", range(5))
def test_equation_13_as_printed_and_consistent(seed: int) -> None:
    v, w = curve(seed), curve(seed + 100)
    printed = rho_13(v.values, w.values)
    assert float(correlation_3d(v, w, form="as_printed")) == pytest.approx(printed, abs=1e-14)
    assert float(correlation_3d(v, w)) == pytest.approx(printed * 40 / 39, abs=1e-14)


def test_equation_13_in_one_dimension_is_pearson() -> None:
    """Motion along one axis only: rho is the ordinary correlation coefficient."""
    rng = np.random.default_rng(4)
    x, y = rng.normal(size=50), rng.normal(size=50)
    v, w = np.zeros((2, 3, 50))
    v[1], w[1] = x, y
    assert float(correlation_3d(array(v), array(w))) == pytest.approx(np.corrcoef(x, y)[0, 1])


@pytest.mark.parametrize("n", [2, 3, 10, 160])
def test_trajectory_with_itself(n: int) -> None:
    v = curve(n, n)
    assert float(correlation_3d(v, v)) == pytest.approx(1.0, abs=1e-14)
    assert float(correlation_3d(v, -v)) == pytest.approx(-1.0, abs=1e-14)
    assert float(correlation_3d(v, v, form="as_printed")) == pytest.approx((n - 1) / n, abs=1e-14)


def test_precision_is_kept_far_from_the_origin() -> None:
    """A movement of micrometres at a distance of a kilometre; the printed form would return noise."""
    v, w = curve(1), curve(2)
    near = float(correlation_3d(v, w))
    far_v, far_w = 1e-6 * v + 1e3, 1e-6 * w - 1e3
    assert float(correlation_3d(far_v, far_w)) == pytest.approx(near, abs=1e-6)


@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    factor=st.floats(1e-6, 1e6),
    offset=st.lists(st.floats(-1.0, 1.0), min_size=3, max_size=3),
    angle=st.floats(-3.0, 3.0),
)
def test_invariances(seed: int, factor: float, offset: list[float], angle: float) -> None:
    """Invariant to shift, positive scale and common rotation; odd in the sign."""
    v, w = curve(seed), curve(seed + 1)
    rho = float(correlation_3d(v, w))
    moved = factor * (w + xr.DataArray(offset, dims="axis"))
    moved.attrs["units"] = "m"
    assert float(correlation_3d(v, moved)) == pytest.approx(rho, abs=1e-9)
    assert float(correlation_3d(moved, v)) == pytest.approx(rho, abs=1e-9)
    assert -1.0 <= rho <= 1.0
    turn = Rotation.from_rotvec([0.3 * angle, angle, -0.2 * angle]).as_matrix()
    both = array(turn @ v.values), array(turn @ w.values)
    assert float(correlation_3d(*both)) == pytest.approx(rho, abs=1e-12)


def test_not_invariant_to_rotation_of_one() -> None:
    """A planar motion rotated by theta within its plane has the correlation cos theta."""
    t = np.linspace(0, 2 * np.pi, 100, endpoint=False)
    v = np.stack([np.cos(t), np.sin(t), 0 * t])
    for theta in (0.2, 1.0, np.pi / 2, np.pi):
        turned = Rotation.from_rotvec([0, 0, theta]).as_matrix() @ v
        rho = float(correlation_3d(array(v), array(turned)))
        assert rho == pytest.approx(np.cos(theta), abs=1e-14)


def test_more_dims_are_kept() -> None:
    """One call scores every marker and every further dim."""
    rng = np.random.default_rng(3)
    v = xr.DataArray(rng.normal(size=(2, 4, 3, 30)), dims=("trial", "marker", "axis", "time"))
    w = xr.DataArray(rng.normal(size=(4, 3, 30)), dims=("marker", "axis", "time"))
    rho = correlation_3d(v, w)
    assert rho.dims == ("trial", "marker")
    one = correlation_3d(v[1, 2], w[2])
    assert float(rho[1, 2]) == pytest.approx(float(one), abs=1e-15)


def test_reasons_of_undefined_markers() -> None:
    rng = np.random.default_rng(3)
    v, w = rng.normal(size=(2, 7, 3, 20))
    v[1] = v[1, :, :1]
    w[2] = w[2, :, :1] + 1e-17
    v[3], w[3] = 0.1, 0.7
    v[4, 1, 5] = np.nan
    w[5, 0, 0] = np.inf
    v[6, 0, 0], w[6, 0, 1] = np.nan, np.nan
    reason = undefined_reason(array(v), array(w))
    assert list(reason.values) == [
        "",
        "the measured marker does not move",
        "the simulated marker does not move",
        "neither moves",
        "the measured marker has gaps",
        "the simulated marker has gaps",
        "both have gaps",
    ]
    for rho in (correlation_3d(array(v), array(w)),
                  correlation_3d(array(v), array(w), form="as_printed")):  # fmt: skip
        assert list(np.isfinite(rho.values)) == [True] + [False] * 6
    ratio = amplitude_ratio(array(v), array(w)).values
    assert ratio[2] == 0.0
    assert list(np.isfinite(ratio)) == [True, False, True, False, False, False, False]


def test_motion_due_to_rounding_is_not_scored() -> None:
    """A constant with rounding errors must not be scored as a movement."""
    rng = np.random.default_rng(0)
    v = array(0.1 + 1e-17 * rng.integers(-2, 3, size=(3, 50)))
    assert str(undefined_reason(v, curve(1, 50)).values) == "the measured marker does not move"


@pytest.mark.parametrize(
    ("reference", "expected"),
    [("origin", math.sqrt(1.0 + 0.125)), ("mean", math.sqrt(0.125)), ("first", math.sqrt(0.125))],
)
def test_rmse_of_a_sine_and_an_offset(reference: str, expected: float) -> None:
    """Offset (0.6, 0, 0.8) and a difference 0.5 sin t over full periods: sqrt(1 + 0.125)."""
    t = np.linspace(0, 2 * np.pi, 64, endpoint=False)
    v = np.stack([np.cos(t), t, np.sin(2 * t)])
    w = v + np.array([0.6, 0.0, 0.8])[:, None]
    w[1] += 0.5 * np.sin(t)
    error = rmse(array(v), array(w), reference=reference)
    assert float(error) == pytest.approx(expected, rel=1e-12)
    assert error.attrs["units"] == "m"


def test_rmse_from_first_sample_differs_from_mean() -> None:
    """The difference is 0, 1: rms 1/sqrt 2 from the first sample, 1/2 about the mean."""
    v, w = np.zeros((2, 3, 2))
    w[0, 1] = 1.0
    assert float(rmse(array(v), array(w), reference="first")) == pytest.approx(math.sqrt(0.5))
    assert float(rmse(array(v), array(w), reference="mean")) == pytest.approx(0.5)


def test_score_after_alignment() -> None:
    """The same movement at half the amplitude, later and offset: rho 1, ratio 1/2."""
    model = trajectory(there_and_back, amplitude=2.5e-3)
    data = trajectory(there_and_back, shift=0.07, origin="simulated", volunteer="v1")
    data["position"] += 0.02
    data["position"].attrs["units"] = "m"
    scores = score(align(data, model), model)
    np.testing.assert_allclose(scores["rho"], 1.0, atol=1e-5)
    np.testing.assert_allclose(scores["amplitude_ratio"], 0.5, rtol=1e-2)
    assert set(scores["reason"].values) == {""}
    assert float(scores["shift"]) == pytest.approx(0.07, abs=1e-4)
    assert int(scores["samples"]) == round(float(align(data, model)["overlap"]) * 160)
    assert scores["rmse"].attrs["units"] == "m"
    assert scores.attrs["origin"] == "simulated"
    assert scores.attrs["volunteer"] == "v1"


def test_score_of_a_still_marker() -> None:
    model, data = trajectory(), trajectory(shift=0.05)
    model["position"].values[4] = model["position"].values[4, :, :1] + 1e-11 * np.sin(
        np.arange(160)
    )
    scores = score(align(data, model), model)
    assert (
        str(scores["reason"].sel(marker="marker_4").values) == "the simulated marker does not move"
    )
    assert np.isnan(scores["rho"].sel(marker="marker_4"))
    assert int(np.isfinite(scores["rho"]).sum()) == 9
    assert float(scores["amplitude_ratio"].sel(marker="marker_4")) == 0.0


def test_score_marks_a_gap_inside_but_not_the_ends() -> None:
    data = trajectory()
    data["position"].values[:, :, :10] = np.nan
    data["position"].values[2, :, 50] = np.nan
    scores = score(data, trajectory())
    assert int(scores["samples"]) == 150
    assert str(scores["reason"].sel(marker="marker_2").values) == "the measured marker has gaps"
    assert int(np.isfinite(scores["rho"]).sum()) == 9


def test_score_with_one_array_and_no_alignment() -> None:
    data = trajectory(once)
    scores = score(data["position"], data["position"])
    np.testing.assert_allclose(scores["rho"], 1.0, atol=1e-14)
    assert "shift" not in scores


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda d: d.isel(time=slice(0, 100)), "different values of 'time'"),
        (lambda d: d.assign_coords(time=d["time"] + 0.1), "different values of 'time'"),
        (lambda d: d.isel(marker=slice(0, 4)), "not measured: marker_4, marker_5, marker_6, "),
        (lambda d: d.rename(axis="direction"), "expected .*marker, axis, time"),
        (lambda d: d.where(d["time"] > 9).assign_attrs(units="m"), "align them first"),
    ],
)
def test_pairs_that_do_not_match_are_refused(spoil, words: str) -> None:
    data = trajectory()["position"]
    with pytest.raises(TrajectoryError, match=words):
        score(spoil(data), data)


@pytest.mark.parametrize(
    ("v", "w", "words"),
    [
        (curve(0, 5), curve(1, 6), "5 and 6 samples"),
        (curve(0, 1), curve(1, 1), "at least 2"),
        (curve(0), curve(1).assign_attrs(units="mm"), "'m' and 'mm'"),
        (curve(0).rename(time="t"), curve(1), "lacks time"),
    ],
)
def test_correlation_of_unequal_pairs(v: xr.DataArray, w: xr.DataArray, words: str) -> None:
    with pytest.raises(TrajectoryError, match=words):
        correlation_3d(v, w)


def test_unknown_forms() -> None:
    with pytest.raises(TrajectoryError, match="'printed', expected 'consistent'"):
        correlation_3d(curve(0), curve(1), form="printed")  # type: ignore[arg-type]
    with pytest.raises(TrajectoryError, match="'median', expected 'mean'"):
        rmse(curve(0), curve(1), reference="median")  # type: ignore[arg-type]


@pytest.mark.parametrize("measure", [correlation_3d, amplitude_ratio, rmse])
def test_what_overflows_or_has_no_axis_has_no_score(measure) -> None:
    """The correlation with positions of 1e160 m was 0, and the distance without an axis was 0."""
    v = curve(1)
    beyond = v.copy(data=1e160 * v.values)
    for pair in ((v, beyond), (beyond, v)):
        assert np.isnan(measure(*pair))
    with pytest.raises(TrajectoryError, match="no axis, expected at least one"):
        measure(v.isel(axis=[]), v.isel(axis=[]))
