"""``emgface study``, ``report`` and ``demo``."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from emgface.characters import visible
from emgface.cli.console import BAD_INPUT, PARTIAL, Bar, progress, say, tell
from emgface.cli.machine import announce_compilation, cores, executing, graceful_stop, show_page
from emgface.cli.options import (
    AccuracyOption,
    ContactSwitch,
    FacePath,
    MappingOption,
    OutPath,
    SchedulerOption,
    WorkersOption,
)

if TYPE_CHECKING:
    from emgface.report.kept import KeptReport, Page
    from emgface.report.study_tables import Report
    from emgface.run.runner import Workers
    from emgface.study.configuration import StudyConfiguration
    from emgface.study.run import StudyResult
    from emgface.volunteers.settings import VolunteerParameters

app = typer.Typer(no_args_is_help=True, help="Run studies, from recordings to the cube of scores.")


@app.command()
def template(
    out_path: OutPath = None,
    every: Annotated[bool, typer.Option("--all", help="Write every parameter.")] = False,
) -> None:
    """Write a study file with the parameters that most studies decide, with default, unit and source."""
    from emgface.run.store import store_text
    from emgface.study.file import SHORT_PARAMETERS, study_template

    text = study_template(only=None if every else SHORT_PARAMETERS)
    if out_path is None:
        typer.echo(text, nl=False)
        return
    store_text(out_path, text)
    say(f"Wrote {out_path}.")


@app.command()
def run(
    path: Annotated[Path, typer.Argument(help="Study file (TOML).")],
    out_folder: Annotated[Path, typer.Option("--out", help="Folder of the results.")],
    workers: WorkersOption = None,
    scheduler: SchedulerOption = None,
    store: Annotated[
        Path | None,
        typer.Option(
            help="Folder of the stored results, which studies may share; default: in --out."
        ),
    ] = None,
    objects: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS",
            help="Object storage from which results are copied if it has them, and to which computed "
            "ones are copied, such as s3://bucket/folder.",
        ),
    ] = None,
    accuracy: AccuracyOption = None,
) -> None:
    """Run a study, or complete one that was interrupted.

    Ctrl-C and SIGTERM complete the trials that have begun; a second one stops at once.
    """
    from emgface.study.file import load_study

    configuration = _as_accurate(load_study(path), accuracy)
    with executing(workers, scheduler) as chosen:
        raise typer.Exit(_run(configuration, out_folder, chosen, store, objects))


@app.command()
def published(
    folder: Annotated[Path, typer.Argument(help="Folder with the recordings of the study.")],
    out_folder: Annotated[Path, typer.Option("--out", help="Folder of the results.")],
    mapping: MappingOption = None,
    offset: Annotated[
        float,
        typer.Option(help="Start of the clock of the markers on that of the EMG, in s."),
    ] = 0.0,
    face: FacePath = None,
    accuracy: AccuracyOption = None,
    contact: ContactSwitch = True,
    workers: WorkersOption = None,
    scheduler: SchedulerOption = None,
) -> None:
    """Run the study of Eskes et al. 2017 on its recordings, and compare it with the printed values.

    Files of EMG and of markers of the same volunteer, instruction and repetition are joined.
    """
    from emgface.study.published import join_recordings, published_study

    joined = join_recordings(folder, out_folder / "recordings", mapping=mapping, offset=offset)
    for text in joined.omitted:
        say(f"Omitted: {text}")
    say(f"Joined {len(joined.paths)} trials in {out_folder / 'recordings'}.")
    changes: dict[str, dict[str, object]] = {"face": {}, "simulation": {}}
    if face is not None:
        changes["face"]["path"] = face.resolve()
    if not contact:
        changes["simulation"]["contact"] = {"method": "none"}
    study = published_study(out_folder / "recordings", **changes)
    with executing(workers, scheduler) as chosen:
        code = _run(_as_accurate(study, accuracy), out_folder, chosen, None, None)
    _beside_printed(out_folder)
    raise typer.Exit(code)


def _beside_printed(folder: Path) -> None:
    """Print and write the comparison with the printed values."""
    from analysis.published import printed_statements, printed_table, used_stress
    from emgface.run.store import store_text
    from emgface.schema.netcdf import read_netcdf

    cube = read_netcdf(folder / "cube.nc", "cube")
    table = printed_table(cube)
    tell(table.text())
    store_text(folder / "tables" / "printed.csv", table.csv())
    store_text(folder / "tables" / "printed.md", visible(table.markdown()))
    for statement, verdict, numbers in printed_statements(cube):
        tell(f"Printed: {statement}. Here: {verdict} ({numbers}).")
    for volunteer, (low, high) in used_stress(cube).items():
        span = f"{low / 1e3:.4g}" if low == high else f"{low / 1e3:.4g} to {high / 1e3:.4g}"
        tell(f"sigma_max of {volunteer}: {span} kPa, lowered from 300 kPa; no value is printed.")


def _as_accurate(configuration: "StudyConfiguration", accuracy: str | None) -> "StudyConfiguration":
    """Study with the specified accuracy of its simulations."""
    if accuracy is None:
        return configuration
    simulation = configuration.simulation.as_accurate(accuracy)
    return configuration.model_copy(update={"simulation": simulation})


def _run(
    configuration: "StudyConfiguration",
    out_folder: Path,
    workers: "int | Workers",
    store: Path | None,
    objects: str | None,
) -> int:
    """Run a study, print its tables and return the exit code."""
    with graceful_stop() as stopping:
        result, report = _results(configuration, out_folder, workers, store, objects, stopping)
    tell(report.summary)
    for sentence in report.meaning:
        tell(sentence)
    computed, reused = len(result.computed()), len(result.events) - len(result.computed())
    say(f"{computed} results were computed, {reused} were already stored.")
    say(f"Cube: {result.path}. Tables: {report.folder}.")
    return _code(result, report)


def _results(
    configuration: "StudyConfiguration",
    out_folder: Path,
    workers: "int | Workers",
    store: Path | None = None,
    objects: str | None = None,
    stopping: Callable[[], bool] = lambda: False,
) -> "tuple[StudyResult, Report]":
    """Run a study and write its tables."""
    from emgface.report.study_tables import write_tables
    from emgface.study.run import run_study

    announce_compilation()
    with progress(f"study {configuration.name}") as bar:
        result = run_study(
            configuration,
            out_folder,
            workers=workers,
            observer=bar,
            store=store,
            objects=objects,
            stopping=stopping,
        )
    return result, write_tables(result.cube, out_folder)


def _code(result: "StudyResult", report: "Report") -> int:
    """Report the trials that failed, and return the exit code."""
    from analysis.axes import NOT_IN_DESIGN

    planned = result.cube["reason"].values != NOT_IN_DESIGN
    status = result.cube["status"].values[planned].tolist()
    n_ok = status.count("ok")
    for sentence in report.failures:
        say(sentence)
    if n_ok == 0:
        return BAD_INPUT
    done = n_ok + status.count("excluded")
    return PARTIAL if done < len(status) or result.unreadable else 0


def report(
    folder: Annotated[
        Path, typer.Argument(help="Folder of a study that contains cube.nc, or of a demonstration.")
    ],
    out_path: Annotated[
        Path | None, typer.Option("--out", help="Page to write, such as report.html.")
    ] = None,
    faces: Annotated[bool, typer.Option(help="Include the moving face.")] = True,
) -> None:
    """Print the tables of a finished study; with --out, write its report as one page."""
    from emgface.report.kept import KeptReport, study_folder

    folder = study_folder(folder)
    kept = KeptReport(folder)
    page = kept.page(out_path, faces=faces) if out_path is not None else None
    known = _tables(folder, kept)
    if page is not None:
        _wrote(page)
    elif out_path is not None:
        _page(folder, out_path, known, faces=faces)


def _tables(folder: Path, kept: "KeptReport") -> "Report | None":
    """Print the tables of a study and return them, or None if they were kept and are unchanged."""
    text, written = kept.text(), None
    if text is None:
        from emgface.report.results import study_cube
        from emgface.report.study_tables import write_tables

        written = write_tables(study_cube(folder), folder)
        text = "\n".join([*(table.text() for table in written.tables.values()), *written.meaning])
        kept.keep_text(text + "\n")
    tell(text.rstrip("\n"))
    say(f"Tables as CSV, Markdown and LaTeX: {folder / 'tables'}.")
    return written


def _page(folder: Path, out_path: Path, known: "Report | None", *, faces: bool = True) -> None:
    """Write the page of a study and print its path."""
    from emgface.report.write import write_page

    announce_compilation()
    with progress("moving faces") as bar:

        def show(label: str, done: int, total: int) -> None:
            bar.working(f"moving face {label}")
            bar.show(done, total)

        page = write_page(folder, out_path, faces=faces, known=known, say=show)
    _wrote(page)


def _wrote(page: "Page") -> None:
    for note in page.notes:
        say(note)
    say(f"Report: {page.path} ({page.size / 1e6:.1f} MB), can be opened without a network.")


def demo(
    out_folder: Annotated[Path, typer.Option("--out", help="Folder of the results.")] = Path(
        "emgface-demo"
    ),
    full: Annotated[
        bool, typer.Option("--full", help="All six instructions instead of pursing and smiling.")
    ] = False,
    accuracy: AccuracyOption = None,
) -> None:
    """Simulate two volunteers, run a study of them and write its report with the moving face."""
    from emgface.run.runner import kept_processes

    with kept_processes(cores(), ("emgface.volunteers.simulate", "emgface.study.outcomes")):
        raise typer.Exit(_demo(out_folder, full, accuracy))


def _demo(out_folder: Path, full: bool, accuracy: str | None) -> int:
    """Run the demonstration in the waiting processes and return the exit code."""
    from emgface.api.demonstration import SHORT, STRATEGY_WORDS, demo_study, demo_volunteers
    from emgface.face.file import save_face
    from emgface.files import write_text
    from emgface.muscles import INSTRUCTIONS
    from emgface.study.file import study_face, study_template

    plan = demo_study(out_folder, instructions=tuple(INSTRUCTIONS) if full else SHORT)
    plan, settings = _as_accurate(plan, accuracy), demo_volunteers()
    say(
        "Volunteers, sEMG and motion of this demonstration are simulated. The volunteers belong to the "
        f"{settings.world.label}: they differ from the assumptions of the study."
    )
    announce_compilation()
    _simulate_volunteers(plan, settings, out_folder)
    save_face(study_face(plan.face), out_folder / "face.nc")
    write_text(out_folder / "study.toml", study_template(plan))
    result, tables = _results(plan, out_folder / "study", cores())
    tell(tables.summary)
    for name, meaning in STRATEGY_WORDS.items():
        tell(f"{name}: {meaning}.")
    page = out_folder / "report.html"
    _page(out_folder / "study", page, tables)
    say(
        "The page shows the face of the study as the sEMG of each volunteer moves it, and next to it "
        "the recorded lip markers, for every instruction and strategy. The score rho is the "
        "correlation of the two motions in space: 1 means that they are equal except for their size."
    )
    say(
        f"To continue, change {out_folder / 'study.toml'}, for example its strategies, and run "
        f"'emgface study run {out_folder / 'study.toml'} --out {out_folder / 'changed'}'."
    )
    show_page(page)
    return _code(result, tables)


def _simulate_volunteers(
    plan: "StudyConfiguration", settings: "VolunteerParameters", out_folder: Path
) -> None:
    """Write the recordings of the demonstration, unless they exist, and a page of the first trial."""
    from emgface.api.demonstration import volunteers_digest
    from emgface.files import write_text
    from emgface.report.first_motion import FirstMotion
    from emgface.volunteers.simulate import make_volunteers

    folder = out_folder / "volunteers"
    mark, wanted = folder / "made_of.txt", volunteers_digest(plan, settings)
    n_files = len(list((folder / "recordings").glob("S??_?_1.nc")))
    made = mark.is_file() and mark.read_text(encoding="utf-8") == wanted
    if made and n_files >= 2 * len(plan.recordings.instructions):
        return
    mark.unlink(missing_ok=True)

    def ready(outcome: Path | Exception) -> None:
        if isinstance(outcome, Exception):
            say(f"The page of the first trial is omitted: {outcome}")
            return
        say(f"{outcome} shows the motion of the first trial.")
        show_page(outcome)

    page, at_same_time = out_folder / "first.html", cores() > 1
    first = FirstMotion(plan, out_folder / "study", page, ready, threaded=at_same_time)

    class Showing(Bar):
        """Progress bar that begins the page when the first recording exists."""

        def finished(self, label: str, status: str) -> None:
            """Advance by one, and begin the page of the first recording."""
            super().finished(label, status)
            first.begin(folder / "recordings" / f"{label.replace(' ', '_')}_1.nc")

    with progress("simulated volunteers", bar=Showing) as bar:
        make_volunteers(
            None,
            folder,
            n=2,
            instructions=plan.recordings.instructions,
            seed=plan.seed,
            parameters=plan.simulation,
            settings=settings,
            workers=cores(),
            observer=bar,
        )
    first.end()
    write_text(mark, wanted)
