"""Labelled volumes of other programs as surfaces, in the frame of the patient (LPS, metres).

SimpleITK reads NIfTI, NRRD, MetaImage and folders of DICOM with their direction, origin and spacing, and
gives all of them in LPS: x to the left, y to the back, z up, in millimetres. A voxel (i, j, k) lies at
origin + D diag(spacing) (i, j, k). Surfaces are those of the value 1/2 of a mask smoothed by a Gaussian
(scikit-image, marching cubes), whose points have the same map; a reflecting D turns the triangles.
"""

import gzip
import os
import sys
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from emgface.errors import FitError, listed
from emgface.fit.readers.guard import digest_of_files
from emgface.fit.readers.surfaces import Scan, surface_of
from emgface.fit.triangulated import Floats, Integers

SWIG: Final = "swig_runtime_data"  #: start of the name of the module with the table of types
VOLUME_ENDINGS: Final = (".nii", ".nii.gz", ".nrrd", ".nhdr", ".mha", ".mhd")
MOST_VOXELS: Final = 600_000_000
MOST_OF_PART: Final = 120_000_000  #: voxels of the box around a part
VOXEL_SPACING_MM: Final = (0.03, 10.0)  #: smallest and largest distance of voxels [mm]
FIELD: Final = (0.02, 1.5)  #: smallest and largest extent of a volume of a head [m]
LEAST_VOXELS: Final = 500  #: smallest number of voxels of a part
SMALLEST_PART: Final = 0.02  #: smallest extent of a part, such as a cricoid [m]
#: standard deviation of the Gaussian on a mask, in the largest spacing [1]
MASK_SMOOTHING: Final = 0.7
TURNED: Final = 1e-3  #: deviation of the axes of a volume from right angles [1]


@dataclass(frozen=True, eq=False)
class Volume:
    """Values (k, j, i) of a volume, and the affine map (4, 4) from (i, j, k) to LPS [m]."""

    values: NDArray[Any]
    affine: Floats
    source: str
    digest: str

    def at(self, index: Floats) -> Floats:
        """Points (n, 3) [m] of indices (i, j, k)."""
        return index @ self.affine[:3, :3].T + self.affine[:3, 3]


def toolkit() -> Any:
    """Return SimpleITK; FitError if it is not installed.

    SimpleITK and ezc3d are made by SWIG, whose modules share one table of C++ types by name. With
    SimpleITK in the table of ezc3d, the latter takes lists of texts for objects of the former, and the
    process ends in a segmentation fault when a C3D file is written. SimpleITK therefore has its own.
    """
    shared = {name: sys.modules.pop(name) for name in list(sys.modules) if name.startswith(SWIG)}
    try:
        import SimpleITK
    except ImportError as error:
        raise FitError(
            "volumes require SimpleITK and scikit-image: install the extra with "
            "pip install 'emgface[images]'"
        ) from error
    finally:
        for name in [name for name in sys.modules if name.startswith(SWIG)]:
            del sys.modules[name]
        sys.modules.update(shared)
    return SimpleITK


def read_volume(path: str | os.PathLike[str]) -> Volume:
    """Read a volume in three dimensions; FitError if it is damaged, too large or has no geometry."""
    return volume_of(read_image(path), Path(path).name, digest_of_files(_files(Path(path))))


def read_image(path: str | os.PathLike[str]) -> Any:
    """SimpleITK image of a file or of a folder with one DICOM series; errors as of `read_volume`."""
    sitk = toolkit()
    files = _files(Path(path))
    reader: Any = sitk.ImageFileReader() if len(files) == 1 else sitk.ImageSeriesReader()
    sitk.ProcessObject.SetGlobalWarningDisplay(False)
    try:
        if len(files) == 1:
            reader.SetFileName(str(files[0]))
            reader.ReadImageInformation()
            size = [int(n) for n in reader.GetSize()]
            _check_size(size, Path(path).name)
            one = sitk.Image([1, 1, 1], reader.GetPixelID())
            _check_whole(files[0], int(np.prod(size)) * one.GetSizeOfPixelComponent())
        else:
            reader.SetFileNames([str(file) for file in files])
        return reader.Execute()
    except RuntimeError as error:
        raise FitError(
            f"{Path(path).name} cannot be read as a volume ({_first_line(error)}), expected NIfTI, "
            "NRRD, MetaImage or a folder with one DICOM series: export it again"
        ) from error


