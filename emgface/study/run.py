"""Execution of a study, from configuration to cube, with resumption."""

import json
import time
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np
import xarray as xr

from analysis.axes import combine_cubes, reference_cube
from analysis.cube import build_cube
from analysis.trial import Origin, Trial
from emgface.errors import EmgfaceError
from emgface.muscles import LIP_MARKERS
from emgface.schema.netcdf import write_netcdf
from emgface.study.axes import Label
from emgface.study.baselines import add_baselines
from emgface.study.configuration import StudyConfiguration
from emgface.study.description import described, merged_environments, montages, with_recordings
from emgface.study.digest import dataset_digest
from emgface.study.faces import study_face
from emgface.study.formants import add_formants
from emgface.study.observer import Observer, Silent
from emgface.study.one_trial import run_trial
from emgface.study.stages import Laboratory
from emgface.study.store import Event, Result, Store, write_text
from emgface.study.table import Intake, PlannedTrial, plan_trials, take_in, take_in_references
from emgface.study.variants import variants
from emgface.study.workers import in_parallel
from sim.described import Described
from sim.threads import one_blas_thread


@dataclass(frozen=True, repr=False)
class StudyResult(Described):
    """Results of a study.

    Attributes
    ----------
    cube : Dataset
        Scores and status of every trial.
    path : Path
        File of the cube.
    events : list of Event
        Computed and reused results, in order.
    unreadable : dict of Path to EmgfaceError
        Files of the recordings' folder whose trial could not be identified.
    """

    cube: xr.Dataset
    path: Path
    events: list[Event]
    unreadable: dict[Path, EmgfaceError] = field(default_factory=dict)

    def facts(self) -> dict[str, str]:
        """Design, status of the trials and median rho of every strategy."""
        cube = reference_cube(self.cube)
        design = ", ".join(f"{n} {dim}" for dim, n in self.cube.sizes.items())
        status, counts = np.unique(cube["status"].values, return_counts=True)
        rho = cube["rho"].median([dim for dim in cube["rho"].dims if dim != "strategy"])
        medians = (f"{s} {float(rho.sel(strategy=s)):.2f}" for s in cube["strategy"].values)
        return {
            "recordings": " ".join(
                str(cube.attrs[key]) for key in ("origin", "world") if key in cube.attrs
            ),
            "design": design,
            "trials": ", ".join(f"{n} {s}" for s, n in zip(status, counts, strict=True)),
            "median rho": ", ".join(medians),
            "cube": "/".join(self.path.parts[-2:]),
            "computed": f"{len(self.computed())} of {len(self.events)} results",
        }

    def computed(self) -> list[Event]:
        """Return the events of results that were absent or damaged in the store."""
        return [event for event in self.events if event.outcome != "reused"]


@one_blas_thread
def run_study(
    study: StudyConfiguration,
    out: Path,
    *,
    workers: int = 1,
    observer: Observer | None = None,
    store: Path | None = None,
) -> StudyResult:
    """Run a study, computing only results that are not stored.

    The folder `out` receives ``cube.nc``, ``times.jsonl`` and the stages under ``store``, or in the
    folder `store`, which several studies may share; the results do not depend on the number of
    processes, `workers`; `observer` receives messages and progress. A failure of one trial is
    recorded with its status and reason in the cube. After an
    interruption (KeyboardInterrupt), completed results remain stored. Raises DataError if no
    recording can be used or the face is not valid, and StoreError if results cannot be written.
    """
    observer = observer or Silent()
    intake = take_in(study.recordings, study.exclude)
    for error in intake.unreadable.values():
        observer.message(f"Omitted: {error}")
    for exclusion in study.exclude:
        if not any(exclusion.covers(recording.place) for recording in intake.recordings):
            observer.message(f"The exclusion of {exclusion.label} matches no recording.")
    trials = plan_trials(intake.recordings, study.strategy_names)
    made = variants(study)
    observer.begin(len(trials) * len(made))
    kept = Store(store or out / "store", report=observer.message)
    cubes: dict[tuple[Label, ...], xr.Dataset] = {}
    reference: Laboratory | None = None
    muted: set[str] = set()
    try:
        for variant in made:
            laboratory = Laboratory(
                kept, study_face(variant.study.face), variant.study, observer.message
            )
            reference = reference or laboratory
            told = f"{variant.label}: " if variant.labels else ""
            extents = feature_extents(laboratory, intake)
            results = _run_trials(laboratory, trials, extents, workers, observer, told)
            cube = _cube(laboratory, intake, trials, results)
            cube = add_baselines(laboratory, cube, trials, results, extents, observer)
            cubes[variant.labels] = add_formants(
                laboratory, cube, trials, results, extents, observer
            )
            muted |= laboratory.muted
    finally:
        _log_times(out / "times.jsonl", kept.events)
    if muted:
        observer.message(
            f"In {len(muted)} of {len(intake.recordings)} recordings the feature of at least "
            "one muscle is zero or saturated throughout; it is listed in the attribute "
            f"'warnings' of the results in {kept.folder / 'activation'} ."
        )
    assert reference is not None, "a study has at least one variant"
    cube = described(
        _combined(study, cubes) if study.axis else cubes[made[0].labels],
        name=study.name,
        face={
            "name": str(reference.face.attrs["name"]),
            "origin": str(reference.face.attrs["origin"]),
            "digest": reference.face_digest,
        },
        configuration=study.model_dump_json(),
        environments=merged_environments(cubes.values()),
        montage=montages(intake.recordings, study.signals.montage),
    )
    path = write_netcdf(cube, out / "cube.nc", "cube")
    return StudyResult(cube, path, kept.events, dict(intake.unreadable))


