"""Stages of the trials of a study, and the computation of one trial, with failures as results."""

import time
from functools import cached_property
from typing import Any

import numpy as np
import xarray as xr

from analysis.align import align
from analysis.scores import score
from analysis.trial import Origin, Trial
from emgface.anatomy.head.incisor import with_incisor
from emgface.face.measured import measured_during
from emgface.face.numerical_error import largest_motion
from emgface.face.sigma_max import lower_sigma_max
from emgface.face.simulation_parameters import SimulationParameters
from emgface.face.stability import stability_warning
from emgface.inverse.configuration import VARIANT
from emgface.recordings.findings import findings_in
from emgface.recordings.repeated import for_scores, headline, stored_with
from emgface.run.digest import (
    canonical_json,
    code_version,
    text_digest,
)
from emgface.run.store import Result
from emgface.run.tasks import JOB_ERRORS, OF_THE_MACHINE
from emgface.study.activations import ByMarkers, activation_digest, activation_from_emg
from emgface.study.laboratory import Setup
from emgface.study.skin import SKIN_STAGE, SkinMotions
from emgface.study.stage_code import (
    ACTIVATION_OF_HEAD,
    ALIGNED,
    MOTION,
    MOTION_OF_HEAD,
    SCORES,
    SCORES_OF_HEAD,
    STAGES,
)
from emgface.study.table import PlannedTrial, Recording
from sim.errors import SimulationError


class StoredFailure(Exception):
    """A stored failure of a simulation with the same inputs, code and parameters.

    `name` is the name of the error, `sigma_max` the last value tried [Pa], `run_time` the time of
    all attempts [s], and `result` the stored variables.
    """

    def __init__(
        self, name: str, reason: str, sigma_max: float, run_time: float, result: Result
    ) -> None:
        self.name, self.sigma_max, self.run_time = name, sigma_max, run_time
        self.result = result
        super().__init__(reason)


