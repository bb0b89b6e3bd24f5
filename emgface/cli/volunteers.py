"""``emgface volunteers``: recordings of simulated people."""

from pathlib import Path
from typing import Annotated

import typer

from emgface.cli.console import ProgressObserver, progress, say
from emgface.cli.machine import announce_compilation, cores


def volunteers(
    out_path: Annotated[Path, typer.Option("--out", help="Folder to write to.")],
    n: Annotated[int, typer.Option("--n", min=1, help="Number of volunteers.")] = 2,
    repetitions: Annotated[int, typer.Option(min=1, help="Repetitions per instruction.")] = 1,
    instructions: Annotated[str, typer.Option(help="Some of ABCDEF.")] = "ABCDEF",
    face: Annotated[
        Path | None, typer.Option(help="Face model; the block of lip tissue when absent.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the whole set.")] = 0,
    workers: Annotated[
        int | None,
        typer.Option(min=1, help="Processes that simulate at the same time; one per core."),
    ] = None,
    study: Annotated[
        Path | None, typer.Option("--study", help="Study file whose simulation table applies.")
    ] = None,
) -> None:
    """Simulate volunteers: known activations, sEMG and lip markers, labelled simulated."""
    from emgface.study.configuration import FaceConfiguration, StudyConfiguration, load_study
    from emgface.study.faces import study_face
    from emgface.volunteers.simulate import make_volunteers

    configuration = load_study(study) if study else StudyConfiguration()
    where = FaceConfiguration(path=face) if face else configuration.face
    model = study_face(where)
    announce_compilation()
    with progress("simulated volunteers") as bar:
        paths = make_volunteers(
            model,
            out_path,
            n=n,
            repetitions=repetitions,
            instructions=tuple(instructions),
            seed=seed,
            parameters=configuration.simulation,
            workers=workers or cores(),
            observer=ProgressObserver(bar),
        )
    say(f"Wrote {len(paths)} simulated recordings to {out_path / 'recordings'}.")
