"""Subset of a study for experiments with many simulations."""

from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
import xarray as xr

from emgface.study.configuration import StudyConfiguration
from studies.science.setup import study_of

VOLUNTEERS: Final = 4
"""Number of volunteers in the subset, which limits the run time of the page."""


def names_of(cube: xr.Dataset) -> list[str]:
    """Volunteers of the subset."""
    return [str(name) for name in cube["volunteer"].values[:VOLUNTEERS]]


def of_subset(cube: xr.Dataset) -> xr.Dataset:
    """Cut the subset out of a cube."""
    return cube.sel(volunteer=names_of(cube), repetition=[1])


def subset_study(
    recordings: Path, names: list[str], title: str, **changes: Any
) -> StudyConfiguration:
    """Configure a study of the subset."""
    part = {"volunteers": names, "repetitions": [1]}
    return study_of(recordings, title, recordings=part, **changes)


def median_per_volunteer(cube: xr.Dataset, **labels: Any) -> pd.DataFrame:
    """Tabulate median rho over instructions and markers, and lost trials, per volunteer and strategy."""
    rows: list[dict[str, Any]] = []
    for strategy in cube["strategy"].values:
        for volunteer in cube["volunteer"].values:
            one = cube.sel(strategy=strategy, volunteer=volunteer)
            rho = one["rho"].values
            rows.append(
                {
                    **labels,
                    "strategy": str(strategy),
                    "volunteer": str(volunteer),
                    "median rho": float(np.nanmedian(rho)) if np.isfinite(rho).any() else np.nan,
                    "median shift [s]": float(np.nanmedian(one["shift"].values)),
                    "trials": int(one["status"].size),
                    "without score": int((one["status"] != "ok").sum()),
                }
            )
    return pd.DataFrame(rows)
