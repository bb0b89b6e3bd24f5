"""``emgface study``, ``report`` and ``demo``: whole studies."""

from pathlib import Path
from typing import Annotated

import typer

from emgface.cli.console import BAD_INPUT, PARTIAL, ProgressObserver, out, progress, say
from emgface.cli.machine import announce_compilation, cores, use_one_thread

app = typer.Typer(no_args_is_help=True, help="Whole studies, from recordings to the scored cube.")


@app.command()
def template(
    out_path: Annotated[
        Path | None, typer.Option("--out", help="File to write; printed when absent.")
    ] = None,
) -> None:
    """Write a study file with every parameter, its default, unit and source."""
    from emgface.study.store import write_text
    from emgface.study.template import study_template

    if out_path is None:
        typer.echo(study_template(), nl=False)
        return
    write_text(study_template(), out_path)
    say(f"Wrote {out_path}.")


@app.command()
def run(
    path: Annotated[Path, typer.Argument(help="Study file (TOML).")],
    out_path: Annotated[Path, typer.Option("--out", help="Folder of the results.")],
    workers: Annotated[
        int | None,
        typer.Option(min=1, help="Processes that simulate at the same time; one per core."),
    ] = None,
) -> None:
    """Run a study, or complete one that was interrupted."""
    from emgface.study.configuration import load_study

    raise typer.Exit(_run(load_study(path), out_path, workers or cores()))


def _run(configuration, out_path: Path, workers: int) -> int:  # noqa: ANN001
    """Run a study, print its tables and return the exit code."""
    from emgface.study.report import write_report
    from emgface.study.run import run_study

    announce_compilation()
    with progress(f"study {configuration.name}") as bar:
        result = run_study(configuration, out_path, workers=workers, observer=ProgressObserver(bar))
    report = write_report(result.cube, out_path)
    out.print(report.summary, markup=False, highlight=False, soft_wrap=True)
    computed, reused = len(result.computed()), len(result.events) - len(result.computed())
    say(f"{computed} results were computed, {reused} were there already.")
    say(f"Cube: {result.path}. Tables: {report.folder}.")
    status = result.cube["status"].values.ravel().tolist()
    n_ok = status.count("ok")
    for sentence in report.failures:
        say(sentence)
    if n_ok == 0:
        return BAD_INPUT
    done = n_ok + status.count("excluded")
    return PARTIAL if done < len(status) or result.unreadable else 0


def report(
    folder: Annotated[Path, typer.Argument(help="Folder of a study, with its cube.nc.")],
) -> None:
    """Print the tables of a finished study."""
    from emgface.errors import DataError
    from emgface.netcdf import read_netcdf
    from emgface.study.report import write_report

    if not (folder / "cube.nc").is_file():
        raise DataError(
            f"{folder} holds no cube.nc, expected the folder of a finished study: name the folder "
            "given to 'emgface study run --out', or run the study again to finish it"
        )
    written = write_report(read_netcdf(folder / "cube.nc", "cube"), folder)
    for table in written.tables.values():
        out.print(table.text(), markup=False, highlight=False, soft_wrap=True)
    say(f"Tables as CSV and Markdown: {written.folder}.")


def demo(
    out_path: Annotated[Path, typer.Option("--out", help="Folder of the results.")] = Path(
        "emgface-demo"
    ),
    quick: Annotated[
        bool, typer.Option("--quick", help="Fewer trials on a coarser block.")
    ] = False,
) -> None:
    """Simulate two volunteers on a block of lip tissue and run a study of them."""
    use_one_thread()  # the block is small: threads would only wait for each other
    from emgface.face.model import save_face
    from emgface.study.demo import demo_study
    from emgface.study.faces import study_face
    from emgface.study.store import write_text
    from emgface.study.template import study_template
    from emgface.volunteers.simulate import make_volunteers

    plan, workers = demo_study(out_path, quick=quick), cores()
    say("All of this demonstration is simulated: volunteers, sEMG and motion.")
    face = study_face(plan.face)
    save_face(face, out_path / "face.nc")
    announce_compilation()
    with progress("simulated volunteers") as bar:
        make_volunteers(
            face,
            out_path / "volunteers",
            n=2,
            instructions=plan.recordings.instructions,
            seed=plan.seed,
            parameters=plan.simulation,
            workers=workers,
            observer=ProgressObserver(bar),
        )
    write_text(study_template(plan), out_path / "study.toml")
    code = _run(plan, out_path / "study", workers)
    say(
        f"Face: {out_path / 'face.nc'}. Recordings: {out_path / 'volunteers' / 'recordings'}. "
        f"Study file, to change and run again with 'emgface study run': {out_path / 'study.toml'}."
    )
    raise typer.Exit(code)
