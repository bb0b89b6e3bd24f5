"""Flags of an alignment that a reader of its scores must know."""

from typing import Final

import xarray as xr

FLAGS: Final = {
    "sign_disagrees": "direction and correlation of the components call for different signs",
    "shift_at_bound": "the best shift lies at, or is hidden by, the bound of what is allowed",
    "scale_at_bound": "the stretch lies at the end of the allowed range, or outside it",
    "little_overlap": "less of the simulated time was measured than must overlap",
    "inaccurate": "the estimated error of the time steps exceeds a tenth of the simulated motion",
    "weak_match": "the aligned components share less than half of their variance",
}
"""Variables that are 1 where a trial is flagged, and what that says."""


def flags_of(trial: xr.Dataset) -> list[str]:
    """Name the flags that are raised in the scores or the alignment of one trial."""
    return [name for name in FLAGS if name in trial and float(trial[name]) == 1.0]
