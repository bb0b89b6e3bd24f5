"""Scores of a study compared with the values and statements printed by Eskes et al. 2017.

Source: M. Eskes et al. 2017, Simulation of facial expressions using person-specific sEMG signals
controlling a biomechanical face model, Results (mean, standard deviation and median of rho) and Fig. 6.
"""

from typing import Final

import numpy as np
import xarray as xr

from analysis.axes import reference_cube
from analysis.descriptives import descriptives
from analysis.tables import Column, Table, origin_of, recordings
from analysis.typed import selected, status_of

PRINTED: Final = {
    "act_all": {"median": 0.45, "mean": 0.26, "standard_deviation": 0.63},
    "act_3": {"median": 0.78, "mean": 0.55, "standard_deviation": 0.51},
    "act_rel": {"median": 0.77, "mean": 0.53, "standard_deviation": 0.52},
}
"""Median, mean and standard deviation of rho over volunteers, instructions, repetitions and markers."""
PRINTED_SOURCE: Final = "Eskes et al. 2017, Results"


def printed_table(cube: xr.Dataset) -> Table:
    """Tabulate the statistics of rho of a study and the printed ones."""
    base = reference_cube(cube)
    statistics = descriptives(base)
    rows: list[tuple[object, ...]] = []
    for strategy, printed in PRINTED.items():
        known = strategy in statistics["strategy"].values
        for name, value in printed.items():
            own = float(selected(statistics[name], {"strategy": strategy})) if known else np.nan
            rows.append((strategy, name.replace("_", " "), value, own, own - value))
    origin = origin_of(base)
    columns = (
        Column("strategy"), Column("of rho"), Column("printed"), Column("this study"),
        Column("difference"),
    )  # fmt: skip
    note = f"Printed: {PRINTED_SOURCE}, six volunteers."
    if origin == "simulated":
        note += " The recordings of this study are simulated, so that the values need not agree."
    return Table(
        f"rho and the printed values, {recordings(origin)}", columns, tuple(rows), origin, note
    )


def printed_statements(cube: xr.Dataset) -> list[tuple[str, str, str]]:
    """Judge the printed statements on Fig. 6 and amplitude by the medians of a study.

    Returns statement, "holds", "does not hold" or "not tested", and the numbers compared.
    """
    base = reference_cube(cube)
    rho = base["rho"].where(status_of(base) == "ok")
    ratio = base["amplitude_ratio"].where(status_of(base) == "ok")
    markers = [str(m) for m in base["marker"].values]
    lateral = [m for m in markers if "corner" in m or "_lateral_" in m]
    central = [m for m in markers if "paramedian" in m]
    upper, lower = ([m for m in markers if m.startswith(side)] for side in ("upper", "lower"))
    strategies = base["strategy"].values.tolist()
    rows: list[tuple[str, str, str]] = []

    def compare(text: str, more: float, less: float) -> None:
        known = np.isfinite(more) and np.isfinite(less)
        said = ("holds" if more > less else "does not hold") if known else "not tested"
        rows.append((text, said, f"{more:.2f} and {less:.2f}"))

    compare(
        "lateral markers have a higher rho than central ones",
        _median(selected(rho, {"marker": lateral})),
        _median(selected(rho, {"marker": central})),
    )
    compare(
        "markers of the upper lip have a higher rho than those of the lower lip",
        _median(selected(rho, {"marker": upper})),
        _median(selected(rho, {"marker": lower})),
    )
    medians = {
        str(i): _median(selected(rho, {"instruction": i})) for i in base["instruction"].values
    }
    best = [medians[i] for i in ("E", "F") if i in medians]
    rest = [value for i, value in medians.items() if i not in ("E", "F")]
    compare(
        "instructions E and F have the highest rho",
        min(best) if len(best) == 2 else np.nan,
        max(rest) if rest else np.nan,
    )
    for other in ("act_3", "act_rel"):
        both = other in strategies and "act_all" in strategies
        compare(
            f"{other} has a higher rho than act_all",
            _median(selected(rho, {"strategy": other})) if both else np.nan,
            _median(selected(rho, {"strategy": "act_all"})) if both else np.nan,
        )
    moved = _median(ratio)
    rows.append(
        (
            "the model moves less than the volunteer",
            ("holds" if moved < 1.0 else "does not hold") if np.isfinite(moved) else "not tested",
            f"amplitude ratio {moved:.2f}",
        )
    )
    return rows


def _median(values: xr.DataArray) -> float:
    known = values.values[np.isfinite(values.values)]
    return float(np.median(known)) if known.size else np.nan


def used_stress(cube: xr.Dataset) -> dict[str, tuple[float, float]]:
    """Smallest and largest sigma_max [Pa] of the scored trials of every volunteer."""
    base = reference_cube(cube)
    used = base["sigma_max"].where(status_of(base) == "ok")
    ranges: dict[str, tuple[float, float]] = {}
    for volunteer in base["volunteer"].values.tolist():
        values = selected(used, {"volunteer": volunteer}).values
        values = values[np.isfinite(values)]
        if values.size:
            ranges[str(volunteer)] = float(values.min()), float(values.max())
    return ranges
