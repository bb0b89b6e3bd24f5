"""Reduction of many markers to one coefficient per instant."""

import numpy as np
import xarray as xr

from analysis.errors import AlignmentError
from analysis.lag import Array
from analysis.trajectory import checked, without_gaps
from analysis.typed import coordinates, relabelled


def principal_component(position: xr.Dataset | xr.DataArray, *, centred: bool = True) -> xr.Dataset:
    """Reduce the positions of all markers to one coefficient per instant.

    X = U Sigma V^T and b = u_1^T X, where a column of X (3 markers x T) holds the x, y and z
    coordinates of all markers at one instant.

    Parameters
    ----------
    position : xarray.Dataset or xarray.DataArray
        Positions, dims (marker, axis, time) [m].
    centred : bool
        Remove the mean over time from every row of X, which the source does not state. Otherwise
        u_1 is the mean posture, which contains nearly all of the "variance".

    Returns
    -------
    xarray.Dataset
        ``b`` (time) [m]; ``u`` (marker, axis) [1], unit length, its largest entry positive;
        ``explained_variance`` [1], sigma_1^2 / sum sigma_j^2.

    Raises
    ------
    TrajectoryError
        Wrong dims or units, gaps, or fewer than two samples.
    AlignmentError
        X is zero.

    Notes
    -----
    Source: Eskes et al. 2017, Eqs 9-10.
    """
    data = checked(position, "given")
    without_gaps(data, "given", least=2)
    b, u, explained = first_component(data.values, centred=centred)
    result = xr.Dataset(
        {
            "b": ("time", b, {"units": "m", "long_name": "first coefficient vector"}),
            "u": (("marker", "axis"), u, {"units": "1"}),
            "explained_variance": ((), explained, {"units": "1"}),
        },
        coords={"marker": data["marker"], "time": data["time"]},
        attrs={"centred": int(centred)},
    )
    if "axis" in coordinates(data):
        result = relabelled(result, {"axis": data["axis"]})
    return result


def first_component(values: Array, *, centred: bool) -> tuple[Array, Array, float]:
    """B (time) [m], u (marker, axis) and the explained variance of `principal_component`.

    `values` (marker, axis, time) [m] are finite. Raises AlignmentError if X is zero.
    """
    rows = values.reshape(-1, values.shape[2])
    X = rows - rows.mean(axis=1, keepdims=True) if centred else rows
    U, sigma, _ = np.linalg.svd(X, full_matrices=False)
    total = float((sigma**2).sum())
    if total == 0.0:
        raise AlignmentError("the given trajectory does not move: it has no principal component")
    u = U[:, 0]
    u = u if u[np.argmax(np.abs(u))] > 0 else -u
    return u @ X, u.reshape(-1, 3), float(sigma[0] ** 2) / total
