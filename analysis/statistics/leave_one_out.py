"""Contrasts without each of the volunteers in turn."""

import math

import numpy as np
import xarray as xr

from analysis.statistics.finding import (
    INDEPENDENT,
    StatisticalFinding,
    judged_tests,
    persons,
    shown_p,
)
from analysis.statistics.paired import Array, Comparison, PairedScores
from analysis.statistics.sign_flip import (
    MOST_EXACT_SIGNS,
    TIED,
    sign_flip_p,
    sign_patterns,
    signed_sums,
)


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
        if len(kept) < 2:
            continue
        values = each.means.values[kept]
        estimates[row, kept] = (values.sum() - values) / (len(kept) - 1)
        chances[row, kept] = _without(values)
    rows = {each.label: row for row, each in enumerate(data.pairs)}
    result = judged_tests(
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


def _without(values: Array) -> Array:
    """Sign-flip p of `values`, shape (n,), without each of them."""
    n = len(values)
    if n - 1 <= MOST_EXACT_SIGNS:
        patterns = sign_patterns(n - 1)
        return np.array([sign_flip_p(np.delete(values, k), patterns) for k in range(n)])
    # The same random patterns serve for all, so that a value's share is taken from their sums.
    patterns = sign_patterns(n)
    sums = signed_sums(values[None], patterns)[0]
    p = np.empty(n)
    for k, value in enumerate(values):
        size: Array = np.abs(sums - patterns[:, k] * value)
        tied = TIED * float(np.abs(values).sum() - abs(value))
        p[k] = float(np.mean(size >= float(size[0]) - tied))
    return p


def _finding(data: PairedScores, estimates: np.ndarray, chances: np.ndarray) -> StatisticalFinding:
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
        f"largest {shown_p(p)} of {persons(n - 1)} (smallest possible {2.0 ** (2 - n):.2g})."
    )
    least, further = min(1.0, 2.0 ** (2 - n)), {"sign_changes": float(changes)}
    return StatisticalFinding(estimate, low, high, p, least, sentence, further)
