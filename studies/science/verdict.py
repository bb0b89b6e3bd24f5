"""Verdict on assisted inversion against sEMG alone, the difference it detects, and its controls.

The verdict compares the correlations of deviations of two estimates over volunteers. A verdict that
shows no difference means little without the smallest difference that would have been found.
"""

from typing import Final

import numpy as np
import pandas as pd

from analysis.statistics.power import detectable
from studies.science.deviations import (
    Floats,
    Trials,
    deviation_agreement,
    random_activations,
    spread_of_deviations,
    with_known_agreement,
)
from studies.science.subset import mean_interval, mean_text

SEMG: Final = "sEMG alone"
ASSISTED: Final = "trajectory:assisted"
DRAWS: Final = 200
DRAWS_OF_DIFFERENCE: Final = 500
KNOWN: Final = (0.1, 0.2, 0.3, 0.5, 0.8)  #: correlations of the positive control
DIFFERENCES: Final = (0.1, 0.2, 0.3, 0.4, 0.5)
"""Differences of two correlations in the positive control of the verdict."""
BOUND: Final = 0.95  #: largest correlation of an estimate drawn in the controls
TARGET: Final = 0.8  #: power of the smallest detectable difference


def differences(table: pd.DataFrame) -> Floats:
    """Correlation of deviations of the assisted inversion minus that of sEMG alone, per volunteer."""
    wide = table.pivot_table(index="volunteer", columns="estimate", values="of deviations")
    return (wide[ASSISTED] - wide[SEMG]).to_numpy(dtype=np.float64)


def smallest_difference(difference: Floats) -> float:
    """Smallest mean difference that the interval of `verdict` detects with the power `TARGET`.

    The spread is that of these volunteers, which is itself uncertain.
    """
    return detectable(difference.size, test="t", target=TARGET) * spread(difference)


def spread(difference: Floats) -> float:
    """Standard deviation of the differences of independent persons."""
    return spread_of_deviations(difference.size) * float(difference.std(ddof=1))


def verdict(table: pd.DataFrame) -> str:
    """Sentences on assisted inversion against sEMG alone on the deviations, and on their power."""
    own = table.groupby("estimate")["of deviations"]
    difference = differences(table)
    wider = spread_of_deviations(difference.size)
    mean, low, high = mean_interval(difference, wider)
    said = (
        "estimates a person's own deviations better than sEMG alone"
        if low > 0.0
        else "estimates a person's own deviations worse than sEMG alone"
        if high < 0.0
        else "is not shown to estimate a person's own deviations better than sEMG alone"
    )
    smallest = smallest_difference(difference)
    power = (
        "With this spread between volunteers, the smallest difference that is detected with a power of "
        f"{TARGET:g} is {smallest:.2f}"
    )
    if low <= 0.0 <= high:
        power += "; a smaller one can remain undetected"
    return (
        f"**The assisted inversion (trajectory) {said}:** the correlation of deviations is "
        f"{mean_text(own.get_group(ASSISTED).to_numpy(), wider=wider)}, compared with "
        f"{mean_text(own.get_group(SEMG).to_numpy(), wider=wider)}; the difference is {mean:+.2f} "
        f"({low:+.2f} to {high:+.2f}) in {difference.size} simulated volunteers. {power}."
    )


def controls(truth: Floats, trials: Trials) -> pd.DataFrame:
    """Share of draws in which deviations are found (interval above 0), by their true correlation.

    The correlation 0 is the negative control: random activations, which know nothing of the person.
    """
    rng, wider = np.random.default_rng(47), spread_of_deviations(len(trials.persons))
    rows: list[dict[str, float]] = []
    for rho in (0.0, *KNOWN):
        intervals: list[tuple[float, bool]] = []
        for _ in range(DRAWS):
            estimate = (
                with_known_agreement(truth, trials, rho, rng)
                if rho
                else random_activations(truth.shape, rng)  # pyright: ignore[reportArgumentType]
            )
            mean, low, _ = mean_interval(deviation_agreement(estimate, truth, trials), wider)
            intervals.append((mean, low > 0.0))
        rows.append({"true": rho, **_share(intervals)})
    return pd.DataFrame(rows)


def controls_of_difference(truth: Floats, trials: Trials, table: pd.DataFrame) -> pd.DataFrame:
    """Share of draws in which one of two estimates is found to be better, by the true difference.

    The correlations of both are drawn about the mean of the two compared estimates, so that their
    differences have the standard deviation of those in `table`. The difference 0 is the negative
    control.
    """
    rng, wider = np.random.default_rng(48), spread_of_deviations(len(trials.persons))
    deviation = spread(differences(table))
    middle = float(table[table["estimate"].isin([ASSISTED, SEMG])]["of deviations"].mean())
    rows: list[dict[str, float]] = []
    for true in (0.0, *DIFFERENCES):
        intervals: list[tuple[float, bool]] = []
        for _ in range(DRAWS_OF_DIFFERENCE):
            half = 0.5 * (true + deviation * rng.standard_normal(len(trials.persons)))
            better, worse = (
                deviation_agreement(
                    with_known_agreement(truth, trials, np.clip(middle + one, -BOUND, BOUND), rng),
                    truth,
                    trials,
                )
                for one in (half, -half)
            )
            mean, low, _ = mean_interval(better - worse, wider)
            intervals.append((mean, low > 0.0))
        rows.append({"true": true, **_share(intervals)})
    return pd.DataFrame(rows)


def _share(intervals: list[tuple[float, bool]]) -> dict[str, float]:
    means, above = np.array(intervals, dtype=np.float64).T
    return {"measured": float(means.mean()), "found": float(above.mean())}


def power_sentences(power: pd.DataFrame, of_difference: pd.DataFrame) -> str:
    """Sentences on the controls of single estimates, and on those of the difference of two."""
    none, zero = power.iloc[0], of_difference.iloc[0]
    return (
        f"* **Controls:** in {DRAWS} draws, estimates with a known correlation of deviations are found "
        f"(interval above 0) as follows: {_each(power)}. Random activations, which know nothing of the "
        f"person, are found in {none['found']:.0%} (2.5 % are expected), with a mean correlation of "
        f"{none['measured']:+.2f}.\n"
        f"* **Controls of the difference:** in {DRAWS_OF_DIFFERENCE} draws of two estimates whose "
        "differences vary between volunteers as those of the verdict, a known difference of the "
        f"correlations is found as follows: {_each(of_difference)}. Without a difference, one is found "
        f"in {zero['found']:.0%} (2.5 % are expected)."
    )


def _each(power: pd.DataFrame) -> str:
    known = power.iloc[1:]
    return ", ".join(f"{row['true']:g} in {row['found']:.0%}" for _, row in known.iterrows())
