"""Picture of the measurements of ``benchmarks scale``."""

import json
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402

ALLOWED = 20.0
"""Largest processor time of the driver per trial [ms]."""


def picture(folder: Path) -> Path:
    """Draw throughput.json, thousand.json and plan.json to scale.png beside them."""
    figure, panels = plt.subplots(1, 3, figsize=(13, 3.8), layout="constrained")
    for axes, name, draw in zip(panels, ("throughput", "thousand", "plan"),
                                (_overhead, _thousand, _plan), strict=True):  # fmt: skip
        draw(axes, json.loads((folder / f"{name}.json").read_text()))
        axes.spines[["top", "right"]].set_visible(False)
    path = folder / "scale.png"
    figure.savefig(path, dpi=130)
    return path


def _overhead(axes: Any, rows: list[dict[str, Any]]) -> None:
    names = [f"{row['workers']}, {row['number']}" for row in rows]
    axes.barh(names, [row["driver, processor ms per trial"] for row in rows])
    axes.axvline(ALLOWED, color="k", ls=":")
    axes.annotate(f"allowed: {ALLOWED:.0f} ms", (ALLOWED, len(rows) - 1), xytext=(-4, 0),
                  textcoords="offset points", ha="right", va="center", fontsize=8)  # fmt: skip
    axes.invert_yaxis()
    axes.set(xlabel="processor time of the driver per trial [ms]", title="Stub trials, by workers")


def _thousand(axes: Any, rows: list[dict[str, Any]]) -> None:
    demanded = [row["demanded [1/s]"] for row in rows]
    axes.loglog(demanded, [row["recorded [1/s]"] for row in rows], "o-", label="recorded")
    # A driver that had a core of its own.
    able = [1e3 / row["driver, processor ms per trial"] for row in rows]
    axes.loglog(demanded, able, "s--", label="possible with one core for the driver")
    axes.loglog(demanded, demanded, "k:", label="finished by the workers")
    for row in rows:
        axes.annotate(f"{row['mean duration of a trial [s]']:g} s",
                      (row["demanded [1/s]"], row["recorded [1/s]"]),
                      xytext=(4, -12), textcoords="offset points", fontsize=8)  # fmt: skip
    axes.set(xlabel="trials per second that 1000 workers finish", ylabel="trials per second",
             title="1000 simulated workers, by duration of a trial")  # fmt: skip
    axes.legend(frameon=False, fontsize=8)


def _plan(axes: Any, rows: list[dict[str, Any]]) -> None:
    hours = {
        r["quantity"].removesuffix(" [h]"): float(r["value"])
        for r in rows
        if "[h]" in r["quantity"]
    }
    names = [
        name.replace(", at most", "").replace(" and 50 other volunteers", "") for name in hours
    ]
    bars = axes.barh(names, list(hours.values()))
    told = [f"{60 * h:.2g} min" if h < 1 else f"{h:.2g} h" for h in hours.values()]
    axes.bar_label(bars, told, padding=3, fontsize=8)
    axes.set_xscale("log")
    axes.set_xlim(min(hours.values()) / 2, 8 * max(hours.values()))
    axes.invert_yaxis()
    axes.set(xlabel="duration [h]", title="Plan for 10 000 volunteers")
