"""Inversion of several recordings by workers, one job for each."""

import warnings
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import xarray as xr

from emgface.errors import DataError, StoreError
from emgface.inverse.calibration import Calibration
from emgface.inverse.doubts import doubts
from emgface.inverse.kept import Kept
from emgface.inverse.parameters import InverseParameters, form_of
from emgface.inverse.run import invert
from emgface.recordings.dataset import read_recording
from emgface.run.digest import dataset_digest
from emgface.run.observer import Observer, Silent
from emgface.run.runner import Workers
from emgface.run.store import Stage, Store
from emgface.run.tasks import run_table
from emgface.schema.netcdf import write_netcdf
from emgface.study.configuration import StudyConfiguration
from emgface.study.outcomes import on_laboratory
from emgface.study.stage_code import INVERSE
from emgface.study.stages import Laboratory
from sim.state import Array
from sim.threads import one_blas_thread

INVERTED = Stage("inverted", INVERSE.modules)


@dataclass(frozen=True)
class InversionJob:
    """One recording, the file of its result, and what all recordings share."""

    path: Path
    out: Path
    mapping: Path | None
    parameters: InverseParameters
    calibration: Calibration | None
    mixing: Array | None


@dataclass(frozen=True)
class Inverted:
    """Outcome of one recording.

    Attributes
    ----------
    name : of the file without its suffix.
    status, reason : "ok", or "failed:" with the name of the error, and its message.
    misfit : root mean square distance of the tracked markers per coordinate [m].
    misfit_ratio : it over the displacements that were wanted [1].
    width : mean width of the intervals of the activations [1], NaN without any.
    """

    name: str
    status: str = "ok"
    reason: str = ""
    misfit: float = np.nan
    misfit_ratio: float = np.nan
    width: float = np.nan


@one_blas_thread
def invert_all(
    recordings: Sequence[Path],
    face: xr.Dataset,
    study: StudyConfiguration,
    out: Path,
    parameters: InverseParameters | None = None,
    *,
    mapping: Path | None = None,
    calibration: Calibration | None = None,
    mixing: Array | None = None,
    workers: int | Workers = 1,
    observer: Observer | None = None,
    stopping: Callable[[], bool] = lambda: False,
) -> list[Inverted]:
    """Invert recordings as `emgface.inverse.run.invert`, and write ``NAME.nc`` of each to `out`.

    The results are also in ``out/store`` under the digest of their inputs, parameters and code, from
    which a repeated call takes them; an interrupted fit of the trajectory form continues with its last
    iteration. ``out/runs`` contains the journal. The simulation and the signals are those of `study`.
    A recording that cannot be inverted is an outcome with its reason; an earlier result of the same
    name is then removed, and the next call tries again. The results do not depend on `workers`.

    Raises
    ------
    ConfigurationError
        The trajectory form does not exist with contact.
    DataError
        Two recordings have the same name, or the recordings are in `out`.
    StoreError, ExecutionError
        A result cannot be stored, or the workers cannot compute.
    KeyboardInterrupt
        `stopping` returned True; the recordings that had begun are complete.
    """
    p = parameters or InverseParameters()
    form_of(p.form, study.simulation.contact.method != "none")
    names = [path.stem for path in recordings]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise DataError(
            f"{names.count(twice[0])} recordings are named {twice[0]}, expected different names of "
            "files, as those of their results: rename one"
        )
    if out.resolve() in {path.resolve().parent for path in recordings}:
        raise DataError(
            f"{out} contains the recordings, which have the names of the results: specify another "
            "folder"
        )
    store = Store(out / "store", report=(observer or Silent()).message)
    laboratory = Laboratory(store, face, study, store.report)
    given = (None if mapping is None else mapping.absolute(), p, calibration, mixing)
    jobs = [
        InversionJob(path.absolute(), out.absolute() / f"{path.stem}.nc", *given)
        for path in recordings
    ]
    if workers != 1:
        laboratory.rest(study.simulation)  # computed once, instead of by every worker
    return run_table(
        on_laboratory(invert_one, laboratory, workers, failed=_failed),
        jobs,
        [(name,) for name in names],
        name=f"inverse, {p.variant}",
        out=out,
        store=store.folder,
        workers=workers,
        observer=observer or Silent(),
        stopping=stopping,
        status=lambda one: (one.status, one.reason),
    )


def invert_one(laboratory: Laboratory, job: InversionJob) -> Inverted:
    """Invert one recording and write the file of its result."""
    name, kept = job.path.stem, Kept.for_result(job.out)
    with warnings.catch_warnings(record=True) as caught:
        inverted = _inverted(laboratory, job, kept)
    try:
        write_netcdf(inverted, job.out, "activation")
    except DataError as error:
        raise StoreError(str(error)) from error
    kept.remove()
    misfit = float((inverted["misfit"] ** 2).mean()) ** 0.5
    ratio = float(inverted.attrs["misfit_ratio"])
    for text in doubts(inverted):
        laboratory.report(f"{name}: {text}")
    if caught:
        more = f" (and {len(caught) - 1} more warnings)" if len(caught) > 1 else ""
        laboratory.report(f"{name}: {caught[0].message}{more}")
    width = np.nan
    if "interval" in inverted.attrs:
        width = float((inverted["activation_high"] - inverted["activation_low"]).mean())
    return Inverted(name, "ok", "", misfit, ratio, width)


def _inverted(laboratory: Laboratory, job: InversionJob, kept: Kept) -> xr.Dataset:
    """Return the stored result of a recording, computing it if it is absent."""
    study, recording = laboratory.study, read_recording(job.path, mapping=job.mapping)
    inputs = {"recording": dataset_digest(recording), "face": laboratory.face_digest}
    if job.calibration is not None:
        inputs["calibration"] = dataset_digest(job.calibration.data)
    chosen = asdict(job.parameters)
    return laboratory.store.get_or_compute(
        INVERTED,
        inputs,
        {
            "parameters": chosen | {"left_out": list(job.parameters.left_out)},
            "mixing": None if job.mixing is None else job.mixing.tolist(),
            "simulation": study.simulation.model_dump(mode="json"),
            "signals": study.signals.model_dump(mode="json"),
        },
        lambda: invert(
            recording, laboratory.face, study.simulation, study.signals, job.parameters,
            settled=laboratory.rest(study.simulation).dataset, calibration=job.calibration,
            mixing=job.mixing, kept=kept,
        ),
        label=job.path.stem,
    ).dataset  # fmt: skip


def _failed(job: InversionJob, error: Exception) -> Inverted:
    job.out.unlink(missing_ok=True)
    return Inverted(job.path.stem, f"failed:{type(error).__name__}", str(error))
