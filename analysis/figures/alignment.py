"""How a recording was synchronised with its simulation."""

from typing import TYPE_CHECKING

import xarray as xr

from analysis.cube import TRIAL_DIMS
from analysis.errors import CubeError
from analysis.figures.style import FIRST, SECOND, blank, heading, legend, styled
from analysis.trajectory import names

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@styled
def synchronisation(aligned: xr.Dataset) -> "Figure":
    """Draw the coefficient vectors of measurement and simulation before and after alignment.

    Parameters
    ----------
    aligned : xarray.Dataset
        Result of `analysis.align.align`.

    Returns
    -------
    matplotlib.figure.Figure
        Left as recorded, right stretched and shifted; both vectors in millimetres about their
        means.

    Raises
    ------
    CubeError
        The dataset holds no alignment.

    Notes
    -----
    After Fig. 3 of Eskes et al. 2017.
    """
    lacking = [name for name in ("b_measured", "b_simulated", "b_aligned") if name not in aligned]
    if lacking:
        raise CubeError(
            f"the dataset lacks {names(lacking)}, expected the result of analysis.align.align"
        )
    figure = blank(8.0, 3.4)
    before, after = figure.subplots(1, 2, sharex=True, sharey=True)
    time = aligned["time"].values - aligned["time"].values[0]
    own = aligned["time_measured"].values - aligned["time_measured"].values[0]
    model = 1e3 * (aligned["b_simulated"] - aligned["b_simulated"].mean()).values
    mean = float(aligned["b_measured"].mean())
    given = 1e3 * (aligned["b_measured"].values - mean)
    for panel in (before, after):
        panel.plot(time, model, label="simulation", **FIRST)
        panel.set_xlabel("time [s]")
    before.plot(own, given, label="recording", **SECOND)
    moved = 1e3 * (aligned["b_aligned"].values - mean)
    after.plot(time, moved, label="recording, aligned", **SECOND)
    before.set_title("as recorded")
    after.set_title(
        f"shift {1e3 * float(aligned['shift']):.0f} ms, scale {float(aligned['scale']):.3g}, "
        f"correlation {float(aligned['b_correlation']):.2f}",
        fontsize="medium",
    )
    before.set_ylabel("first coefficient [mm]")
    legend(figure, before.get_lines(), ["simulation", "recording"])
    heading(figure, f"synchronisation {_which(aligned)}", _origin(aligned))
    return figure


def _which(data: xr.Dataset) -> str:
    """Name the trial, as far as the attributes tell."""
    return " ".join(str(data.attrs[name]) for name in TRIAL_DIMS if name in data.attrs)


def _origin(data: xr.Dataset) -> str:
    return str(data.attrs.get("origin", "unlabelled"))
