"""Which settings can be simulated at all, and where the limit of each method lies."""

import textwrap
from typing import TYPE_CHECKING, Any, Final, cast

import numpy as np
import xarray as xr
from numpy.typing import NDArray

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
LETTER: Final = 0.062
LINE: Final = 0.17
COLUMN: Final = 1.12
"""Width of a letter, height of a line and width of a column in small type [inch]."""
MOST: Final = 19
"""Letters of a line that a column holds."""


@styled
def stability_table(found: xr.Dataset, *, title: str = "") -> "Figure":
    """Draw which method survives which case.

    Parameters
    ----------
    found : xarray.Dataset
        Text ``status`` (case, method): "ok", "ok:<what was rightly refused>", "failed:<name of the
        error>", "wrong:<what>" for an answer that came without an error, or "" where not run.
        Optional coord ``group`` (case): cases that follow each other with the same one stand under it.
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
    status = _text(found, "status", ("case", "method"))
    kinds = np.where(status == "", "not run", np.char.partition(status, ":")[..., 0])
    odd = sorted(set(kinds.ravel().tolist()) - set(OUTCOMES))
    if odd:
        raise FigureError(
            f"the status {names(odd)} is unknown, expected ok, failed:<error> or wrong:<what>"
        )
    words = np.array(
        [[str(s).rpartition(":")[2] or str(k) for s, k in zip(*pair, strict=True)]
         for pair in zip(status, kinds, strict=True)]
    )  # fmt: skip
    cases = [str(label).replace("_", " ") for label in found["case"].values]
    groups = found["group"].values.astype(str).tolist() if "group" in found.coords else None
    return _table(cases, groups, found["method"].values, words, kinds, title or "stability")


@styled
def limits_table(found: xr.Dataset, *, title: str = "") -> "Figure":
    """Draw where the limit of each method lies.

    Parameters
    ----------
    found : xarray.Dataset
        Text ``limit`` (case, method): "all", or the range that a method holds with the error that
        ends it in brackets, or "" where not run. Optional coord ``group`` (case).
    title : str
        Names the scene.

    Returns
    -------
    matplotlib.figure.Figure
        One row per swept parameter, one column per method.

    Raises
    ------
    FigureError
        Other dims.
    """
    limit = _text(found, "limit", ("case", "method"))
    kinds = np.where(limit == "", "not run", np.where(limit == "all", "ok", "failed"))
    kinds = np.where(np.char.find(limit, "WRONG") >= 0, "wrong", kinds)
    words = np.char.replace(np.where(limit == "", "not run", limit), " (", "\n(")
    cases = [str(label) for label in found["case"].values]
    groups = found["group"].values.astype(str).tolist() if "group" in found.coords else None
    return _table(cases, groups, found["method"].values, words, kinds, title or "limits", lines=2)


def _text(found: xr.Dataset, name: str, dims: tuple[str, str]) -> NDArray[np.str_]:
    if name not in found or set(found[name].dims) != set(dims):
        raise FigureError(f"expected a text variable {name} with dims {' and '.join(dims)}")
    return found[name].transpose(*dims).values.astype(str)


def _table(
    cases: list[str],
    groups: list[str] | None,
    methods: NDArray[Any],
    words: NDArray[np.str_],
    kinds: NDArray[np.str_],
    title: str,
    *,
    lines: int = 1,
) -> "Figure":
    """Cells in the colours of their kinds, under wrapped heads."""
    from matplotlib.patches import Patch, Rectangle

    heads = [textwrap.fill(str(m).replace("_", " "), 14) for m in methods]
    places, spaces = _places(groups or [""] * len(cases))
    height = LINE * (lines + 0.3)
    left = LETTER * max(map(len, cases)) + 0.3
    figure = blank(left + COLUMN * len(heads), 1.4 + height * (places[-1] + 1))
    panel = grid(figure)[0][0]
    for row, place in enumerate(places):
        for column in range(len(heads)):
            kind = str(kinds[row, column])
            colour, hatch = OUTCOMES[kind]
            panel.add_patch(
                Rectangle(
                    (column - 0.48, place - 0.45), 0.96, 0.9, facecolor=colour, hatch=hatch,
                    edgecolor="white", alpha=0.35 if kind != "not run" else 1.0,
                )
            )  # fmt: skip
            text = "\n".join(
                part if len(part) <= MOST else f"{part[: MOST - 1]}…"
                for part in str(words[row, column]).split("\n")
            )
            panel.text(column, place, text, ha="center", va="center", fontsize="x-small")
    for place, text in spaces:
        panel.text(-0.5, place, text, ha="left", va="center", fontsize="small", weight="bold")
    panel.set_xlim(-0.5, len(heads) - 0.5)
    panel.set_ylim(places[-1] + 0.5, -0.5)
    ticks(panel, "x", range(len(heads)), heads)
    ticks(panel, "y", places, cases)
    panel.tick_params(axis="both", length=0, labelsize="x-small")
    panel.xaxis.tick_top()
    panel.tick_params(axis="x", length=0, labelsize="small")
    for spine in panel.spines.values():
        spine.set_visible(False)
    shown = [k for k in ("ok", "failed", "wrong") if (kinds == k).any()]
    patches = [
        Patch(
            facecolor=OUTCOMES[k][0], hatch=OUTCOMES[k][1], edgecolor="white", alpha=0.35, label=k
        )
        for k in shown
    ]
    legend(figure, patches)
    # motions of a bench are always simulated
    cast(Any, figure).suptitle(f"{title} (simulated)")
    return figure


def _places(groups: list[str]) -> tuple[list[int], list[tuple[int, str]]]:
    """Row of every case, and row and text of every heading."""
    places: list[int] = []
    headings: list[tuple[int, str]] = []
    row, latest = 0, ""
    for group in groups:
        if group != latest:
            headings.append((row, group))
            row, latest = row + 1, group
        places.append(row)
        row += 1
    return places, headings