def volume_of(image: Any, name: str, digest: str = "") -> Volume:
    """Values and geometry of a SimpleITK image; errors as of `read_volume`."""
    sitk = toolkit()
    size = [int(n) for n in image.GetSize()]
    _check_size(size, name)
    if image.GetNumberOfComponentsPerPixel() != 1:
        raise FitError(f"{name} has several values per voxel, expected one: export one channel")
    spacing, D = np.array(image.GetSpacing()), np.array(image.GetDirection()).reshape(3, 3)
    if not ((spacing >= VOXEL_SPACING_MM[0]) & (spacing <= VOXEL_SPACING_MM[1])).all():
        raise FitError(
            f"{name} has a spacing of {listed(np.round(spacing, 6))} mm, expected "
            f"{VOXEL_SPACING_MM[0]} to {VOXEL_SPACING_MM[1]:g} mm: check the unit of the volume, "
            "which is mm in all these formats"
        )
    if np.abs(D.T @ D - np.eye(3)).max() > TURNED:
        raise FitError(
            f"the axes of {name} are not at right angles, expected a volume without shear: resample it"
        )
    extent = 1e-3 * spacing * np.array(size)
    if not (extent.max() >= FIELD[0] and extent.max() <= FIELD[1]):
        raise FitError(
            f"{name} has an extent of {listed(np.round(1e3 * extent, 1))} mm, expected at least "
            f"{1e3 * FIELD[0]:.0f} mm and at most {1e3 * FIELD[1]:.0f} mm: check the unit"
        )
    affine = np.eye(4)
    affine[:3, :3] = 1e-3 * D * spacing
    affine[:3, 3] = 1e-3 * np.array(image.GetOrigin())
    return Volume(sitk.GetArrayFromImage(image), affine, name, digest)


def surfaces_of_labels(
    path: str | os.PathLike[str] | Volume, parts: Mapping[str, Sequence[int]]
) -> dict[str, Scan]:
    """Surfaces of parts of a labelled volume, in LPS [m]; each is the union of its labels.

    Raises FitError for a volume that is not labelled, a label that it does not contain, a part of
    few voxels, or one that is cut by the border of the volume on all sides.
    """
    volume = path if isinstance(path, Volume) else read_volume(path)
    values = _labelled(volume)
    known = np.unique(values)
    return {
        part: surface_of_mask(volume, _mask(volume, values, part, labels, known), part)
        for part, labels in parts.items()
    }


def surface_of_mask(volume: Volume, mask: NDArray[np.bool_], part: str) -> Scan:
    """Surface of the largest connected part of a mask (k, j, i), in LPS [m]; errors as above."""
    from scipy import ndimage
    from skimage.measure import label, marching_cubes

    name = f"{part} of {volume.source}"
    if mask.sum() < LEAST_VOXELS:
        raise FitError(
            f"{name} has {int(mask.sum())} voxels, expected at least {LEAST_VOXELS}: check the label"
        )
    box = ndimage.find_objects(np.where(mask, 1, 0))[0]
    size = np.array([s.stop - s.start for s in box])
    if np.prod(size) > MOST_OF_PART:
        raise FitError(
            f"{name} fills a box of {np.prod(size) / 1e6:.0f} million voxels, expected at most "
            f"{MOST_OF_PART / 1e6:.0f} million: reduce the resolution, or cut the volume"
        )
    notes: list[str] = []
    own, count = label(mask[box], return_num=True, connectivity=1)
    shares = np.bincount(own.ravel())[1:]
    if count > 1:
        notes.append(
            f"{count - 1} further parts with {1.0 - shares.max() / shares.sum():.1%} of the voxels of "
            f"{part} were omitted"
        )
    ends = [(s.start == 0, s.stop == n) for s, n in zip(box, mask.shape, strict=True)]
    if np.any(ends):
        notes.append(f"{part} reaches the border of the volume and is open there")
    spacing = np.linalg.norm(volume.affine[:3, :3], axis=0)
    sigma = MASK_SMOOTHING * spacing.max() / spacing[::-1]
    wide = int(np.ceil(3.0 * sigma.max())) + 1
    width = np.where(np.array(ends), wide, 0), np.where(np.array(ends), 0, wide)
    # beyond the border of the volume the part continues, so that its surface is open there
    body = np.pad((own == 1 + shares.argmax()).astype(np.float32), width[0], mode="edge")
    body = np.pad(body, width[1])
    smooth = ndimage.gaussian_filter(body, np.minimum(sigma, 3.0))
    corner, triangle, _, _ = marching_cubes(smooth, 0.5)
    inside = (corner[:, ::-1] - wide) + np.array([s.start for s in box])[::-1]
    keep = ((inside >= -0.5) & (inside <= np.array(mask.shape)[::-1] - 0.5)).all(axis=1)
    triangle = triangle[keep[triangle].all(axis=1)].astype(np.int64)
    return _scan(volume, inside, triangle, name, notes)


