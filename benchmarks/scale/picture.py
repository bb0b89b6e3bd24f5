"""Picture of the throughput measured by ``benchmarks scale``."""

import json
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402


def picture(folder: Path) -> Path:
    """Draw throughput.json and thousand.json to scale.png beside them."""
    measured = json.loads((folder / "throughput.json").read_text())
    simulated = json.loads((folder / "thousand.json").read_text())
    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained")
    for label, names, marker in (
        ("local processes", ("in this process", "processes"), "o-"),
        ("dask workers", ("dask",), "s-"),
    ):
        rows = [row for row in measured if row["workers"] in names]
        left.plot([row["number"] for row in rows], [row["trials per second"] for row in rows], marker,
                  label=label)  # fmt: skip
    numbers = sorted({r["number"] for r in measured})
    left.plot(numbers, [10 * n for n in numbers], "k:", label="ideal")
    left.set(xlabel="workers", ylabel="trials per second", xticks=numbers, ylim=(0, None),
             title="Stub trials of 0.1 s")  # fmt: skip
    demanded = [row["demanded [1/s]"] for row in simulated]
    recorded = [row["recorded [1/s]"] for row in simulated]
    right.loglog(demanded, recorded, "o-", label="recorded by the driver")
    ends = [min(demanded), max(demanded)]
    right.loglog(ends, ends, "k:", label="demanded")
    for row in simulated:
        right.annotate(f"{row['mean duration of a trial [s]']:g} s",
                       (row["demanded [1/s]"], row["recorded [1/s]"]),
                       xytext=(4, -12), textcoords="offset points", fontsize=8)  # fmt: skip
    right.set(xlabel="trials per second that 1000 workers finish", ylabel="trials per second recorded",
              title="1000 simulated workers, by the duration of a trial")  # fmt: skip
    for axes in (left, right):
        axes.legend(frameon=False)
        axes.spines[["top", "right"]].set_visible(False)
    path = folder / "scale.png"
    figure.savefig(path, dpi=130)
    return path
