"""Figure of outcomes against the share of a lip that is removed."""

from typing import Any, Final

import pandas as pd
from matplotlib.figure import Figure

from emgface.treatment.dose import (
    LEAST_FOR_QUANTILES,
    DoseSetting,
    changes_by_dose,
    draws_of,
    intervals_by_dose,
    spread_of,
)
from emgface.treatment.outcomes import OUTCOMES
from emgface.treatment.plan import NOT_VALIDATED

SHOWN_MEASURES: Final = (
    "mouth width", "lower vermilion height", "lip opening", "pursing, amplitude",
    "smile, excursion of the corners", "pressure held before the lips part",
)  # fmt: skip


def dose_figure(table: pd.DataFrame, setting: DoseSetting) -> Figure:
    """Change of outcomes against the share removed: median and persons (band), and every draw.

    A draw of the unknown parameters is a point, the mean over persons; many draws are a bar. The title
    states the faces, contact and numbers of persons and draws.
    """
    intervals, drawn = intervals_by_dose(table), _drawn_points(table)
    units = {o.name: o.unit for o in OUTCOMES}
    shown = [
        name
        for name in SHOWN_MEASURES
        if intervals.loc[intervals["outcome"] == name, "median"].notna().any()
    ]
    figure = Figure(figsize=(10.5, 6.4), layout="constrained")
    axes = figure.subplots(2, -(-max(len(shown), 1) // 2), squeeze=False)
    for axis in axes.ravel()[len(shown) :]:
        axis.set_axis_off()
    for axis, name in zip(axes.ravel(), shown, strict=False):
        own, points = intervals[intervals["outcome"] == name], drawn[drawn["outcome"] == name]
        groups = own.groupby(["shape", "place", "rejoin"], sort=False)
        for k, (label, part) in enumerate(groups):
            part = part.sort_values("share")
            x = 100 * part["share"].to_numpy()
            (line,) = axis.plot(
                x, part["median"], "o-", ms=3.5, label=_line_label(label, groups.groups)
            )
            color = line.get_color()
            axis.fill_between(x, part["persons low"], part["persons high"], alpha=0.15, color=color)
            at, shift = points.set_index(["shape", "place", "rejoin"]).index, 0.7 * (k + 1)
            mine = points[at == label]
            if len(mine) and draws_of(table) >= LEAST_FOR_QUANTILES:
                axis.vlines(
                    x + shift, part["parameters low"], part["parameters high"], color=color, lw=1.2
                )
            elif len(mine):
                axis.plot(100 * mine["share"] + shift, mine["change"], "x", ms=4, color=color)
        axis.axhline(0.0, color="0.6", lw=0.8)
        unit = units.get(name, "mm").replace("mm2", "mm²")
        axis.set(title=name, xlabel="share of the lip removed [%]", ylabel=f"change [{unit}]")
        if bounds := int(own["bounds"].sum()):
            axis.set_title(f"{name}\n({bounds} changes are bounds)")
    if shown:
        axes[0, 0].legend(frameon=False, fontsize=8)
    figure.suptitle(_figure_title(table, setting), fontsize=9)
    return figure


def _drawn_points(table: pd.DataFrame) -> pd.DataFrame:
    """Change in every draw of the unknown parameters, mean over persons, in long form."""
    long = changes_by_dose(table)
    keys = ["shape", "share", "place", "rejoin", "outcome", "draw"]
    return long[long["draw"] > 0].groupby(keys, sort=False)["change"].mean().reset_index()


def _figure_title(table: pd.DataFrame, setting: DoseSetting) -> str:
    persons, draws = int(table["person"].nunique()), draws_of(table)
    contact = "in contact" if setting.contact else "without contact"
    spread = f"median and {spread_of(persons)[2]} of the persons (band)"
    if draws:
        mark = f"{spread_of(draws)[2]}, bars" if draws >= LEAST_FOR_QUANTILES else "crosses"
        spread += (
            f"; {draws} draw{'s' * (draws > 1)} of unknown parameters, mean of persons ({mark})"
        )
    return (
        f"simulated: {persons} generated person{'s' * (persons > 1)}, faces of {setting.resolution} "
        f"resolution, {contact}, sigma_max {setting.sigma_max / 1e3:g} kPa\n{spread}\n{NOT_VALIDATED}"
    )


def _line_label(label: Any, groups: Any) -> str:
    """Words of a line: those of its shape, place and joining that differ between lines."""
    differing = [len(set(values)) > 1 for values in zip(*groups, strict=True)]
    joined = {"all": "fibres joined", "none": "fibres not joined"}
    words = (str(label[0]), f"at {label[1]:g}", joined.get(label[2], str(label[2])))
    return ", ".join(w for w, d in zip(words, differing, strict=True) if d) or words[0]
