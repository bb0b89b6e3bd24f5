"""``emgface jaw``: import a jaw model, and move it by tasks or excitations."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from emgface.cli.console import frame, progress, say, show_table
from emgface.cli.machine import announce_compilation

if TYPE_CHECKING:
    import xarray as xr

app = typer.Typer(
    no_args_is_help=True, help="Import, build, move and show models of jaw, hyoid and larynx."
)

JawPath = Annotated[Path, typer.Argument(help="Jaw model (netCDF).")]
SeriesOption = Annotated[
    Path | None,
    typer.Option(help="Folder of published series for a chewing task, such as probes/leftchew."),
]
StepOption = Annotated[float, typer.Option(help="Time step [s].")]


@app.command(name="import")
def import_(
    folder: Annotated[Path, typer.Argument(help="Data folder of the published jaw model.")],
    out_path: Annotated[Path, typer.Option("--out", help="Jaw model to write (netCDF).")],
    variant: Annotated[str, typer.Option(help="larynx (free hyoid) or fixed.")] = "larynx",
    condyle: Annotated[
        str | None, typer.Option(help="planar or curved; default: as published.")
    ] = None,
    values: Annotated[
        str, typer.Option(help="Masses and inertia of the text or of the program.")
    ] = "text",
) -> None:
    """Import the published model of jaw, hyoid and larynx."""
    from emgface.anatomy.jaw.published import import_jaw
    from emgface.schema.netcdf import write_netcdf

    jaw = import_jaw(
        folder,
        variant=variant,  # pyright: ignore[reportArgumentType]  # checked, with its own message
        condyle=condyle,  # pyright: ignore[reportArgumentType]
        values=values,  # pyright: ignore[reportArgumentType]
    )
    write_netcdf(jaw, out_path, "jaw_model")
    _say_written(jaw, out_path)


def _say_written(jaw: "xr.Dataset", out_path: Path) -> None:
    say(
        f"Wrote {out_path}: {jaw.attrs['name']}: {int(jaw['body_moves'].sum())} moving bodies, "
        f"{jaw.sizes['muscle']} muscles, {jaw.sizes['spring']} springs, {jaw.sizes['joint']} joints."
    )


@app.command()
def build(
    out_path: Annotated[Path, typer.Option("--out", help="Jaw model to write (netCDF).")],
    preset: Annotated[
        str,
        typer.Option(help="adult, woman, man, older_woman, older_man, girl or boy."),
    ] = "adult",
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set", help="Measure of face or jaw, such as condyle_width=98mm; repeatable."
        ),
    ] = None,
    seed: Annotated[
        int | None, typer.Option(min=0, help="Seed of a random person, as for the face.")
    ] = None,
) -> None:
    """Generate jaw, hyoid and larynx from published measures, of the same person as the face."""
    from emgface.anatomy.jaw.template import template_jaw
    from emgface.anatomy.jaw.template.measures import parse_settings
    from emgface.schema.netcdf import write_netcdf

    jaw = template_jaw(measures=parse_settings(settings or []), preset=preset, seed=seed)
    write_netcdf(jaw, out_path, "jaw_model")
    _say_written(jaw, out_path)


@app.command()
def show(
    path: Annotated[Path, typer.Argument(help="Motion of a jaw (netCDF).")],
    out_path: Annotated[
        Path | None,
        typer.Option(
            "--out", help="Page (html) or figure (png, svg, pdf); default: a page beside it."
        ),
    ] = None,
) -> None:
    """Write the page of a motion: bones, muscles by activation, paths and forces."""
    from analysis.figures.style import save
    from emgface.anatomy.jaw.picture import jaw_figure, jaw_page
    from emgface.files import write_text
    from emgface.pictures.show import PAGES
    from emgface.schema.netcdf import read_netcdf

    motion = read_netcdf(path, "jaw_motion")
    out_path = out_path or path.with_suffix(".html")
    if out_path.suffix.lower() in PAGES:
        write_text(out_path, jaw_page(motion))
    else:
        save(jaw_figure(motion), out_path)
    say(f"Wrote {out_path}.")


@app.command()
def run(
    path: JawPath,
    out_path: Annotated[Path, typer.Option("--out", help="Motion to write (netCDF).")],
    task: Annotated[
        str | None,
        typer.Option(
            help="rest, close, open, open_head, gape, protrude, lateral, clench, chew, swallow or pull."
        ),
    ] = None,
    excitation: Annotated[
        Path | None,
        typer.Option(help="Excitations (csv, nc) with a column time and one per exciter."),
    ] = None,
    series: SeriesOption = None,
    duration: Annotated[float | None, typer.Option(help="Simulated time [s].")] = None,
    law: Annotated[
        str, typer.Option(help="Muscle law: peck, hill, pennate, spring or constant.")
    ] = "peck",
    step: StepOption = 1e-3,
) -> None:
    """Move a jaw by a task or by excitations."""
    from emgface.anatomy.jaw.run import run_task
    from emgface.anatomy.jaw.series import read_excitation
    from emgface.anatomy.jaw.tasks import Task, with_series
    from emgface.schema.netcdf import read_netcdf, write_netcdf

    jaw = read_netcdf(path, "jaw_model")
    if excitation is not None:
        given = read_excitation(excitation)
        chosen, name = Task(excitation.stem, float(given.time[-1])), excitation.stem
        options: dict[str, object] = {"excitation": given}
    else:
        name = task or "rest"
        chosen, options = with_series(name, series)
    options |= {"law": law, "step": step} | ({} if duration is None else {"duration": duration})
    announce_compilation()
    with progress(f"simulating {name}") as bar:
        motion = run_task(jaw, chosen, progress=bar.show, **options)
    motion.attrs["task"] = name
    write_netcdf(motion, out_path, "jaw_motion")
    clipped = motion.attrs["clipped_excitation"]
    if clipped < 0.0:
        say(f"Negative excitations, down to {clipped:.3g}, were set to zero.")
    say(f"Wrote {out_path}: {name} of the {jaw.attrs['name']}, simulated.")


@app.command()
def tasks(
    path: JawPath,
    out_path: Annotated[Path | None, typer.Option("--out", help="Table to write (csv).")] = None,
    series: SeriesOption = None,
    step: StepOption = 1e-3,
) -> None:
    """Run all tasks, and compare their outcome with the published one."""
    from emgface.anatomy.jaw.outcomes import outcome_table
    from emgface.files import write_text
    from emgface.schema.netcdf import read_netcdf

    jaw = read_netcdf(path, "jaw_model")
    announce_compilation()
    with progress("simulating tasks") as bar:
        table = outcome_table(jaw, series, step=step, progress=bar.show)
    show_table(frame(table), f"{jaw.attrs['name']}, simulated")
    if out_path is not None:
        write_text(out_path, table.to_csv(index=False))