def _combined(study: StudyConfiguration, cubes: dict[tuple[Label, ...], xr.Dataset]) -> xr.Dataset:
    """Combine the cubes of all variants along the axes of a study."""
    cube = combine_cubes(cubes, {axis.dim: axis.labels() for axis in study.axis})
    for axis in study.axis:
        numeric = cube[axis.dim].dtype.kind == "f"
        cube[axis.dim].attrs = {"units": "1"} if numeric else {}
        cube[axis.dim].attrs["parameters"] = ", ".join(axis.parameters)
    return cube


def _run_trials(
    laboratory: Laboratory,
    trials: list[PlannedTrial],
    extents: dict[str, Result],
    workers: int,
    observer: Observer,
    told: str,
) -> list[Trial]:
    """Compute all trials, with one sigma_max per volunteer if requested."""
    results = _through_stages(laboratory, trials, extents, workers, observer, told)
    if laboratory.study.simulation.sigma_max_policy.scope == "trial":
        return results
    done = {(r.volunteer, r.instruction, r.repetition, r.strategy): r for r in results}
    while again := sigma_max_to_share(done.values()):
        for volunteer, lowest in again.items():
            observer.message(
                f"{told}{volunteer}: a trial required sigma_max = {lowest / 1e3:.4g} kPa, which holds "
                "for all trials of the volunteer; trials with a higher value are simulated again"
            )
            higher = [
                trial
                for trial in trials
                if trial.place[0] == volunteer
                and done[*trial.place, trial.strategy].sigma_max > lowest
            ]
            lowered = laboratory.lowered(lowest)
            redone = _through_stages(lowered, higher, extents, workers, Silent(), told)
            done |= {(r.volunteer, r.instruction, r.repetition, r.strategy): r for r in redone}
            laboratory.muted |= lowered.muted
    return list(done.values())


def sigma_max_to_share(results: Iterable[Trial]) -> dict[str, float]:
    """Volunteers whose trials differ in sigma_max, and the smallest value of each [Pa].

    Trials that failed with every value are ignored, because theirs is the minimum of the policy.
    """
    used: dict[str, set[float]] = {}
    for result in results:
        if result.scores is not None:
            used.setdefault(result.volunteer, set()).add(result.sigma_max)
    return {volunteer: min(values) for volunteer, values in used.items() if len(values) > 1}


def _through_stages(
    laboratory: Laboratory,
    trials: list[PlannedTrial],
    extents: dict[str, Result],
    workers: int,
    observer: Observer,
    told: str,
) -> list[Trial]:
    results: list[Trial] = []
    if workers == 1:
        for trial in trials:
            observer.working(told + trial.label)
            outcome = run_trial(laboratory, trial, extents.get(trial.place[0]))
            results.append(outcome)
            observer.finished(told + trial.label, outcome.status)
        return results
    for trial, done in in_parallel(laboratory, trials, extents, workers):
        results.append(done.outcome)
        laboratory.store.events.extend(done.events)
        laboratory.muted |= done.muted
        for text in done.messages:
            observer.message(text)
        observer.finished(told + trial.label, done.outcome.status)
    return results


def _cube(
    laboratory: Laboratory, intake: Intake, trials: list[PlannedTrial], results: list[Trial]
) -> xr.Dataset:
    """Collect the results under one configuration."""
    cube = build_cube(
        results,
        volunteers=list(dict.fromkeys(t.place[0] for t in trials)),
        instructions=list(dict.fromkeys(t.place[1] for t in trials)),
        repetitions=sorted({t.place[2] for t in trials}),
        strategies=list(laboratory.study.strategy_names),
        markers=list(LIP_MARKERS),
        origin=_origin(intake),
    )
    cube = with_recordings(cube, intake.recordings)
    return cube.assign_attrs({"world": intake.world} if intake.world else {})


def feature_extents(laboratory: Laboratory, intake: Intake) -> dict[str, Result]:
    """Range of the features per volunteer, if Eq. 8 does not use the range of the trial."""
    reach = laboratory.study.signals.normalisation.reach
    if reach == "trial" or laboratory.study.activation_source == "true":
        return {}
    volunteers = sorted({r.place[0] for r in intake.recordings if intake.of(r.place[0])})
    if reach == "session":
        return {
            volunteer: laboratory.extent(
                {r.digest: r.dataset for r in intake.of(volunteer)}, f"{volunteer}, session"
            )
            for volunteer in volunteers
        }

    references = take_in_references(laboratory.study.recordings)
    return {
        volunteer: laboratory.extent(
            {dataset_digest(r): r for r in references[volunteer]}, f"{volunteer}, reference"
        )
        for volunteer in volunteers
        if volunteer in references
    }


def _origin(intake: Intake) -> Origin:
    return "simulated" if intake.origin == "simulated" else "measured"


def _log_times(path: Path, events: Iterable[Event]) -> None:
    """Add the results computed in this run to the log, one JSON object per line."""
    now = time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())
    lines = (
        json.dumps({"run_ended": now, **asdict(event), "seconds": round(event.seconds, 4)})
        for event in events
        if event.outcome != "reused"
    )
    old = path.read_text() if path.exists() else ""
    write_text(old + "".join(f"{line}\n" for line in lines), path)
