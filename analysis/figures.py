"""Figures of a study: box plots of a cube, and how two trajectories were synchronised.

Colours are those of Okabe and Ito, distinct under the common colour deficiencies; hatches and
line styles repeat the distinction for print in grey. Every figure says whether its recordings
were measured or simulated. matplotlib is imported only when a figure is drawn.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
import xarray as xr

from analysis.cube import MARKER_DIMS
from analysis.descriptives import descriptives
from analysis.errors import CubeError
from analysis.tables import SHOWN, recordings
from analysis.trajectory import names

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOURS: Final = ("#56B4E9", "#E69F00", "#009E73", "#CC79A7", "#0072B2", "#D55E00", "#F0E442")
HATCHES: Final = ("", "//", "..", "xx", "\\\\", "--", "oo")
TITLES: Final = {
    "rho": ("3D correlation", "rho"),
    "amplitude_ratio": ("amplitude, simulated over measured", "ratio"),
    "rmse": ("root-mean-square distance", "distance"),
}
"""Title and label of the axis."""


def box_plots(
    cube: xr.Dataset,
    *,
    variable: str = "rho",
    by: Sequence[str] = ("volunteer", "instruction", "marker"),
) -> "Figure":
    """Draw the distribution of a variable per volunteer, instruction and marker, by strategy.

    The legend counts the values shown, and those that are not: undefined, failed, missing.
    Boxes span the quartiles with the median as a line and the mean as a dot; whiskers reach the
    last value within 1.5 times the interquartile range, values beyond are crosses.

    Parameters
    ----------
    cube : xarray.Dataset
        Result of `analysis.cube.build_cube`.
    variable : str
        ``"rho"``, ``"amplitude_ratio"`` or ``"rmse"``.
    by : sequence of str
        One panel for each of these dims.

    Returns
    -------
    matplotlib.figure.Figure
        Not attached to any window; give it to `save`.

    Raises
    ------
    CubeError
        Unknown variable or dim.

    Notes
    -----
    After Fig. 6 of Eskes et al. 2017.
    """
    if variable not in TITLES or variable not in cube:
        raise CubeError(f"cannot draw {variable!r}, expected one of {names([*TITLES])}")
    wrong = [dim for dim in by if dim not in MARKER_DIMS or dim == "strategy"]
    if wrong or not by:
        raise CubeError(f"cannot draw panels by {names(wrong) or 'nothing'}, expected trial dims")
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch

    _, shown, factor, _ = SHOWN[variable]
    data = cube[variable] * factor
    strategies = [str(label) for label in cube["strategy"].values]
    figure = Figure(figsize=(8.0, 0.6 + 2.6 * len(by)), layout="constrained")
    axes = figure.subplots(len(by), 1, squeeze=False)[:, 0]
    for panel, dim in zip(axes, by, strict=True):
        _boxes(panel, data, dim)
        panel.set_ylabel(TITLES[variable][1] + (f" [{shown}]" if shown != "1" else ""))
        panel.set_xlabel(dim)
        if variable == "rho":
            panel.set_ylim(-1.05, 1.05)
            panel.axhline(0.0, color="0.6", linewidth=0.8, zorder=0)
        else:
            panel.set_ylim(bottom=0.0)
    found = descriptives(cube, variable=variable)
    handles: list[Patch] = []
    for i, strategy in enumerate(strategies):
        # Trials that are not in the boxes are named, or their absence would go unseen.
        n, *left = (
            int(found[name].sel(strategy=strategy))
            for name in ("n", "n_undefined", "n_failed", "n_missing")
        )
        label = f"{strategy} (n = {n}, not shown {sum(left)})"
        colour, hatch = COLOURS[i % 7], HATCHES[i % 7]
        handles.append(Patch(facecolor=colour, hatch=hatch, edgecolor="black", label=label))
    figure.legend(
        handles=handles,
        loc="outside lower center",
        ncols=min(3, len(handles)),
        fontsize="small",
        frameon=False,
    )
    figure.suptitle(f"{TITLES[variable][0]} ({recordings(str(cube.attrs['origin']))})")
    return figure


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
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 3.4), layout="constrained")
    before, after = figure.subplots(1, 2, sharex=True, sharey=True)
    time = aligned["time"].values - aligned["time"].values[0]
    own = aligned["time_measured"].values - aligned["time_measured"].values[0]
    model = 1e3 * (aligned["b_simulated"] - aligned["b_simulated"].mean()).values
    mean = float(aligned["b_measured"].mean())
    given = 1e3 * (aligned["b_measured"].values - mean)
    for panel in (before, after):
        panel.plot(time, model, color=COLOURS[4], label="simulation")
        panel.set_xlabel("time [s]")
    style = {"color": COLOURS[5], "linestyle": "--"}
    before.plot(own, given, label="recording", **style)
    after.plot(
        time, 1e3 * (aligned["b_aligned"].values - mean), label="recording, aligned", **style
    )
    before.set_title("as recorded", fontsize="medium")
    after.set_title(
        f"shift {1e3 * float(aligned['shift']):.0f} ms, scale {float(aligned['scale']):.3g}, "
        f"correlation {float(aligned['b_correlation']):.2f}",
        fontsize="medium",
    )
    before.set_ylabel("first coefficient [mm]")
    handles, labels = after.get_legend_handles_labels()
    labels[1] = "recording"
    figure.legend(handles, labels, loc="outside lower center", ncols=2, frameon=False)
    label = [str(aligned.attrs[name]) for name in MARKER_DIMS if name in aligned.attrs]
    what = recordings(str(aligned.attrs.get("origin", "unlabelled")))
    figure.suptitle(f"synchronisation {' '.join(label)} ({what})".replace("  ", " "))
    return figure


def save(figure: "Figure", path: str | Path, *, dpi: int = 200) -> Path:
    """Write a figure; the format follows the suffix.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
        What to write. Its title becomes the title in the file's metadata.
    path : str or Path
        Where to, such as ``rho.png`` or ``rho.pdf``.
    dpi : int
        Dots per inch of pixel formats.

    Returns
    -------
    Path
        The file.
    """
    path = Path(path)
    title = figure.get_suptitle()
    # No date: the same cube gives the same file.
    metadata = {
        ".png": {"Title": title, "Software": None},
        ".svg": {"Title": title, "Date": None},
        ".pdf": {"Title": title, "CreationDate": None},
    }.get(path.suffix.lower(), {})
    figure.savefig(path, dpi=dpi, metadata=metadata)
    return path


def _boxes(panel: "Axes", data: xr.DataArray, dim: str) -> None:
    """Draw one group of boxes per label of a dim, one box per strategy."""
    labels, strategies = data[dim].values, data["strategy"].values
    width = 0.8 / len(strategies)
    for i, strategy in enumerate(strategies):
        for place, label in enumerate(labels):
            values = data.sel({"strategy": strategy, dim: label}).values.ravel()
            values = values[np.isfinite(values)]
            if not len(values):
                continue
            panel.boxplot(
                [values],
                positions=[place + (i - (len(strategies) - 1) / 2) * width],
                widths=0.85 * width,
                patch_artist=True,
                showmeans=True,
                manage_ticks=False,
                boxprops={"facecolor": COLOURS[i % 7], "hatch": HATCHES[i % 7], "linewidth": 0.7},
                medianprops={"color": "black", "linewidth": 1.6},
                meanprops={
                    "marker": "o",
                    "markersize": 4,
                    "markerfacecolor": "white",
                    "markeredgecolor": "black",
                },
                flierprops={"marker": "x", "markersize": 3, "markeredgewidth": 0.7},
                whiskerprops={"linewidth": 0.7},
                capprops={"linewidth": 0.7},
            )
    text = [str(label).replace("_", "\n") if dim == "marker" else str(label) for label in labels]
    panel.set_xticks(range(len(labels)), text, fontsize="x-small" if dim == "marker" else "medium")
    panel.set_xlim(-0.6, len(labels) - 0.4)
