"""Measured transfer functions of printed vocal tracts, and their formants.

The layout is that of the text files of the Dresden group (VocalTractLab, and the measured and computed
functions of Birkholz et al. 2020, Scientific Data 7:255): a line ``num_points: N``, a line of headings
``frequency_Hz magnitude phase_rad``, and columns separated by blanks. Tables with commas, without the
first line, and without a phase are read, too.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from emgface.acoustics.errors import AcousticsError
from emgface.acoustics.medium import Complex, Floats
from emgface.errors import DataError
from emgface.texts import read_text

HEADINGS = ("frequency_hz", "magnitude", "phase_rad")
DECIBEL = ("magnitude_db", "db", "magnitude[db]")
PROMINENCE = 3.0
"""Height of a maximum over the adjacent valleys from which it counts as a formant [dB]."""
SMALLEST_SIZE = 8
"""Points below which a table is no transfer function."""


@dataclass(frozen=True)
class TransferFunction:
    """Transfer function of a vocal tract from glottis to lips.

    Attributes
    ----------
    frequency : ndarray, shape (n,)
        Ascending [Hz].
    value : ndarray of complex, shape (n,)
        Ratio of the flows [1], up to a factor; real and positive if the file has no phase.
    has_phase : bool
        Whether the file states the phase.
    """

    frequency: Floats
    value: Complex
    has_phase: bool

    def peaks(self, highest: float = 5000.0) -> tuple[Floats, Floats]:
        """Frequencies and bandwidths [Hz] of the maxima of the magnitude up to `highest`.

        A maximum is refined by a parabola through three points of the level in dB; a bandwidth is the
        distance of the points 3 dB below it, NaN where a neighbour hides them. Maxima that rise less
        than `PROMINENCE` over the adjacent valleys are noise or zeros and are left out.
        """
        level = 20.0 * np.log10(np.maximum(np.abs(self.value), 1e-12 * np.abs(self.value).max()))
        f = self.frequency
        inside = range(1, len(f) - 1)
        tops = [k for k in inside if level[k - 1] < level[k] >= level[k + 1] and f[k] <= highest]
        tops = [k for k in tops if _prominence(level, k) >= PROMINENCE]
        at = np.array([_vertex(f, level, k) for k in tops])
        return at, np.array([_bandwidth(f, level, k) for k in tops])


def read_transfer_function(path: str | Path) -> TransferFunction:
    """Read a measured or computed transfer function.

    Raises
    ------
    AcousticsError
        The file cannot be read, has other columns, too few points, values that are not finite, or
        frequencies that do not increase.
    """
    path = Path(path)
    try:
        lines = read_text(path).splitlines()
    except (OSError, UnicodeError, DataError) as error:
        raise AcousticsError(f"{path.name} cannot be read as a text ({error})") from error
    rows = [re.split(r"[,;\s]+", line.strip().strip(",;")) for line in lines if line.strip()]
    stated = None
    if rows and rows[0][0].lower().rstrip(":") == "num_points":
        stated, rows = rows[0], rows[1:]
    heads = [cell.lower() for cell in rows[0]] if rows and not _number(rows[0][0]) else []
    if heads:
        rows = rows[1:]
    decibel = len(heads) > 1 and heads[1] in DECIBEL
    if heads and (heads[0] != HEADINGS[0] or not (decibel or heads[1:2] == [HEADINGS[1]])):
        raise AcousticsError(
            f"{path.name} has the columns {', '.join(heads)}, expected frequency_Hz, magnitude (or "
            "magnitude_dB) and phase_rad"
        )
    values = _table(path, rows)
    f, magnitude = values[:, 0], values[:, 1]
    if not (np.diff(f) > 0.0).all() or f[0] < 0.0:
        raise AcousticsError(f"{path.name}: frequencies do not increase from 0, expected Hz")
    if stated is not None and len(stated) > 1 and int(float(stated[1])) < len(f):
        raise AcousticsError(
            f"{path.name} states {stated[1]} points and contains {len(f)}: it is not whole"
        )
    if decibel:
        magnitude = 10.0 ** (magnitude / 20.0)
    elif (magnitude < 0.0).any():
        raise AcousticsError(
            f"{path.name} has negative magnitudes, expected ratios of 0 or more; name the column "
            "magnitude_dB if they are in dB"
        )
    has_phase = values.shape[1] > 2
    phase = values[:, 2] if has_phase else np.zeros(len(f))
    return TransferFunction(f, np.asarray(magnitude * np.exp(1j * phase), np.complex128), has_phase)


def nearest_maxima(
    measured: TransferFunction, frequency: Sequence[float] | Floats
) -> tuple[Floats, Floats]:
    """Measured maxima nearest to computed formants, and their relative differences.

    Formants and maxima are assigned one to one in their order, by the smallest sum of the relative
    differences; formants without a maximum are NaN.

    Returns
    -------
    maximum : ndarray, shape (n,)
        [Hz].
    difference : ndarray, shape (n,)
        computed/measured - 1 [1].
    """
    from scipy.optimize import linear_sum_assignment

    computed = np.asarray(frequency, np.float64)
    tops = measured.peaks(float(computed.max(initial=0.0)) * 1.25)[0]
    nearest = np.full(len(computed), np.nan)
    if len(tops) and len(computed):
        cost = np.abs(np.log(computed[:, None] / tops[None, :]))
        own, other = linear_sum_assignment(cost)
        near = cost[own, other] < np.log(1.25)
        nearest[own[near]] = tops[other[near]]
    return nearest, computed / nearest - 1.0


def _number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _table(path: Path, rows: Sequence[Sequence[str]]) -> Floats:
    """Numbers (n, 2 or 3) of the rows."""
    widths = {len(row) for row in rows}
    if len(rows) < SMALLEST_SIZE or len(widths) != 1 or not widths <= {2, 3}:
        raise AcousticsError(
            f"{path.name} contains {len(rows)} rows of {sorted(widths)} columns, expected at least "
            f"{SMALLEST_SIZE} rows of frequency, magnitude and phase"
        )
    try:
        values = np.array(rows, dtype=np.float64)
    except ValueError as error:
        raise AcousticsError(f"{path.name} contains a text among its numbers ({error})") from error
    if not np.isfinite(values).all():
        raise AcousticsError(f"{path.name} contains values that are not finite")
    return values


def _prominence(level: Floats, k: int) -> float:
    """Height of a maximum over the higher of the valleys that separate it from higher points [dB]."""
    valleys: list[float] = []
    for side in (level[k::-1], level[k:]):
        higher = np.flatnonzero(side > level[k])
        end = int(higher[0]) if len(higher) else len(side)
        valleys.append(float(side[:end].min()))
    return float(level[k] - max(valleys))


def _vertex(f: Floats, level: Floats, k: int) -> float:
    """Frequency of the maximum of the parabola through three neighbours [Hz]."""
    square, linear, _ = np.polyfit(f[k - 1 : k + 2] - f[k], level[k - 1 : k + 2], 2)
    return float(f[k] - 0.5 * linear / square)


def _bandwidth(f: Floats, level: Floats, k: int) -> float:
    """Distance of the points 3 dB below a maximum, NaN if a valley above them is nearer."""
    ends: list[float] = []
    for step in (-1, 1):
        j = k
        while 0 <= j + step < len(f) and level[j + step] > level[k] - 3.0:
            if level[j + step] > level[j] and level[j] < level[k] - 1.0:
                return float("nan")
            j += step
        if not 0 <= j + step < len(f):
            return float("nan")
        share = (level[j] - level[k] + 3.0) / (level[j] - level[j + step])
        ends.append(float(f[j] + share * (f[j + step] - f[j])))
    return ends[1] - ends[0]
