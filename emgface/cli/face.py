"""``emgface face``: import, generate, examine and draw face models."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from emgface.cli.console import frame, say, show_table

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
        float, typer.Option(help="Distance from a fibre within which elements are muscle [m].")
    ] = 5e-3,
    oop: Annotated[
        str, typer.Option(help="Elements of OOP: oldoop, active, block or radius.")
    ] = "oldoop",
    oom: Annotated[str, typer.Option(help="Elements of OOM: active or radius.")] = "active",
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
    resolution: Annotated[
        str, typer.Option(help="coarse, medium, fine, or the approximate number of elements.")
    ] = "medium",
    preset: Annotated[
        str,
        typer.Option(help="adult, woman, man, older_woman, older_man, girl or boy."),
    ] = "adult",
    settings: Annotated[
        list[str] | None,
        typer.Option("--set", help="Measure of the face, such as mouth_width=52mm; repeatable."),
    ] = None,
    seed: Annotated[
        int | None,
        typer.Option(
            min=0,
            help="Seed for drawing a random person of the group; default: the means of the group.",
        ),
    ] = None,
) -> None:
    """Generate a lower face from published measures, at any resolution."""
    from emgface.face.file import save_face
    from emgface.face.template import parse_measures, template_face

    face = template_face(
        resolution=int(resolution) if resolution.isdecimal() else resolution,
        measures=parse_measures(settings or []),
        preset=preset,
        seed=seed,
    )
    save_face(face, out_path)
    _say_written(face, out_path)


@app.command()
def check(path: FacePath) -> None:
    """Count and measure a face model; fail if it cannot be simulated."""
    from emgface.face.check import face_report
    from emgface.face.file import load_face

    face = load_face(path)
    report = face_report(face)
    show_table(frame(report.summary), f"{face.attrs['name']} ({face.attrs['origin']})")
    show_table(frame(report.muscles), "muscles, volumes in mm3")


def _say_written(face: "xr.Dataset", path: Path) -> None:
    say(
        f"Wrote {path}: {face.attrs['name']}, {face.attrs['origin']}: {face.sizes['node']} nodes, "
        f"{face.sizes['element']} elements, {int((face['fixed'] > 0).sum())} fixed nodes."
    )
