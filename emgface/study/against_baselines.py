"""Scores of the trials of one volunteer and instruction against their baselines."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import xarray as xr

from analysis.baselines import BASELINE_VARIABLES, best_of, ceiling_of, mean_of, scored
from analysis.errors import AnalysisError
from analysis.individual import (
    Together,
    asymmetry,
    instants,
    together,
    within_instruction,
)
from analysis.registration import mean_motion
from emgface.face.measured import measured_during
from emgface.muscles import LIP_MARKERS
from emgface.study.motions import StoredMotion
from emgface.study.stages import Laboratory
from emgface.study.table import Recording

Person = tuple[str, str]  #: volunteer and instruction


@dataclass(frozen=True)
class Recorded:
    """One recorded trial with its simulated motions by strategy."""

    recording: Recording
    motions: dict[str, StoredMotion]

    @property
    def first(self) -> StoredMotion:
        """Motion of the first strategy."""
        return next(iter(self.motions.values()))

    @cached_property
    def measured(self) -> xr.Dataset:
        """Measured lip positions during the simulation."""
        laboratory = self.first.laboratory.for_volunteer(self.recording.place[0])
        head = laboratory.study.signals.head_frame
        return measured_during(self.recording.dataset, self.first.dataset, laboratory.face, head)

    @property
    def pace(self) -> float:
        """Recorded time per simulated time [1]."""
        return float(self.first.dataset.attrs["recorded_pace"])

    def digests(self, label: str) -> dict[str, str]:
        """Digests of the recording and of its motions, by name."""
        by_name = {f"recording {label}": self.recording.digest}
        return by_name | {f"motion {label} {s}": m.digest for s, m in self.motions.items()}


def compared(
    laboratory: Laboratory,
    person: Person,
    recorded: Mapping[int, Recorded],
    others: Sequence[xr.Dataset],
    driven: Mapping[str, Sequence[xr.Dataset]],
    elsewhere: Mapping[str, Mapping[int, Recorded]],
) -> xr.Dataset:
    """Score every trial of one volunteer and instruction against its baselines.

    `others` are the typical measured motions of the other volunteers, and `driven` their typical
    simulated motions by strategy.
    """
    alignment, form = laboratory.alignment, laboratory.study.score.form
    least, count = laboratory.study.score.smallest_motion, len(LIP_MARKERS)
    result = _empty(person, list(recorded), list(laboratory.study.strategy_names))
    template = None
    # Without other volunteers there is no template; the other measures are computed.
    with suppress(AnalysisError):
        template = mean_motion([other["position"] for other in others], alignment)
        template = template.sel(marker=list(LIP_MARKERS))
        result["template_volunteers"][...] = template.attrs["contributors"]
        result["template_asymmetry"][...] = asymmetry(template, smallest_motion=least)

    without_own: dict[str, xr.DataArray] = {}
    for strategy, typical in driven.items():
        with suppress(AnalysisError):
            without_own[strategy] = mean_motion([t["position"] for t in typical], alignment)

    def against(one: Recorded, predicted: xr.Dataset | xr.DataArray) -> np.ndarray:
        return scored(one.measured, predicted.sel(marker=list(LIP_MARKERS)), alignment, form)[0]

    for repetition, one in recorded.items():
        at: dict[str, Any] = {"repetition": repetition}
        own = np.multiply(instants(one.measured, smallest_motion=least), one.pace)
        result["asymmetry_measured"].loc[at] = asymmetry(one.measured, smallest_motion=least)
        if template is not None:
            rho, ratio = scored(one.measured, template, alignment, form)
            result["template_rho"].loc[at] = rho
            result["template_amplitude_ratio"].loc[at] = ratio
            for k, name in enumerate(("onset", "peak")):
                mean = mean_of([np.array([float(other[name])]) for other in others], 1)[0]
                result[f"template_{name}_error"].loc[at] = mean - own[k]
        again = [against(one, other.measured) for r, other in recorded.items() if r != repetition]
        result["repeat_rho"].loc[at] = mean_of(again, count)
        result["ceiling"].loc[at] = ceiling_of(mean_of(again, count))
        for strategy, motion in one.motions.items():
            here = at | {"strategy": strategy}
            moved = motion.dataset
            onset, peak = np.multiply(instants(moved, smallest_motion=least), one.pace) - own
            result["onset_error"].loc[here], result["peak_error"].loc[here] = onset, peak
            result["asymmetry_simulated"].loc[here] = asymmetry(moved, smallest_motion=least)
            shuffled = [
                against(one, other.motions[strategy].dataset)
                for r, other in recorded.items()
                if r != repetition and strategy in other.motions
            ]
            wrong = [
                against(one, trials[repetition].motions[strategy].dataset)
                for trials in elsewhere.values()
                if repetition in trials and strategy in trials[repetition].motions
            ]
            if strategy in without_own:
                result["others_rho"].loc[here] = against(one, without_own[strategy])
            result["shuffled_rho"].loc[here] = mean_of(shuffled, count)
            result["wrong_rho"].loc[here] = mean_of(wrong, count)
            result["wrong_rho_max"].loc[here] = best_of(wrong, count)
    known: dict[tuple[int, ...], Together] = {}
    for strategy in laboratory.study.strategy_names:
        repetitions = tuple(r for r, one in recorded.items() if strategy in one.motions)
        both = [recorded[r] for r in repetitions]
        if len(both) > 1:
            with suppress(AnalysisError):  # of motions that cannot be aligned, which have no mean
                if repetitions not in known:
                    known[repetitions] = together([one.measured for one in both], alignment)
            result["within_rho"].loc[{"strategy": strategy}] = (
                within_instruction(
                    [one.measured for one in both],
                    [one.motions[strategy].dataset for one in both],
                    alignment,
                    known=known.get(repetitions),
                )
                .sel(marker=list(LIP_MARKERS))
                .values
            )
    return result.assign_attrs(volunteer=person[0], instruction=person[1])


def _empty(person: Person, repetitions: list[int], strategies: list[str]) -> xr.Dataset:
    """Undefined values of one volunteer and instruction."""
    coords: dict[str, Any] = {
        "volunteer": [person[0]], "instruction": [person[1]], "repetition": repetitions,
        "strategy": strategies, "marker": list(LIP_MARKERS),
    }  # fmt: skip
    return xr.Dataset(
        {
            name: (dims, np.full([len(coords[dim]) for dim in dims], np.nan))
            for name, (dims, _, _) in BASELINE_VARIABLES.items()
            if name != "skill"
        },
        coords=coords,
    )
