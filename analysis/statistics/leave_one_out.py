"""Contrasts without each of the volunteers in turn."""

import math

import numpy as np
import xarray as xr

from analysis.statistics.finding import INDEPENDENT, Finding, judged, persons, shown_p
from analysis.statistics.paired import Comparison, Paired
from analysis.statistics.sign_flip import sign_flip_p, sign_patterns


def leave_one_volunteer_out(data: Comparison) -> xr.Dataset:
    """Repeat the comparison of strategies without each volunteer in turn.

    ``estimate`` is that of all volunteers, ``interval`` the smallest and largest estimate without
    one of them (no confidence interval), ``p`` the largest sign-flip p without one; besides, dims
    (contrast, volunteer), ``estimate_without`` and ``p_without``, NaN for a volunteer without a
    pair, and ``sign_changes``, volunteers without whom the estimate has the other sign.
    """
    shape = (len(data.pairs), data.values.sizes["volunteer"])
    estimates, chances = np.full(shape, np.nan), np.full(shape, np.nan)
    for row, each in enumerate(data.pairs):
        kept = np.flatnonzero(np.isfinite(each.means.values))
        patterns = sign_patterns(len(kept) - 1) if len(kept) > 1 else np.ones((1, 0))
        for column in kept if len(kept) > 1 else ():
            rest = each.means.values[kept[kept != column]]
            estimates[row, column] = rest.mean()
            chances[row, column] = sign_flip_p(rest, patterns)
    rows = {each.label: row for row, each in enumerate(data.pairs)}
    result = judged(
        data.pairs,
        lambda each: _finding(each, estimates[rows[each.label]], chances[rows[each.label]]),
        lambda _: (INDEPENDENT,),
        further=("sign_changes",),
        method="leave one volunteer out, sign-flip test of the others",
        level=math.nan,
        attrs=data.attrs,
    )
    dims = ("contrast", "volunteer")
    result["estimate_without"] = (dims, estimates, {"units": data.attrs["units"]})
    result["p_without"] = (dims, chances, {"units": "1"})
    result["volunteer"] = [str(label) for label in data.values["volunteer"].values]
    return result


def _finding(data: Paired, estimates: np.ndarray, chances: np.ndarray) -> Finding:
    values = data.values
    n, estimate = len(values), float(values.mean())
    low, high = float(np.nanmin(estimates)), float(np.nanmax(estimates))
    changes = int((np.sign(estimates[np.isfinite(estimates)]) == -np.sign(estimate)).sum())
    changes = changes if estimate else 0
    most = str(data.means["volunteer"].values[int(np.nanargmax(np.abs(estimates - estimate)))])
    p = float(np.nanmax(chances))
    sentence = (
        f"{data.shown(estimate)} over {persons(n)}, from {data.shown(low)} to "
        f"{data.shown(high)} without one of them, with the largest change without {most}; "
        f"{'the sign is unchanged' if not changes else f'the sign changes without {changes} of them'}; "
        f"largest {shown_p(p)} of {persons(n - 1)} (smallest possible {2.0 / 2 ** (n - 1):.2g})."
    )
    least, further = min(1.0, 2.0 / 2 ** (n - 1)), {"sign_changes": float(changes)}
    return Finding(estimate, low, high, p, least, sentence, further)
