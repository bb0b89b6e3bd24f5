"""The simulated volunteers and studies that all sections of the page are made from."""

from pathlib import Path

from emgface.choices import configure
from emgface.face.simulation_parameters import SimulationParameters
from emgface.study.configuration import StudyConfiguration
from emgface.study.observer import Observer
from emgface.study.report import write_report
from emgface.study.run import run_study
from emgface.volunteers.settings import VolunteerParameters
from emgface.volunteers.simulate import make_volunteers

SEED = 17
REPETITIONS = 2
RESOLUTION = "coarse"
"""Elements of the face of the study; it is the mesh, not the physiology, that is coarse."""
SIGMA_MAX = 100e3
"""Largest muscle stress [Pa] of the study, within the range of the volunteers' own."""


def simulation() -> SimulationParameters:
    """Mechanics of both sides, but for what a world changes."""
    return configure(SimulationParameters, {"sigma_max": SIGMA_MAX, "accuracy": "study"})


def study_of(recordings: Path, name: str, **changes: object) -> StudyConfiguration:
    """Configure the study of a set: the package's defaults on a coarse template face."""
    values = {
        "name": name,
        "recordings": {"folder": recordings.resolve()},
        "face": {"template": {"resolution": RESOLUTION}},
        "signals": {"normalisation": {"silent": "zero"}},
        "simulation": simulation().model_dump(),
    }
    return configure(StudyConfiguration, values | changes)


def run_world(
    world: str, store: Path, *, volunteers: int, workers: int, observer: Observer
) -> Path:
    """Simulate the volunteers of a world and run their study; what is stored is not computed again.

    Returns
    -------
    Path
        Folder of the finished study.
    """
    folder = store / world
    make_volunteers(
        None,
        folder,
        n=volunteers,
        repetitions=REPETITIONS,
        seed=SEED,
        parameters=simulation(),
        settings=settings_of(world),
        workers=workers,
        observer=observer,
    )
    results = folder / "study"
    study = study_of(folder / "recordings", f"simulated volunteers, {world} world")
    cube = run_study(study, results, workers=workers, observer=observer).cube
    write_report(cube, results)
    return results


def settings_of(world: str) -> VolunteerParameters:
    """Faces, sessions and electrodes of the volunteers of a world."""
    return configure(VolunteerParameters, {"resolution": RESOLUTION})
