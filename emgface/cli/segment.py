"""``emgface segment``: labels of the parts of a head in images, from a file of clicks."""

from pathlib import Path
from typing import Annotated

import typer

from emgface.cli.console import frame, progress, say, show_table
from emgface.cli.fit import parts_of


def segment(
    paths: Annotated[
        list[Path],
        typer.Argument(
            metavar="IMAGE...",
            help="Image (NIfTI, NRRD, MetaImage, or a folder of DICOM), or stacks of several planes.",
        ),
    ],
    clicks: Annotated[
        Path,
        typer.Option(
            help="Points inside the parts, named as 'jaw 1' (.csv, .mrk.json, .fcsv, "
            ".landmarkAscii)."
        ),
    ],
    label: Annotated[
        list[str],
        typer.Option(metavar="PART=NUMBER", help="Part and its label, such as jaw=4; repeatable."),
    ],
    out_path: Annotated[Path, typer.Option("--out", help="Labels to write (.nii.gz, .nrrd).")],
    fiducials: Annotated[
        list[Path] | None,
        typer.Option(help="Points that stacks have in common, a file for each stack; repeatable."),
    ] = None,
    spacing: Annotated[
        float, typer.Option(help="Distance of voxels of joined stacks, in mm.")
    ] = 1.0,
    bias: Annotated[
        bool, typer.Option("--bias", help="Remove the bias field of the coils (N4).")
    ] = False,
    unit: Annotated[
        str | None, typer.Option(help="Unit of points that do not state it: mm, cm or m.")
    ] = None,
    picture: Annotated[
        Path | None, typer.Option(help="Slices with the outlines of the parts (.png, .svg).")
    ] = None,
) -> None:
    """Label parts of a head in images around clicks, for 'emgface fit --labels'."""
    from emgface.fit.segment import (
        ending_of_labels,
        segmentation_figure,
        segmented,
        write_labels,
    )
    from emgface.pictures.stills import write_figure

    ending_of_labels(out_path)
    with progress("segmenting") as bar:
        bar.working("regions around the clicks")
        segmentation = segmented(
            paths, clicks, _numbers(label), fiducials=fiducials or (), spacing=1e-3 * spacing,
            bias=bias, unit=unit,
        )  # fmt: skip
    write_labels(segmentation, out_path)
    say(f"Wrote {out_path}.")
    if picture is not None:
        write_figure(segmentation_figure(segmentation), picture)
        say(f"Wrote {picture}.")
    show_table(frame(segmentation.table), "Parts")
    for sentence in segmentation.notes:
        say(sentence)


def _numbers(given: list[str]) -> dict[str, int]:
    """Label by part, of options such as jaw=4."""
    labels: dict[str, int] = {}
    for part, text in parts_of("--label", given).items():
        if not text.isdecimal():
            raise typer.BadParameter(f"--label {part}={text}: expected a number, such as {part}=4")
        labels[part] = int(text)
    return labels
