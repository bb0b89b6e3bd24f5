"""Cost of copies in object storage: results of a trial written, and read on another machine."""

import time
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from emgface.run.objects import Objects
from emgface.run.store import Stage, Store
from emgface.study.stage_code import MOTION, SCORES

STORED = ("skin", 60, 1500), ("motion", 120, 11), ("scores", 1, 11)
"""Results of a trial: name, number of times and of points."""


def result(times: int, points: int) -> xr.Dataset:
    """Positions over time as they are stored, single precision to 0.01 mm; scores without time."""
    rng = np.random.default_rng(points)
    if times == 1:
        return xr.Dataset({"rho": ("marker", rng.random(points))})
    moved = np.cumsum(rng.normal(scale=1e-4, size=(times, points, 3)), axis=0)
    values = np.round(moved, 5).astype(np.float32)
    return xr.Dataset({"position": (("time", "point", "axis"), values, {"units": "m"})})


TRIALS = 20
"""Results of each kind."""


def objects(folder: Path, url: str) -> list[dict[str, Any]]:
    """Milliseconds per result, without storage, written to it, and copied from it; size [kB]."""
    rows = list[dict[str, Any]]()
    for name, times, points in STORED:
        stage: Stage = {"motion": MOTION, "scores": SCORES}.get(name, Stage(name, MOTION.modules))
        made = result(times, points)

        def timed(place: str, remote: str | None, stage: Stage = stage, made: Any = made) -> float:
            store = Store(folder / place, objects=Objects(remote) if remote else None)
            started = time.perf_counter()
            for k in range(TRIALS + 1):
                if k == 1:  # the first one imports what the storage needs
                    started = time.perf_counter()
                store.get_or_compute(stage, {"trial": str(k)}, {}, lambda: made)
            return 1e3 * (time.perf_counter() - started) / TRIALS

        alone, written, read = timed("a", None), timed("b", url), timed("c", url)
        size = next((folder / "a" / name).glob("*.nc")).stat().st_size
        rows.append({
            "result": name, "stored [kB]": size / 1e3, "computed without storage [ms]": alone,
            "computed with storage [ms]": written, "copied from storage [ms]": read,
        })  # fmt: skip
    return rows
