"""Labelled volume of parts of a head from images and a file of clicks, with a picture to check it.

One image, or stacks of several planes that fiducials bring to one frame; bias is removed on request.
Every part is the region around its clicks (`emgface.fit.images`), and becomes a label of a volume that
`emgface fit --labels` reads.
"""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from shutil import copyfile
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from numpy.typing import NDArray

from analysis.figures.style import blank, grid, styled
from emgface.errors import FitError, listed
from emgface.files import replace_file
from emgface.fit.images import combined_stacks, region_around, without_bias
from emgface.fit.readers.landmarks import landmarks_of, plain
from emgface.fit.readers.volumes import VOLUME_ENDINGS, read_image, toolkit, volume_of
from emgface.fit.triangulated import Floats

LARGEST_PART_OVERLAP: Final = 0.1  #: largest share of a part that may belong to another, too [1]
LABELS: Final = (1, 65_535)  #: smallest and largest label


@dataclass(frozen=True, eq=False)
class Segmented:
    """Image in one frame, its labels, the clicks of every part, and sentences about both."""

    image: Any  #: SimpleITK image
    labels: NDArray[np.uint16]  #: (k, j, i), 0 outside all parts
    clicks: Mapping[str, Floats]  #: points (n, 3) [m] by part
    table: pd.DataFrame  #: label, clicks and volume [cm3] by part
    notes: tuple[str, ...]


def segmented(
    images: Sequence[str | os.PathLike[str]],
    clicks: Any,
    parts: Mapping[str, int],
    *,
    fiducials: Sequence[Any] = (),
    spacing: float = 1e-3,
    bias: bool = False,
    unit: str | None = None,
) -> Segmented:
    """Label the regions around clicks in an image, or in stacks of several planes.

    Parameters
    ----------
    images : sequence of path-like
        Volumes (NIfTI, NRRD, MetaImage, folders of DICOM): one, or stacks of the same head.
    clicks : path-like, mapping or DataFrame
        Points in the frame of the first image, as landmarks. Those whose names begin with the name of a
        part, as ``jaw``, ``jaw 1`` or ``jaw_2``, lie inside this part.
    parts : mapping
        Label, 1 to 65535, by the name of the part.
    fiducials : sequence of path-like, mapping or DataFrame
        Three or more points by name in the frame of each stack, in the order of the stacks.
    spacing : float
        Distance of voxels of the combined stacks [m].
    bias : bool
        Divide each image by its bias field (N4).
    unit : str, optional
        Unit of files of points that do not state it.

    Raises
    ------
    FitError
        An input is unusable, a part has no click, its region fills the image, or two parts overlap by
        more than a tenth of the smaller one.
    """
    _check_parts(parts)
    if len(images) > 1 and len(fiducials) != len(images):
        raise FitError(
            f"{len(images)} stacks have {len(fiducials)} files of fiducials, expected one for each: "
            "their frames differ by the motion of the head between them"
        )
    own = _clicks(landmarks_of(clicks, unit, least=0.0), parts)
    read = [read_image(path) for path in images]
    for image, path in zip(read, images, strict=True):
        volume_of(image, Path(path).name)  # refuses what has no geometry, or several values
    read = [without_bias(image) for image in read] if bias else read
    image, notes = read[0], list[str]()
    if len(read) > 1:
        marks = [landmarks_of(given, unit, least=0.0) for given in fiducials]
        points = [dict(zip(m.names, m.position.tolist(), strict=True)) for m in marks]
        image, motions = combined_stacks(read, points, spacing)
        for path, motion in zip(images[1:], motions[1:], strict=True):
            angle = np.degrees(np.arccos(np.clip((np.trace(motion.rotation) - 1.0) / 2.0, -1, 1)))
            notes.append(
                f"{Path(path).name} was turned by {angle:.1f} degrees onto the first stack."
            )
    masks = {part: region_around(image, points.tolist()) for part, points in own.items()}
    labels, shared = _labels(masks, parts)
    voxel = 1e-3 * float(np.prod(image.GetSpacing()))  # cm3
    rows = [
        {
            "part": part, "label": parts[part], "clicks": len(own[part]),
            "volume [cm3]": voxel * int((labels == parts[part]).sum()),
        }
        for part in parts
    ]  # fmt: skip
    return Segmented(image, labels, own, pd.DataFrame(rows), (*notes, *shared))


def ending_of_labels(path: str | os.PathLike[str]) -> str:
    """Ending of a file of labels; FitError for one that volumes in one file do not have."""
    name = Path(path).name
    ending = next((one for one in VOLUME_ENDINGS if name.lower().endswith(one)), "")
    if ending not in (".nii", ".nii.gz", ".nrrd", ".mha"):
        raise FitError(
            f"{name} has the ending of no volume in one file, expected .nii, .nii.gz, .nrrd or .mha"
        )
    return ending


