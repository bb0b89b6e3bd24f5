"""Number of volunteers required by a contrast, by simulation."""

import math
from collections.abc import Sequence
from functools import cache
from itertools import combinations
from typing import Final, Literal

import numpy as np
import xarray as xr
from scipy.stats import chi2, t

from analysis.arguments import count, generator, number
from analysis.errors import StatisticsError
from analysis.statistics.finding import check_level, persons
from analysis.statistics.paired import Array, Comparison
from analysis.statistics.ranks import signed_rank_counts
from analysis.statistics.scope import LEAST_VOLUNTEERS, too_few_volunteers
from analysis.statistics.sign_flip import TIED, sign_patterns

Test = Literal["sign_flip", "wilcoxon", "t"]

VOLUNTEERS: Final = (4, 6, 8, 10, 12, 16, 20, 30)

#: studies whose sign patterns are computed at once, which bounds the memory
STUDIES_AT_ONCE: Final = 100

MOST_DETECTABLE: Final = 1e3
"""Largest standardised difference in the search for the detectable difference."""


def simulated_power(
    effect: float,
    standard_deviation: float,
    *,
    volunteers: Sequence[int] = VOLUNTEERS,
    test: Test = "sign_flip",
    alpha: float = 0.05,
    target: float = 0.8,
    simulations: int = 2000,
    draws: int = 999,
    seed: int = 0,
    contrasts: int = 1,
) -> xr.Dataset:
    """Compute the power of a test of normal mean differences for several numbers of volunteers.

    `effect` and `standard_deviation` are those of the volunteers' mean differences, on the scale of
    the analysis. `volunteers` are the numbers to try, 2 or more each; the `test` over volunteers is
    two-sided; `alpha` is its size and `target` the desired power [1]. `simulations` are simulated
    studies per number, and `draws` random sign patterns for more than 12 volunteers. `contrasts` are
    tested together: between strategies of equal spread, one of which has the effect and the others
    none. The power is that of one contrast, with p over all of them jointly (``sign_flip``), or at the
    strictest step of Holm.

    The result has the dim volunteers: ``power`` [1] with its ``monte_carlo_error`` and
    ``smallest_p``; ``volunteers_needed``, the smallest number that reaches `target`, NaN if none
    does; attribute ``sentence``. A test whose smallest p lies above alpha has no power for any
    effect.
    """
    for name, given in (("effect", effect), ("standard deviation", standard_deviation)):
        number(name, given)
    count("the number of simulations", simulations, least=1)
    count("the number of draws", draws, least=1)
    count("the number of contrasts", contrasts, least=1)
    if not standard_deviation > 0 or not math.isfinite(effect):
        raise StatisticsError(
            f"effect and standard deviation are {effect} and {standard_deviation}, expected a "
            "number and one above 0"
        )
    if test not in ("sign_flip", "wilcoxon", "t"):
        raise StatisticsError(f"the test is {test!r}, expected 'sign_flip', 'wilcoxon' or 't'")
    if not volunteers or min(volunteers) < 2 or simulations < 1 or draws < 1:
        raise StatisticsError("expected 2 or more volunteers, and at least one simulation and draw")
    if not 0 < alpha < 1 or not 0 < target < 1:
        raise StatisticsError(f"alpha and target are {alpha} and {target}, expected 0 to 1")
    rng = generator(seed)
    power, least = np.zeros(len(volunteers)), np.zeros(len(volunteers))
    joint = contrasts if test == "sign_flip" else 1
    strict = alpha if test == "sign_flip" else alpha / contrasts
    for index, n in enumerate(volunteers):
        studies = _differences(rng, (simulations, joint, n), effect, standard_deviation)
        p, least[index] = _chances(studies, test, draws, seed)
        power[index] = float(np.mean(p <= strict * (1 + 1e-9)))
    one = {"units": "1"}
    enough = [n for n, reached in sorted(zip(volunteers, power, strict=True)) if reached >= target]
    needed = enough[0] if enough else None
    result = xr.Dataset(
        {
            "power": ("volunteers", power, one),
            "monte_carlo_error": ("volunteers", np.sqrt(power * (1 - power) / simulations), one),
            "smallest_p": ("volunteers", least, one),
            "volunteers_needed": ((), math.nan if needed is None else float(needed), one),
        },
        coords={"volunteers": list(volunteers)},
    )
    what = f"a difference of {effect:.2g} with standard deviation {standard_deviation:.2g}"
    requirement = (
        (f"requires {persons(needed)}")
        if needed
        else f"requires more than {max(volunteers)} volunteers"
    )
    names = {"sign_flip": "sign-flip", "wilcoxon": "Wilcoxon", "t": "t"}
    sentence = f"To detect {what} with power {target:.2g}, the {names[test]} test {requirement}."
    result.attrs = {
        "method": "power by simulation of normal mean differences",
        "test": test, "effect": effect, "standard_deviation": standard_deviation,
        "alpha": alpha, "target": target, "simulations": simulations, "draws": draws,
        "seed": seed, "sentence": sentence,
    }  # fmt: skip
    return result


