"""Fibre courses of tractography (.trk, .tck), read by nibabel, in the frame of the patient (LPS, m).

nibabel applies the affine of the file and returns millimetres in RAS; LPS has the opposite signs of x
and y.
"""

import os
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from emgface.errors import FitError
from emgface.fit.readers.guard import FACE, MOST_GEOMETRY_BYTES, Content, content_of
from emgface.fit.triangulated import Floats

TRACT_ENDINGS: Final = (".trk", ".tck")
LEAST_STREAMLINES: Final = 5  #: smallest number of streamlines of a bundle
TO_LPS: Final = 1e-3 * np.array([-1.0, -1.0, 1.0])
TRK_HEADER: Final = 1000  #: bytes of the header of a .trk file
COUNT_AT: Final = 988  #: place of the number of streamlines in it


@dataclass(frozen=True, eq=False)
class Tracts:
    """Streamlines (k, 3) [m] of one bundle, with the digest of their file."""

    lines: tuple[Floats, ...]
    source: str = "given as numbers"
    digest: str = ""


def tracts_of(given: Any) -> Tracts:
    """Streamlines of a file, or of arrays (k, 3) in metres; FitError if they cannot be used."""
    if isinstance(given, Tracts):
        return given
    if isinstance(given, str | os.PathLike):
        return _read(Path(given))
    return _checked([np.asarray(line, dtype=np.float64) for line in given], "tracts", "")


def _read(path: Path) -> Tracts:
    content = content_of(path, MOST_GEOMETRY_BYTES)
    if not content.name.lower().endswith(TRACT_ENDINGS):
        raise FitError(
            f"{content.name} has an unknown ending, expected {' or '.join(TRACT_ENDINGS)}: export "
            "the bundle"
        )
    try:
        from nibabel.streamlines import load
    except ImportError as error:
        raise FitError(
            "fibre courses require nibabel: install the extra with pip install 'emgface[images]'"
        ) from error
    _check_size(content)
    with warnings.catch_warnings(record=True) as doubts:
        warnings.simplefilter("always")
        try:
            read: Any = load(str(path))
            lines = [np.asarray(line, dtype=np.float64) * TO_LPS for line in read.streamlines]
        except Exception as error:  # nibabel raises many types, MemoryError among them
            raise FitError(
                f"{content.name} cannot be read as streamlines ({type(error).__name__}: "
                f"{str(error)[:120]}), expected a whole .trk or .tck file: export it again"
            ) from error
    if texts := [str(d.message) for d in doubts if "affine" in str(d.message).lower()]:
        raise FitError(
            f"{content.name} does not state where its voxels lie ({texts[0][:120]}), expected an affine "
            "in its header: export it with a program that writes vox_to_ras"
        )
    stated = read.header.get("count", read.header.get("nb_streamlines"))
    if stated is not None and int(stated) not in (0, len(lines)):
        raise FitError(
            f"{content.name} states {int(stated)} streamlines and has {len(lines)}, expected the same: "
            "export it again"
        )
    return _checked(lines, content.name, content.digest)


def _check_size(content: Content) -> None:
    """Refuse a .trk file that states more streamlines than it has room for."""
    if not content.name.lower().endswith(".trk") or len(content.data) < TRK_HEADER:
        return
    counts = [int.from_bytes(content.data[COUNT_AT : COUNT_AT + 4], order, signed=True)  # pyright: ignore[reportArgumentType]
              for order in ("little", "big")]  # fmt: skip
    if min(abs(n) for n in counts) * 16 > len(content.data):
        raise FitError(
            f"{content.name} states {min(map(abs, counts))} streamlines, more than its "
            f"{len(content.data)} bytes can hold, expected a whole file: export it again"
        )


def _checked(lines: list[Floats], name: str, digest: str) -> Tracts:
    for k, line in enumerate(lines):
        if line.ndim != 2 or line.shape[1] != 3 or not np.isfinite(line).all():
            raise FitError(
                f"{name}: streamline {k} has values of shape {line.shape}, expected finite points (k, 3)"
            )
    lines = [line for line in map(_distinct, lines) if len(line) >= 2]
    if len(lines) < LEAST_STREAMLINES:
        raise FitError(
            f"{name} has {len(lines)} streamlines with a length, expected at least "
            f"{LEAST_STREAMLINES} of one muscle"
        )
    extent = float(np.ptp(np.concatenate(lines), axis=0).max())
    if not 5e-3 <= extent <= FACE[1]:
        raise FitError(
            f"{name} has an extent of {1e3 * extent:.4g} mm, expected 5 to {1e3 * FACE[1]:.0f} mm for a "
            "muscle of the face: check the unit, which is mm in these formats"
        )
    return Tracts(tuple(lines), name, digest)


def _distinct(line: Floats) -> Floats:
    """Points without those that repeat their predecessor."""
    keep = np.ones(len(line), dtype=bool)
    keep[1:] = np.linalg.norm(np.diff(line, axis=0), axis=1) > 1e-9
    return line[keep]
