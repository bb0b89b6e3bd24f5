"""Electromyograms: recorded, filtered, and features."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import xarray as xr

from analysis.errors import FigureError
from analysis.figures.style import COLOURS, blank, grid, heading, legend, styled
from analysis.trajectory import names
from analysis.typed import selected

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOST_CHANNELS: Final = 14  #: largest number of channels on a page


@styled
def emg_with_features(
    raw: xr.DataArray,
    filtered: xr.DataArray,
    feature: xr.DataArray,
    *,
    channels: Sequence[str] | None = None,
    origin: str,
    label: str = "",
) -> "Figure":
    """Draw each channel as recorded and as filtered, and its feature.

    Parameters
    ----------
    raw, filtered : xarray.DataArray
        Dims (channel, time_emg) [V], time in seconds.
    feature : xarray.DataArray
        Dims (channel, time), or (muscle, time) with muscles of the same names.
    channels : sequence of str, optional
        Channels to draw, at most 14; by default the first seven.
    origin : {"measured", "simulated"}
        Origin of the recording.
    label : str
        Name of the trial in the title.

    Returns
    -------
    matplotlib.figure.Figure
        One row per channel: left the signals in microvolt about their means, right the feature.

    Raises
    ------
    FigureError
        Other dims, a unit other than volt, or an unknown channel.
    """
    for role, data in (("raw", raw), ("filtered", filtered)):
        if set(data.dims) != {"channel", "time_emg"} or data.attrs.get("units") != "V":
            raise FigureError(
                f"the {role} signal has dims {tuple(map(str, data.dims))} and units "
                f"{data.attrs.get('units')!r}, expected (channel, time_emg) in 'V'"
            )
    row = "channel" if "channel" in feature.dims else "muscle"
    if set(feature.dims) != {row, "time"}:
        raise FigureError(
            f"the feature has dims {tuple(map(str, feature.dims))}, expected (channel, time)"
        )
    known = [str(name) for name in raw["channel"].values]
    drawn = list(channels) if channels is not None else known[:7]
    wrong = [name for name in drawn if name not in known]
    if wrong or not drawn or len(drawn) > MOST_CHANNELS:
        raise FigureError(
            f"cannot draw {names(wrong) if wrong else f'{len(drawn)} channels'}, expected 1 to "
            f"{MOST_CHANNELS} of {names(known, MOST_CHANNELS)}"
        )
    figure = blank(8.0, 0.9 + 0.85 * len(drawn))
    axes = grid(figure, len(drawn), 2, sharex=True, width_ratios=(3, 2))
    has = [str(name) for name in feature[row].values]
    lines: list[Any] = []
    for (left, right), name in zip(axes, drawn, strict=True):
        lines = []
        for data, text, colour in (
            (raw, "as recorded", "0.65"), (filtered, "filtered", COLOURS[4]),
        ):  # fmt: skip
            one = selected(data, {"channel": name})
            values = 1e6 * (one.values - np.nanmean(one.values))
            lines += left.plot(
                one["time_emg"].values, values, color=colour, linewidth=0.4, label=text,
                rasterized=True,
            )  # fmt: skip
        left.set_ylabel(name.replace("_", " "), rotation=0, ha="right", va="center")
        left.yaxis.set_label_coords(-0.14, 0.5)
        if name in has:
            one = selected(feature, {row: name})
            lines += right.plot(one["time"].values, one.values, color=COLOURS[5], label="feature")
            right.set_ylim(bottom=min(0.0, float(np.nanmin(one.values))))
        else:
            right.text(0.5, 0.5, "no feature", transform=right.transAxes, ha="center", color="0.5")
        right.yaxis.tick_right()
        right.spines["left"].set_visible(False)
        right.spines["right"].set_visible(True)
    for panel, text in zip(axes[-1], ("time [s]", "time [s]"), strict=True):
        panel.set_xlabel(text)
    kind = str(feature.attrs.get("feature", feature.name or "feature"))
    units = str(feature.attrs.get("units", "1"))
    axes[0][0].set_title("signal [µV]")
    axes[0][1].set_title(f"feature: {kind}" + (f" [{units}]" if units != "1" else ""))
    legend(figure, [_thick(line) for line in lines])
    heading(figure, f"electromyogram {label}", origin)
    return figure


def _thick(line: Any) -> Any:
    """Return a copy of a line that is visible in a legend."""
    from matplotlib.lines import Line2D

    return Line2D([], [], color=line.get_color(), linewidth=1.5, label=str(line.get_label()))
