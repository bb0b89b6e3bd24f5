"""``emgface fit``: a face of a person from landmarks and surfaces."""

from pathlib import Path
from typing import Annotated

import typer

from emgface.cli import options
from emgface.cli.console import progress, say
from emgface.cli.machine import announce_compilation

SurfaceHelp = "(.ply, .obj, .stl)"


def fit(
    landmarks: Annotated[
        Path, typer.Option(help="Landmarks by name (.csv, .mrk.json, .fcsv, .landmarkAscii).")
    ],
    out_path: Annotated[Path, typer.Option("--out", help="Face model to write (netCDF).")],
    face: options.FacePath = None,
    skin: Annotated[Path | None, typer.Option(help=f"Scan of the skin {SurfaceHelp}.")] = None,
    inner: Annotated[
        Path | None, typer.Option(help=f"Inner surface of the soft tissue {SurfaceHelp}.")
    ] = None,
    bone: Annotated[
        Path | None, typer.Option(help=f"Bones to which the tissue is fixed {SurfaceHelp}.")
    ] = None,
    unit: Annotated[
        str | None, typer.Option(help="Unit of files that do not state it: mm, cm or m.")
    ] = None,
    on_face: Annotated[
        Path | None,
        typer.Option(help="Places of the landmarks on the face that is fitted (as --landmarks)."),
    ] = None,
    noise: Annotated[float, typer.Option(help="Standard deviation of a landmark, in mm.")] = 0.8,
    thickness: Annotated[
        float,
        typer.Option(
            help="Thickness where no data determine it, in standard deviations from the expected one."
        ),
    ] = 0.0,
    name: Annotated[str | None, typer.Option(help="Name of the fitted face.")] = None,
    report: Annotated[
        Path | None, typer.Option(help="Page with distances, quality and uncertainty (HTML).")
    ] = None,
    simulated: Annotated[
        bool, typer.Option("--simulated", help="State that the inputs are simulated.")
    ] = False,
) -> None:
    """Fit a face to a person by landmarks and, if present, surfaces."""
    from emgface.api.given import face_of, study_of
    from emgface.face.file import save_face
    from emgface.fit.person import fit_face
    from emgface.fit.report import summary, write_report

    announce_compilation()
    with progress("fitting") as bar:

        def tell(label: str, done: int, total: int) -> None:
            bar.working(label)
            bar.show(done, total)

        fitted = fit_face(
            face_of(face, study_of(None)), landmarks, skin=skin, inner=inner, bone=bone, unit=unit,
            on_face=on_face, noise=1e-3 * noise, thickness=thickness,
            name=name or out_path.stem, simulated=simulated, progress=tell,
        )  # fmt: skip
    save_face(fitted.face, out_path)
    say(f"Wrote {out_path}.")
    if report is not None:
        write_report(fitted, report)
        say(f"Wrote {report}.")
    for sentence in (*fitted.notes, *summary(fitted)):
        say(sentence)
