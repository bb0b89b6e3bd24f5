"""Simulations of two faces, one after another or in several processes: movements and pressures."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import xarray as xr

from emgface.errors import FaceError
from emgface.face.lip_shape import has_mouth
from emgface.face.motion import settle_face, simulate_face
from emgface.face.mouth import Mouth
from emgface.face.sigma_max import AVOIDED_BY_WEAKER
from emgface.face.simulation_parameters import SimulationParameters
from emgface.pictures.body import skin_of
from emgface.pictures.surface import SurfaceProbe, with_surface
from emgface.run.digest import dataset_digest, file_digest
from emgface.run.mechanics import MECHANICS
from emgface.run.runner import Workers
from emgface.run.store import Stage, Store
from emgface.run.tasks import Task
from emgface.treatment.pressure import pressure_held
from sim import SimulationError

TREATMENT_MOTION: Final = Stage("treatment_motion", (*MECHANICS, "emgface.treatment.jobs"))
PRESSURE_STAGE: Final = Stage(
    "treatment_pressure", (*TREATMENT_MOTION.modules, "emgface.treatment.pressure")
)
PRESSED: Final = "pressure held"  #: name of the job that finds the pressure of closed lips
PRESSURE: Final = "pressure_held_Pa"  #: attribute of a motion of closing
PRESSURE_STEP: Final = "pressure_step_Pa"
AT_LEAST: Final = "pressure_at_least"  #: 1 if the pressure is a lower bound
BOUNDED: Final = "pressure_bounded_because"
NO_PRESSURE: Final = "pressure_not_found"


def pressure_attributes(
    face: xr.Dataset, parameters: SimulationParameters, settled: xr.Dataset
) -> dict[str, Any]:
    """Attributes of the pressure that closed lips hold, or of the reason why it was not found.

    They are `PRESSURE` [Pa], `PRESSURE_STEP` [Pa] (the width of the interval in which the lips part) and
    `AT_LEAST`, 1 if the pressure is a lower bound, with the reason `BOUNDED`; or `NO_PRESSURE` alone.
    Without contact, there are none.
    """
    if parameters.contact.method == "none":
        return {}
    try:
        pressure = pressure_held(face, parameters, settled=settled)
    except FaceError as error:
        return {NO_PRESSURE: str(error)}
    attributes = {
        PRESSURE: pressure.pressure,
        PRESSURE_STEP: pressure.step,
        AT_LEAST: int(pressure.at_least),
    }
    return attributes | ({BOUNDED: pressure.reason} if pressure.at_least else {})


@dataclass(frozen=True)
class Job:
    """One simulation of the intact (0) or the treated face (1): a movement, or `PRESSED`."""

    which: int
    name: str
    parameters: SimulationParameters


@dataclass(frozen=True)
class FailedJob:
    """Failure of a simulation; `weaker` if a smaller sigma_max may avoid it."""

    text: str
    weaker: bool

    @classmethod
    def from_error(cls, error: SimulationError) -> "FailedJob":
        """Describe an error, which other processes may not be able to read."""
        return cls(str(error), isinstance(error, AVOIDED_BY_WEAKER))


class Faces:
    """Intact and treated face with the activations of their movements; results are kept in a store.

    `reduced` are the files of the reduced faces of both, with which the movements are simulated; the
    pressure that the lips hold is found at full order.
    """

    def __init__(
        self,
        faces: tuple[xr.Dataset, xr.Dataset],
        activations: Mapping[str, xr.DataArray],
        store: Store | None = None,
        reduced: tuple[Path, Path] | None = None,
    ) -> None:
        self.reduced = reduced
        self.given, self.activations, self._store = faces, dict(activations), store
        self._skins = [skin_of(face) for face in faces]
        self._digests = [] if store is None else [dataset_digest(face) for face in faces]
        self._settled: dict[tuple[int, float], xr.Dataset] = {}

    @property
    def store(self) -> Store:
        """Store of the results, through which processes return them."""
        assert self._store is not None, "several processes require a store"
        return self._store

    def result(self, job: Job) -> xr.Dataset:
        """Motion of a job, or its pressure as attributes; from the store if it is there."""
        if self._store is None:
            return self._computed(job)
        stage, inputs = PRESSURE_STAGE, {"face": self._digests[job.which]}
        if job.name != PRESSED:
            own = self.activations[job.name].to_dataset(name="activation")
            stage, inputs = TREATMENT_MOTION, inputs | {"activation": dataset_digest(own)}
            if self.reduced is not None:
                inputs |= {"reduced": file_digest(self.reduced[job.which])}
        return self._store.get_or_compute(
            stage, inputs, {"simulation": job.parameters.model_dump(mode="json")},
            lambda: self._computed(job), label=job.name,
        ).dataset  # fmt: skip

    def _computed(self, job: Job) -> xr.Dataset:
        face, p, skin = self.given[job.which], job.parameters, self._skins[job.which]
        activation = self.activations.get(job.name)
        if self.reduced is not None and activation is not None:
            p = p.model_copy(
                update={"reduced": p.reduced.model_copy(update={"file": self.reduced[job.which]})}
            )
            probes = (
                SurfaceProbe(skin.node),
                *([Mouth.from_face(face)] if has_mouth(face) else []),
            )
            return with_surface(simulate_face(face, activation, p, further=probes), face, skin)
        key = job.which, p.sigma_max
        if key not in self._settled:
            self._settled[key] = settle_face(face, p)
        if activation is None:
            return xr.Dataset(attrs=pressure_attributes(face, p, self._settled[key]))
        motion = simulate_face(
            face, activation, p, settled=self._settled[key], further=(SurfaceProbe(skin.node),)
        )
        return with_surface(motion, face, skin)


Given = tuple[
    tuple[xr.Dataset, xr.Dataset], dict[str, xr.DataArray], Path, tuple[Path, Path] | None
]


def _prepared(given: Given, report: Callable[[str], None]) -> Faces:
    faces, activations, folder, reduced = given
    return Faces(faces, activations, Store(folder, report=report), reduced)


def _simulated(faces: Faces, job: Job) -> FailedJob | None:
    """Simulate a job, whose result the store then contains."""
    try:
        faces.result(job)
    except SimulationError as error:
        return FailedJob.from_error(error)
    return None


def results(
    faces: Faces,
    jobs: Sequence[Job],
    workers: int | Workers = 1,
    stopping: Callable[[], bool] = lambda: False,
) -> Iterator[tuple[Job, xr.Dataset | FailedJob]]:
    """Yield every job with its result when it ends; in one process, none after a failure of its name.

    Raises KeyboardInterrupt if `stopping` returns True, after the jobs that have begun.
    """
    if workers == 1:
        lost: set[str] = set()
        for job in jobs:
            if stopping():
                raise KeyboardInterrupt
            if job.name in lost:
                continue
            try:
                result: xr.Dataset | FailedJob = faces.result(job)
            except SimulationError as error:
                result = FailedJob.from_error(error)
                lost.add(job.name)
            yield job, result
        return
    given = faces.given, faces.activations, faces.store.folder, faces.reduced
    task = Task(_prepared, given, _simulated, lambda job: job.which)
    count = 0
    for index, done in task.outcomes(jobs, workers, starting=lambda _: not stopping()):
        for text in done.messages:
            faces.store.report(text)
        count += 1
        yield jobs[index], done.outcome or faces.result(jobs[index])
    if count < len(jobs):
        raise KeyboardInterrupt
