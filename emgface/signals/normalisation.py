"""Min-max normalisation of features to 0-1.

Source: Eskes et al. 2017, Eq. 8.
"""

from typing import Final

import numpy as np
import xarray as xr

from emgface.errors import ActivationError, SignalError
from emgface.recordings.findings import ATTRIBUTE, Finding, with_findings
from emgface.signals.parameters import NormalisationParameters

LARGEST_ABOVE: Final = 0.05
"""Share of samples above the range that is clipped without a finding [1]."""
LARGEST_BELOW: Final = 0.5
"""Share below the range: more means that a muscle is hardly ever active, as with another gain."""


def normalise(
    feature: xr.DataArray, extent: xr.Dataset | None, parameters: NormalisationParameters
) -> xr.DataArray:
    """Min-max normalisation, (g - min g) / (max g - min g), to 0-1 (Eskes et al. 2017, Eq. 8).

    `feature` has the dims (row, time); `extent` is a `feature_range`, and without one the range is
    that of the trial. `parameters` determine the treatment of a constant feature (0/0), of a muscle
    at rest and of values outside the range. The attributes of the result are ``clipped_fraction``,
    ``silent``, ``resting``, and findings on rows of which much is outside the range. Raises
    SignalError if a feature is constant or none reaches the Willison threshold, and ActivationError
    if a trial leaves the range of the session or the reference.
    """
    dim = str(next(d for d in feature.dims if d != "time"))
    g = feature.transpose(dim, "time")
    rows = [str(name) for name in g[dim].values]
    if extent is None:
        low, high = g.values.min(axis=1), g.values.max(axis=1)
    else:
        matched = extent.sel({dim: g[dim]})
        low, high = matched["minimum"].values, matched["maximum"].values
    flat = ~(high > low)
    # A count of zero throughout indicates rest, any other constant a failed electrode or setting.
    at_rest = flat & (high == 0.0) & (feature.attrs.get("feature") == "wamp")
    resting = [name for name, rests in zip(rows, at_rest, strict=True) if rests]
    silent = [name for name, is_flat in zip(rows, flat & ~at_rest, strict=True) if is_flat]
    if len(resting) == len(rows) or (resting and parameters.resting == "error"):
        raise SignalError(
            f"no step of {dim} {', '.join(resting)} reaches the Willison threshold over the "
            f"{parameters.reach}, so that Eq. 8 is 0/0: lower the threshold (in volts), or "
            "specify it as a multiple of the baseline"
        )
    if silent and parameters.silent == "error":
        raise SignalError(
            f"feature of {dim} {', '.join(silent)} is constant over the {parameters.reach}, "
            "so that Eq. 8 is 0/0: check electrode and threshold, or choose silent = 'zero' "
            "for activation 0"
        )
    scale = np.where(flat, 1.0, high - low)
    values = np.where(flat[:, None], 0.0, (g.values - low[:, None]) / scale[:, None])
    outside = (values < 0.0) | (values > 1.0)
    above = below = np.zeros(len(rows))
    if outside.any():
        if parameters.outside == "error":
            k, j = np.unravel_index(np.argmax(np.abs(values - 0.5)), values.shape)
            remedy = (
                "use a reference of greater effort" if values[k, j] > 1.0 else "include rest in it"
            )
            raise ActivationError(
                f"activation of {dim} {rows[k]} is {values[k, j]:.3g} at t = "
                f"{float(g['time'][j]):.6g} s, outside 0-1: the trial exceeds the range of the "
                f"{parameters.reach}; {remedy}, or choose outside = 'clip'"
            )
        above, below = (values > 1.0).mean(axis=1), (values < 0.0).mean(axis=1)
        values = np.clip(values, 0.0, 1.0)
    result = g.copy(data=values)
    result.attrs |= {
        "units": "1",
        "clipped_fraction": float(outside.mean()),
        "silent": " ".join(silent),
        "resting": " ".join(resting),
    }
    result.attrs.pop(ATTRIBUTE, None)  # those of the feature
    kind = "muscle" if dim == "muscle" else "channel"
    return with_findings(
        result,
        [
            Finding("outside_range", kind, name, {"above": high_share, "below": low_share})
            for name, high_share, low_share in zip(
                rows, above.tolist(), below.tolist(), strict=True
            )
            if high_share > LARGEST_ABOVE or low_share > LARGEST_BELOW
        ],
    )
