"""What accuracy costs, and which settings can be simulated at all."""

from typing import TYPE_CHECKING, Any, Final, cast

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from analysis.errors import FigureError
from analysis.figures.style import COLOURS, MARKS, blank, grid, legend, styled, ticks
from analysis.trajectory import names

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LINES: Final = ("-", "--", ":", "-.")
OUTCOMES: Final = {
    "ok": ("#009E73", ""),
    "failed": ("#D55E00", "//"),
    "wrong": ("#000000", "xx"),
    "not run": ("0.92", ""),
}
"""Colour and hatch of a cell."""


@styled
def error_against_run_time(found: xr.Dataset, *, title: str = "") -> "Figure":
    """Draw the error of every method and setting against its run time.

    Parameters
    ----------
    found : xarray.Dataset
        ``error`` [m] and ``run_time`` [s], dims (method, setting); NaN where a run failed. The
        labels of setting, such as step sizes, are written beside the points of every method.
        Optional ``planned`` (method, setting) says which settings a method was run with, all if
        absent.
    title : str
        Names the scene.

    Returns
    -------
    matplotlib.figure.Figure
        Both axes logarithmic; Pareto-optimal runs, which no other run beats in both, are ringed.

    Raises
    ------
    FigureError
        Other dims or units, or no run with a positive error and time.
    """
    for name, units in (("error", "m"), ("run_time", "s")):
        if name not in found or set(found[name].dims) != {"method", "setting"}:
            raise FigureError(f"expected {name} with dims method and setting")
        if found[name].attrs.get("units") != units:
            raise FigureError(
                f"{name} is in {found[name].attrs.get('units')!r}, expected {units!r}"
            )
    error = 1e3 * found["error"].transpose("method", "setting").values
    time = found["run_time"].transpose("method", "setting").values
    usable = np.isfinite(error) & np.isfinite(time) & (error > 0) & (time > 0)
    if not usable.any():
        raise FigureError("no run has a positive error and run time: there is nothing to draw")
    planned = np.ones_like(usable)
    if "planned" in found:
        planned = found["planned"].transpose("method", "setting").values.astype(bool)
    best = pareto(np.where(usable, error, np.inf), np.where(usable, time, np.inf))
    figure = blank(6.5, 4.2)
    panel = grid(figure)[0][0]
    settings = [str(label) for label in found["setting"].values]
    handles: list[Any] = []
    for i, method in enumerate(found["method"].values):
        good = usable[i]
        failed = int((planned[i] & ~good).sum())
        label = str(method) + (f" ({failed} failed)" if failed else "")
        handles += panel.plot(
            time[i, good], error[i, good], linestyle=LINES[i % 4], marker=MARKS[i % 7],
            color=COLOURS[(i + 4) % 7], markersize=5, label=label,
        )  # fmt: skip
        for k in np.flatnonzero(good):
            panel.annotate(
                settings[k], (time[i, k], error[i, k]), xytext=(4, 4),
                textcoords="offset points", fontsize="x-small", color="0.3",
            )  # fmt: skip
    panel.plot(
        time[best], error[best], linestyle="", marker="o", markersize=11, color="black",
        markerfacecolor="none", markeredgewidth=0.8,
    )  # fmt: skip
    panel.set_xscale("log")
    panel.set_yscale("log")
    panel.set_xlabel("run time [s]")
    panel.set_ylabel("error of marker positions [mm]")
    panel.grid(which="major", color="0.9", linewidth=0.6)
    legend(figure, handles)
    panel.set_title("ringed: no other run is both faster and more accurate", fontsize="small")
    _title(figure, title or "error against run time")
    return figure


def pareto(error: NDArray[np.float64], time: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether no other run has both a smaller error and a shorter run time.

    Parameters
    ----------
    error, time : ndarray
        Of one shape; infinite where a run is out.

    Returns
    -------
    ndarray of bool
        Of the same shape.
    """
    e, t = error.ravel(), time.ravel()
    dominated = (
        (e[None] <= e[:, None])
        & (t[None] <= t[:, None])
        & ((e[None] < e[:, None]) | (t[None] < t[:, None]))
    ).any(axis=1)
    return (~dominated & np.isfinite(e) & np.isfinite(t)).reshape(error.shape)


@styled
def stability_table(found: xr.Dataset, *, title: str = "") -> "Figure":
    """Draw which method survives which case.

    Parameters
    ----------
    found : xarray.Dataset
        Text ``status`` (case, method): "ok", "ok:<what was rightly refused>", "failed:<name of the
        error>", "wrong:<what>" for an answer that came without an error, or "" where not run.
    title : str
        Names the scene.

    Returns
    -------
    matplotlib.figure.Figure
        One row per case, one column per method; colour, hatch and words say the same.

    Raises
    ------
    FigureError
        Other dims, or an unknown status.
    """
    from matplotlib.patches import Patch, Rectangle

    if "status" not in found or set(found["status"].dims) != {"case", "method"}:
        raise FigureError("expected a text variable status with dims case and method")
    status = found["status"].transpose("case", "method").values.astype(str)
    kinds = np.where(status == "", "not run", np.char.partition(status, ":")[..., 0])
    odd = sorted(set(kinds.ravel().tolist()) - set(OUTCOMES))
    if odd:
        raise FigureError(
            f"the status {names(odd)} is unknown, expected ok, failed:<error> or wrong:<what>"
        )
    cases = [str(label).replace("_", " ") for label in found["case"].values]
    methods = [str(label).replace("_", " ") for label in found["method"].values]
    figure = blank(2.6 + 1.5 * len(methods), 1.1 + 0.34 * len(cases))
    panel = grid(figure)[0][0]
    for row in range(len(cases)):
        for column in range(len(methods)):
            kind = str(kinds[row, column])
            colour, hatch = OUTCOMES[kind]
            panel.add_patch(
                Rectangle(
                    (column - 0.48, row - 0.45), 0.96, 0.9, facecolor=colour, hatch=hatch,
                    edgecolor="white", alpha=0.35 if kind != "not run" else 1.0,
                )
            )  # fmt: skip
            text = str(status[row, column]).rpartition(":")[2] or kind
            panel.text(column, row, text, ha="center", va="center", fontsize="small")
    panel.set_xlim(-0.5, len(methods) - 0.5)
    panel.set_ylim(len(cases) - 0.5, -0.5)
    ticks(panel, "x", range(len(methods)), methods)
    ticks(panel, "y", range(len(cases)), cases)
    panel.xaxis.tick_top()
    panel.tick_params(length=0)
    for spine in panel.spines.values():
        spine.set_visible(False)
    legend(
        figure,
        [
            Patch(
                facecolor=OUTCOMES[k][0],
                hatch=OUTCOMES[k][1],
                edgecolor="white",
                alpha=0.35,
                label=k,
            )
            for k in ("ok", "failed", "wrong")
            if (kinds == k).any()
        ],
    )
    _title(figure, title or "stability")
    return figure


def _title(figure: "Figure", text: str) -> None:
    """Name what is drawn; motions of a bench are always simulated."""
    cast(Any, figure).suptitle(f"{text} (simulated)")
