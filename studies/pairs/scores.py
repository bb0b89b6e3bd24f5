"""Correlation of predicted and measured excursions, with and without the EMG of the trial."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt
import pandas as pd

Floats = npt.NDArray[np.float64]

STEP: Final = 0.02  #: common sampling [s]
LAGS: Final = 1.0  #: largest lag that is compared [s]; clocks of EMG and video differ
NAMES: Final = ("EMG", "template", "shuffled EMG")


@dataclass(frozen=True)
class Trial:
    """Measured and predicted excursion of one trial, sampled every `STEP` from its start."""

    volunteer: str
    instruction: str
    repetition: int
    measured: Floats
    predicted: Floats


def best_correlation(a: Floats, b: Floats) -> tuple[float, float]:
    """Largest Pearson correlation over lags up to `LAGS`, and the lag of b [s]; NaN without variation.

    At least half of the shorter signal is compared at every lag.
    """
    best, at = np.nan, np.nan
    most = round(LAGS / STEP)
    for lag in range(-most, most + 1):
        x, y = (a[: len(a) - lag], b[lag:]) if lag >= 0 else (a[-lag:], b[: len(b) + lag])
        n = min(len(x), len(y))
        x, y = x[:n], y[:n]
        seen = np.isfinite(x) & np.isfinite(y)
        if seen.sum() * 2 < min(len(a), len(b)):
            continue
        x, y = x[seen], y[seen]
        if np.ptp(x) > 0.0 and np.ptp(y) > 0.0:
            rho = float(np.corrcoef(x, y)[0, 1])
            if not rho <= best:
                best, at = rho, lag * STEP
    return best, at


def onset(signal: Floats) -> int:
    """Sample at which a signal first exceeds half of its range."""
    above = signal - np.nanmin(signal) > 0.5 * (np.nanmax(signal) - np.nanmin(signal))
    return int(above.argmax())


def template(trials: list[Trial], k: int) -> Floats:
    """Mean measured excursion of the other volunteers in the instruction, at the onset of trial k.

    Every trial is divided by its largest value. NaN where no volunteer was recorded.
    """
    own = trials[k]
    rows: list[Floats] = []
    for one in trials:
        if one.instruction == own.instruction and one.volunteer != own.volunteer:
            at = np.arange(len(own.measured)) - onset(own.measured) + onset(one.measured)
            inside = (at >= 0) & (at < len(one.measured))
            row = np.full(len(own.measured), np.nan)
            row[inside] = (one.measured / np.nanmax(one.measured))[at[inside]]
            rows.append(row)
    if not rows:
        return np.full(len(own.measured), np.nan)
    stacked = np.array(rows)
    count = np.isfinite(stacked).sum(axis=0)
    total = np.nansum(stacked, axis=0)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def shuffled(trials: list[Trial], k: int) -> list[Floats]:
    """Predictions from the EMG of other repetitions of the volunteer in the same instruction."""
    own = trials[k]
    return [
        one.predicted
        for one in trials
        if (one.volunteer, one.instruction) == (own.volunteer, own.instruction)
        and one.repetition != own.repetition
    ]


def scored(trials: list[Trial]) -> pd.DataFrame:
    """Correlation of every prediction with the measured excursion, one row per trial."""
    rows: list[dict[str, object]] = []
    for k, one in enumerate(trials):
        rho, lag = best_correlation(one.predicted, one.measured)
        others = [best_correlation(p, one.measured)[0] for p in shuffled(trials, k)]
        rows.append(
            {
                "volunteer": one.volunteer,
                "instruction": one.instruction,
                "repetition": one.repetition,
                NAMES[0]: rho,
                "lag [s]": lag,
                NAMES[1]: best_correlation(template(trials, k), one.measured)[0],
                NAMES[2]: float(np.nanmean(others)) if np.isfinite(others).any() else np.nan,
            }
        )
    return pd.DataFrame(rows)


def differences(table: pd.DataFrame) -> Mapping[str, Floats]:
    """EMG minus template and minus shuffled EMG, mean of every volunteer."""
    means = table.groupby("volunteer")[list(NAMES)].mean()
    return {name: (means[NAMES[0]] - means[name]).to_numpy() for name in NAMES[1:]}
