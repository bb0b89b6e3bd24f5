"""Execution of a study, from configuration to cube, with resumption."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np
import xarray as xr

from analysis.axes import reference_cube
from emgface.errors import EmgfaceError
from emgface.run.digest import code_version, dataset_digest, text_digest
from emgface.run.journal import Entry, Journal, StoredFiles, events_of
from emgface.run.objects import Objects
from emgface.run.observer import Observer, Silent
from emgface.run.provenance import CODE
from emgface.run.runner import Workers
from emgface.run.store import Event, Result, Store
from emgface.schema.netcdf import read_netcdf
from emgface.study.assembly import Computed, write_cube
from emgface.study.baselines import compute_baselines
from emgface.study.calibrated import with_calibrated
from emgface.study.configuration import StudyConfiguration
from emgface.study.file import variants
from emgface.study.formants import compute_formants
from emgface.study.intake import Intake, take_in, take_in_references
from emgface.study.outcomes import Entries, StudyRun, compute_trials
from emgface.study.stages import Laboratory
from emgface.study.table import PlannedTrial, Recording, plan_trials
from sim.described import Described
from sim.threads import one_blas_thread


@dataclass(frozen=True, repr=False)
class StudyResult(Described):
    """Results of a study."""

    path: Path  #: file of the cube
    journal: Path  #: file of the events of this run
    #: outcome of every trial, also of those that were simulated again with a lower sigma_max
    entries: list[Entry]
    others: list[Event]  #: results of no single trial: rest states, ranges of features, baselines
    #: files of the recordings' folder whose trial could not be identified
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

    @cached_property
    def cube(self) -> xr.Dataset:
        """Scores and status of every trial, read from the file when they are first used."""
        return read_netcdf(self.path, "cube")

    @cached_property
    def events(self) -> list[Event]:
        """Computed and reused results."""
        trials = (event for entry in self.entries for event in events_of(entry, self.journal))
        return [*trials, *self.others]

    def computed(self) -> list[Event]:
        """Return the events of results that were absent or damaged in the store."""
        return [event for event in self.events if event.outcome != "reused"]


@one_blas_thread
def run_study(
    study: StudyConfiguration,
    out: Path,
    *,
    workers: int | Workers = 1,
    observer: Observer | None = None,
    store: Path | None = None,
    objects: str | None = None,
    stopping: Callable[[], bool] = lambda: False,
) -> StudyResult:
    """Run a study, computing only results that are not stored.

    The folder `out` receives ``cube.nc``, the journal of the run under ``runs`` and the stages under
    ``store``, or in the folder `store`, which several studies may share. With `objects`, an address
    such as ``s3://bucket/folder``, results are copied from this object storage if it has them, and
    to it otherwise. The results do not depend on `workers`, a number of processes or the workers of
    a scheduler; `observer` receives messages and progress. A failure of one trial is recorded with
    its status and reason in the cube. After an interruption (KeyboardInterrupt), completed results
    remain stored; if `stopping` returns True, the trials that have begun are completed before
    KeyboardInterrupt is raised. Raises
    DataError if no recording can be used or the face is not valid, StoreError if results cannot be
    read or written, and ExecutionError if the workers cannot compute.
    """
    observer = observer or Silent()
    remote = None if objects is None else Objects(objects)
    intake = take_in(
        study.recordings,
        study.exclude,
        study=out,
        workers=workers,
        observer=observer,
        stopping=stopping,
    )
    for error in intake.unreadable.values():
        observer.message(f"Omitted: {error}")
    for exclusion in study.exclude:
        if not any(exclusion.covers(recording.place) for recording in intake.recordings):
            observer.message(f"The exclusion of {exclusion.label} matches no recording.")
    trials = plan_trials(intake.recordings, study.strategy_names)
    made = variants(study)
    total = len(trials) * len(made)
    observer.begin(total)
    kept = Store(store or out / "store", report=observer.message, objects=remote)
    facts = {
        "study": study.name,
        "folder": str(out.resolve()),
        "trials": total,
        "workers": workers if isinstance(workers, int) else type(workers).__name__,
        "store": "store" if store is None else str(store.resolve()),
        "objects": objects or "",
        "code": code_version(CODE),
        "configuration": text_digest(study.model_dump_json(exclude={"name"})),
    }
    journal = Journal(out, facts)
    for line in intake.read:
        journal.write("recording", **line)
    run = StudyRun(journal, StoredFiles(kept.folder), workers, observer, stopping)
    computed: list[Computed] = []
    outcome = "failed"
    try:
        for variant in made:
            volunteers = [trial.place[0] for trial in trials]
            laboratory = Laboratory.of_study(kept, variant.study, observer.message, volunteers)
            run.variant = variant.label
            extents = feature_extents(laboratory, intake, run)
            entries = _run_trials(run, laboratory, trials, extents)
            given = (laboratory, trials, entries, extents, run)
            computed.append(
                Computed(
                    variant.labels,
                    laboratory,
                    entries,
                    compute_baselines(*given),
                    compute_formants(*given),
                )
            )
        path = write_cube(out / "cube.nc", study, computed, intake, trials, run.checkpoint)
        if remote is not None:
            remote.add_missing(kept.folder)
        outcome = "finished"
    except KeyboardInterrupt:
        outcome = "interrupted"
        raise
    finally:
        journal.end(outcome, kept.events)
    if run.muted:
        observer.message(
            f"In {len(run.muted)} of {len(intake.recordings)} recordings the feature of at least "
            "one muscle is zero or saturated throughout: 'emgface report' names the muscles, with a "
            f"threshold to try (attribute 'warnings' of the results in {kept.folder / 'activation'})."
        )
    return StudyResult(path, journal.path, run.entries, kept.events, dict(intake.unreadable))


def _run_trials(
    run: StudyRun,
    laboratory: Laboratory,
    trials: Sequence[PlannedTrial],
    extents: dict[str, Result],
) -> Entries:
    """Compute all trials, with one sigma_max per volunteer if requested."""
    policy = laboratory.study.simulation.sigma_max_policy
    if policy.calibration != "none":
        trials = with_calibrated(run, laboratory, trials, extents)
    done = _through_stages(run, laboratory, trials, extents)
    if policy.scope == "trial" or policy.calibration != "none":
        return done
    while again := sigma_max_to_share((place[0], entry) for place, entry in done.items()):
        for volunteer, lowest in again.items():
            run.observer.message(
                f"{run.variant}{': ' if run.variant else ''}{volunteer}: a trial required "
                f"sigma_max = {lowest / 1e3:.4g} kPa, which holds for all trials of the volunteer; "
                "trials with a higher value are simulated again"
            )
            higher = [
                trial
                for trial in trials
                if trial.place[0] == volunteer
                and done[*trial.place, trial.strategy].sigma_max > lowest
            ]
            with run.silently():
                done |= _through_stages(run, laboratory.lowered(lowest), higher, extents)
    return done


def sigma_max_to_share(entries: Iterable[tuple[str, Entry]]) -> dict[str, float]:
    """Volunteers whose trials differ in sigma_max, and the smallest value of each [Pa].

    Trials that failed with every value are ignored, because theirs is the minimum of the policy.
    """
    used: dict[str, set[float]] = {}
    for volunteer, entry in entries:
        if entry.status == "ok":
            used.setdefault(volunteer, set()).add(entry.sigma_max)
    return {volunteer: min(values) for volunteer, values in used.items() if len(values) > 1}


def _through_stages(
    run: StudyRun,
    laboratory: Laboratory,
    trials: Sequence[PlannedTrial],
    extents: dict[str, Result],
) -> Entries:
    """Outcomes of trials under one configuration."""
    return run.outcomes(
        trials,
        [_key(laboratory, trial, extents.get(trial.place[0])) for trial in trials],
        lambda left: compute_trials(laboratory, left, extents, run.workers, run.starting),
        laboratory.store.folder,
    )


def _key(laboratory: Laboratory, trial: PlannedTrial, extent: Result | None) -> str:
    """Digest of all inputs of a trial, with its calibrated sigma_max if it has one."""
    stress = trial.sigma_max
    return (laboratory if stress is None else laboratory.lowered(stress)).trial_key(trial, extent)


def feature_extents(
    laboratory: Laboratory, intake: Intake, run: StudyRun | None = None
) -> dict[str, Result]:
    """Range of the features per volunteer, if Eq. 8 does not use the range of the trial.

    Sessions are read by the workers of `run`, or in this process.
    """
    study = laboratory.study
    reach = study.signals.normalisation.reach
    if reach == "trial" or study.activation_source == "true":
        return {}
    if reach == "session":
        sessions = [(name, tuple(intake.usable[name])) for name in sorted(intake.usable)]
        if run is None:
            extents = [_session(laboratory, one) for one in sessions]
        else:
            extents = run.computed(_session, laboratory, sessions, "range")
        return {name: extent for (name, _), extent in zip(sessions, extents, strict=True)}
    references = take_in_references(study.recordings)

    def reference(volunteer: str) -> Result:
        datasets = references[volunteer]
        return laboratory.extent(
            map(dataset_digest, datasets), lambda: datasets, f"{volunteer}, reference"
        )

    return {name: reference(name) for name in sorted(intake.usable) if name in references}


def _session(laboratory: Laboratory, session: tuple[str, tuple[Recording, ...]]) -> Result:
    """Range of the features over the recordings of one volunteer."""
    name, recordings = session
    return laboratory.extent(
        [r.digest for r in recordings], lambda: (r.dataset for r in recordings), f"{name}, session"
    )
