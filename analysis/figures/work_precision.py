"""What accuracy costs: errors of time stepping against run time, and those of the discretisation."""

from typing import TYPE_CHECKING, Any, Final, cast

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from analysis.errors import FigureError
from analysis.figures.style import COLOURS, HATCHES, MARKS, blank, grid, legend, styled, ticks

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LINES: Final = ("-", "--", ":", "-.")
INKS: Final = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
OF_SETTINGS: Final = ("error_max", "change_rho", "run_time", "pareto")
OF_MODELS: Final = ("difference_max", "difference_rho", "elements")


@styled
def work_precision(found: xr.Dataset, *, title: str = "") -> "Figure":
    """Draw the errors of every setting against its run time, and the differences of the models.

    Parameters
    ----------
    found : xarray.Dataset
        ``error_max`` [m], ``change_rho`` [1] and ``run_time`` [s/s], dims (setting, instruction), NaN
        where a run failed; ``pareto`` (setting); coords ``family``, ``label`` and ``model_of``.
        ``difference_max`` [m], ``difference_rho`` [1], dims (model, instruction), ``elements`` (model);
        the attribute ``finest``. The worst instruction counts.
    title : str
        Names the face.

    Returns
    -------
    matplotlib.figure.Figure
        Above, of the first model: largest error of a marker and largest change of rho that the time
        steps cause. Below, where there are several models, left the same error for the others, right how
        far the models themselves, solved exactly in time, lie from the finest.

    Raises
    ------
    FigureError
        A variable is missing, or no run of the first model succeeded.
    """
    missing = [name for name in (*OF_SETTINGS, *OF_MODELS) if name not in found]
    if missing:
        raise FigureError(f"expected {missing[0]} in the measurement")
    models = [str(m) for m in found["model"].values]
    of = found["model_of"].values.astype(str)
    worst = found[list(OF_SETTINGS[:3])].max("instruction", skipna=False)
    time, error = worst["run_time"].values, 1e3 * worst["error_max"].values
    rho, best = worst["change_rho"].values, found["pareto"].values.astype(bool)
    families = found["family"].values.astype(str)
    labels = found["label"].values.astype(str)
    first = of == models[0]
    order = {name: k for k, name in enumerate(dict.fromkeys(families.tolist()))}
    if not np.isfinite(error[first]).any():
        raise FigureError("no run of the first model succeeded: there is nothing to draw")
    several = len(models) > 1
    figure = blank(10.0, 8.6 if several else 5.0)
    panels = grid(figure, 2 if several else 1, 2)
    handles: list[Any] = []
    for panel, values in ((panels[0][0], error), (panels[0][1], rho)):
        handles = _lines(panel, time, values, families, first, order)
        _ring(panel, time, values, labels, first & best)
    clock = str(found.attrs.get("clock", "run"))
    _axes(panels[0][0], f"a. time steps: {models[0]}", "largest error of a marker [mm]", clock)
    _axes(panels[0][1], f"b. time steps: {models[0]}", "largest change of rho [1]", clock)
    others: list[Any] = []
    for i, model in enumerate(models[1:]):
        own = of == model
        ink = {"color": INKS[i % 7], "linestyle": LINES[i % 4]}
        others += _lines(panels[1][0], time, error, families, own, order, name=model, **ink)[:1]
        _ring(panels[1][0], time, error, labels, own & best)
    if several:
        _axes(panels[1][0], "c. time steps: other models", "largest error of a marker [mm]", clock)
        panels[1][0].legend(handles=others, fontsize="x-small", loc="best")
        _bars(panels[1][1], found, models)
    legend(figure, handles, most=3)
    heading = title or "error against run time"
    cast(Any, figure).suptitle(
        f"{heading} (simulated)\na to c: against the same model in small steps, ringed: none of the "
        "model is faster and better; d: models against each other",
        fontsize="medium",
    )
    return figure


@styled
def error_control(found: xr.Dataset, *, title: str = "") -> "Figure":
    """Draw the error achieved against the error requested.

    Parameters
    ----------
    found : xarray.Dataset
        ``error_max`` (setting, instruction) [m] and the coords ``requested`` [m], NaN for settings
        without error control, and ``model_of``.
    title : str
        Names the face.

    Returns
    -------
    matplotlib.figure.Figure
        One line per instruction and model; what lies below the diagonal holds what was requested.

    Raises
    ------
    FigureError
        No setting has error control.
    """
    requested = 1e3 * found["requested"].values
    errors = found["error_max"].transpose("setting", "instruction").values
    chosen = np.isfinite(requested)
    if not chosen.any():
        raise FigureError("no setting has error control: there is nothing to draw")
    figure = blank(5.6, 4.6)
    panel = grid(figure)[0][0]
    models = found["model_of"].values.astype(str)
    handles: list[Any] = []
    for i, model in enumerate(dict.fromkeys(models[chosen].tolist())):
        here = np.flatnonzero(chosen & (models == model))
        here = here[np.argsort(requested[here])]
        for k, instruction in enumerate(found["instruction"].values):
            error = 1e3 * errors[here, k]
            handles += panel.plot(
                requested[here], error, color=INKS[k % 7], linestyle=LINES[i % 4], marker=MARKS[k % 7],
                label=f"{instruction}, {model}",
            )  # fmt: skip
    ends = [requested[chosen].min(), requested[chosen].max()]
    panel.plot(ends, ends, color="0.5", linewidth=0.8)
    panel.annotate("as requested", (ends[0], ends[0]), color="0.4", fontsize="x-small", va="bottom")
    _axes(panel, "error control holds what lies below the line", "largest error of a marker [mm]")
    panel.set_xlabel("error requested [mm]")
    legend(figure, handles)
    cast(Any, figure).suptitle(f"{title or 'error control'} (simulated)")
    return figure


