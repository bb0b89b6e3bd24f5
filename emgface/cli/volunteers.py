"""``emgface volunteers``: recordings of simulated volunteers."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from emgface.cli import options
from emgface.cli.console import progress, say
from emgface.cli.machine import announce_compilation, executing, graceful_stop


class Form(StrEnum):
    """Output formats of simulated recordings."""

    netcdf = "netcdf"
    bids = "bids"
    both = "both"


class Source(StrEnum):
    """Sources of the EMG."""

    motor_units = "motor_units"
    noise = "noise"


def volunteers(
    out_folder: Annotated[Path, typer.Option("--out", help="Folder to write to.")],
    n: Annotated[int, typer.Option("--n", min=1, help="Number of volunteers.")] = 2,
    repetitions: Annotated[int, typer.Option(min=1, help="Repetitions per instruction.")] = 1,
    instructions: Annotated[str, typer.Option(help="Letters of the instructions.")] = "ABCDEF",
    face: Annotated[
        Path | None,
        typer.Option(
            help="Face model, scaled for each volunteer; default: a random face for each."
        ),
    ] = None,
    world: Annotated[
        str,
        typer.Option(
            help="Differences between the volunteers and the assumptions of a study: mismatched, "
            "matched, or some of mesh, laws, courses, strengths, delay, recruitment, repetition, "
            "pick-up, noise, joined by '+'."
        ),
    ] = "mismatched",
    resolution: options.ResolutionOption = "medium",
    seed: Annotated[int, typer.Option(min=0, help="Seed of all random numbers.")] = 0,
    form: Annotated[
        Form,
        typer.Option(
            "--format", help="Format; the true values of a BIDS dataset are written as netCDF."
        ),
    ] = Form.netcdf,
    emg: Annotated[
        Source, typer.Option(help="EMG of motor units, or of amplitude-modulated noise.")
    ] = Source.motor_units,
    step: Annotated[
        float | None,
        typer.Option(help="Time step of the simulation in s; default: half the step of the study."),
    ] = None,
    cross_talk: Annotated[
        float | None,
        typer.Option(
            help="Fraction of the amplitude of neighbouring channels, in worlds without "
            "mismatched pick-up; default: random."
        ),
    ] = None,
    electrode_failure: Annotated[
        float, typer.Option(help="Probability that an electrode fails in a session.")
    ] = 0.0,
    sessions: Annotated[
        bool, typer.Option("--sessions", help="Also write the uncut sessions with their events.")
    ] = False,
    workers: options.WorkersOption = None,
    scheduler: options.SchedulerOption = None,
    study: options.StudyPath = None,
) -> None:
    """Simulate volunteers with known activations, sEMG and lip markers.

    Ctrl-C and SIGTERM complete the sessions that have begun; the same command continues.
    """
    given = {
        "emg": emg.value,
        "resolution": options.mesh_size(resolution),
        "cross_talk": cross_talk,
        "electrode_failure": electrode_failure,
        "keep_sessions": sessions,
    }
    with executing(workers, scheduler) as chosen, graceful_stop() as stopping:
        paths = _simulated(
            out_folder,
            world,
            given,
            face,
            study,
            step,
            n=n,
            repetitions=repetitions,
            instructions=tuple(instructions),
            seed=seed,
            workers=chosen,
            stopping=stopping,
        )
    _report(paths, out_folder, form)


def _simulated(
    out_folder: Path,
    world: str,
    given: dict[str, Any],
    face: Path | None,
    study: Path | None,
    step: float | None,
    **design: Any,
) -> list[Path]:
    """Simulate the volunteers; `given` are parameters of the volunteers."""
    from emgface.choices import configure
    from emgface.face.file import load_face
    from emgface.face.simulation_parameters import SimulationParameters
    from emgface.study.configuration import StudyConfiguration
    from emgface.study.file import load_study, study_face
    from emgface.volunteers.settings import VolunteerParameters
    from emgface.volunteers.simulate import make_volunteers
    from emgface.volunteers.world import world_of

    settings = configure(VolunteerParameters, {"world": world_of(world), **given})
    configuration = load_study(study) if study else StudyConfiguration()
    simulation = configuration.simulation.model_dump()
    fine = step or configuration.simulation.step / 2
    simulation |= {"step": fine, "output": fine}
    parameters = configure(SimulationParameters, simulation)
    model = load_face(face) if face else None
    own = configuration.face  # template faces are individual
    if model is None and own.path is not None:
        model = study_face(own)
    announce_compilation()
    with progress("simulated volunteers") as bar:
        return make_volunteers(
            model, out_folder, parameters=parameters, settings=settings, observer=bar, **design
        )


def _report(paths: list[Path], out_folder: Path, form: Form) -> None:
    """Convert the recordings if requested, and print what was written."""
    from emgface.recordings.dataset import read_recording
    from emgface.volunteers.write import write_set_as_bids

    if form in (Form.bids, Form.both):
        with progress("BIDS"):
            write_set_as_bids(paths, out_folder / "bids", out_folder / "truth")
        say(f"Wrote {len(paths)} simulated trials to {out_folder / 'bids'}, the true values to "
            f"{out_folder / 'truth'}.")  # fmt: skip
    if form == Form.bids:
        for path in paths:
            path.unlink()
        paths[0].parent.rmdir()
        return
    say(
        f"Wrote {len(paths)} simulated recordings to {out_folder / 'recordings'}, "
        f"{read_recording(paths[0]).attrs['world']}."
    )
