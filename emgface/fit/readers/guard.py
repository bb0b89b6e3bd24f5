"""Bytes, digest and unit of an input file, with limits on its size."""

import hashlib
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from emgface.errors import FitError
from emgface.files import existing_file

Floats = NDArray[np.float64]

#: metres per unit
METRES_PER_UNIT: Final = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "in": 0.0254}
MOST_GEOMETRY_BYTES: Final = 500_000_000  #: largest size of a surface or tractography [byte]
FACE: Final = (0.04, 0.6)
"""Smallest and largest extent of landmarks or surfaces of a face or a bone of the face [m]."""


@dataclass(frozen=True)
class Content:
    """Name, bytes and digest (SHA-256) of a file."""

    name: str
    data: bytes

    @property
    def digest(self) -> str:
        """Digest of the bytes."""
        return hashlib.sha256(self.data).hexdigest()

    @property
    def text(self) -> str:
        """Decoded text; FitError if the bytes are not text."""
        try:
            return self.data.decode("utf-8-sig")
        except UnicodeDecodeError as error:
            raise FitError(
                f"{self.name} is not text in UTF-8 (byte {error.start}), expected a text file: "
                "export it again"
            ) from error


def digest_of_files(paths: Sequence[Path]) -> str:
    """Digest (SHA-256) of the bytes of files, in the order of their names, read in pieces."""
    hasher = hashlib.sha256()
    for path in sorted(paths):
        with path.open("rb") as stream:
            while piece := stream.read(1 << 20):
                hasher.update(piece)
    return hasher.hexdigest()


def content_of(path: str | os.PathLike[str], most: int) -> Content:
    """Read a file of at most this number of bytes; FitError if it is absent, empty or larger."""
    path = existing_file(path, "landmarks or a surface", FitError)
    try:
        size = path.stat().st_size
        if size > most:
            raise FitError(
                f"{path} has {size / 1e6:.0f} MB, expected at most {most / 1e6:.0f} MB: reduce the "
                "number of triangles or points"
            )
        data = path.read_bytes()
    except OSError as error:
        raise FitError(
            f"{path} cannot be read ({error.strerror}), expected a file: check its path"
        ) from error
    if not data.strip():
        raise FitError(f"{path} is empty, expected landmarks or a surface: export it again")
    return Content(path.name, data)


def metres(
    points: Floats,
    unit: str | None,
    name: str,
    *,
    stated: str | None = None,
    least: float = FACE[0],
) -> Floats:
    """Points in metres, from the given `unit` or the one `stated` by the file.

    `least` [m] is the smallest extent, that of a face; 0 for points of a part. Raises FitError if no
    unit is known, both contradict each other, a number is not finite, or the extent is another.
    """
    bad = ~np.isfinite(points).all(axis=1)
    if bad.any():
        raise FitError(
            f"{name}: point {int(np.argmax(bad))} of {len(points)} is not finite, expected three "
            "numbers: remove or correct it"
        )
    for one in (unit, stated):
        if one is not None and one not in METRES_PER_UNIT:
            raise FitError(
                f"{name}: unknown unit {one!r}, expected one of {', '.join(METRES_PER_UNIT)}"
            )
    if unit is not None and stated is not None and unit != stated:
        raise FitError(
            f"{name} states the unit {stated}, and {unit} was given: omit the option or correct the "
            "file"
        )
    extent = float(np.ptp(points, axis=0).max()) if len(points) else 0.0
    known = stated or unit
    if known is None:
        likely = [u for u, factor in METRES_PER_UNIT.items() if least <= factor * extent <= FACE[1]]
        hint = (
            f"a surface of this size is likely in {' or '.join(likely)}"
            if likely
            else ("no unit gives the expected size")
        )
        raise FitError(
            f"{name} does not state its unit; its extent is {extent:.4g} units, and {hint}: give the "
            "unit"
        )
    size = METRES_PER_UNIT[known] * extent
    if not least <= size <= FACE[1]:
        raise FitError(
            f"{name} has an extent of {extent:.4g} {known}, that is {1e3 * size:.4g} mm, expected "
            f"{1e3 * least:.0f} to {1e3 * FACE[1]:.0f} mm: check the unit"
        )
    return METRES_PER_UNIT[known] * points