def _scan(volume: Volume, index: Floats, triangle: Integers, name: str, notes: list[str]) -> Scan:
    """Surface with outward triangles, of indices (i, j, k) of its points."""
    points = volume.at(index.astype(np.float64))
    corners = (points - points.mean(axis=0))[triangle]
    if np.linalg.det(corners).sum() < 0.0:
        triangle = triangle[:, ::-1].copy()
    scan = surface_of(points, triangle, unit="m", name=name, least=SMALLEST_PART)
    return Scan(scan.surface, name, volume.digest, notes + scan.notes)


def labels_by_part(given: Mapping[str, str]) -> dict[str, tuple[int, ...]]:
    """Labels by part, of texts such as "1,2,3"; FitError for others."""
    labels: dict[str, tuple[int, ...]] = {}
    for part, text in given.items():
        try:
            labels[part] = tuple(int(one) for one in text.split(","))
        except ValueError:
            raise FitError(
                f"the labels of {part} are {text!r}, expected whole numbers such as 1,2,3"
            ) from None
    return labels


def _labelled(volume: Volume) -> NDArray[Any]:
    values = volume.values
    if values.dtype.kind == "f":
        whole = np.rint(values)
        if not np.isfinite(values).all() or np.abs(whole - values).max() > 1e-6:
            raise FitError(
                f"{volume.source} has values that are no whole numbers, expected labels: it may be the "
                "image and not its segmentation"
            )
        values = whole.astype(np.int64)
    return values


def _mask(
    volume: Volume, values: NDArray[Any], part: str, labels: Sequence[int], known: NDArray[Any]
) -> NDArray[np.bool_]:
    if absent := [label for label in labels if label not in known or label == 0]:
        raise FitError(
            f"{volume.source} has no label {listed(absent)} for {part}, expected some of "
            f"{listed(known[known != 0], 20)}: check the list of labels of the segmentation"
        )
    return np.isin(values, np.asarray(labels))


def _check_size(size: Sequence[int], name: str) -> None:
    if len(size) != 3 or min(size) < 2:
        raise FitError(
            f"{name} has {len(size)} dimensions of {listed(size)} voxels, expected a volume in three"
        )
    if (count := float(np.prod(np.array(size, dtype=np.float64)))) > MOST_VOXELS:
        raise FitError(
            f"{name} has {count / 1e6:.0f} million voxels, expected at "
            f"most {MOST_VOXELS / 1e6:.0f} million: reduce the resolution, or cut the volume"
        )


def _check_whole(path: Path, wanted: int) -> None:
    """Refuse a NIfTI file with fewer bytes than its voxels: it would be read with zeros at its end."""
    name = path.name.lower()
    if not name.endswith((".nii", ".nii.gz")):
        return
    count = 0
    try:
        with gzip.open(path) if name.endswith(".gz") else path.open("rb") as stream:
            while count < wanted and (piece := stream.read(1 << 20)):
                count += len(piece)
    except (EOFError, OSError, zlib.error):
        count = 0
    if count < wanted:
        raise FitError(
            f"{path.name} cannot be read as a volume (it ends before its {wanted} bytes of voxels), "
            "expected a whole file: copy or export it again"
        )


def _files(path: Path) -> list[Path]:
    """File of a volume, or those of the one DICOM series of a folder."""
    if path.is_file():
        if not path.name.lower().endswith(VOLUME_ENDINGS):
            raise FitError(
                f"{path.name} has an unknown ending, expected one of {', '.join(VOLUME_ENDINGS)}, "
                "or a folder with one DICOM series"
            )
        return [path]
    if not path.is_dir():
        raise FitError(f"{path} does not exist, expected a volume or a folder: check its path")
    reader = toolkit().ImageSeriesReader
    series = reader.GetGDCMSeriesIDs(str(path))
    if len(series) != 1:
        raise FitError(
            f"{path} contains {len(series)} DICOM series, expected one: move each to a folder of its own"
        )
    return [Path(file) for file in reader.GetGDCMSeriesFileNames(str(path), series[0])]


def _first_line(error: Exception) -> str:
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return (lines[-1] if lines else "unknown reason")[:200]
