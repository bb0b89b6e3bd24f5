"""How much a contrast hangs on any one volunteer."""

import math
from collections.abc import Sequence

import numpy as np
import xarray as xr

from analysis.statistics.finding import (
    INDEPENDENT,
    Finding,
    collected,
    left_out,
    lost,
    persons,
    shown_p,
    too_few,
)
from analysis.statistics.paired import LIMIT, Paired, Scale, all_paired
from analysis.statistics.sign_flip import sign_flip_p, sign_patterns


def leave_one_volunteer_out(
    cube: xr.Dataset,
    *,
    contrasts: Sequence[tuple[str, str]] | None = None,
    variable: str = "rho",
    scale: Scale | None = None,
    limit: float = LIMIT,
) -> xr.Dataset:
    """Repeat the comparison of strategies without each volunteer in turn.

    Parameters
    ----------
    cube, contrasts, variable, scale, limit
        As in `analysis.statistics.sign_flip.sign_flip`.

    Returns
    -------
    xarray.Dataset
        See `analysis.statistics.finding.collected`: ``estimate`` over all volunteers,
        ``interval`` the smallest and largest estimate without one of them (no confidence
        interval), ``p`` the largest sign-flip p without one; besides, dims (contrast, volunteer),
        ``estimate_without`` and ``p_without``, NaN for a volunteer without a pair, and
        ``sign_changes``, volunteers without whom the estimate has the other sign.

    Raises
    ------
    StatisticsError
        Unknown strategy or variable, or further dims.
    """
    data, attrs = all_paired(cube, contrasts, variable, scale, limit)
    shape = (len(data), cube.sizes["volunteer"])
    estimates, chances = np.full(shape, np.nan), np.full(shape, np.nan)
    for row, each in enumerate(data):
        kept = np.flatnonzero(np.isfinite(each.means.values))
        for column in kept if len(kept) > 1 else ():
            rest = each.means.values[kept[kept != column]]
            estimates[row, column] = rest.mean()
            chances[row, column] = sign_flip_p(rest, sign_patterns(len(rest)))
    findings = [_finding(each, estimates[row], chances[row]) for row, each in enumerate(data)]
    units = attrs["units"]
    result = collected(
        findings,
        method="leave one volunteer out, sign-flip test of the rest",
        level=math.nan,
        attrs=attrs,
    )
    dims = ("contrast", "volunteer")
    result["estimate_without"] = (dims, estimates, {"units": units})
    result["p_without"] = (dims, chances, {"units": "1"})
    result["volunteer"] = [str(label) for label in cube["volunteer"].values]
    return result


def _finding(data: Paired, estimates: np.ndarray, chances: np.ndarray) -> Finding:
    checks = (INDEPENDENT, left_out(data))
    few = too_few(data, checks, ("sign_changes",))
    if few is not None:
        return few
    values = data.values
    n, estimate = len(values), float(values.mean())
    low, high = float(np.nanmin(estimates)), float(np.nanmax(estimates))
    changes = int((np.sign(estimates[np.isfinite(estimates)]) == -np.sign(estimate)).sum())
    changes = changes if estimate else 0
    most = str(data.means["volunteer"].values[int(np.nanargmax(np.abs(estimates - estimate)))])
    p = float(np.nanmax(chances))
    sentence = (
        f"{data.label}: {data.shown(estimate)} over {persons(n)}, from {data.shown(low)} to "
        f"{data.shown(high)} without one of them, most changed without {most}; "
        f"{'the sign holds' if not changes else f'the sign changes without {changes} of them'}; "
        f"largest {shown_p(p)} of {persons(n - 1)} (smallest possible {2.0 / 2 ** (n - 1):.2g})."
        f"{lost(data.counts)}"
    )
    return Finding(
        data.label, estimate, low, high, p, min(1.0, 2.0 / 2 ** (n - 1)), n, sentence,
        data.counts, checks, {"sign_changes": float(changes)},
    )  # fmt: skip
