"""``emgface jaw``: import or build a jaw model, move it by tasks, excitations or sEMG, and score it."""

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from emgface.cli import options
from emgface.cli.console import Rows, frame, progress, say, show_table
from emgface.cli.machine import announce_compilation
from emgface.cli.moved import ExcitationOption, PictureOption, tell_motion, write_picture

if TYPE_CHECKING:
    import xarray as xr

app = typer.Typer(
    no_args_is_help=True, help="Import, build, move and show models of jaw, hyoid and larynx."
)

JawPath = Annotated[Path, typer.Argument(help="Jaw model (netCDF).")]
BaselineOption = Annotated[
    list[Path] | None,
    typer.Option(
        "--baseline",
        help="Motion by other excitations, such as those of exchanged channels, that is scored "
        "likewise; repeatable.",
    ),
]
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
        shown = beside(given, motion, _motions(baseline))
    elif baseline or mapping:
        raise typer.BadParameter("--baseline and --mapping require a --recording")
    write_picture(
        path, out_path, lambda: jaw_page(motion, shown), lambda: jaw_figure(motion, shown)
    )


def _motions(paths: list[Path] | None) -> "dict[str, xr.Dataset]":
    from emgface.schema.netcdf import read_netcdf

    return {path.stem: read_netcdf(path, "jaw_motion") for path in paths or ()}


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
        if task is not None or series is not None:
            raise typer.BadParameter(
                "--excitation replaces the excitations of a --task and --series"
            )
        name, simulated = excitation.stem, partial(run_excitation, jaw, read_excitation(excitation))
    else:
        name = task or "rest"
        chosen, own = with_series(name, series)
        if series is not None and not own:
            raise typer.BadParameter(
                f"--series has no place in the task {name!r}: specify --task chew"
            )
        if chosen.series and not own:
            say("The excitations of chewing are chosen; --series reads published ones.")
        simulated = partial(run_task, jaw, chosen, **own)
    announce_compilation()
    with progress(f"simulating {name}") as bar:
        motion = simulated(progress=bar.show, **options)
    motion.attrs["task"] = name
    write_netcdf(motion, out_path, "jaw_motion")
    if absent := motion.attrs.get("absent_exciters"):
        say(f"The model has no exciter {absent}; the task is simulated without it.")
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
        told += f" It exceeds the desired one with the shortest steps, {shortest:.2g} ms."
    elif tolerance is None and error > 0.1 * moved:
        told += " It exceeds a tenth of the motion: specify an --accuracy such as '0.1 mm'."
    say(told)


@app.command()
def record(
    path: Annotated[Path, typer.Argument(help="Motion of a jaw (netCDF).")],
    out_path: Annotated[Path, typer.Option("--out", help="Recording to write (netCDF).")],
    person: Annotated[int, typer.Option(min=0, help="Seed of the person's amplitudes.")] = 0,
    repetition: Annotated[int, typer.Option(min=1, help="Seed of the signals.")] = 1,
) -> None:
    """Simulate a recording of a motion: sEMG of temporalis, masseter and digastric, and the incisor."""
    from emgface.anatomy.jaw.recorded import simulated_recording
    from emgface.recordings.dataset import write_recording
    from emgface.schema.netcdf import read_netcdf

    motion = read_netcdf(path, "jaw_motion")
    write_recording(simulated_recording(motion, person=person, repetition=repetition), out_path)
    say(f"Wrote {out_path}: simulated recording of {path.name}.")


@app.command()
def activate(
    path: Annotated[Path, typer.Argument(help="Recording with channels such as MAS_L.")],
    out_path: Annotated[Path, typer.Option("--out", help="Excitations to write (netCDF).")],
    reference: options.ReferenceOption = None,
    mapping: options.MappingOption = None,
    band: options.BandOption = None,
    feature: options.FeatureOption = None,
    clip: options.ClipOption = False,
) -> None:
    """Compute excitations of a jaw from the sEMG of temporalis, masseter and digastric."""
    from emgface.anatomy.jaw.emg import excitation_of
    from emgface.choices import configure
    from emgface.cli.options import chain_with
    from emgface.recordings.dataset import read_recording
    from emgface.schema.netcdf import write_netcdf
    from emgface.signals.parameters import SignalChain

    chain = chain_with(SignalChain(), band=band, feature=feature)
    if clip:
        values = chain.model_dump()
        values["normalisation"]["outside"] = "clip"
        chain = configure(SignalChain, values, where="options")
    given = (read_recording(one, mapping=mapping) for one in reference or ())
    excitation = excitation_of(read_recording(path, mapping=mapping), chain, reference=given)
    write_netcdf(excitation, out_path, "jaw_excitation")
    if passive := excitation.attrs["passive"]:
        say(f"No channel drives {passive}; these muscles are passive.")
    if not reference:
        say("Without --reference the strongest instant of every channel counts as full activity.")
    if (above := excitation.attrs["exceeded_fraction"]) > 0.0:
        say(f"{100.0 * above:.2g} % of the samples exceed maximum effort, and are limited.")
    if (below := excitation.attrs["clipped_fraction"] - above) > 1e-9:
        say(f"{100.0 * below:.2g} % lie below the rest of the reference, and are zero.")
    say(f"Wrote {out_path}: {excitation.sizes['exciter']} exciters.")


@app.command()
def score(
    recording: Annotated[Path, typer.Argument(help="Recording with positions of the jaw.")],
    motion: Annotated[Path, typer.Argument(help="Motion written by 'run'.")],
    out_path: Annotated[Path, typer.Option("--out", help="Scores to write (netCDF).")],
    mapping: options.MappingOption = None,
    baseline: BaselineOption = None,
) -> None:
    """Align the recorded points of a jaw with a motion, and score every one beside baselines."""
    from emgface.anatomy.jaw.compared import compared
    from emgface.anatomy.jaw.recorded import score_motion
    from emgface.recordings.dataset import read_recording
    from emgface.schema.netcdf import read_netcdf, write_netcdf

    given = read_recording(recording, mapping=mapping)
    moved = read_netcdf(motion, "jaw_motion")
    write_netcdf(score_motion(given, moved), out_path, "scores")
    table = compared(given, moved, _motions(baseline))
    heads = tuple(column.head() for column in table.columns)
    rows = (zip(table.columns, row, strict=True) for row in table.rows)
    cells = tuple(tuple(column.cell(value) for column, value in row) for row in rows)
    show_table(Rows(heads, cells), table.title)
    say(table.note)
    say(f"Wrote {out_path}.")


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
