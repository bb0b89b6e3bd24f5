"""Flags of alignments that may be incorrect."""

from typing import Final

import xarray as xr

FLAGS: Final = {
    "sign_disagrees": "direction and correlation of the components indicate different signs",
    "shift_at_bound": "the best shift lies at the bound of the allowed range, or beyond it",
    "scale_at_bound": "the time scale lies at an end of the allowed range, or outside it",
    "little_overlap": "the measured fraction of the simulated time is smaller than the required overlap",
    "inaccurate": "the estimated error of the time steps exceeds a tenth of the simulated motion",
    "weak_match": "the aligned components share less than half of their variance",
}
"""Variables that are 1 where a trial is flagged, with their meanings."""


def flags_of(trial: xr.Dataset) -> list[str]:
    """Return the flags raised in the scores or the alignment of one trial."""
    return [name for name in FLAGS if name in trial and float(trial[name]) == 1.0]
