"""Reasons for computing a trial again, and comparison of stored results with computed ones."""

import json
import random
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import xarray as xr

from analysis.cube import OF_INCISOR, OF_NOISE, PER_MARKER, PER_TRIAL, TRIAL_DIMS, build_cube
from analysis.trial import Trial
from emgface.errors import DataError
from emgface.files import result_file
from emgface.run.journal import Entry, StoredFiles
from emgface.run.lines import Line, journal_files, lines
from emgface.run.store import Result, Stage, Store, damage_of
from emgface.schema.netcdf import read_netcdf
from emgface.study.configuration import Label, StudyConfiguration
from emgface.study.file import variants
from emgface.study.intake import Intake, take_in
from emgface.study.run import feature_extents
from emgface.study.stages import Laboratory, run_trial
from emgface.study.table import PlannedTrial, plan_trials

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
    for path in journal_files(folder):
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
    planned: list[Planned] = []
    for variant in variants(study):
        volunteers = [trial.place[0] for trial in trials]
        laboratory = Laboratory.of_study(store, variant.study, store.report, volunteers)
        extents = feature_extents(laboratory, Intake(intake.recordings, {}))
        for trial in chosen:
            label = f"{variant.label}: {trial.label}" if variant.label else trial.label
            line = last.get((variant.label, trial.label))
            extent = extents.get(trial.place[0])
            labels = dict(zip((axis.dim for axis in study.axis), variant.labels, strict=True))
            planned.append(Planned(label, variant.label, laboratory, trial, extent, line, labels))
    return planned


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
        entry = Entry.from_line(Path(), 0, last)
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
    changes: list[str] = []
    for name in sorted(old.keys() | new.keys()):
        a, b = old.get(name), new.get(name)
        if a == b:
            continue
        here = f"{path}.{name}" if path else name
        if isinstance(a, Mapping) and isinstance(b, Mapping):
            changes += differences(a, b, here)
        elif here == "code.version":
            changes.append("the source code of its modules changed")
        elif here == "code.modules":
            changes.append("it depends on other modules")
        elif here.startswith("inputs."):
            changes.append(f"its input {name} changed")
        else:
            changes.append(f"{here.removeprefix('parameters.')} changed from {a!r} to {b!r}")
    return changes


MEASURED_TIMES: Final = ("run_time", "run_time_s")
"""Variables and attributes with measured computing times, which differ between runs."""


@dataclass(frozen=True)
class ComparedTrial:
    """Comparison of one trial: label, number of equal results, and one sentence per difference."""

    label: str
    equal: int
    differences: list[str]


def reproduce(
    study: StudyConfiguration,
    folder: Path,
    store: Path,
    *,
    count: int | None = 3,
    seed: int = 0,
    wanted: Sequence[str] = (),
    report: Callable[[str], None] = print,
) -> list[ComparedTrial]:
    """Compute trials again in an empty store and compare all results with the stored ones.

    `count` trials are drawn with `seed`, or all of them if it is None. Results are equal if names,
    dims, values and attributes are, except measured computing times. Status and scores are also
    compared with the cube in `folder`, if there is one. Raises DataError if no trial of the study has
    been computed, or the cube cannot be read.
    """
    path = folder / "cube.nc"
    cube = read_netcdf(path, "cube") if path.is_file() else None
    with tempfile.TemporaryDirectory(prefix="emgface-reproduce-") as place:
        fresh = Store(Path(place), report=report)
        planned = [
            one
            for one in planned_trials(study, folder, fresh, wanted)
            if one.last is not None and one.last["stages"]
        ]
        if not planned:
            raise DataError(f"{folder} has no computed trial, expected some: run the study first")
        if count is not None and count < len(planned):
            planned = random.Random(seed).sample(planned, count)
        return [_compared(one, fresh, store, cube) for one in planned]


