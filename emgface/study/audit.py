"""Reasons for computing a trial again."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import xarray as xr

from emgface.errors import DataError
from emgface.files import result_file
from emgface.run.journal import Entry, StoredFiles
from emgface.run.lines import Line, lines, run_files
from emgface.run.store import Result, Stage, Store, damage_of
from emgface.study.axes import Label
from emgface.study.configuration import StudyConfiguration
from emgface.study.intake import Intake, take_in
from emgface.study.one_trial import run_trial
from emgface.study.run import feature_extents
from emgface.study.stages import Laboratory
from emgface.study.table import PlannedTrial, plan_trials
from emgface.study.variants import variants

Find = Callable[[PlannedTrial, str], Line | None]


class _Absent(Exception):
    """A result that would be computed, and its key."""

    def __init__(self, stage: Stage, key: Mapping[str, Any]) -> None:
        self.stage, self.key = stage, key
        super().__init__(stage.name)


class _ReadOnly(Store):
    """Store in which nothing is computed."""

    def get_or_compute(
        self,
        stage: Stage,
        inputs: Mapping[str, str],
        parameters: Mapping[str, Any],
        compute: Callable[[], xr.Dataset],
        *,
        label: str = "",
    ) -> Result:
        """Return a stored result; raises _Absent if it would be computed."""

        def refuse() -> xr.Dataset:
            raise _Absent(stage, self.key(stage, inputs, parameters))

        return super().get_or_compute(stage, inputs, parameters, refuse, label=label)


@dataclass(frozen=True)
class Planned:
    """One trial of a study: label, laboratory of its variant, plan, and its last line or None."""

    label: str
    variant: str
    laboratory: Laboratory
    trial: PlannedTrial
    extent: Result | None
    last: Line | None
    labels: Mapping[str, Label]  #: of the variant, by the dims of the cube

    @property
    def key(self) -> str:
        """Digest of everything that the outcome depends on."""
        return self.laboratory.trial_key(self.trial, self.extent)


def planned_trials(
    study: StudyConfiguration, folder: Path, store: Store, wanted: Sequence[str] = ()
) -> list[Planned]:
    """List the trials of a study whose label begins with `wanted`, all of them by default.

    Raises DataError if no trial has that label.
    """
    last: dict[tuple[str, str], Line] = {}
    for path in run_files(folder):
        for _, line in lines(path):
            if line["event"] == "trial":
                last[line["variant"], " ".join(map(str, line["trial"]))] = line
    intake = take_in(study.recordings, study.exclude, study=folder)
    trials = plan_trials(intake.recordings, study.strategy_names)
    text = " ".join(wanted)
    chosen = [trial for trial in trials if f"{trial.label} ".startswith(f"{text} " if text else "")]
    if not chosen:
        raise DataError(
            f"there is no trial {text!r}, expected volunteer, instruction, repetition and strategy, "
            f"such as {trials[0].label!r}"
        )
    found: list[Planned] = []
    for variant in variants(study):
        volunteers = [trial.place[0] for trial in trials]
        laboratory = Laboratory.of_study(store, variant.study, store.report, volunteers)
        extents = feature_extents(laboratory, Intake(intake.recordings, {}))
        for trial in chosen:
            label = f"{variant.label}: {trial.label}" if variant.label else trial.label
            line = last.get((variant.label, trial.label))
            extent = extents.get(trial.place[0])
            labels = dict(zip((axis.dim for axis in study.axis), variant.labels, strict=True))
            found.append(Planned(label, variant.label, laboratory, trial, extent, line, labels))
    return found


def explain(
    study: StudyConfiguration, folder: Path, store: Path, wanted: Sequence[str]
) -> list[str]:
    """Explain for each chosen trial why it would be computed, or why it would not.

    `folder` contains the journal of the study. One sentence per trial and variant. Raises DataError
    if there is no such trial.
    """
    kept = _ReadOnly(store, report=lambda text: None)
    files = StoredFiles(store)
    return [
        f"{one.label}: {_reason(one, kept, files)}"
        for one in planned_trials(study, folder, kept, wanted)
    ]


def _reason(one: Planned, store: Store, files: StoredFiles) -> str:
    if not one.key:
        recording = one.trial.recording
        why = (
            "there is no recording" if recording is None else recording.excluded or recording.error
        )
        return f"nothing is computed ({why})."
    last = one.last
    if last is not None and last["key"] == one.key:
        entry = Entry.of(Path(), 0, last)
        if not entry.final:
            return f"it failed with {last['status'].removeprefix('failed:')} and is tried again."
        if files.intact(entry):
            return (
                f"it is up to date ({last['status']}, computed {last['computed'] or last['time']})."
            )
    try:
        run_trial(one.laboratory, one.trial, one.extent)
    except _Absent as absent:
        stage = absent.stage.name
        before = next((s for s in (last or {}).get("stages", ()) if s["stage"] == stage), None)
        if before is None:
            return f"from stage {stage} on it is computed for the first time."
        index = result_file(store.folder, stage, before["digest"], ".json")
        try:
            old = json.loads(index.read_text(encoding="utf-8"))["key"]
        except (OSError, ValueError, KeyError):
            return f"it is computed again from stage {stage} on, whose stored result is missing."
        changed = differences(old, absent.key)
        if not changed:
            damage = damage_of(index.with_suffix(".nc"))
            return f"it is computed again from stage {stage} on: its result {damage or 'changed'}."
        return f"it is computed again from stage {stage} on: {'; '.join(changed)}."
    return "its stored results are valid; they are read again and nothing is computed."


def differences(old: Mapping[str, Any], new: Mapping[str, Any], path: str = "") -> list[str]:
    """Changes between two keys of results, one sentence part each."""
    found: list[str] = []
    for name in sorted(old.keys() | new.keys()):
        a, b = old.get(name), new.get(name)
        if a == b:
            continue
        here = f"{path}.{name}" if path else name
        if isinstance(a, Mapping) and isinstance(b, Mapping):
            found += differences(a, b, here)
        elif here == "code.version":
            found.append("the source code of its modules changed")
        elif here == "code.modules":
            found.append("it depends on other modules")
        elif here.startswith("inputs."):
            found.append(f"its input {name} changed")
        else:
            found.append(f"{here.removeprefix('parameters.')} changed from {a!r} to {b!r}")
    return found
