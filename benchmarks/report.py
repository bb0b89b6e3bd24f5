"""Table and figure of a measurement: Markdown on the terminal, CSV and pictures in a folder."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
import xarray as xr
from PIL import Image

from analysis.figures.style import COLOURS, HATCHES, MARKS, blank, grid, legend, save, styled, ticks

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LINES = ("-", "--", ":", "-.")
SHORT = 300.0  #: ratio of the ends of a logarithmic axis below which it is labelled within a decade


@dataclass(frozen=True)
class Chart:
    """Columns of a table as lines, or as stacked bars if the column `x` contains text."""

    x: str  #: column along the axis
    y: tuple[str, ...]  #: columns that are drawn
    label: str  #: quantity and unit of `y`
    by: str = ""  #: column whose values are separate lines; "" for one
    panel: str = ""  #: column whose values are separate panels; "" for one
    log: bool = False  #: both axes of lines are logarithmic


def say(text: str) -> None:
    """Print the progress of a measurement on the error stream."""
    print(text, file=sys.stderr, flush=True)


def face_of(path: Path | None, resolution: str = "coarse") -> xr.Dataset:
    """Face model of a file, by default the template face."""
    from emgface.face.file import load_face
    from emgface.face.template import template_face

    return template_face(resolution=resolution) if path is None else load_face(path)


def markdown(table: pd.DataFrame, form: str = ".4g") -> str:
    """Table in Markdown; floats in the given format, undefined values empty."""

    def cell(value: object) -> str:
        if isinstance(value, float):
            return "" if np.isnan(value) else format(value, form)
        return str(value)

    rows = [list(map(str, table.columns)), ["---"] * len(table.columns)]
    rows += [[cell(value) for value in row] for row in table.itertuples(index=False)]
    return "\n".join("| " + " | ".join(row) + " |" for row in rows)


@styled
def draw(table: pd.DataFrame, chart: Chart, title: str) -> "Figure":
    """Draw a table with a title, to which "(simulated)" is added."""
    bars = not pd.api.types.is_numeric_dtype(table[chart.x])
    names = list(dict.fromkeys(table[chart.panel])) if chart.panel else [""]
    across = min(3, len(names))
    rows = -(-len(names) // across)
    height = 1.0 + 0.3 * len(table) if bars else 3.0 * rows + 0.8
    figure = blank(7.0 if across == 1 else 3.6 * across, height)
    panels = [panel for row in grid(figure, rows, across, sharex=not bars) for panel in row]
    handles: dict[str, Any] = {}
    for panel, name in zip(panels, names, strict=False):
        own = table[table[chart.panel] == name] if chart.panel else table
        (_bars if bars else _lines)(panel, own, chart, handles)
        panel.set_title(str(name))
    for panel in panels[len(names) :]:
        panel.set_visible(False)
    legend(figure, list(handles.values()), list(handles))
    figure.suptitle(f"{title} (simulated)")
    return figure


def _lines(panel: Any, table: pd.DataFrame, chart: Chart, handles: dict[str, Any]) -> None:
    """Draw a panel; equal labels have the same style in all panels."""
    order = list(handles)
    groups = table.groupby(chart.by, sort=False) if chart.by else [("", table)]
    for name, own in groups:
        for column in chart.y:
            label = ", ".join(filter(None, (str(name), column if len(chart.y) > 1 else "")))
            if label not in order:
                order.append(label)
            k, own = order.index(label), own.sort_values(chart.x)
            handles[label] = panel.plot(
                own[chart.x], own[column], color=COLOURS[k % 7], linestyle=LINES[k // 7 % 4],
                marker=MARKS[k % 7] if len(own) < 30 else "",
            )[0]  # fmt: skip
    if chart.log:
        panel.set(xscale="log", yscale="log")
        for axis in (panel.xaxis, panel.yaxis):
            _decades(axis)
        panel.grid(which="major", color="0.9", linewidth=0.6)
    panel.set(xlabel=chart.x, ylabel=chart.label)


def _decades(axis: Any) -> None:
    """Label a logarithmic axis in plain numbers: every decade, on a short axis also 2 and 5 times."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    low, high = axis.get_view_interval()
    steps = (1.0, 2.0, 5.0) if high < SHORT * low else (1.0,)
    axis.set_major_locator(LogLocator(subs=steps))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def _bars(panel: Any, table: pd.DataFrame, chart: Chart, handles: dict[str, Any]) -> None:
    place, left = np.arange(len(table)), np.zeros(len(table))
    for k, column in enumerate(chart.y):
        handles[column] = panel.barh(
            place, table[column], 0.75, left=left, facecolor=COLOURS[k % 7],
            hatch=HATCHES[k % 7], edgecolor="white",
        )  # fmt: skip
        left = left + np.nan_to_num(table[column].to_numpy(dtype=float))
    ticks(panel, "y", place.tolist(), table[chart.x].tolist())
    panel.set_ylim(len(table) - 0.5, -0.5)
    panel.set_xlabel(chart.label)


def shrink(picture: Path) -> Path:
    """Store a picture with 128 colours."""
    with Image.open(picture) as opened:
        opened.convert("RGB").quantize(128).save(picture, optimize=True)
    return picture


def finish(
    name: str, table: pd.DataFrame, out: Path | None = None, chart: Chart | None = None
) -> list[Path]:
    """Print a table and, if a folder is given, store it with its figure.

    `name` is that of the files and the title. Returns the paths of CSV, SVG and PNG.
    """
    print(markdown(table), flush=True)
    if out is None:
        return []
    out.mkdir(parents=True, exist_ok=True)
    paths = [out / f"{name}.csv"]
    table.to_csv(paths[0], index=False)
    if chart is not None:
        figure = draw(table, chart, name)
        paths += [save(figure, out / f"{name}{ending}") for ending in (".svg", ".png")]
    say("written: " + ", ".join(map(str, paths)))
    return paths
