"""Figure of a sweep: outcomes of every run with their errors, one panel for each outcome."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from analysis.figures.style import COLOURS, blank, grid, styled, ticks
from emgface.anatomy.head.sweep import MESH_ERROR, STEP_ERROR

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@styled
def outcome_figure(table: pd.DataFrame, outcomes: Sequence[str], title: str) -> "Figure":
    """Draw outcomes of a sweep over its runs, with the sums of step and mesh errors as bars."""
    figure = blank(2.2 + 2.2 * len(outcomes), 1.2 + 0.22 * len(table))
    place = np.arange(len(table))
    for k, (panel, outcome) in enumerate(
        zip(grid(figure, 1, len(outcomes), sharex=False)[0], outcomes, strict=True)
    ):
        known = [c for c in (outcome + STEP_ERROR, outcome + MESH_ERROR) if c in table]
        error = table[known].fillna(0.0).sum(axis=1).to_numpy(dtype=float)
        panel.errorbar(
            table[outcome], place, xerr=error, fmt="o", markersize=4, color=COLOURS[k], capsize=2
        )
        panel.axvline(0.0, color="0.7", linewidth=0.8, zorder=0)
        for y in place:
            panel.axhline(y, color="0.93", linewidth=0.6, zorder=0)
        name, _, unit = outcome.rpartition("_")
        panel.set_xlabel(f"{name.replace('_', ' ')}, {unit.replace('2', '²')}")
        ticks(panel, "y", place.tolist(), table["name"].tolist() if k == 0 else [""] * len(table))
        panel.set_ylim(len(table) - 0.5, -0.5)
    figure.suptitle(f"{title} (simulated)")
    return figure
