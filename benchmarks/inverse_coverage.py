"""Coverage of the intervals of inverse tracking by class of estimate, and factors that would repair it.

    python -m benchmarks inverse-coverage RECORDING.nc ... --results FOLDER [--setting SETTING]

The results are those of ``python -m benchmarks inverse --results FOLDER`` for the same recordings of
simulated volunteers. A posterior that is right contains the truth with 90 % in every class of what it
states; given the truth it does not: intervals of muscles that may be silent begin at 0, so that all
misses are among active samples. Factors multiply the part of the intervals above the estimate, so that
90 % of the samples of other trials, or of their active samples, are inside (split conformal prediction,
Vovk et al. 2005); they are evaluated in the trial that was left out.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import pandas as pd
import typer
import xarray as xr

from benchmarks.inverse import ACTIVE
from benchmarks.report import markdown
from emgface.inverse.refine import LEVEL
from emgface.recordings.dataset import read_recording

CLASSES = (0.0, 0.01, 0.03, 0.1, np.inf)
"""Bounds of the classes of the estimate."""


@dataclass(frozen=True)
class Trial:
    """Estimates, intervals and truth of one trial, each (n,)."""

    name: str
    estimate: np.ndarray
    low: np.ndarray
    high: np.ndarray
    truth: np.ndarray

    @property
    def active(self) -> np.ndarray:
        """Samples whose true activation is above `ACTIVE`."""
        return self.truth > ACTIVE

    def inside(self, factor: float = 1.0) -> np.ndarray:
        """Samples within the interval, whose part above the estimate is multiplied."""
        high = np.minimum(self.estimate + factor * (self.high - self.estimate), 1.0)
        return (self.low <= self.truth) & (self.truth <= high)


def read(path: Path, results: Path, setting: str) -> Trial:
    """Trial of a recording and its result."""
    found = xr.load_dataset(results / f"{path.stem}_{setting.replace(':', '_')}.nc")
    truth = read_recording(path)["true_activation"].interp(time_true=found["time"].values)
    truth = truth.sel(muscle=found["muscle"].values).transpose("muscle", ...)
    names = ("activation", "activation_low", "activation_high")
    each = (found[name].transpose("muscle", "time").values.ravel() for name in names)
    return Trial(path.stem, *each, truth.values.ravel())


def factor(trials: Sequence[Trial], active: bool) -> float:
    """Factor for which `LEVEL` of all, or of the active, samples are not above their interval."""
    needed = [
        ((t.truth - t.estimate) / np.maximum(t.high - t.estimate, 1e-9))[
            t.active if active else slice(None)
        ]
        for t in trials
    ]
    return max(float(np.quantile(np.concatenate(needed), LEVEL)), 0.0)


def of_trials(trials: Sequence[Trial]) -> pd.DataFrame:
    """Coverage of every trial and of all, by class of estimate."""
    rows: list[dict] = []
    names = [f"estimate {a:g} to {b:g}" for a, b in zip(CLASSES[:-2], CLASSES[1:-1], strict=True)]
    names.append(f"estimate above {CLASSES[-2]:g}")
    every = Trial("all", *(np.concatenate([getattr(t, k) for t in trials]) for k in
                           ("estimate", "low", "high", "truth")))  # fmt: skip
    for trial in (*trials, every):
        inside, of = trial.inside(), np.digitize(trial.estimate, CLASSES[1:-1])
        row = {"trial": trial.name, "all": inside.mean()}
        row |= {name: inside[of == k].mean() for k, name in enumerate(names) if (of == k).any()}
        row |= {
            f"truth above {ACTIVE:g}": inside[trial.active].mean(),
            "truth below the interval": (trial.truth < trial.low).mean(),
            f"share above {ACTIVE:g}": trial.active.mean(),
        }
        rows.append(row)
    return pd.DataFrame(rows)


def of_factors(trials: Sequence[Trial]) -> pd.DataFrame:
    """Coverage in trials that are left out, with factors from others."""
    same: dict[str, Callable[[Trial, Trial], bool]] = {
        "other volunteers": lambda a, b: a.name[:3] != b.name[:3],
        "other trials of the person": lambda a, b: a.name[:3] == b.name[:3] and a is not b,
    }
    rows = []
    for label, chosen in same.items():
        for active in (False, True):
            kept = [(t, [o for o in trials if chosen(t, o)]) for t in trials]
            used = [(t, factor(others, active)) for t, others in kept if others]
            if not used:
                continue
            cover = np.array([t.inside(f).mean() for t, f in used])
            rows.append(
                {
                    "factor from": label + (", active samples" if active else ""),
                    "factor": np.mean([f for _, f in used]),
                    "all": cover.mean(),
                    "lowest trial": cover.min(),
                    "highest": cover.max(),
                    f"truth above {ACTIVE:g}": np.mean(
                        [t.inside(f)[t.active].mean() for t, f in used]
                    ),
                }
            )
    return pd.DataFrame(rows)


def main(
    recordings: list[Path],
    results: Annotated[Path, typer.Option(help="Folder of `benchmarks inverse --results`.")],
    setting: Annotated[str, typer.Option(help="form:variant:weight")] = "trajectory:assisted",
) -> None:
    """Print both tables."""
    trials = [read(path, results, setting) for path in recordings]
    print(markdown(of_trials(trials), ".3f"), flush=True)
    print(markdown(of_factors(trials), ".3f"), flush=True)