def write_labels(result: Segmented, path: str | os.PathLike[str]) -> Path:
    """Write the labels in the geometry of the image; FitError for an ending that volumes do not have."""
    path, ending = Path(path), ending_of_labels(path)
    sitk = toolkit()
    volume = sitk.GetImageFromArray(result.labels)
    volume.CopyInformation(result.image)

    with TemporaryDirectory() as folder:  # the format follows from the ending
        made = Path(folder, "labels").with_suffix(ending)
        sitk.WriteImage(volume, str(made), useCompression=ending != ".nii")
        replace_file(path, lambda target: copyfile(made, target))
    return path


@styled
def segmentation_figure(result: Segmented) -> Figure:
    """Draw, for every part, the three slices through its middle click, with the outline of the part."""
    sitk = toolkit()
    values = sitk.GetArrayViewFromImage(result.image)
    spacing = result.image.GetSpacing()
    figure = blank(7.2, 2.4 * len(result.clicks))
    axes = grid(figure, len(result.clicks), 3)
    label_of = dict(zip(result.table["part"].tolist(), result.table["label"].tolist(), strict=True))
    low, high = np.quantile(values, (0.01, 0.995))
    for row, (part, points) in zip(axes, result.clicks.items(), strict=True):
        label = label_of[part]
        middle = points[len(points) // 2]
        i, j, k = (
            round(x) for x in result.image.TransformPhysicalPointToContinuousIndex(1e3 * middle)
        )
        mask = result.labels == label
        for axis, (cut, names, sizes) in zip(
            row,
            (
                ((k, slice(None), slice(None)), "i j", spacing[:2]),
                ((slice(None), j, slice(None)), "i k", spacing[::2]),
                ((slice(None), slice(None), i), "j k", spacing[1:]),
            ),
            strict=True,
        ):
            axis.imshow(
                values[cut], cmap="gray", vmin=low, vmax=high, origin="lower",
                aspect=sizes[1] / sizes[0], interpolation="nearest",
            )  # fmt: skip
            if mask[cut].any():
                axis.contour(mask[cut], levels=[0.5], colors=["#e69f00"], linewidths=1.2)
            axis.set(xlabel=names[0], ylabel=names[2])
        row[0].set_title(f"{part} (label {label})", loc="left")
    return figure


def _check_parts(parts: Mapping[str, int]) -> None:
    if not parts or len(set(parts.values())) < len(parts):
        raise FitError(
            f"the labels are {dict(parts)}, expected at least one part, and one label each"
        )
    wrong = {part: n for part, n in parts.items() if not LABELS[0] <= n <= LABELS[1]}
    if wrong:
        raise FitError(f"the labels are {wrong}, expected {LABELS[0]} to {LABELS[1]}")


def _clicks(marks: Any, parts: Mapping[str, int]) -> dict[str, Floats]:
    """Points by part; every point belongs to the part with the longest fitting name."""
    clicks: dict[str, list[Any]] = {part: [] for part in parts}
    stray: list[str] = []
    for name, point in zip(marks.names, marks.position, strict=True):
        own = [
            p for p in parts if plain(name) == plain(p) or plain(name).startswith(f"{plain(p)}_")
        ]
        if own:
            clicks[max(own, key=len)].append(point)
        else:
            stray.append(name)
    if stray:
        raise FitError(
            f"{marks.source} has points of no part: {listed(stray[:5])}, expected names that begin with "
            f"{listed(parts)}: rename them, or give the part a label"
        )
    if empty := [part for part, points in clicks.items() if not points]:
        raise FitError(
            f"{marks.source} has no click in {listed(empty)}, expected at least one, named as "
            f"'{empty[0]} 1'"
        )
    return {part: np.array(points, dtype=np.float64) for part, points in clicks.items()}


def _labels(
    masks: Mapping[str, NDArray[np.bool_]], parts: Mapping[str, int]
) -> tuple[NDArray[np.uint16], list[str]]:
    """Labels of all masks, voxels of two being of the first; and sentences about these."""
    labels = np.zeros(next(iter(masks.values())).shape, dtype=np.uint16)
    notes: list[str] = []
    for part, mask in masks.items():
        for other, number in parts.items():
            both = int((mask & (labels == number)).sum())
            least = min(int(mask.sum()), int((labels == number).sum()))
            if both > LARGEST_PART_OVERLAP * least:
                raise FitError(
                    f"{part} and {other} overlap by {both / least:.0%} of the smaller one, expected at "
                    f"most {LARGEST_PART_OVERLAP:.0%}: their intensities do not separate them, add "
                    "clicks"
                )
            if both:
                notes.append(f"{both} voxels of {part} are of {other}, which was given first.")
        labels[mask & (labels == 0)] = parts[part]
    return labels, notes


__all__ = ["Segmented", "ending_of_labels", "segmentation_figure", "segmented", "write_labels"]
