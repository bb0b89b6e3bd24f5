"""Parts of a study for experiments with many simulations, and their means over volunteers."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
import xarray as xr
from scipy.stats import t

from analysis.statistics.power import detectable
from analysis.statistics.scope import LEAST_VOLUNTEERS
from emgface.study.configuration import StudyConfiguration
from emgface.volunteers.world import world_of
from studies.science.setup import people, plan, study_of

INSTRUCTIONS: Final = ("A", "D")
"""Instructions of the experiments with many simulations, which limit the run time of the page: the
lips protruded, and spread symmetrically."""


def subset() -> tuple[str, ...]:
    """Instructions of the subset that the plan contains."""
    return tuple(x for x in INSTRUCTIONS if x in plan.instructions) or plan.instructions


def of_subset(cube: xr.Dataset) -> xr.Dataset:
    """Cut the instructions and the first repetition of the subset out of a cube."""
    return cube.sel(instruction=list(subset()), repetition=[1])


def mismatched_people(study: Path) -> Path:
    """Simulate the volunteers of the mismatched world for the subset; return their recordings.

    With ``--finished``, they are not simulated again for a finished study in the folder `study`.
    """
    folder = plan.store / "mismatched"
    if plan.finished and (study / "cube.nc").is_file():
        return folder / "recordings"
    return people(world_of("mismatched"), folder, subset())


def subset_study(
    recordings: Path, title: str, /, *, session: bool = False, **changes: Any
) -> StudyConfiguration:
    """Configure a study of the subset, with all volunteers.

    With `session`, the minimum and maximum of Eq. 8 are those of all trials of the volunteer, also
    of those that are not part of the subset.
    """
    part: dict[str, Any] = {"instructions": subset(), "repetitions": [1]}
    part |= changes.pop("recordings", {})
    if session:
        part["reference_folder"] = recordings.resolve()
        changes["signals"] = {"normalisation": {"reach": "reference", "silent": "zero"}}
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


def mean_interval(
    values: Sequence[float] | np.ndarray, wider: float = 1.0
) -> tuple[float, float, float]:
    """Mean over volunteers and its 0.95 interval by Student's t.

    `wider` is the ratio of the spread of independent volunteers to that of these values [1]. The bounds
    are NaN with fewer than `LEAST_VOLUNTEERS` values.
    """
    known = np.asarray(values, dtype=np.float64)
    known = known[np.isfinite(known)]
    mean = float(known.mean()) if known.size else math.nan
    if known.size < LEAST_VOLUNTEERS:
        return mean, math.nan, math.nan
    error = wider * float(known.std(ddof=1)) / math.sqrt(known.size)
    reach = float(t.ppf(0.975, known.size - 1)) * error
    return mean, mean - reach, mean + reach


def mean_text(values: Sequence[float] | np.ndarray, form: str = ".2f", wider: float = 1.0) -> str:
    """Mean over volunteers with its interval (`mean_interval`), as text; `form` formats each number."""
    mean, low, high = mean_interval(values, wider)
    if math.isnan(low):
        return f"{mean:{form}}"
    return f"{mean:{form}} ({low:{form}} to {high:{form}})"


def smallest_change(values: Sequence[float] | np.ndarray) -> float:
    """Smallest mean change of paired volunteers that their interval detects with a power of 0.8.

    The spread is that of these volunteers; NaN with fewer than `LEAST_VOLUNTEERS`.
    """
    known = np.asarray(values, dtype=np.float64)
    known = known[np.isfinite(known)]
    if known.size < LEAST_VOLUNTEERS:
        return math.nan
    return detectable(known.size, test="t") * float(known.std(ddof=1))
