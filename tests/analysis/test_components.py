"""Eqs 9-10 of Eskes et al. 2017 against an independent computation."""

import numpy as np
import pytest
import xarray as xr
from synthetic_trajectories import there_and_back, trajectory

from analysis.components import principal_component
from analysis.errors import AlignmentError, TrajectoryError


def columns(data: xr.Dataset) -> np.ndarray:
    """X: 30 x T, each column x, y, z of marker 1, x, y, z of marker 2, ..."""
    position = data["position"].transpose("time", "marker", "axis").values
    return np.array([sample.ravel() for sample in position]).T


def test_equation_9_first_component_is_leading_eigenvector_of_the_covariance() -> None:
    """The sigma_j^2 of X = U S V^T are eigenvalues of X X^T, u_1 its leading eigenvector."""
    data = trajectory(there_and_back, noise=3e-4)
    X = columns(data)
    X = X - X.mean(axis=1, keepdims=True)
    values, vectors = np.linalg.eigh(X @ X.T)
    component = principal_component(data)
    u = component["u"].values.ravel()
    assert abs(u @ vectors[:, -1]) == pytest.approx(1.0, abs=1e-12)
    assert float(component["explained_variance"]) == pytest.approx(
        values[-1] / values.sum(), rel=1e-12
    )


def test_equation_10_coefficients_are_projections_on_the_first_component() -> None:
    """Check b = u_1^T X sample by sample; the variance of b is sigma_1^2."""
    data = trajectory(there_and_back, noise=3e-4)
    X = columns(data)
    component = principal_component(data)
    u, mean = component["u"].values.ravel(), X.mean(axis=1)
    expected = [sum(u[i] * (X[i, t] - mean[i]) for i in range(30)) for t in range(X.shape[1])]
    np.testing.assert_allclose(component["b"], expected, atol=1e-15)
    sigma = np.linalg.svd(X - mean[:, None], compute_uv=False)
    assert float((component["b"] ** 2).sum()) == pytest.approx(sigma[0] ** 2, rel=1e-12)
    assert component["b"].attrs["units"] == "m"


def test_uncentred_component_is_the_posture() -> None:
    """Without centring u_1 is approximately the mean posture, with nearly all of the 'variance'."""
    data = trajectory(there_and_back)
    X = columns(data)
    component = principal_component(data, centred=False)
    posture = X.mean(axis=1) / np.linalg.norm(X.mean(axis=1))
    assert abs(component["u"].values.ravel() @ posture) > 0.99
    assert float(component["explained_variance"]) > 0.97
    np.testing.assert_allclose(component["b"], component["u"].values.ravel() @ X, rtol=1e-12)


def test_sign_is_deterministic() -> None:
    """The largest entry of u_1 is positive for both signs of the movement."""
    for amplitude in (5e-3, -5e-3):
        u = principal_component(trajectory(amplitude=amplitude))["u"].values
        assert u.ravel()[np.argmax(np.abs(u))] > 0


def test_still_trajectory_has_no_component() -> None:
    data = trajectory()
    still = data.copy(deep=True)
    still["position"].values[:] = 0.0
    with pytest.raises(AlignmentError, match="does not move"):
        principal_component(still)


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda d: d.rename(position="place"), "no variable 'position'"),
        (lambda d: d.isel(axis=[0, 1]), "2 axes"),
        (lambda d: d.isel(marker=0, drop=True), "select one trial"),
        (lambda d: d.expand_dims(strategy=2), "select one trial"),
        (lambda d: d.drop_vars("marker"), "no coordinate 'marker'"),
        (lambda d: d.isel(marker=[0, 0, 1]), "twice: marker_0"),
        (lambda d: d.isel(time=[0, 2, 1]), "not strictly increasing"),
        (lambda d: d.isel(time=[0]), "1 samples, expected at least 2"),
    ],
)
def test_an_invalid_trajectory_is_refused_with_a_reason(spoil, words: str) -> None:
    with pytest.raises(TrajectoryError, match=words):
        principal_component(spoil(trajectory()))


def test_other_units_are_refused() -> None:
    data = trajectory()
    data["position"].attrs["units"] = "mm"
    with pytest.raises(TrajectoryError, match="'mm', expected units 'm'"):
        principal_component(data)
