"""``emgface face``: import, generate, examine and draw face models."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from emgface.cli import options
from emgface.cli.console import frame, progress, say, show_table
from emgface.cli.machine import announce_compilation

if TYPE_CHECKING:
    import xarray as xr

app = typer.Typer(no_args_is_help=True, help="Import, build, check and show face models.")
importing = typer.Typer(no_args_is_help=True, help="Import a face model from published geometry.")
app.add_typer(importing, name="import")

FacePath = Annotated[Path, typer.Argument(help="Face model (netCDF).")]


@importing.command()
def artisynth(
    folder: Annotated[
        Path, typer.Argument(help="Checkout of artisynth_models, or folder with its files.")
    ],
    out_path: Annotated[Path, typer.Option("--out", help="Face model to write (netCDF).")],
    radius: Annotated[
        float, typer.Option(help="Distance from a fibre within which elements are muscle, in m.")
    ] = 5e-3,
    oop: Annotated[
        str,
        typer.Option(
            help="Rule by which the elements of orbicularis oris peripheralis (OOP) are "
            "selected: oldoop, active, block or radius."
        ),
    ] = "oldoop",
    oom: Annotated[
        str,
        typer.Option(
            help="Rule by which the elements of orbicularis oris marginalis (OOM) are selected: "
            "active or radius."
        ),
    ] = "active",
    lao: Annotated[str, typer.Option(help="Fibres of LAO: both or lateral.")] = "both",
    marker_ring_offset: Annotated[
        int, typer.Option(help="Move the lip markers outwards by this many rings of nodes.")
    ] = 0,
    bones: Annotated[
        str, typer.Option(help="Teeth for contact: whole (closed), or patch (facing the lips).")
    ] = "whole",
) -> None:
    """Import the published reference face."""
    from emgface.face.artisynth import import_artisynth
    from emgface.face.file import save_face

    face = import_artisynth(
        folder,
        radius=radius,
        oop=oop,  # pyright: ignore[reportArgumentType]  # checked, with its own message
        oom=oom,  # pyright: ignore[reportArgumentType]
        lao_fibres=lao,  # pyright: ignore[reportArgumentType]
        marker_ring_offset=marker_ring_offset,
        bones=bones,  # pyright: ignore[reportArgumentType]
    )
    save_face(face, out_path)
    _say_written(face, out_path)


@app.command()
def build(
    out_path: Annotated[Path, typer.Option("--out", help="Face model to write (netCDF).")],
    resolution: options.ResolutionOption = "medium",
    preset: options.PresetOption = "adult",
    settings: options.MeasureOption = None,
    seed: options.SeedOption = None,
) -> None:
    """Generate a lower face from published measures, at any resolution."""
    from emgface.face.file import save_face
    from emgface.face.template import parse_measures, template_face

    face = template_face(
        resolution=options.mesh_size(resolution),
        measures=parse_measures(settings or []),
        preset=preset,
        seed=seed,
    )
    save_face(face, out_path)
    _say_written(face, out_path)


@app.command()
def check(path: FacePath) -> None:
    """Report counts and measures of a face model; fail if it cannot be simulated."""
    from emgface.face.check import face_report
    from emgface.face.file import load_face

    face = load_face(path)
    report = face_report(face)
    show_table(frame(report.summary), f"{face.attrs['name']} ({face.attrs['origin']})")
    show_table(frame(report.muscles), "muscles, volumes in mm3")


@app.command()
def reduce(
    path: FacePath,
    out_path: Annotated[Path, typer.Option("--out", help="Reduced face to write (netCDF).")],
    study: options.StudyPath = None,
    sigma_max: Annotated[
        float | None,
        typer.Option(
            help="Largest muscle stress of the training, which later simulations must not exceed [Pa]."
        ),
    ] = None,
    modes: Annotated[int | None, typer.Option(help="Number of modes, a multiple of three.")] = None,
    elements: Annotated[
        int | None, typer.Option(help="Largest number of elements with a weight.")
    ] = None,
    sequences: Annotated[
        int | None, typer.Option(help="Number of sequences of the training.")
    ] = None,
    calibration: Annotated[
        int | None, typer.Option(help="Number of sequences that calibrate the bound of the error.")
    ] = None,
    ramps: Annotated[bool, typer.Option(help="Also train with ramps of each muscle.")] = True,
    seed: Annotated[int | None, typer.Option(help="Seed of the sequences.")] = None,
    activations: Annotated[
        str | None,
        typer.Option(help="Sequences of the training: study (default) or random."),
    ] = None,
    contact: options.ContactSwitch = True,
) -> None:
    """Train a reduced face; a repeated command reuses the stored training motions."""
    import emgface as ef
    from emgface.schema.netcdf import write_netcdf

    given = {"modes": modes, "elements": elements, "seed": seed}
    options: dict[str, Any] = {name: v for name, v in given.items() if v is not None}
    if sigma_max is not None:
        options["sigma_max"] = sigma_max
    plan: dict[str, Any] = {
        "activations": activations,
        "sequences": sequences,
        "calibration": calibration,
        "ramps": None if ramps else False,
    }
    options["training"] = {name: v for name, v in plan.items() if v is not None}
    if not contact:
        options["contact"] = {"method": "none"}
    announce_compilation()
    with progress("training") as bar:

        def tell(label: str, done: int, total: int) -> None:
            bar.working(label)
            bar.show(done, total)

        reduced = ef.reduce(
            path, study=study, folder=out_path.with_suffix(".training"), progress=tell, **options
        )
    write_netcdf(reduced, out_path, "reduced_face")
    a = reduced.attrs
    say(
        f"Wrote {out_path}: {a['moving']} modes, {reduced.sizes['sample']} elements, from "
        f"{a['training_seconds']:.0f} simulated seconds in {a['training_time_s']:.0f} s. Markers in "
        f"the calibration: {1e3 * a['calibration_rms']:.2g} mm rms, at most "
        f"{1e3 * a['calibration_largest']:.2g} mm from full order."
    )


def _say_written(face: "xr.Dataset", path: Path) -> None:
    say(
        f"Wrote {path}: {face.attrs['name']}, {face.attrs['origin']}: {face.sizes['node']} nodes, "
        f"{face.sizes['element']} elements, {int((face['fixed'] > 0).sum())} fixed nodes."
    )
