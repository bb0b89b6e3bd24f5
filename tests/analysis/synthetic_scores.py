"""Cubes with given scores, for the tests of the statistics."""

import numpy as np
import xarray as xr

STRATEGIES = ("act_all", "act_3", "act_rel")


def of_rho(rho: np.ndarray, *, strategies: tuple[str, ...] = STRATEGIES) -> xr.Dataset:
    """A cube of given scores, dims volunteer, instruction, repetition, strategy, marker."""
    dims = ("volunteer", "instruction", "repetition", "strategy", "marker")
    labels = {
        "volunteer": [f"v{i + 1}" for i in range(rho.shape[0])],
        "instruction": list("ABCDEF"[: rho.shape[1]]),
        "repetition": list(range(1, rho.shape[2] + 1)),
        "strategy": list(strategies),
        "marker": [f"marker_{i}" for i in range(rho.shape[4])],
    }
    return xr.Dataset(
        {
            "rho": (dims, rho, {"units": "1"}),
            "amplitude_ratio": (dims, np.exp(rho), {"units": "1"}),
            "rmse": (dims, 1e-3 * (1.0 - rho), {"units": "m"}),
            "status": (dims[:-1], np.full(rho.shape[:-1], "ok", dtype="U24")),
        },
        coords=labels,
        attrs={"origin": "simulated"},
    )


def of_differences(values: list[float]) -> xr.Dataset:
    """One value per volunteer and two strategies whose z differ by `values`."""
    z = np.zeros((len(values), 1, 1, 2, 1))
    z[:, 0, 0, 1, 0] = values
    return of_rho(np.tanh(z), strategies=("a", "b"))


def fail(cube: xr.Dataset, **label: object) -> xr.Dataset:
    """Set the status of the trials of a label to failed."""
    cube = cube.copy(deep=True)
    cube["status"].loc[label] = "failed:InvertedElement"
    for name in ("rho", "amplitude_ratio", "rmse"):
        cube[name].loc[label] = np.nan
    return cube
