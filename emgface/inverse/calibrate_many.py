"""Calibration of the sEMG from trials in files, which workers fit, one job for each trial."""

import warnings
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import xarray as xr

from emgface.errors import DataError, StoreError
from emgface.inverse.calibrate import described_calibration, estimate, volunteer_of
from emgface.inverse.calibration import Calibration, over_session
from emgface.inverse.calibration_trial import CalibrationTrial, fit_trial
from emgface.inverse.kept import Kept
from emgface.inverse.parameters import InverseParameters
from emgface.recordings.dataset import read_recording
from emgface.run.digest import dataset_digest
from emgface.run.observer import Observer, Silent
from emgface.run.runner import Workers
from emgface.run.store import Result, Stage, Store
from emgface.run.tasks import run_table
from emgface.study.configuration import StudyConfiguration
from emgface.study.outcomes import on_laboratory
from emgface.study.stage_code import INVERSE
from emgface.study.stages import Laboratory
from sim.state import Array
from sim.threads import one_blas_thread

FITTED = Stage("calibration_trial", (*INVERSE.modules, "emgface.inverse.calibration_trial"))


@dataclass(frozen=True)
class CalibrationJob:
    """One trial, and what all trials share."""

    name: str
    path: Path
    mapping: Path | None
    parameters: InverseParameters
    session: Result


@dataclass(frozen=True)
class FittedTrial:
    """Outcome of one trial: its name, "ok" and the digest of its fit, or "failed:" and the reason."""

    name: str
    digest: str = ""
    status: str = "ok"
    reason: str = ""


@one_blas_thread
def calibrate_all(
    recordings: Sequence[Path],
    face: xr.Dataset,
    study: StudyConfiguration,
    folder: Path,
    parameters: InverseParameters | None = None,
    *,
    mapping: Path | None = None,
    mixing: Array | None = None,
    cross_talk: bool = False,
    workers: int | Workers = 1,
    observer: Observer | None = None,
    stopping: Callable[[], bool] = lambda: False,
) -> Calibration:
    """Calibrate with trials in files, as `emgface.inverse.calibrate.calibrate`.

    The fits are stored in ``folder/store`` under the digest of their inputs, parameters and code, from
    which a repeated call takes them; an interrupted fit continues with its last iteration. The journal
    is in ``folder/runs``. The result does not depend on `workers`.

    Raises
    ------
    DataError
        There is no trial, they are of several volunteers, or at least one of them cannot be fitted; the
        fits of the others are kept.
    StoreError, ExecutionError
        A result cannot be stored, or the workers cannot compute.
    KeyboardInterrupt
        `stopping` returned True; the fits that had begun are complete.
    """
    p, chain = parameters or InverseParameters(), over_session(study.signals)
    study = study.model_copy(update={"signals": chain})
    given = [read_recording(path, mapping=mapping) for path in recordings]
    volunteer, origin = volunteer_of(given), str(given[0].attrs.get("origin", "measured"))
    store = Store(folder.absolute() / "store", report=(observer or Silent()).message)
    laboratory = Laboratory(store, face, study, store.report)
    session = laboratory.extent(
        [dataset_digest(one) for one in given], lambda: given, "range of the calibration trials"
    )
    mapped = None if mapping is None else mapping.absolute()
    names = [path.stem for path in recordings]
    names = names if len({*names}) == len(names) else [str(path) for path in recordings]
    jobs = [
        CalibrationJob(name, path.absolute(), mapped, p, session)
        for name, path in zip(names, recordings, strict=True)
    ]
    laboratory.rest(study.simulation)  # computed once, instead of by every worker
    outcomes = run_table(
        on_laboratory(fit_one, laboratory, workers, failed=_failed),
        jobs,
        [(name,) for name in names],
        name=f"calibration of {volunteer}",
        out=folder,
        store=store.folder,
        workers=workers,
        observer=observer or Silent(),
        stopping=stopping,
        status=lambda one: (one.status, one.reason),
    )
    if failed := [one for one in outcomes if one.status != "ok"]:
        each = "; ".join(
            f"{o.name}: {o.status.removeprefix('failed:')}: {o.reason}" for o in failed
        )
        raise DataError(
            f"{len(failed)} of {len(outcomes)} calibration trials cannot be fitted ({each}), expected "
            "all: repair these, or leave them out"
        )
    trials = [_stored(store, one) for one in outcomes]
    data = estimate(trials, p, session.dataset, mixing=mixing, cross_talk=cross_talk)
    return described_calibration(data, volunteer, face, study.simulation, origin)


def _stored(store: Store, one: FittedTrial) -> CalibrationTrial:
    stored = store.read(FITTED.name, one.digest)
    if stored is None:
        raise StoreError(
            f"the fit of {one.name} in {store.folder} was damaged in the meantime: run the command again"
        )
    return CalibrationTrial.of_dataset(stored)


def fit_one(laboratory: Laboratory, job: CalibrationJob) -> FittedTrial:
    """Fit one trial, or take its stored fit."""
    study, p = laboratory.study, job.parameters
    recording = read_recording(job.path, mapping=job.mapping)
    inputs = {
        "recording": dataset_digest(recording),
        "face": laboratory.face_digest,
        "range": job.session.digest,
    }
    kept = Kept.for_result(laboratory.store.folder / FITTED.name / f"{inputs['recording']}.nc")
    with warnings.catch_warnings(record=True) as caught:
        result = laboratory.store.get_or_compute(
            FITTED,
            inputs,
            {
                "parameters": asdict(p) | {"left_out": list(p.left_out)},
                "simulation": study.simulation.model_dump(mode="json"),
                "signals": study.signals.model_dump(mode="json"),
            },
            lambda: fit_trial(
                recording, laboratory.face, study.simulation, study.signals, p,
                settled=laboratory.rest(study.simulation).dataset,
                session=job.session.dataset, kept=kept,
            ).to_dataset().assign_attrs(origin=recording.attrs.get("origin", "measured")),
            label=job.name,
        )  # fmt: skip
    kept.remove()
    for text in dict.fromkeys(str(one.message) for one in caught):
        laboratory.report(f"{job.name}: {text}")
    return FittedTrial(job.name, result.digest)


def _failed(job: CalibrationJob, error: Exception) -> FittedTrial:
    return FittedTrial(job.name, "", f"failed:{type(error).__name__}", str(error))
