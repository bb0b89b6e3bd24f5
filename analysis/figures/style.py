"""Style and output of the figures.

Colours are those of Okabe and Ito, distinct under the common colour deficiencies; hatches, line
styles and markers repeat the distinction for print in grey. matplotlib is imported only when a
figure is drawn.
"""

import io
import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from functools import wraps
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Any, Final, ParamSpec, TypeVar, cast

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from analysis.cube import TRIAL_DIMS
from analysis.tables import recordings

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOURS: Final = ("#56B4E9", "#E69F00", "#009E73", "#CC79A7", "#0072B2", "#D55E00", "#F0E442")
HATCHES: Final = ("", "//", "..", "xx", "\\\\", "--", "oo")
MARKS: Final = ("o", "s", "^", "D", "v", "P", "X")
FIRST_LINE: Final = {"color": COLOURS[4], "linestyle": "-"}  #: line style of a model or an input
SECOND_LINE: Final = {"color": COLOURS[5], "linestyle": "--"}
"""Line style of a recording or a reference."""
LETTER: Final = 0.6  #: mean width of a letter, in the size of the type [1]
POINTS_PER_INCH: Final = 72.0  #: per inch
LONGEST_LABEL: Final = 27  #: largest number of characters of a line at an axis
LEAST_OF_BOX: Final = 8  #: number of values below which quartiles say little, and points are drawn
LEGEND_LINE_WIDTH: Final = 6  #: width of the sample of a line in a legend, in letters
SHADES: Final = "cividis"  #: colour map of ordered values, suitable for colour vision deficiency

LITERAL: Final[dict[str, Any]] = {"text.parse_math": False}
"""Dollar signs in names of files, channels and volunteers are characters, not formulas."""
STYLE: Final[dict[str, Any]] = {
    **LITERAL,
    "font.size": 9.0,
    "axes.titlesize": 9.0,
    "axes.labelsize": 9.0,
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "lines.linewidth": 1.2,
    "hatch.linewidth": 0.5,
    "legend.frameon": False,
    "legend.fontsize": 8.0,
    "figure.titlesize": 11.0,
}
SAVED_PARAMETERS: Final[dict[str, Any]] = {
    # Text is stored as text, so that it can be searched and set in another font.
    "svg.fonttype": "none",
    "pdf.fonttype": 42,
    # Element identifiers of an SVG would be random, and equal figures would differ as files.
    "svg.hashsalt": "emgface",
}

P = ParamSpec("P")
T = TypeVar("T")


def styled(draw: "Callable[P, Figure]") -> "Callable[P, Figure]":
    """Draw in the style of the package, independent of the user's settings of matplotlib."""

    @wraps(draw)
    def inside(*args: P.args, **kwargs: P.kwargs) -> "Figure":
        import matplotlib

        with settings({}):
            matplotlib.rcdefaults()
            with settings(STYLE):
                return draw(*args, **kwargs)

    return inside


def literal(draw: "Callable[P, T]") -> "Callable[P, T]":
    """Draw texts as they are, in the settings of the user, as `styled` does in its own."""

    @wraps(draw)
    def inside(*args: P.args, **kwargs: P.kwargs) -> "T":
        with settings(LITERAL):
            return draw(*args, **kwargs)

    return inside


