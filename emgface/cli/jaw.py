"""``emgface jaw``: import or build a jaw model, move it by tasks, excitations or sEMG, and score it."""

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from emgface.cli import options
from emgface.cli.console import frame, progress, say, show_table
from emgface.cli.jaw_recorded import BaselineOption, motions_of
from emgface.cli.machine import announce_compilation
from emgface.cli.moved import ExcitationOption, PictureOption, tell_motion, write_picture

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
StepOption = Annotated[float, typer.Option(help="Time step in s.")]


@app.command(name="import")
def import_(
    folder: Annotated[Path, typer.Argument(help="Data folder of the published jaw model.")],
    out_path: Annotated[Path, typer.Option("--out", help="Jaw model to write (netCDF).")],
    variant: Annotated[str, typer.Option(help="larynx (free hyoid) or fixed.")] = "larynx",
    condyle: Annotated[
        str | None,
        typer.Option(help="Path of the condyles: planar or curved; default: as published."),
    ] = None,
    values: Annotated[
        str,
        typer.Option(help="Source of masses and inertia: text (of the publication) or program."),
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
    preset: options.PresetOption = "adult",
    settings: options.MeasureOption = None,
    seed: options.SeedOption = None,
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
    out_path: PictureOption = None,
    recording: Annotated[
        Path | None,
        typer.Option(help="Recording whose points are shown and scored beside the motion."),
    ] = None,
    mapping: options.MappingOption = None,
    baseline: BaselineOption = None,
) -> None:
    """Write the page of a motion: bones, muscles by activation, paths and forces."""
    from emgface.anatomy.jaw.compared import beside
    from emgface.anatomy.jaw.picture import jaw_figure, jaw_page
    from emgface.recordings.dataset import read_recording
    from emgface.schema.netcdf import read_netcdf

    motion, shown = read_netcdf(path, "jaw_motion"), None
    if recording is not None:
        given = read_recording(recording, mapping=mapping)
        shown = beside(given, motion, motions_of(baseline))
    elif baseline or mapping:
        raise typer.BadParameter("--baseline and --mapping require a --recording")
    write_picture(
        path, out_path, lambda: jaw_page(motion, shown), lambda: jaw_figure(motion, shown)
    )


@app.command()
def run(
    path: JawPath,
    out_path: Annotated[Path, typer.Option("--out", help="Motion to write (netCDF).")],
    task: Annotated[
        str | None,
        typer.Option(
            help="rest, close, open, open_head, gape, protrude, lateral, clench, effort, cycles, chew, "
            "swallow or pull."
        ),
    ] = None,
    excitation: ExcitationOption = None,
    series: SeriesOption = None,
    morsel: Annotated[
        str | None,
        typer.Option(help="Side of the morsel: L, R or none; by default that of the --series."),
    ] = None,
    duration: Annotated[float | None, typer.Option(help="Simulated time in s.")] = None,
    law: Annotated[
        str, typer.Option(help="Muscle law: peck, hill, pennate, spring or constant.")
    ] = "peck",
    step: StepOption = 1e-3,
    accuracy: Annotated[
        str | None,
        typer.Option(
            help="Desired error of the points, such as '0.1 mm': steps are halved until the estimated "
            "error is below it."
        ),
    ] = None,
) -> None:
    """Move a jaw by a task or by excitations."""
    from emgface.anatomy.jaw.run import run_excitation, run_task
    from emgface.anatomy.jaw.series import read_excitation
    from emgface.anatomy.jaw.tasks import with_series
    from emgface.schema.netcdf import read_netcdf, write_netcdf

    jaw = read_netcdf(path, "jaw_model")
    tolerance = _tolerance(accuracy)
    options: dict[str, object] = {"law": law, "step": step, "tolerance": tolerance}
    options |= {} if duration is None else {"duration": duration}
    if excitation is not None:
        if task is not None or series is not None or morsel is not None:
            raise typer.BadParameter(
                "--excitation replaces the excitations of a --task and --series, and has no --morsel"
            )
        name, simulated = excitation.stem, partial(run_excitation, jaw, read_excitation(excitation))
    else:
        name = task or "rest"
        chosen, own = with_series(name, series, morsel=morsel)
        if series is not None and not own:
            raise typer.BadParameter(
                f"--series cannot be used with the task {name!r}: specify --task chew"
            )
        if chosen.series and not own:
            say(
                "The excitations of chewing are chosen, not measured; --series reads published ones."
            )
        simulated = partial(run_task, jaw, chosen, **own)
    announce_compilation()
    with progress(f"simulating {name}") as bar:
        motion = simulated(progress=bar.show, **options)
    motion.attrs["task"] = name
    write_netcdf(motion, out_path, "jaw_motion")
    if absent := motion.attrs.get("absent_exciters"):
        say(f"The model has no exciter {absent}; the task is simulated without it.")
    if side := motion.attrs.get("morsel"):
        say(f"The morsel is on the {'left' if side == 'L' else 'right'} side.")
    _tell_unrest(motion)
    _tell_error(motion, tolerance)
    tell_motion(motion, out_path, jaw.attrs["name"])


def _tolerance(accuracy: str | None) -> float | None:
    from emgface.errors import JawError
    from emgface.face.accuracy import desired_error

    if accuracy is None:
        return None
    found = desired_error(accuracy)
    if found is None:
        raise JawError(f"accuracy = {accuracy!r}, expected an error such as '0.1 mm'")
    return found


def _tell_unrest(motion: "xr.Dataset") -> None:
    """Report the speed of the jaw at the end of a task that should end at rest."""
    from emgface.anatomy.jaw.run import STILL

    speed = motion.attrs.get("end_speed", 0.0)
    if speed > STILL:
        end = float(motion["time"][-1])
        say(
            f"At the end, {end:.4g} s, a point still moves at {1e3 * speed:.2g} mm/s, although the "
            "task should end at rest: specify a longer --duration."
        )


def _tell_error(motion: "xr.Dataset", tolerance: float | None) -> None:
    """Report the estimated error, and how to reduce it if it is large."""
    import numpy as np

    error, x = motion.attrs["numerical_error"], motion["position"]
    moved = float(np.sqrt(((x - x.isel(time=0)) ** 2).sum("axis")).max())
    told = f"Estimated error of the time steps: {1e3 * error:.2g} mm"
    told += f", {100.0 * error / moved:.2g} % of the motion." if moved > 0.0 else "."
    if tolerance is not None and error > tolerance:
        shortest = 1e3 * motion.attrs["step_s"]
        told += f" It exceeds the desired error even with the shortest steps, {shortest:.2g} ms."
    elif tolerance is None and error > 0.1 * moved:
        told += " It exceeds a tenth of the motion: specify an --accuracy such as '0.1 mm'."
    say(told)


@app.command()
def tasks(
    path: JawPath,
    out_path: Annotated[Path | None, typer.Option("--out", help="Table to write (csv).")] = None,
    series: SeriesOption = None,
    step: StepOption = 1e-3,
) -> None:
    """Run all tasks, and compare the results with the published ones."""
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
