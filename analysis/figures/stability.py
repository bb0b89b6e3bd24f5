"""Which settings can be simulated at all."""

from typing import TYPE_CHECKING, Any, Final, cast

import numpy as np
import xarray as xr

from analysis.errors import FigureError
from analysis.figures.style import blank, grid, legend, styled, ticks
from analysis.trajectory import names

if TYPE_CHECKING:
    from matplotlib.figure import Figure

OUTCOMES: Final = {
    "ok": ("#009E73", ""),
    "failed": ("#D55E00", "//"),
    "wrong": ("#000000", "xx"),
    "not run": ("0.92", ""),
}
"""Colour and hatch of a cell."""


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