def _lines(
    panel: Any,
    time: NDArray[np.float64],
    values: NDArray[np.float64],
    families: NDArray[np.str_],
    own: NDArray[np.bool_],
    place: dict[str, int],
    *,
    name: str = "",
    **ink: Any,
) -> list[Any]:
    """One line per family; the longest first where they all belong to one named model."""
    good = own & np.isfinite(values) & np.isfinite(time) & (values > 0.0)
    handles: list[Any] = []
    for family in dict.fromkeys(families[own].tolist()):
        k = place[family]
        here = good & (families == family)
        failed = int((own & ~good & (families == family)).sum())
        look = ink or {"color": INKS[k % 7], "linestyle": LINES[k % 4]}
        handles += panel.plot(
            time[here], values[here], marker=MARKS[k % 7], markersize=5, linewidth=1.0,
            fillstyle="none" if k >= 7 else "full",
            label=name or family + (f" ({failed} failed)" if failed else ""), **look,
        )  # fmt: skip
    return sorted(handles, key=lambda h: -len(h.get_xdata())) if name else handles


def _ring(
    panel: Any,
    time: NDArray[np.float64],
    values: NDArray[np.float64],
    labels: NDArray[np.str_],
    which: NDArray[np.bool_],
) -> None:
    """Ring and name the points that no other beats."""
    panel.plot(
        time[which], values[which], linestyle="", marker="o", markersize=11, color="black",
        markerfacecolor="none", markeredgewidth=0.8,
    )  # fmt: skip
    named = np.flatnonzero(which & np.isfinite(time) & np.isfinite(values))
    for i, k in enumerate(named[np.argsort(time[named])]):
        side: dict[str, Any] = (
            {"xytext": (-5, -6), "ha": "right", "va": "top"}
            if i % 2 == 0
            else {"xytext": (5, 6), "ha": "left", "va": "bottom"}
        )
        panel.annotate(
            labels[k], (time[k], values[k]), textcoords="offset points", fontsize="x-small",
            color="0.2", **side,
        )  # fmt: skip


def _plain(value: float, place: int | None = None) -> str:
    return f"{value:g}"


def _axes(panel: Any, title: str, what: str, clock: str = "run") -> None:
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    for axis, scale in ((panel.xaxis, panel.set_xscale), (panel.yaxis, panel.set_yscale)):
        scale("log")
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0), numticks=12))
        axis.set_major_formatter(FuncFormatter(_plain))
        axis.set_minor_formatter(NullFormatter())
    panel.margins(0.12)
    panel.set_title(title, loc="left")
    panel.set_xlabel(f"{clock} time [s per simulated s]")
    panel.set_ylabel(what)
    panel.grid(which="major", color="0.9", linewidth=0.6)


def _bars(panel: Any, found: xr.Dataset, models: list[str]) -> None:
    """How far every model is from the finest."""
    gap = 1e3 * found["difference_max"].max("instruction").values
    rho = found["difference_rho"].max("instruction").values
    finest = str(found.attrs.get("finest", ""))
    place = np.arange(len(models))
    panel.barh(
        place, gap, 0.7, color=COLOURS[0], hatch=HATCHES[1], edgecolor="white", linewidth=0.0
    )
    for k in place:
        text = "finest" if models[k] == finest else f"{gap[k]:.2g} mm, rho by {rho[k]:.2g}"
        panel.annotate(
            text, (gap[k], k), xytext=(4, 0), textcoords="offset points", va="center",
            fontsize="x-small",
        )  # fmt: skip
    count = found["elements"].values
    ticks(panel, "y", place.tolist(), [f"{m}\n{n}" for m, n in zip(models, count, strict=True)])
    panel.set_ylim(len(models) - 0.5, -0.5)
    panel.set_xlim(0.0, max(1.55 * float(gap.max()), 1e-6))
    panel.set_title("d. discretisation: model and number of elements", loc="left")
    panel.set_xlabel("largest difference of a marker from the finest model [mm]")
