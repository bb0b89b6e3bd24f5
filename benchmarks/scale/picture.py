"""Picture of the measurements of ``benchmarks scale``."""

import json
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402


def picture(folder: Path) -> Path:
    """Draw thousand.json and plan.json to scale.png beside them."""
    figure, panels = plt.subplots(1, 2, figsize=(10, 3.8), layout="constrained")
    for axes, name, draw in zip(panels, ("thousand", "plan"), (_thousand, _plan), strict=True):
        draw(axes, json.loads((folder / f"{name}.json").read_text()))
        axes.spines[["top", "right"]].set_visible(False)
    path = folder / "scale.png"
    figure.savefig(path, dpi=130)
    return path


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
    axes.set_ylim(0.5 * min(demanded), None)
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
    for name, value in zip(names, hours.values(), strict=True):
        axes.plot(value, name, "o", color="C0")
        told = f"{60 * value:.2g} min" if value < 1 else f"{value:.2g} h"
        axes.annotate(told, (value, name), xytext=(8, 0), textcoords="offset points", va="center")
    axes.set_xscale("log")
    axes.set_xlim(min(hours.values()) / 3, 10 * max(hours.values()))
    axes.grid(axis="x", alpha=0.3)
    axes.invert_yaxis()
    axes.set(xlabel="duration [h]", title="Plan for 10 000 volunteers")