@cache
def detectable(
    n: int, *, test: Test, contrasts: int = 1, alpha: float = 0.05, target: float = 0.8
) -> float:
    """Find the smallest difference that a test of n volunteers detects with a given power.

    In standard deviations of the volunteers' differences [1], to about 3 % (by simulation);
    infinite if no p of the test reaches alpha. The options are those of `simulated_power`.
    """

    def reached(effect: float) -> float:
        # The draws are the same for every effect, so that power increases monotonically with it.
        power = simulated_power(
            effect, 1.0, volunteers=[n], test=test, alpha=alpha, target=target, simulations=1000,
            contrasts=contrasts,
        )  # fmt: skip
        return float(power["power"][0])

    low, high = 0.0, 1.0
    while reached(high) < target:
        low, high = high, 2.0 * high
        if high > MOST_DETECTABLE:
            return math.inf
    while high - low > 0.01 * high:
        middle = (low + high) / 2.0
        low, high = (low, middle) if reached(middle) >= target else (middle, high)
    return high


def power(
    data: Comparison,
    *,
    effect: float | None = None,
    level: float = 0.95,
    volunteers: Sequence[int] = VOLUNTEERS,
    test: Test = "sign_flip",
    alpha: float = 0.05,
    target: float = 0.8,
    simulations: int = 1000,
    seed: int = 0,
) -> xr.Dataset:
    """Estimate the number of volunteers required by each contrast of a cube.

    `effect` is the difference to be shown, on the scale of the analysis, preferably one that
    matters; by default the observed one, which makes the result as uncertain as that estimate.
    `level` is that of the interval of the standard deviation; the other options are those of
    `simulated_power`, with all contrasts of the cube tested together.

    The result has the dims contrast, volunteers, spread (lower, estimate, upper): ``power`` [1] at
    the observed standard deviation and at both ends of its interval, ``monte_carlo_error``,
    ``volunteers_needed`` (contrast, spread), ``effect`` (contrast), ``standard_deviation``
    (contrast, spread), ``n`` (contrast), ``sentence`` (contrast). NaN without variation between
    volunteers, and at the ends of an interval from too few of them.
    """
    check_level(level)
    generator(seed)  # errors before the first simulation
    spreads = ("lower", "estimate", "upper")
    shape = (len(data.pairs), len(spreads))
    powers = np.full((*shape, len(volunteers)), np.nan)
    errors, deviations, needed = powers.copy(), np.full(shape, np.nan), np.full(shape, np.nan)
    effects = np.full(len(data.pairs), math.nan)
    sentences: list[str] = []
    for row, each in enumerate(data.pairs):
        values = each.values
        n = len(values)
        effects[row] = effect if effect is not None else (values.mean() if n else math.nan)
        if n < 2 or not np.ptp(values) > 0:
            sentences.append(
                f"{each.label}: {persons(n)} show no variation, which planning requires."
            )
            continue
        sd = float(values.std(ddof=1))
        tail = (1.0 - level) / 2.0
        deviations[row, 1] = sd
        if n >= LEAST_VOLUNTEERS:
            for column, quantile in ((0, 1.0 - tail), (2, tail)):
                share = float(chi2.ppf(quantile, n - 1)) / (n - 1)
                deviations[row, column] = sd / math.sqrt(share)
        for column in np.flatnonzero(np.isfinite(deviations[row])):
            result = simulated_power(
                float(effects[row]), float(deviations[row, column]), volunteers=volunteers,
                test=test, alpha=alpha, target=target, simulations=simulations, seed=seed,
                contrasts=len(data.pairs),
            )  # fmt: skip
            powers[row, column] = result["power"].values
            errors[row, column] = result["monte_carlo_error"].values
            needed[row, column] = float(result["volunteers_needed"])
        shown = [f"{k:.0f}" if np.isfinite(k) else f"over {max(volunteers)}" for k in needed[row]]
        chosen = "the observed difference" if effect is None else "a difference"
        spread = (
            f"{shown[0]} to {shown[2]} for the {100 * level:.3g} % interval of the spread between "
            f"{persons(n)}"
        )
        sentences.append(
            f"{each.label}: to detect {chosen} of {each.shown(float(effects[row]))} with power "
            f"{target:.2g}, {shown[1]} volunteers are needed ({too_few_volunteers(n) or spread})."
        )
    one, units = {"units": "1"}, {"units": data.attrs["units"]}
    contrast = np.array([each.label for each in data.pairs], dtype=str)
    dims = ("contrast", "spread")
    return xr.Dataset(
        {
            "power": ((*dims, "volunteers"), powers, one),
            "monte_carlo_error": ((*dims, "volunteers"), errors, one),
            "volunteers_needed": (dims, needed, one),
            "effect": ("contrast", effects, units),
            "standard_deviation": (dims, deviations, units),
            "n": ("contrast", np.array([len(each.values) for each in data.pairs], dtype=int), one),
            "sentence": ("contrast", np.array(sentences, dtype=str)),
        },
        coords={"contrast": contrast, "spread": list(spreads), "volunteers": list(volunteers)},
        attrs={
            **data.attrs,
            "method": "power by simulation of normal mean differences",
            "test": test, "alpha": alpha, "target": target, "simulations": simulations,
            "seed": seed, "level": level,
            "sentence": " ".join(sentences) or
                "There is one strategy and therefore no contrast to plan.",
        },
    )  # fmt: skip


