"""Computation of all stages of one trial, with failures as results."""

from typing import Any

import numpy as np
import xarray as xr

from analysis.trial import Origin, Trial
from emgface.face.numerical_error import largest_motion
from emgface.face.stability import stability_warning
from emgface.recordings.findings import findings_in
from emgface.recordings.repeated import headline
from emgface.run.store import Result
from emgface.run.tasks import EXPECTED, OF_THE_MACHINE
from emgface.study.stages import Laboratory, StoredFailure
from emgface.study.table import PlannedTrial


def run_trial(laboratory: Laboratory, trial: PlannedTrial, extent: Result | None = None) -> Trial:
    """Compute all stages of one trial: its scores, or the status and reason of its failure.

    `extent` is the range of the features if the normalisation is not that of the trial. Raises
    StoreError if results cannot be read or written.
    """
    labels, laboratory = (*trial.place, trial.strategy), laboratory.of(trial.place[0])
    recording, origin = trial.recording, origin_of(trial)
    if recording is None:
        return Trial(*labels, status="missing", reason="there is no recording of this trial")
    if recording.excluded:
        return Trial(*labels, status="excluded", reason=recording.excluded, origin=origin)
    if recording.error is not None:
        return Trial.failed(*labels, recording.error, origin=origin)
    known: dict[str, Any] = {}
    stages: list[Result] = []
    try:
        activation = laboratory.activation(recording, trial.strategy, extent)
        stages.append(activation)
        motion = laboratory.predicted(
            recording, trial.strategy, activation.dataset["activation"], trial.label, extent
        )
        stages.append(motion)
        attrs = motion.dataset.attrs
        known = {
            "sigma_max": float(attrs["sigma_max"]),
            "run_time": float(attrs["run_time_s"]),
            "steps": steps_of(motion.dataset),
            "numerical_error": float(attrs.get("numerical_error", np.nan)),
            "motion": largest_motion(motion.dataset),
            "reduced": float(attrs.get("reduced", np.nan)),
        }
        aligned = laboratory.aligned(recording, motion, trial.label)
        stages.append(aligned)
        scores = laboratory.scores(recording, aligned, motion, trial.label)
        stages.append(scores)
    except StoredFailure as failure:
        return Trial(
            *labels,
            status=f"failed:{failure.name}",
            reason=str(failure),
            sigma_max=failure.sigma_max,
            run_time=failure.run_time,
            origin=origin,
            **_provenance([*stages, failure.result]),
        )
    except OF_THE_MACHINE:
        raise
    except EXPECTED as error:
        return Trial.failed(*labels, error, origin=origin, **known, **_provenance(stages))
    remarks = (
        stability_warning(motion.dataset),
        scores.dataset.attrs.get("incisor_reason", ""),
        headline([*findings_in(activation.dataset), *findings_in(scores.dataset)]),
    )
    known["reason"] = "; ".join(filter(None, remarks))
    return Trial(*labels, scores=scores.dataset, origin=origin, **known, **_provenance(stages))


def origin_of(trial: PlannedTrial) -> Origin | None:
    """Origin of the recording of a trial, None without a recording."""
    if trial.recording is None:
        return None
    return "simulated" if trial.recording.origin == "simulated" else "measured"


def _provenance(stages: list[Result]) -> dict[str, Any]:
    """Date of the last of several results, and all their environments."""
    return {
        "computed": max((stage.computed for stage in stages), default=""),
        "environments": tuple(
            dict.fromkeys(stage.environment for stage in stages if stage.environment)
        ),
    }


def steps_of(motion: xr.Dataset) -> float:
    """Number of time steps of a motion, including rejected ones if they were counted."""
    if "steps" in motion:
        return float(np.nansum(motion["steps"].values))
    return float(motion.sizes["time"] - 1)