def _compared(one: Planned, fresh: Store, store: Path, cube: xr.Dataset | None) -> ComparedTrial:
    assert one.last is not None, "only computed trials are compared"
    laboratory, last = one.laboratory, one.last
    if last["key"] != one.key and last["sigma_max"] is not None:
        # Another trial of the volunteer required a lower sigma_max.
        laboratory = laboratory.lowered(last["sigma_max"])
    before = len(fresh.events)
    trial = run_trial(laboratory, one.trial, one.extent)
    made = [event for event in fresh.events[before:] if event.stage != "rest"]
    stages = [stage for stage in last["stages"] if stage["stage"] != "rest"]
    equal, changes = 0, list[str]()
    for event in made:
        stage = next((s for s in stages if s["stage"] == event.stage), None)
        if stage is not None:
            stages.remove(stage)
        # a run that found a result did not open those from which it follows
        digest = event.digest if stage is None else stage["digest"]
        path = result_file(store, event.stage, digest)
        if not path.is_file():
            if stage is not None:
                changes.append(f"{event.stage}: the stored result {path.name} is missing")
            continue
        change = _change(
            content(path), content(result_file(fresh.folder, event.stage, event.digest))
        )
        if change:
            changes.append(f"{event.stage}: {change}")
        else:
            equal += 1
    changes += [f"{stage['stage']}: it was not computed again" for stage in stages]
    change = "" if cube is None else _change_of_cell(cube, trial, one.labels)
    return ComparedTrial(one.label, equal, [*changes, f"cube: {change}"] if change else changes)


def _change_of_cell(cube: xr.Dataset, trial: Trial, labels: Mapping[str, Label]) -> str:
    """First difference of the status and scores of a trial in a cube, empty if they are equal."""
    of_head = "incisor_rho" in cube
    made = build_cube([trial], markers=cube["marker"].values.tolist(), incisor=of_head)
    place = {**labels, **{dim: getattr(trial, dim) for dim in TRIAL_DIMS}}
    try:
        cell = cube.sel(place)
    except KeyError:
        return "it does not contain the trial"
    for name in ("status", *PER_MARKER, *OF_NOISE, *PER_TRIAL, *OF_INCISOR):
        if name in MEASURED_TIMES or name not in cell:
            continue
        a, b = cell[name].values, made[name].values[0, 0, 0, 0]
        if a.dtype.kind != "f":
            if a != b:
                return f"{name} is {a}, computed again {b}"
        elif not np.array_equal(a, b, equal_nan=True):
            largest = float(np.nanmax(np.abs(a - b), initial=0.0))
            return f"{name} differs by up to {largest:.3g} {made[name].attrs.get('units', '')}"
    return ""


def content(path: Path) -> xr.Dataset:
    """Stored dataset without measured times."""
    dataset = xr.load_dataset(path, decode_times=False)
    dataset = dataset.drop_vars([name for name in MEASURED_TIMES if name in dataset])
    dataset.attrs = {k: v for k, v in dataset.attrs.items() if k not in MEASURED_TIMES}
    return dataset


def _change(stored: xr.Dataset, computed: xr.Dataset) -> str:
    """First difference of two datasets, empty if they are equal bit for bit."""
    for name in sorted({*stored.variables, *computed.variables}, key=str):
        if name not in stored.variables or name not in computed.variables:
            return f"only one result contains {name}"
        a, b = stored[name].values, computed[name].values
        if a.shape != b.shape or a.dtype != b.dtype:
            return f"{name} has another shape or type"
        if a.dtype.kind in "fiu":
            if a.tobytes() != b.tobytes():
                largest = float(np.nanmax(np.abs(a.astype(float) - b), initial=0.0))
                return (
                    f"{name} differs by up to {largest:.3g} {stored[name].attrs.get('units', '')}"
                )
        elif not np.array_equal(a, b):
            return f"{name} differs"
    if not stored.identical(computed):
        return "attributes differ"
    return ""