def _differences(
    rng: np.random.Generator, shape: tuple[int, int, int], effect: float, deviation: float
) -> Array:
    """Differences of strategies, shape (studies, contrasts, n); the first contrast has the effect.

    The last of the strategies has the effect; the first contrast is the one with the strategy before.
    """
    studies, contrasts, n = shape
    if contrasts == 1:
        return effect + deviation * rng.standard_normal(shape)
    strategies = math.ceil((1.0 + math.sqrt(1.0 + 8.0 * contrasts)) / 2.0)
    values = deviation / math.sqrt(2.0) * rng.standard_normal((studies, strategies, n))
    values[:, -1] += effect
    pairs = list(combinations(range(strategies), 2))[::-1][:contrasts]
    return values[:, [second for _, second in pairs]] - values[:, [first for first, _ in pairs]]


def _chances(studies: Array, test: Test, draws: int, seed: int) -> tuple[Array, float]:
    """Return the two-sided p of the first contrast of every study, and the smallest possible.

    `studies` have the shape (studies, contrasts, n).
    """
    n = studies.shape[2]
    if test == "t":
        first = studies[:, 0]
        error = first.std(axis=1, ddof=1) / math.sqrt(n)
        size: Array = np.abs(first.mean(axis=1)) / error
        return np.asarray(2.0 * t.sf(size, n - 1), dtype=np.float64), 0.0
    if test == "wilcoxon":
        first = studies[:, 0]
        ranks = np.argsort(np.argsort(np.abs(first), axis=1), axis=1) + 1
        positive = np.where(first > 0, ranks, 0).sum(axis=1)
        _, chances = signed_rank_counts(np.arange(1.0, n + 1.0))
        below = np.cumsum(chances[::2])
        extreme = np.minimum(positive, n * (n + 1) // 2 - positive)
        return np.minimum(1.0, 2.0 * below[extreme]), 2.0 ** (1 - n)
    if n <= 12:
        patterns = sign_patterns(n)
    else:
        drawn = generator(seed).integers(0, 2, size=(draws, n))
        patterns = np.concatenate([np.ones((1, n)), 1.0 - 2.0 * drawn])
    # As in `sign_flip.joint_p`: sums over the root of the sum of squares, contrasts flipped together.
    scaled = studies / np.sqrt((studies**2).sum(axis=2, keepdims=True))
    p = np.empty(len(studies))
    for start in range(0, len(studies), STUDIES_AT_ONCE):
        size = np.abs(scaled[start : start + STUDIES_AT_ONCE] @ patterns.T)
        p[start : start + STUDIES_AT_ONCE] = (size.max(axis=1) >= size[:, 0, :1] - TIED).mean(
            axis=1
        )
    return p, max(2.0 ** (1 - n), 1.0 / len(patterns))