def blank(width: float, height: float) -> "Figure":
    """Return an empty figure [inch], not attached to any window."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def grid(figure: "Figure", rows: int = 1, columns: int = 1, **options: Any) -> list[list[Any]]:
    """Divide a figure into rows and columns of panels."""
    return cast(Any, figure).subplots(rows, columns, squeeze=False, **options).tolist()


def trial_label(data: xr.Dataset) -> str:
    """Label of the trial, as far as the attributes specify it."""
    return " ".join(str(data.attrs[name]) for name in TRIAL_DIMS if name in data.attrs)


def heading(figure: "Figure", what: str, origin: str) -> None:
    """Set the title, with the origin (measured or simulated)."""
    words, source = " ".join(what.split()), f"({recordings(origin)})"
    size = float(cast(float, STYLE["figure.titlesize"])) / POINTS_PER_INCH
    most = max(20, int(figure.get_figwidth() / (LETTER * size)))
    text = f"{words} {source}"
    text = text if len(text) <= most else f"{fill(words, most)}\n{fill(source, most)}"
    cast(Any, figure).suptitle(text)


def title_of(figure: "Figure") -> str:
    """Title of a figure in one line."""
    return " ".join(figure.get_suptitle().split())


def legend(
    figure: "Figure", handles: Sequence[Any], labels: Sequence[str] | None = None, most: int = 3
) -> None:
    """Add a legend below all panels, with at most `most` entries per row, no wider than the figure."""
    texts = [str(one.get_label()) for one in handles] if labels is None else list(labels)
    size = float(cast(float, STYLE["legend.fontsize"])) / POINTS_PER_INCH
    room = int(figure.get_figwidth() / (LETTER * size))

    def wide(columns: int) -> int:
        """Number of letters of a row, with the samples of lines."""
        rows = -(-len(texts) // columns)
        return sum(
            max(map(len, texts[k : k + rows])) + LEGEND_LINE_WIDTH
            for k in range(0, len(texts), rows)
        )

    columns = min(most, len(texts))
    while columns > 1 and wide(columns) > room:
        columns -= 1
    texts = [_shortened(text, max(room - LEGEND_LINE_WIDTH, LONGEST_LABEL)) for text in texts]
    cast(Any, figure).legend(
        handles=list(handles), labels=texts, loc="outside lower center", ncols=max(columns, 1)
    )


def ticks(panel: "Axes", which: str, places: Sequence[float], texts: Sequence[str]) -> None:
    """Set tick labels of an axis, ``"x"`` or ``"y"``, in small type if there are many.

    The middle of lines above `LONGEST_LABEL` characters is left out; texts below an axis are
    upright if they would overlap.
    """
    size = "x-small" if len(texts) > 8 else "medium"
    shown = ["\n".join(map(_shortened, text.split("\n"))) for text in texts]
    letter = (
        LETTER
        * float(cast(float, STYLE["font.size"]))
        * (0.7 if len(texts) > 8 else 1.0)
        / POINTS_PER_INCH
    )
    width = cast(Any, panel).get_position().width * cast(Any, panel).figure.get_figwidth()
    longest = max((len(line) for text in shown for line in text.split("\n")), default=0)
    upright = which == "x" and letter * (longest + 1) * len(texts) > width
    turned = {"rotation": 90} if upright else {}
    getattr(cast(Any, panel), f"set_{which}ticks")(list(places), shown, fontsize=size, **turned)


def _shortened(line: str, most: int = LONGEST_LABEL) -> str:
    """A line of at most `most` characters: its beginning and its end."""
    end = most // 3
    return line if len(line) <= most else f"{line[: most - end - 1]}…{line[-end:]}"


def logarithmic(panel: "Axes") -> None:
    """Give a panel a logarithmic vertical axis with plain numbers; powers of ten would be formulas."""
    from matplotlib.ticker import LogFormatterSciNotation

    class Plain(LogFormatterSciNotation):
        def __call__(self, x: float, pos: Any = None) -> str:
            return f"{x:g}" if super().__call__(x, pos) else ""

    cast(Any, panel).set_yscale("log")
    panel.yaxis.set_major_formatter(Plain())
    panel.yaxis.set_minor_formatter(Plain())


def boxes(
    panel: "Axes",
    groups: Mapping[float, NDArray[np.float64]],
    width: float,
    which: int,
    *,
    whiskers: float | tuple[float, float] = 1.5,
) -> None:
    """Draw a box for the values at each place, in the colour and hatch number `which`.

    Quartiles, median as a line, mean as a dot. Whiskers either reach the last value within a
    multiple of the interquartile range, values beyond drawn as crosses, or two percentiles. Fewer than
    `LEAST_OF_BOX` values are drawn one by one, with their median as a line.
    """
    for place, values in groups.items():
        if len(values) >= LEAST_OF_BOX:
            continue
        colour, mark, axis = COLOURS[which % 7], MARKS[which % 7], cast(Any, panel)
        axis.scatter(
            [place] * len(values), values, s=18, marker=mark, color=colour,
            edgecolor="black", linewidth=0.6, zorder=3,
        )  # fmt: skip
        middle = float(np.median(values))
        ends = [place - width / 2, place + width / 2]
        axis.plot(ends, [middle, middle], color="black", linewidth=1.6)
    groups = {place: values for place, values in groups.items() if len(values) >= LEAST_OF_BOX}
    if not groups:
        return
    panel.boxplot(
        list(groups.values()),
        positions=list(groups),
        widths=width,
        whis=whiskers,
        showfliers=isinstance(whiskers, float),
        patch_artist=True,
        showmeans=True,
        manage_ticks=False,
        boxprops={"facecolor": COLOURS[which % 7], "hatch": HATCHES[which % 7], "linewidth": 0.7},
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


def save(figure: "Figure", path: str | Path, *, dpi: int = 200) -> Path:
    """Write a figure in the format given by the suffix of `path`, with its title in the metadata.

    `dpi` is the resolution of pixel formats in dots per inch. An existing file is replaced when the
    new one is complete.
    """
    path = Path(path)
    temporary = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        temporary.write_bytes(encoded_figure(figure, path.suffix, dpi=dpi))
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)
    return path


def encoded_figure(figure: "Figure", suffix: str, *, dpi: int = 200) -> bytes:
    """Content of the file of a figure in the format of a suffix, such as ``.png``; see `save`."""
    title = title_of(figure)
    # Without a date, equal figures are equal files.
    metadata = {
        ".png": {"Title": title, "Software": None},
        ".svg": {"Title": title, "Date": None},
        ".pdf": {"Title": title, "CreationDate": None},
    }.get(suffix.lower(), {})
    content, form = io.BytesIO(), suffix.lower().removeprefix(".") or None
    with settings(SAVED_PARAMETERS):
        cast(Any, figure).savefig(content, format=form, dpi=dpi, metadata=metadata)
    return content.getvalue()


def settings(chosen: dict[str, Any]) -> AbstractContextManager[None]:
    """Return a context in which matplotlib has these settings."""
    import matplotlib

    return cast(Any, matplotlib).rc_context(chosen)
