"""Formants of an area function and the maxima of a measured transfer function of a printed tract.

    python -m benchmarks printed-tract MEASURED.txt AREAS.csv [--length 0.17] [--out FOLDER]

MEASURED is a transfer function (`emgface.acoustics.printed`); AREAS is a table with a column of areas
[cm2] of sections from the glottis to the lips, and optionally one of the lengths of sections [cm].
"""

from pathlib import Path
from typing import Annotated

import numpy as np
import pandas as pd
import typer

from benchmarks.report import finish, say
from emgface.acoustics.errors import AcousticsError
from emgface.acoustics.matrix import formants
from emgface.acoustics.medium import Medium
from emgface.acoustics.printed import TransferFunction, nearest_maxima, read_transfer_function

SECTIONS = 60  #: of equal length, into which a table is divided
PRINTED = Medium(yielding=0.0, c=343.2, rho=1.204)
"""Rigid walls, and air of 20 degrees, as in measurements of printed tracts."""


def read_areas(path: Path, length: float | None) -> tuple[np.ndarray, float]:
    """Areas of `SECTIONS` equal sections [m2] and length of the tube [m]."""
    table = pd.read_csv(path, sep=r"[,;\s]+", engine="python")
    table.columns = [str(name).lower() for name in table.columns]
    if "area_cm2" not in table.columns:
        raise AcousticsError(
            f"{path.name} has the columns {', '.join(table.columns)}, expected area_cm2, and length_cm "
            "or --length"
        )
    areas = 1e-4 * table["area_cm2"].to_numpy(dtype=np.float64)
    if "length_cm" in table.columns:
        each = 1e-2 * table["length_cm"].to_numpy(dtype=np.float64)
    elif length is not None:
        each = np.full(len(areas), length / len(areas))
    else:
        raise AcousticsError(f"{path.name} has no column length_cm, state the length by --length")
    ends = np.cumsum(each)
    middles = (np.arange(SECTIONS) + 0.5) * ends[-1] / SECTIONS
    return areas[np.minimum(np.searchsorted(ends, middles), len(areas) - 1)], float(ends[-1])


def comparison(measured: TransferFunction, areas: np.ndarray, length: float) -> pd.DataFrame:
    """Formants with rigid walls, as of a printed tract, and the measured maxima [Hz]."""
    frequency, bandwidth = formants(areas, length, medium=PRINTED)
    peaks, widths = measured.peaks()
    maxima, difference = nearest_maxima(measured, frequency)
    rows = [
        {
            "formant": f"F{k + 1}",
            "computed [Hz]": frequency[k],
            "measured [Hz]": maxima[k],
            "difference [%]": 100.0 * difference[k],
            "computed bandwidth [Hz]": bandwidth[k],
            "measured bandwidth [Hz]": widths[np.argmin(np.abs(peaks - maxima[k]))]
            if np.isfinite(maxima[k])
            else np.nan,
        }
        for k in range(len(frequency))
    ]
    return pd.DataFrame(rows)


def main(
    measured: Path,
    areas: Path,
    length: Annotated[float | None, typer.Option(help="Length of the tube [m].")] = None,
    out: Annotated[Path | None, typer.Option(help="Folder of the table.")] = None,
) -> None:
    """Compare a file with an area function."""
    table = comparison(read_transfer_function(measured), *read_areas(areas, length))
    say("rigid walls, air of 20 degrees C, and lips that radiate as a piston in a wall")
    finish("printed_tract", table, out)
