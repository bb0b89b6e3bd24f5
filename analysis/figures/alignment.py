"""Figures of the synchronisation of a recording with its simulation."""

from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from analysis.errors import CubeError, FigureError
from analysis.figures.style import (
    FIRST_LINE,
    SECOND_LINE,
    blank,
    grid,
    heading,
    legend,
    styled,
    ticks,
    trial_label,
)
from analysis.tables import origin_of
from analysis.trajectory import checked, names, same_markers, same_time
from analysis.typed import selected

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
        The dataset contains no alignment.

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
        panel.plot(time, model, label="simulation", **FIRST_LINE)
        panel.set_xlabel("time [s]")
    before.plot(own, given, label="recording", **SECOND_LINE)
    moved = 1e3 * (aligned["b_aligned"].values - mean)
    after.plot(time, moved, label="recording, aligned", **SECOND_LINE)
    before.set_title("as recorded")
    after.set_title(
        f"shift {1e3 * float(aligned['shift']):.0f} ms, scale {float(aligned['scale']):.3g}, "
        f"correlation {float(aligned['b_correlation']):.2f}",
        fontsize="medium",
    )
    before.set_ylabel("first coefficient [mm]")
    legend(figure, before.get_lines(), ["simulation", "recording"])
    heading(figure, f"synchronisation {trial_label(aligned)}", origin_of(aligned))
    return figure


@styled
def marker_traces(
    aligned: xr.Dataset, simulated: xr.Dataset, scores: xr.Dataset | None = None
) -> "Figure":
    """Draw every marker along x, y and z: the aligned recording and its simulation.

    Parameters
    ----------
    aligned : xarray.Dataset
        Result of `analysis.align.align`.
    simulated : xarray.Dataset
        ``position`` (marker, axis, time) [m], the simulation used in the alignment.
    scores : xarray.Dataset, optional
        ``rho`` (marker), written next to the markers.

    Returns
    -------
    matplotlib.figure.Figure
        Displacements about the mean over the measured samples, in millimetres, one row per marker
        and one panel per axis, all on one scale.

    Raises
    ------
    CubeError
        The dataset contains no alignment.
    TrajectoryError
        The two trajectories have different markers or times.
    """
    if "b_aligned" not in aligned:
        raise CubeError("the dataset lacks b_aligned, expected the result of analysis.align.align")
    model = checked(simulated, "simulated")
    given = same_markers(checked(aligned, "aligned"), model)
    same_time(given, model)
    inside = np.isfinite(given.values).all(axis=(0, 1))
    if not (inside.any() and np.isfinite(model.values).all()):
        raise FigureError("there is no instant with all markers on both sides: omit those without")
    time = model["time"].values - model["time"].values[0]
    markers = [str(label) for label in model["marker"].values]
    axes_names = [str(label) for label in model["axis"].values] if "axis" in given.dims else []
    traces: list[np.ndarray] = []
    for data in (model.values, given.values):
        traces.append(1e3 * (data - data[:, :, inside].mean(axis=2, keepdims=True)))
    most = float(max(np.nanmax(np.abs(each)) for each in traces))
    apart = float(f"{2.0 * most:.1g}") if most > 0.0 else 1.0  # between rows, rounded
    rows = -apart * np.arange(len(markers))
    figure = blank(7.5, max(2.4, 1.0 + 0.6 * len(markers)))  # the label of one row needs room
    panels = grid(figure, 1, 3, sharex=True, sharey=True)[0]
    for column, panel in enumerate(panels):
        for label, data, style in zip(
            ("simulation", "recording, aligned"), traces, (FIRST_LINE, SECOND_LINE), strict=True
        ):
            panel.plot(time, data[:, column].T + rows, label=label, **style)
        panel.set_xlabel("time [s]")
        panel.set_title(axes_names[column])
        panel.grid(axis="y", linewidth=0.4)
    texts = [marker.replace("_", " ") for marker in markers]
    if scores is not None:
        rho = [float(selected(scores["rho"], {"marker": marker})) for marker in markers]
        captions = [f"rho = {one:.2f}" if np.isfinite(one) else "rho undefined" for one in rho]
        texts = [f"{text}\n{one}" for text, one in zip(texts, captions, strict=True)]
    ticks(panels[0], "y", rows.tolist(), texts)
    panels[0].set_ylim(rows[-1] - 1.05 * most, 1.05 * most)
    panels[0].set_ylabel(f"displacement, lines {apart:g} mm apart")
    legend(figure, panels[0].get_lines()[:: len(markers)])
    heading(figure, f"markers {trial_label(aligned)}", origin_of(aligned))
    return figure