class Laboratory(Setup):
    """Stages of the trials of a study with one setup, each computed once and stored."""

    @cached_property
    def skin(self) -> SkinMotions:
        """Simulations that store the motion of the skin."""
        return SkinMotions(self)

    @cached_property
    def by_markers(self) -> ByMarkers:
        """Activations that follow the markers."""
        return ByMarkers(self, self.motion)

    def skin_motion(self, activation: xr.DataArray, sigma_max: float, label: str) -> Result:
        """Return the motion of the skin in a trial (`SkinMotions.motion`)."""
        return self.skin.motion(activation, sigma_max, activation_digest(activation), label)

    def trial_key(self, trial: PlannedTrial, extent: Result | None) -> str:
        """Digest of everything that the outcome of a trial depends on; empty if it has no inputs."""
        recording = trial.recording
        if recording is None or recording.error is not None or recording.excluded:
            return ""
        by_markers = self.by_markers.digest if trial.strategy in VARIANT else ""
        moved = self.for_volunteer(trial.place[0]).moved
        return text_digest(
            f"{recording.digest} {trial.strategy} {extent.digest if extent else ''} "
            f"{canonical_json(moved)} {self._study_digest}{by_markers}"
        )

    @cached_property
    def _study_digest(self) -> str:
        """Digest of the parameters and of the code of a trial."""
        tables = {"activation_source", "signals", "simulation", "alignment", "score"}
        of_head = (
            ()
            if self.study.face.head is None
            else (MOTION_OF_HEAD, ACTIVATION_OF_HEAD, SCORES_OF_HEAD)
        )
        modules = {name for stage in (*STAGES, SKIN_STAGE, *of_head) for name in stage.reached}
        chosen = self.study.model_dump(mode="json", include=tables)
        here = (__name__, "emgface.study.activations", "emgface.study.laboratory")
        code = code_version((*sorted(modules), *here))
        return text_digest(f"{canonical_json(chosen)} {code}")

    def activation(
        self, recording: Recording, strategy: str, extent: Result | None = None
    ) -> Result:
        """Return the activation of all muscles during a recording, with a strategy.

        Raises errors as `emgface.signals.activation.activation_of`, or `emgface.inverse.run.invert`.
        """
        if strategy in VARIANT:
            return self.by_markers.activation(recording, strategy, extent)
        return activation_from_emg(self, recording, strategy, extent)

    def predicted(
        self,
        recording: Recording,
        strategy: str,
        activation: xr.DataArray,
        label: str,
        extent: Result | None = None,
        sigma_max: float | None = None,
    ) -> Result:
        """Return the motion of a trial in which no marker is predicted from itself.

        It is `motion`, except for the strategies that follow the markers (`ByMarkers.predicted`).
        Raises as `motion`.
        """
        if strategy not in VARIANT:
            return self.motion(activation, label, sigma_max)
        return self.by_markers.predicted(recording, strategy, label, extent, sigma_max)

    def motion(
        self, activation: xr.DataArray, label: str, sigma_max: float | None = None
    ) -> Result:
        """Return the motion of the lip markers, with a value of sigma_max that can be simulated.

        A failure is stored also, because it would recur and its computation may take long.
        `sigma_max` [Pa] is specified for a trial whose value was lowered to that of another trial
        of the volunteer. Raises StoredFailure if no value of sigma_max down to its minimum can be
        simulated.
        """
        calibrated = self.study.simulation.sigma_max_policy.calibration != "none"
        if sigma_max is not None and calibrated:
            return self.lowered(sigma_max).motion(activation, label)
        result = self.store.get_or_compute(
            MOTION if self.head_of(activation) is None else MOTION_OF_HEAD,
            {**self.moved, "activation": activation_digest(activation)},
            self.study.simulation.model_dump(mode="json"),
            lambda: self._move(activation, label),
            label=label,
        )
        attrs = result.dataset.attrs
        if sigma_max is not None and attrs["sigma_max"] != sigma_max:
            return self.lowered(sigma_max).motion(activation, label)
        if "failure" in attrs:
            raise StoredFailure(
                attrs["failure"], attrs["reason"], attrs["sigma_max"], attrs["run_time_s"], result
            )
        return result

    def _move(self, activation: xr.DataArray, label: str) -> xr.Dataset:
        tried: list[float] = []
        started = time.perf_counter()

        def once(parameters: SimulationParameters) -> xr.Dataset:
            tried.append(parameters.sigma_max)
            digest = activation_digest(activation)
            return self.skin.simulate(activation, parameters, digest, label)

        try:
            return lower_sigma_max(once, self.study.simulation, report=self.report)
        except SimulationError as error:
            reason = " ".join([str(error), *getattr(error, "__notes__", [])])
            return xr.Dataset(
                attrs={
                    "failure": type(error).__name__,
                    "reason": reason,
                    "sigma_max": tried[-1],
                    "run_time_s": time.perf_counter() - started,
                    "origin": "simulated",
                }
            )

    def aligned(self, recording: Recording, motion: Result, label: str) -> Result:
        """Return the measured lip positions on the time base of the simulation."""
        choices = self.study.alignment
        head = self.study.signals.head_frame
        return self.store.get_or_compute(
            ALIGNED,
            {"recording": recording.digest, "motion": motion.digest, "face": self.face_digest},
            {
                "alignment": choices.model_dump(mode="json"),
                "head_frame": head.model_dump(mode="json"),
                **self.limits,
            },
            lambda: align(
                measured_during(recording.dataset, motion.dataset, self.face, head),
                motion.dataset,
                **self.alignment,
            ),
            label=label,
        )

    def scores(self, recording: Recording, aligned: Result, motion: Result, label: str) -> Result:
        """Return the scores of a trial; if a head moved, with that of the lower incisor."""
        choices, frame = self.study.score.model_dump, self.study.signals.head_frame
        of_head = "incisor" in motion.dataset

        def scored() -> xr.Dataset:
            scores = score(aligned.dataset, motion.dataset, **choices())
            scores = stored_with(scores, for_scores(recording.dataset))
            if not of_head:
                return scores
            return with_incisor(scores, recording.dataset, motion.dataset, self.face, frame)

        return self.store.get_or_compute(
            SCORES_OF_HEAD if of_head else SCORES,
            {"aligned": aligned.digest, "motion": motion.digest},
            choices(mode="json"),
            scored,
            label=label,
        )


def run_trial(laboratory: Laboratory, trial: PlannedTrial, extent: Result | None = None) -> Trial:
    """Compute all stages of one trial: its scores, or the status and reason of its failure.

    `extent` is the range of the features if the normalisation is not that of the trial. Raises
    StoreError if results cannot be read or written.
    """
    if trial.sigma_max is not None:
        laboratory = laboratory.lowered(trial.sigma_max)
    labels, laboratory = (*trial.place, trial.strategy), laboratory.for_volunteer(trial.place[0])
    recording, origin = trial.recording, origin_of_trial(trial)
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
            "steps": steps_of_motion(motion.dataset),
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
    except JOB_ERRORS as error:
        return Trial.failed(*labels, error, origin=origin, **known, **_provenance(stages))
    remarks = (
        stability_warning(motion.dataset),
        scores.dataset.attrs.get("incisor_reason", ""),
        headline([*findings_in(activation.dataset), *findings_in(scores.dataset)]),
    )
    known["reason"] = "; ".join(filter(None, remarks))
    return Trial(*labels, scores=scores.dataset, origin=origin, **known, **_provenance(stages))


def origin_of_trial(trial: PlannedTrial) -> Origin | None:
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


def steps_of_motion(motion: xr.Dataset) -> float:
    """Number of time steps of a motion, including rejected ones if they were counted."""
    if "steps" in motion:
        return float(np.nansum(motion["steps"].values))
    return float(motion.sizes["time"] - 1)
