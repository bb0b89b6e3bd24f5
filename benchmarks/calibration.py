"""Size of every test and coverage of every interval with few volunteers, by simulation.

    python benchmarks/calibration.py --simulations 2000 --out docs/statistics

draws cubes of scores without any difference between strategies and counts how often each test
claims one. About 0.15 s per cube and number of volunteers.
"""

import argparse
import sys
import time
from pathlib import Path

import numpy as np

from analysis.statistics.calibration import calibration
from analysis.tables import Column, Table

EXACT = {
    "sign flip": "exact: multiples of 2/2^n",
    "sign flip, joint": "exact, over all contrasts",
    "Wilcoxon": "exact: multiples of 2/2^n",
    "Wilcoxon, Holm": "cannot reject at n = 6",
    "Friedman": "exact",
    "Friedman, chi-square limit": "asymptotic",
    "mixed model, t": "approximate",
    "mixed model, Wald": "asymptotic: too small a p with few volunteers",
    "bootstrap, expanded": "intervals only",
    "bootstrap, percentile": "intervals only: too narrow with few volunteers",
    "equivalence": "at the margin, where its size is largest; interval of 0.90",
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--simulations", type=int, default=2000)
    parser.add_argument("--volunteers", type=int, nargs="+", default=[6])
    parser.add_argument("--seed", type=int, default=1000)
    parser.add_argument("--out", type=Path, default=Path("docs/statistics"))
    options = parser.parse_args()
    started = time.perf_counter()
    rows: list[tuple[object, ...]] = []
    for n in options.volunteers:

        def show(done: int, total: int, n: int = n) -> None:
            if done % 50 == 0:
                print(f"n = {n}: {done} of {total}", file=sys.stderr)

        found = calibration(
            simulations=options.simulations, seed=options.seed, progress=show, volunteers=n
        )
        for test in found["test"].values:
            one = found.sel(test=test)
            size, error = float(one["size"]), float(one["size_error"])
            nominal = float(found.attrs["alpha"])
            apart = abs(size - nominal) > 2.6 * np.sqrt(
                nominal * (1 - nominal) / options.simulations
            )
            verdict = "" if np.isnan(size) else "within error"
            if apart:
                verdict = "below nominal" if size < nominal else "above nominal"
            rows.append(
                (n, str(test), size, error, verdict, float(one["coverage"]),
                 float(one["coverage_error"]), EXACT.get(str(test), ""))
            )  # fmt: skip
    digits = {"digits": 3}
    table = Table(
        "size at 0.05 and coverage of intervals, simulated scores without a difference",
        (
            Column("volunteers"), Column("test"), Column("size", **digits),
            Column("Monte Carlo error", **digits), Column("against 0.05"),
            Column("coverage", **digits), Column("its Monte Carlo error", **digits),
            Column("kind"),
        ),
        tuple(rows),
        "simulated",
        f"{options.simulations} cubes per row, seed {options.seed}; intervals of 0.95 unless stated "
        "(the exact intervals take the next level they can reach). 'Above' and 'below' are beyond "
        "2.6 Monte Carlo errors. Made by benchmarks/calibration.py.",
    )  # fmt: skip
    options.out.mkdir(parents=True, exist_ok=True)
    (options.out / "calibration.csv").write_text(table.csv(), encoding="utf-8")
    (options.out / "calibration.md").write_text(table.markdown(), encoding="utf-8")
    print(table.text())
    print(f"{time.perf_counter() - started:.0f} s", file=sys.stderr)


if __name__ == "__main__":
    main()
