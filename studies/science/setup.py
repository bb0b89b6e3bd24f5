"""Simulated volunteers and studies on which all sections of the page are based."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import xarray as xr

from emgface.choices import configure
from emgface.face.simulation_parameters import SimulationParameters
from emgface.muscles import INSTRUCTIONS
from emgface.study.configuration import StudyConfiguration
from emgface.study.observer import Observer, Silent
from emgface.study.report import write_report
from emgface.study.run import run_study
from emgface.volunteers.settings import VolunteerParameters
from emgface.volunteers.simulate import make_volunteers
from emgface.volunteers.world import World, world_of

SEED: Final = 17
REPETITIONS: Final = 2
RESOLUTION: Final = "coarse"
"""Resolution of the face of the study; only the mesh is coarse, not the physiology."""
SIGMA_MAX: Final = 100e3
"""Largest muscle stress [Pa] of the study, within the range of the volunteers' own."""
WORLDS: Final = ("matched", "mismatched")
"""Worlds whose finished studies are passed to all sections."""


@dataclass
class Plan:
    """Extent of the simulations and their observer, set by the command."""

    store: Path = Path("studies-store")
    volunteers: int = 6
    instructions: tuple[str, ...] = tuple(INSTRUCTIONS)
    accuracy: str = "draft"
    workers: int = 2
    observer: Observer = Silent()
    finished: bool = False
    ends: bool = False


plan = Plan()


def simulation() -> SimulationParameters:
    """Simulation parameters of study and volunteers, except those changed by a world.

    Without contact, which makes a trial about five times as long.
    """
    return configure(
        SimulationParameters,
        {"sigma_max": SIGMA_MAX, "accuracy": plan.accuracy, "contact": {"method": "none"}},
    )


def study_of(recordings: Path, name: str, /, **changes: Any) -> StudyConfiguration:
    """Configure the study of a set: defaults without contact, on a coarse template face."""
    values: dict[str, Any] = {
        "name": name,
        "recordings": {"folder": recordings.resolve(), "instructions": plan.instructions},
        "face": {"template": {"resolution": RESOLUTION}},
        "signals": {"normalisation": {"silent": "zero"}},
        "simulation": simulation().model_dump(),
    }
    for key, value in changes.items():
        values[key] = {**values[key], **value} if isinstance(value, dict) else value
    return configure(StudyConfiguration, values)


def people(world: World, folder: Path, *, volunteers: int, repetitions: int) -> Path:
    """Simulate the volunteers of a world and return the folder of their recordings.

    Motions of all worlds are stored in one folder, because worlds that differ only in their EMG
    share them.
    """
    make_volunteers(
        None,
        folder,
        n=volunteers,
        repetitions=repetitions,
        instructions=plan.instructions,
        seed=SEED,
        parameters=simulation(),
        settings=configure(VolunteerParameters, {"resolution": RESOLUTION, "world": world}),
        workers=plan.workers,
        observer=plan.observer,
        store=plan.store / "motions",
    )
    return folder / "recordings"


def finished_study(study: StudyConfiguration, results: Path) -> Path:
    """Run a study, reusing stored results, and return its folder."""
    if plan.finished and (results / "cube.nc").is_file():
        return results
    cube = run_study(study, results, workers=plan.workers, observer=plan.observer).cube
    write_report(cube, results)
    return results


def run_world(name: str) -> Path:
    """Simulate the volunteers of a world and run their study with the package's defaults."""
    folder = plan.store / name
    results = folder / "study"
    if plan.finished and (results / "cube.nc").is_file():
        return results
    recordings = people(world_of(name), folder, volunteers=plan.volunteers, repetitions=REPETITIONS)
    study = study_of(recordings, f"simulated volunteers, {name} world")
    return finished_study(study, results)


def opened(results: Path) -> xr.Dataset:
    """Cube of a finished study."""
    return xr.load_dataset(results / "cube.nc")
