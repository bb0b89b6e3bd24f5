"""``emgface fit``: a face, jaw or tongue of a person from landmarks, surfaces and labelled images."""

from pathlib import Path
from typing import Annotated

import typer

from emgface.cli.console import progress, say
from emgface.cli.machine import announce_compilation

SurfaceHelp = "(.ply, .obj, .stl)"


def fit(
    out_path: Annotated[Path, typer.Option("--out", help="Fitted model to write (netCDF).")],
    landmarks: Annotated[
        Path | None,
        typer.Option(help="Landmarks by name (.csv, .mrk.json, .fcsv, .landmarkAscii)."),
    ] = None,
    model: Annotated[
        Path | None,
        typer.Option(
            "--model",
            "--face",
            help="Face, jaw or tongue that is fitted, or face, jaw or tongue for the generated one; "
            "default: face.",
        ),
    ] = None,
    skin: Annotated[Path | None, typer.Option(help=f"Scan of the skin {SurfaceHelp}.")] = None,
    inner: Annotated[
        Path | None, typer.Option(help=f"Inner surface of the soft tissue {SurfaceHelp}.")
    ] = None,
    bone: Annotated[
        Path | None, typer.Option(help=f"Bones to which the tissue is fixed {SurfaceHelp}.")
    ] = None,
    surfaces: Annotated[
        list[str] | None,
        typer.Option(
            "--surface",
            metavar="PART=FILE",
            help=f"Surface of a part, such as jaw=jaw.stl or tongue=tongue.stl {SurfaceHelp}; "
            "repeatable.",
        ),
    ] = None,
    labels: Annotated[
        Path | None,
        typer.Option(
            help="Labelled volume (NIfTI, NRRD, or a folder of DICOM) whose labels become surfaces."
        ),
    ] = None,
    label: Annotated[
        list[str] | None,
        typer.Option(
            metavar="PART=NUMBERS",
            help="Part and its labels in the volume, such as skin=1,2,3 or jaw=4; repeatable.",
        ),
    ] = None,
    course: Annotated[
        list[str] | None,
        typer.Option(
            metavar="MUSCLE=FILE",
            help="Tractography (.trk, .tck) that replaces the course of a muscle of a face, such as "
            "ZYG_L=zygomaticus.trk; repeatable.",
        ),
    ] = None,
    volume: Annotated[
        list[str] | None,
        typer.Option(
            metavar="MUSCLE=CM3",
            help="Volume of a muscle with a new course, such as ZYG_L=2.1; default: by the spread of "
            "its bundle; repeatable.",
        ),
    ] = None,
    unit: Annotated[
        str | None, typer.Option(help="Unit of files that do not state it: mm, cm or m.")
    ] = None,
    on_face: Annotated[
        Path | None,
        typer.Option(
            "--on-face",
            "--on-model",
            help="Places of the landmarks on the model that is fitted (as --landmarks).",
        ),
    ] = None,
    frame: Annotated[
        Path | None,
        typer.Option(
            help="Fitted model of the same person: the face (for a jaw) or the jaw (for a tongue)."
        ),
    ] = None,
    before: Annotated[
        Path | None,
        typer.Option(
            help="Jaw from which that of --frame was fitted (for a tongue); default: the generated one."
        ),
    ] = None,
    rim: Annotated[
        bool,
        typer.Option(
            "--rim", help="The surfaces end at the rim of the face, as those of another mesh do."
        ),
    ] = False,
    noise: Annotated[float, typer.Option(help="Standard deviation of a landmark, in mm.")] = 0.8,
    thickness: Annotated[
        float,
        typer.Option(
            help="Thickness where no data determine it, in standard deviations from the expected one."
        ),
    ] = 0.0,
    name: Annotated[str | None, typer.Option(help="Name of the fitted model.")] = None,
    report: Annotated[
        Path | None, typer.Option(help="Page with distances, quality and uncertainty (HTML).")
    ] = None,
    simulated: Annotated[
        bool, typer.Option("--simulated", help="State that the inputs are simulated.")
    ] = False,
) -> None:
    """Fit a face, jaw or tongue to a person by landmarks and, if present, surfaces."""
    from emgface.models.kinds import MODEL_KINDS, Evidence, Person, kind_of_model

    given: dict[str, object] = dict(parts_of("--surface", surfaces))
    if labels is not None or label:
        from emgface.fit.readers.volumes import labels_by_part, surfaces_of_labels

        if labels is None or not label:
            raise typer.BadParameter(
                "--labels and --label belong together, expected a volume and at least one part such as "
                "skin=1: specify both"
            )
        given |= surfaces_of_labels(labels, labels_by_part(parts_of("--label", label)))
    given |= {
        k: v for k, v in {"skin": skin, "inner": inner, "bone": bone}.items() if v is not None
    }
    path = model or Path("face")
    generated = not path.exists() and str(path) in MODEL_KINDS
    kind = MODEL_KINDS[str(path)] if generated else kind_of_model(path)
    announce_compilation()
    with progress("fitting") as bar:

        def tell(what: str, done: int, total: int) -> None:
            bar.working(what)
            bar.show(done, total)

        fitted = kind.fit(
            kind.build(Person()) if generated else kind.functions.read(path),
            Evidence(
                landmarks=landmarks, places=on_face, surfaces=given, unit=unit, rim=rim,
                noise=1e-3 * noise,
                thickness=thickness, frame=frame, before=before,
                courses=parts_of("--course", course) or None, volumes=_volumes(volume),
                name=name or out_path.stem, simulated=simulated,
            ),
            tell,
        )  # fmt: skip
    if report is not None and fitted.report is None:
        raise typer.BadParameter(
            f"--report {report} would show the fit to landmarks and surfaces, but only courses of "
            "muscles are given: leave the report out, or fit to landmarks in the same command"
        )
    kind.functions.write(fitted.model, out_path)
    say(f"Wrote {out_path}.")
    if report is not None and fitted.report is not None:
        fitted.report(report)
        say(f"Wrote {report}.")
    for sentence in fitted.notes:
        say(sentence)


def _volumes(given: list[str] | None) -> dict[str, float] | None:
    """Volumes [m3] by muscle, of options in cm3."""
    volumes: dict[str, float] = {}
    for muscle, text in parts_of("--volume", given).items():
        try:
            volumes[muscle] = 1e-6 * float(text)
        except ValueError:
            raise typer.BadParameter(
                f"--volume {muscle}={text}: expected a volume in cm3, such as {muscle}=2.1"
            ) from None
    return volumes or None


def parts_of(option: str, given: list[str] | None) -> dict[str, str]:
    """Text by part, of options such as jaw=jaw.stl."""
    texts: dict[str, str] = {}
    for text in given or []:
        part, equals, value = (one.strip() for one in text.partition("="))
        if not (part and equals and value):
            raise typer.BadParameter(
                f"{option} {text}: expected PART and a value, such as jaw=jaw.stl or jaw=4"
            )
        texts[part] = value
    return texts
