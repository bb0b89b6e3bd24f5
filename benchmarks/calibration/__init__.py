"""Size of every test and coverage of every interval with few volunteers, by simulation.

    python -m benchmarks calibration --out docs/statistics

draws cubes of scores without any difference between strategies and counts how often each test
rejects and how often each interval contains the true value: six volunteers and six instructions
under eight conditions, and each kind of interval, on three times as many cubes, for two to twelve
volunteers. About six minutes of processor time, in proportion to --simulations.
"""

from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from analysis.tables import Column, Table
from benchmarks.calibration.shares import METHODS, calibration, interval_coverage
from benchmarks.calibration.skewed import skewed
from benchmarks.report import say

BOTH: dict[str, Any] = {"sd_interaction": 0.3, "sd_instruction_strategy": 0.3}
CONDITIONS: dict[str, dict[str, Any]] = {
    "no interaction": {"sd_interaction": 0.0, "sd_instruction_strategy": 0.0},
    "volunteers 0.3": {"sd_interaction": 0.3, "sd_instruction_strategy": 0.0},
    "instructions 0.3": {"sd_interaction": 0.0, "sd_instruction_strategy": 0.3},
    "both 0.3": BOTH,
}
"""Standard deviations of volunteer x strategy and instruction x strategy, in Fisher's z."""
DEPARTURES: dict[str, dict[str, Any]] = {
    "15 % of trials lost": BOTH | {"missing": 0.15},
    "t with 3 degrees": BOTH | {"freedom": 3.0},
    "one strategy twice the spread": BOTH | {"spread": (2.0, 1.0, 1.0)},
    "rho near 1, clipped": BOTH | {"centre": 4.2},
}
FEWER = ("sign_flip", "mixed_model", "mixed_model_in_general")
SIZES = ((2, 6), (3, 6), (4, 6), (5, 6), (6, 6), (8, 6), (12, 6), (6, 2), (6, 3), (6, 4), (12, 3))
"""Numbers of volunteers and of instructions."""
SEED = 1000


def shown(one: xr.Dataset, test: str, name: str) -> str:
    """Format the fraction of a test with its Monte Carlo error; empty if undefined."""
    if test not in one["test"].values:
        return ""
    one = one.sel(test=test)
    share, error = float(one[name]), float(one[f"{name}_error"])
    return "" if np.isnan(share) else f"{share:.3f} ± {error:.3f}"


def pivot(found: dict[str, xr.Dataset], name: str, title: str, note: str) -> Table:
    """Tabulate tests in rows and conditions in columns."""
    tests = list(dict.fromkeys(str(test) for one in found.values() for test in one["test"].values))
    rows: list[tuple[str, ...]] = []
    for test in tests:
        cells = [shown(one, test, name) for one in found.values()]
        if any(cells):
            rows.append((test, *cells))
    return Table(title, (Column("test"), *map(Column, found)), tuple(rows), "simulated", note)


def listed(found: dict[str, xr.Dataset], names: tuple[str, ...], title: str) -> Table:
    """One row per condition and test, for the CSV."""
    columns = [Column(part) for name in names for part in (name, f"{name} Monte Carlo error")]
    rows = [
        (label, str(test), int(one.attrs["simulations"]))
        + tuple(float(one.sel(test=test)[part]) for n in names for part in (n, f"{n}_error"))
        for label, one in found.items()
        for test in one["test"].values
    ]
    heads = (Column("condition"), Column("test"), Column("cubes"), *columns)
    return Table(title, heads, tuple(rows), "simulated")


def intervals(out: Path, count: int) -> None:
    """Write the coverage of every kind of interval for several numbers of volunteers."""
    covered: dict[str, xr.Dataset] = {}
    for volunteers, instructions in SIZES:
        label = f"{volunteers} volunteers, {instructions} instructions"
        covered[label] = interval_coverage(
            simulations=3 * count, seed=SEED, volunteers=volunteers, instructions=instructions,
            **BOTH,
        )  # fmt: skip
        say(label)
    kinds = list(dict.fromkeys(str(t) for one in covered.values() for t in one["test"].values))
    table = Table(
        "coverage of intervals of nominal 0.95, simulated scores",
        (Column("volunteers, instructions"), *map(Column, kinds)),
        tuple(
            (label, *(shown(one, kind, "coverage") for kind in kinds))
            for label, one in covered.items()
        ),
        "simulated",
        f"{3 * count} cubes per row, seed {SEED}, ± Monte Carlo error; difference of two strategies "
        "in z; the standard deviations of volunteer x strategy and instruction x strategy are 0.3. For "
        "fewer volunteers or instructions than required, a row shows the coverage that an interval "
        "would have; studies report no interval in these cases. Computed by python -m benchmarks "
        "calibration.",
    )  # fmt: skip
    (out / "intervals.md").write_text(table.markdown(), encoding="utf-8")
    rows = listed(covered, ("coverage",), table.title)
    (out / "intervals.csv").write_text(rows.csv(), encoding="utf-8")
    print(table.text())


def sizes(out: Path, count: int) -> None:
    """Write size and coverage of every test under every condition."""
    found: dict[str, xr.Dataset] = {}
    for label, model in (CONDITIONS | DEPARTURES).items():
        found[label] = calibration(
            methods=FEWER if label in DEPARTURES else tuple(METHODS),
            simulations=count, seed=SEED, volunteers=6, instructions=6, **model,
        )  # fmt: skip
        say(label)
    note = (
        f"{count} cubes per condition, seed {SEED}, ± Monte Carlo error; six volunteers, six "
        "instructions, two repetitions, three markers. The first four conditions differ in the "
        "standard deviations, in z, of volunteer x strategy and instruction x strategy; both are 0.3 "
        "in the other conditions. The true value is the difference for the instructions drawn, except "
        "in the rows 'mixed model, instructions' and 'mixed model, misread', in which it is the "
        "difference for instructions in general. 'Misread' is the test for these instructions, "
        "interpreted as a test for instructions in general. Computed by python -m benchmarks "
        "calibration."
    )
    parts = [
        pivot(found, "size", "size at 0.05 without a difference, simulated scores", note),
        pivot(found, "coverage", "coverage of intervals of 0.95 (equivalence 0.90), simulated scores",
              "The exact intervals (sign flip, Wilcoxon) have the confidence level 62/64, the lowest "
              "attainable level above the nominal one."),
    ]  # fmt: skip
    text = "\n".join(part.markdown() for part in parts)
    (out / "calibration.md").write_text(text, encoding="utf-8")
    rows = listed(found, ("size", "coverage"), "size and coverage, simulated scores")
    (out / "calibration.csv").write_text(rows.csv(), encoding="utf-8")
    print(*(part.text() for part in parts), sep="\n")


def main(
    simulations: int = 100,
    out: Path = Path("docs/statistics"),
    only: str = "",
) -> None:
    """Write the tables; `only` is intervals, sizes or skewed."""
    out.mkdir(parents=True, exist_ok=True)
    if only in ("", "skewed"):
        skewed(out)
    if only in ("", "intervals"):
        intervals(out, simulations)
    if only in ("", "sizes"):
        sizes(out, simulations)
