"""sigma_max of a volunteer, calibrated by the markers of repetitions other than the one scored.

For every training trial, face and volunteer are compared at the stresses s of `COMPARED_STRESSES`:
the median over the markers of the logarithm of the amplitude ratio, r(s). The calibrated value is
the s at which the median of r(s) over the training trials is 0, linear between the levels in ln s,
and otherwise the first or the last level. rho is not used, because it does not depend on the
amplitude.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np
import xarray as xr

from emgface.errors import ConfigurationError, DataError
from emgface.face.muscle_parameters import PUBLISHED_START
from emgface.plugins import plugins
from emgface.run.store import Result, Store
from emgface.run.tasks import JOB_ERRORS, OF_THE_MACHINE
from emgface.signals.parameters import STRATEGIES
from emgface.study.configuration import StudyConfiguration
from emgface.study.outcomes import StudyRun
from emgface.study.stages import Laboratory, StoredFailure
from emgface.study.table import PlannedTrial, Recording, load_recording, refuse_copies

COMPARED_STRESSES: Final = (50e3, 120e3, PUBLISHED_START)
"""Stresses at which motions are compared [Pa]; a calibrated value is between the first and the last."""

Job = tuple[Recording, str, Result | None]
"""Training trial, strategy, and range of the features of its volunteer, if required."""
Curve = tuple[float, ...]
"""Logarithm of the amplitude ratio at every level [1], NaN where the trial could not be compared."""


def curve_of(laboratory: Laboratory, job: Job) -> Curve:
    """Logarithm of the amplitude ratio of one training trial at every level.

    A level is NaN if the trial cannot be simulated or scored with it, or only with a lowered value.
    """
    recording, strategy, extent = job
    logs: list[float] = []
    for stress in COMPARED_STRESSES:
        at = laboratory.lowered(stress).for_volunteer(recording.place[0])
        try:
            activation = at.activation(recording, strategy, extent).dataset["activation"]
            label = f"{recording.label} {strategy}, {stress / 1e3:g} kPa"
            motion = at.motion(activation, label)
            aligned = at.aligned(recording, motion, label)
            scores = at.scores(recording, aligned, motion, label).dataset
        except OF_THE_MACHINE:
            raise
        except (StoredFailure, *JOB_ERRORS):
            logs.append(np.nan)
            continue
        ratio = scores["amplitude_ratio"].values
        ratio = ratio[np.isfinite(ratio) & (ratio > 0.0)]
        same = abs(float(motion.dataset.attrs["sigma_max"]) / stress - 1.0) < 1e-9
        logs.append(float(np.median(np.log(ratio))) if ratio.size and same else np.nan)
    return tuple(logs)


def stress_of(curves: Sequence[Curve]) -> float:
    """Stress [Pa] at which the median of the curves is 0, or the nearest level with a value.

    NaN if fewer than two levels have a value, or stronger muscles do not move the face farther.
    """
    values = np.array(curves, dtype=np.float64).reshape(-1, len(COMPARED_STRESSES))
    known = np.isfinite(values).any(axis=0)
    if known.sum() < 2:
        return np.nan
    log_stress = np.log(np.array(COMPARED_STRESSES)[known])
    middle = np.nanmedian(values[:, known], axis=0)
    if not middle[-1] > middle[0]:
        return np.nan
    middle = np.maximum.accumulate(middle)
    return float(np.exp(np.interp(0.0, middle, log_stress)))


def with_calibrated(
    run: StudyRun,
    laboratory: Laboratory,
    trials: Sequence[PlannedTrial],
    extents: Mapping[str, Result],
) -> list[PlannedTrial]:
    """Trials with the sigma_max of their volunteer, repetition and strategy.

    The curve of every trial is computed once by the workers of `run`, and the value of a repetition
    follows from the curves of the volunteer's other repetitions. Raises DataError if a repetition has
    no others.
    """
    usable = [
        t
        for t in trials
        if t.recording is not None and t.recording.error is None and not t.recording.excluded
    ]
    jobs: list[Job] = [
        (t.recording, t.strategy, extents.get(t.place[0]))
        for t in usable
        if t.recording is not None
    ]
    curves = run.computed(curve_of, laboratory, jobs, "calibration of sigma_max")
    chosen: dict[tuple[str, int, str], float] = {}
    for trial in usable:
        volunteer, _, repetition = trial.place
        key = (volunteer, repetition, trial.strategy)
        if key in chosen:
            continue
        training = [
            curve
            for other, curve in zip(usable, curves, strict=True)
            if other.place[0] == volunteer
            and other.place[2] != repetition
            and other.strategy == trial.strategy
        ]
        stress = stress_of(training)
        if np.isnan(stress):
            raise DataError(
                f"sigma_max of {volunteer}, repetition {repetition}, {trial.strategy} cannot be "
                f"calibrated: {len(training)} trials of other repetitions, expected some in which face "
                "and volunteer move farther with stronger muscles. Add repetitions, exclude the trial, "
                "or set simulation.sigma_max_policy.calibration = 'none'"
            )
        chosen[key] = stress
        run.observer.message(
            f"{volunteer}, repetition {repetition}, {trial.strategy}: sigma_max {stress / 1e3:.4g} kPa "
            f"from {len(training)} trials of other repetitions"
        )
    return [replace(t, sigma_max=chosen.get((t.place[0], t.place[2], t.strategy))) for t in trials]


def calibrated_for(
    trial: Mapping[Any, Any], training: Sequence[Path], face: xr.Dataset, study: StudyConfiguration
) -> float:
    """sigma_max [Pa] of one trial, calibrated by other recordings of its volunteer.

    `trial` are the attributes of its activation: volunteer, instruction, repetition and strategy.
    Raises ConfigurationError if these are absent, or the trial itself or another volunteer is among
    the recordings, and DataError if no value follows from them, or two contain the same samples.
    """
    names = ("volunteer", "instruction", "repetition", "strategy")
    if lacking := [name for name in names if name not in trial]:
        raise ConfigurationError(
            f"the activation does not state its {', '.join(lacking)}, expected that of a recording: "
            "simulate the recording, or set sigma_max"
        )
    place = (str(trial["volunteer"]), str(trial["instruction"]), int(trial["repetition"]))
    strategy = str(trial["strategy"])
    if strategy not in STRATEGIES and strategy not in plugins("strategy"):
        raise ConfigurationError(
            f"sigma_max cannot be calibrated for the strategy {strategy}, expected one of "
            f"{', '.join(STRATEGIES)}, which do not follow the markers"
        )
    recordings = [load_recording(path, study.recordings) for path in training]
    for one in recordings:
        if one.place == place:
            raise ConfigurationError(
                f"{one.path.name} is the trial that is simulated ({one.label}), expected other trials: "
                "a value from its own markers would anticipate its motion"
            )
        if one.place[0] != place[0]:
            raise ConfigurationError(
                f"{one.path.name} is of {one.place[0]}, expected recordings of {place[0]}"
            )
    refuse_copies(one.dataset for one in recordings)
    with TemporaryDirectory() as folder:
        at = Laboratory(Store(Path(folder)), face, study, lambda text: None)
        extent = None
        if study.signals.normalisation.reach != "trial":
            digests = [one.digest for one in recordings]
            extent = at.extent(digests, lambda: (one.dataset for one in recordings), place[0])
        stress = stress_of([curve_of(at, (one, strategy, extent)) for one in recordings])
    if np.isnan(stress):
        raise DataError(
            f"sigma_max of {place[0]} cannot be calibrated: face and volunteer cannot be compared in "
            f"{len(recordings)} recordings: add recordings with lip markers, or set sigma_max"
        )
    return stress
