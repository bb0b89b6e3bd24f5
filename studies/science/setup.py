"""Simulated volunteers and studies on which all sections of the page are based."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, TypeVar

import xarray as xr

from emgface.choices import configure
from emgface.face.simulation_parameters import SimulationParameters
from emgface.run.observer import Observer, Silent
from emgface.run.runner import run_jobs
from emgface.study.configuration import StudyConfiguration
from emgface.study.run import run_study
from emgface.volunteers.settings import VolunteerParameters
from emgface.volunteers.simulate import make_volunteers
from emgface.volunteers.world import World, world_of

SEED: Final = 17
INSTRUCTIONS: Final = ("A", "B", "D", "E")
"""Instructions of the studies: lips protruded, upper lip raised, smile, and moved from side to side.
Claims about instructions in general require four of them (`analysis.statistics.scope`); F is a sequence
of A and D. Six instructions take half as long again."""
REPETITIONS: Final = 2
RESOLUTION: Final = "coarse"
"""Resolution of the face of the study; only the mesh is coarse, not the physiology."""
SIGMA_MAX: Final = 100e3
"""Largest muscle stress [Pa] of the study, within the range of the volunteers' own."""
STEP: Final = 0.02
"""Largest step and time between outputs [s] of the study; the movements are slower than 10 Hz."""
WORLDS: Final = ("matched", "mismatched")
"""Worlds whose finished studies are passed to all sections."""

Job = TypeVar("Job")
Done = TypeVar("Done")


@dataclass
class Plan:
    """Extent of the simulations and their observer, set by the command."""

    store: Path = Path("studies-store")
    volunteers: int = 6
    instructions: tuple[str, ...] = INSTRUCTIONS
    accuracy: str = "draft"
    workers: int = 2
    observer: Observer = Silent()
    finished: bool = False


plan = Plan()


def simulation(**changes: Any) -> SimulationParameters:
    """Simulation parameters of study and volunteers, except those changed by a world.

    Without contact, which makes a trial about five times as long.
    """
    values = {"sigma_max": SIGMA_MAX, "accuracy": plan.accuracy, "contact": {"method": "none"}}
    return configure(SimulationParameters, values | changes)


def study_of(recordings: Path, name: str, /, **changes: Any) -> StudyConfiguration:
    """Configure the study of a set: defaults without contact, on a coarse template face."""
    values: dict[str, Any] = {
        "name": name,
        "recordings": {"folder": recordings.resolve(), "instructions": plan.instructions},
        "face": {"template": {"resolution": RESOLUTION}},
        "signals": {"normalisation": {"silent": "zero"}},
        "simulation": simulation(step=STEP, output=STEP).model_dump(),
    }
    for key, value in changes.items():
        values[key] = {**values[key], **value} if isinstance(value, dict) else value
    return configure(StudyConfiguration, values)


def people(world: World, folder: Path, instructions: Sequence[str]) -> Path:
    """Simulate the volunteers of a world and return the folder of their recordings.

    Motions of all worlds are stored in one folder, because worlds that differ only in their EMG
    share them. The number of repetitions is the same in all worlds: a session of another length has
    other random numbers.
    """
    make_volunteers(
        None,
        folder,
        n=plan.volunteers,
        repetitions=REPETITIONS,
        instructions=instructions,
        seed=SEED,
        parameters=simulation(),
        settings=configure(VolunteerParameters, {"resolution": RESOLUTION, "world": world}),
        workers=plan.workers,
        observer=plan.observer,
        store=plan.store / "motions",
    )
    return folder / "recordings"


def results_store() -> Path:
    """Folder of the results of all studies: worlds with the same EMG share simulated motions."""
    return plan.store / "results"


def finished_study(study: StudyConfiguration, folder: Path) -> Path:
    """Run a study, reusing stored results, and return its folder."""
    if not (plan.finished and (folder / "cube.nc").is_file()):
        run_study(
            study, folder, workers=plan.workers, observer=plan.observer, store=results_store()
        )
    return folder


def run_world(name: str) -> Path:
    """Simulate the volunteers of a world and run their study with the package's defaults."""
    folder = plan.store / name
    if plan.finished and (folder / "study" / "cube.nc").is_file():
        return folder / "study"
    recordings = people(world_of(name), folder, plan.instructions)
    study = study_of(recordings, f"simulated volunteers, {name} world")
    return finished_study(study, folder / "study")


def opened(folder: Path) -> xr.Dataset:
    """Cube of a finished study."""
    return xr.load_dataset(folder / "cube.nc")


def each(work: Callable[[Job], Done], jobs: Iterable[Job]) -> list[Done]:
    """Results of a module-level function of one job, by the processes of the plan, in order."""
    each_job = list(jobs)
    results = dict(run_jobs(work, each_job, plan.workers, begin=_ready, arguments=()))
    return [results[k] for k in range(len(each_job))]


def _ready() -> None:
    """Jobs of `each` need no preparation."""
