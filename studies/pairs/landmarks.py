"""Excursion of a mouth corner from 68 landmarks of a video, in the frame of the head.

The landmarks are those of the iBUG scheme (numbered from 0), as the columns ``x_0`` to ``y_67`` of
OpenFace and similar programs, with a column ``timestamp`` [s] and optionally ``success`` or
``confidence``. One camera gives no depth: motion towards it and turns of the head are not seen.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt
import pandas as pd

from emgface.errors import DataError

Floats = npt.NDArray[np.float64]

CORNERS: Final = {"R": 48, "L": 54}
"""Landmark of the mouth corner of the person's right and left side."""
HEAD: Final = (27, 28, 29, 30, 36, 39, 42, 45)
"""Bridge of the nose and corners of the eyes, which facial muscles of the mouth do not move."""
OUTER_EYES: Final = (36, 45)
LEAST: Final = 0.5  #: confidence below which a frame counts as lost
REST: Final = 0.1  #: share of the frames at the start that define the rest


@dataclass(frozen=True)
class Excursion:
    """Distance of a mouth corner from rest over the distance of the outer corners of the eyes."""

    time: Floats  #: [s]
    value: Floats  #: [1], NaN in lost frames


def read_landmarks(path: Path) -> tuple[Floats, Floats]:
    """Times (frame,) [s] and landmarks (frame, 68, 2) of a table, NaN in lost frames.

    Raises
    ------
    DataError
        Columns are absent or not numbers, or times do not increase.
    """
    try:
        table = pd.read_csv(path, skipinitialspace=True)
    except (OSError, ValueError) as error:
        raise DataError(
            f"{path.name} cannot be read as a table ({error}); export it again"
        ) from error
    table.columns = [str(name).strip() for name in table.columns]
    wanted = ["timestamp", *(f"{axis}_{k}" for axis in "xy" for k in range(68))]
    absent = [name for name in wanted if name not in table.columns]
    if absent:
        raise DataError(
            f"{path.name} lacks the columns {', '.join(absent[:4])}"
            f"{' and others' if len(absent) > 4 else ''}, expected timestamp, x_0 to x_67 and y_0 to "
            "y_67 (68 landmarks of the iBUG scheme, as of OpenFace)"
        )
    numbers = table[wanted].apply(pd.to_numeric, errors="coerce").to_numpy(dtype=np.float64)
    time = numbers[:, 0]
    if len(time) < 2 or not (np.isfinite(time).all() and (np.diff(time) > 0.0).all()):
        raise DataError(f"{path.name}: timestamps do not increase, expected seconds of every frame")
    points = numbers[:, 1:].reshape(-1, 2, 68).transpose(0, 2, 1).copy()
    if "confidence" in table.columns:
        sure = pd.to_numeric(table["confidence"], errors="coerce").to_numpy(dtype=np.float64)
        points[~(sure >= LEAST)] = np.nan
    if "success" in table.columns:
        points[pd.to_numeric(table["success"], errors="coerce").to_numpy() != 1] = np.nan
    return time, points


def in_frame_of_head(points: Floats) -> Floats:
    """Landmarks (frame, 68, 2) with the similarity of the head removed, in units of the eye distance.

    In every frame the similarity transform maps the landmarks `HEAD` onto those of the median frame by
    least squares (in complex numbers, a z + b).
    """
    z = points[..., 0] + 1j * points[..., 1]
    seen = np.isfinite(z).all(axis=1)
    out = np.full(points.shape, np.nan)
    if not seen.any():
        return out
    reference = np.median(z[seen].real, axis=0) + 1j * np.median(z[seen].imag, axis=0)
    size = abs(reference[OUTER_EYES[1]] - reference[OUTER_EYES[0]])
    head = list(HEAD)
    target = reference[head] - reference[head].mean()
    for k in np.flatnonzero(seen):
        own = z[k, head]
        centred = own - own.mean()
        a = np.vdot(centred, target) / np.vdot(centred, centred).real
        moved = (a * (z[k] - own.mean()) + reference[head].mean()) / size
        out[k] = np.stack([moved.real, moved.imag], axis=1)
    return out


def corner_excursion(path: Path, side: str) -> Excursion:
    """Excursion of the mouth corner of a side ("L" or "R"); DataError as `read_landmarks`."""
    time, points = read_landmarks(path)
    corner = in_frame_of_head(points)[:, CORNERS[side]]
    if np.isfinite(corner).all(axis=1).mean() < 0.5:
        raise DataError(
            f"{path.name}: the face is lost in half of the frames, expected most of them"
        )
    first = corner[: max(3, int(REST * len(corner)))]
    return Excursion(time, np.linalg.norm(corner - np.nanmedian(first, axis=0), axis=1))
