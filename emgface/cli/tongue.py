"""``emgface tongue``: import or build a tongue, move it by excitations, and show its motion."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from emgface.cli import options
from emgface.cli.console import frame, progress, say, show_table
from emgface.cli.machine import announce_compilation
from emgface.cli.moved import PictureOption, check_drive, tell_motion, write_picture

if TYPE_CHECKING:
    import xarray as xr

app = typer.Typer(no_args_is_help=True, help="Import, build, move and show models of the tongue.")

TonguePath = Annotated[Path, typer.Argument(help="Tongue model (netCDF).")]
VariantOption = Annotated[
    str,
    typer.Option(
        help="elements (active stress), lines (axial forces, constant volumes), linear or stable."
    ),
]
StepOption = Annotated[float, typer.Option(help="Largest time step in s.")]


@app.command(name="import")
def import_(
    folder: Annotated[Path, typer.Argument(help="Data folder of the published tongue.")],
    out_path: Annotated[Path, typer.Option("--out", help="Tongue model to write (netCDF).")],
    forces: Annotated[
        str, typer.Option(help="Muscle forces: standard, or strong (about 1.8 times as large).")
    ] = "standard",
    rest: Annotated[
        str | None,
        typer.Option(help="Stored shape that is used as the shape at rest, such as rest_il01."),
    ] = None,
) -> None:
    """Import the published hexahedral tongue."""
    from emgface.anatomy.tongue.published import import_tongue
    from emgface.schema.netcdf import write_netcdf

    tongue = import_tongue(
        folder,
        forces=forces,  # pyright: ignore[reportArgumentType]  # checked, with its own message
        rest=rest,
    )
    write_netcdf(tongue, out_path, "tongue_model")
    _say_written(tongue, out_path)


def _say_written(tongue: "xr.Dataset", out_path: Path) -> None:
    say(
        f"Wrote {out_path}: {tongue.attrs['name']}: {tongue.sizes['element']} elements, "
        f"{tongue.sizes['muscle']} muscles, {tongue.sizes['attachment']} attached nodes."
    )


@app.command()
def build(
    out_path: Annotated[Path, typer.Option("--out", help="Tongue model to write (netCDF).")],
    preset: options.PresetOption = "adult",
    resolution: options.ResolutionOption = "medium",
    settings: options.MeasureOption = None,
    seed: options.SeedOption = None,
) -> None:
    """Generate the tongue of the person of a generated face and jaw."""
    from emgface.anatomy.jaw.template.measures import parse_settings
    from emgface.anatomy.tongue.template import template_tongue
    from emgface.schema.netcdf import write_netcdf

    tongue = template_tongue(
        resolution=options.mesh_size(resolution),
        measures=parse_settings(settings or []),
        preset=preset,
        seed=seed,
    )
    write_netcdf(tongue, out_path, "tongue_model")
    _say_written(tongue, out_path)


@app.command()
def simulate(
    path: TonguePath,
    out_path: Annotated[Path, typer.Option("--out", help="Motion to write (netCDF).")],
    excitation: Annotated[
        Path | None,
        typer.Option(
            help="Excitations (csv, nc) with a column time and one per exciter, or a published "
            "gesture (txt)."
        ),
    ] = None,
    muscle: Annotated[
        list[str] | None,
        typer.Option(help="Exciter that rises and falls, such as bi_GGP or SL; repeatable."),
    ] = None,
    level: Annotated[
        float, typer.Option(min=0, max=1, help="Largest excitation of --muscle.")
    ] = 0.3,
    duration: Annotated[float | None, typer.Option(help="Simulated time in s.")] = None,
    variant: VariantOption = "elements",
    gravity: Annotated[bool, typer.Option(help="Simulate gravity.")] = True,
    step: StepOption = 5e-3,
) -> None:
    """Move a tongue by excitations; jaw and hyoid do not move."""
    from emgface.anatomy.jaw.series import read_excitation
    from emgface.anatomy.tongue.actions import DURATION, raised
    from emgface.anatomy.tongue.parameters import variant as variant_of
    from emgface.anatomy.tongue.published import read_gesture
    from emgface.anatomy.tongue.run import OUTPUT, simulate_tongue
    from emgface.schema.netcdf import read_netcdf, write_netcdf

    check_drive(muscle, excitation)
    tongue, name = read_netcdf(path, "tongue_model"), " and ".join(muscle or []) or "rest"
    if excitation is None:
        duration = DURATION if duration is None else duration
        drive = raised(*(muscle or []), level=level, duration=duration)
    else:
        read = read_gesture if excitation.suffix == ".txt" else read_excitation
        drive, name = read(excitation), excitation.stem
        if duration is None:
            duration = OUTPUT * int(float(drive.time[-1]) / OUTPUT + 1e-9)  # whole outputs
    parameters = variant_of(variant, gravity=gravity)
    announce_compilation()
    with progress(f"simulating {name}") as bar:
        motion = simulate_tongue(
            tongue, drive, duration=duration, parameters=parameters, step=step, progress=bar.show
        )
    motion.attrs["task"] = name
    write_netcdf(motion, out_path, "tongue_motion")
    tell_motion(motion, out_path, tongue.attrs["name"])


@app.command()
def show(
    path: Annotated[Path, typer.Argument(help="Motion of a tongue (netCDF).")],
    out_path: PictureOption = None,
) -> None:
    """Write the page of a motion: the left half, fibres by activation, contours and volume."""
    from emgface.anatomy.tongue.picture import tongue_figure, tongue_page
    from emgface.schema.netcdf import read_netcdf

    motion = read_netcdf(path, "tongue_motion")
    write_picture(path, out_path, lambda: tongue_page(motion), lambda: tongue_figure(motion))


@app.command()
def muscles(
    path: TonguePath,
    out_path: Annotated[Path | None, typer.Option("--out", help="Table to write (csv).")] = None,
    variant: VariantOption = "elements",
    level: Annotated[float, typer.Option(help="Largest excitation.")] = 0.3,
    step: StepOption = 5e-3,
) -> None:
    """Raise and release every muscle, and tabulate how tip, back, size and volume change."""
    from emgface.anatomy.tongue.actions import action_table
    from emgface.anatomy.tongue.parameters import variant as variant_of
    from emgface.files import write_text
    from emgface.schema.netcdf import read_netcdf

    tongue = read_netcdf(path, "tongue_model")
    announce_compilation()
    with progress("simulating muscles") as bar:
        table = action_table(tongue, variant_of(variant), level=level, step=step, progress=bar.show)
    show_table(frame(table), f"{tongue.attrs['name']}, simulated, mm")
    if out_path is not None:
        write_text(out_path, table.to_csv(index=False))
