"""Resources of a large study, extrapolated from the stored results of a small one."""

import json
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from emgface.run.store import Store
from emgface.schema.netcdf import read_netcdf
from emgface.study.assembly import AT_A_TIME
from emgface.study.baselines import MOST_OTHERS, with_stored_baselines

STAGES_OF_TRIAL = ("activation", "motion", "skin", "aligned", "scores")
DRIVER, RECORD = 4e-3, 2.5e3
"""Processor time of the driver [s] and size of the record [bytes] per trial (``thousand``, ``many``)."""


def measured(path: Path, quantity: str) -> float:
    """Value of a row of another part of the measurement."""
    rows = {row["quantity"]: row["value"] for row in json.loads(path.read_text())}
    return float(rows[quantity])


def plan(
    store: Path, folder: Path, volunteers: int = 10_000, workers: int = 1000
) -> list[dict[str, Any]]:
    """Core-hours, storage, files and traffic of a study of volunteers with 72 trials each.

    `store` contains the results of a study, whose indices state sizes and durations, and `folder`
    those of `recordings` and `many`.
    """
    read = measured(folder / "recordings.json", "processor ms of a recording that is read")
    known = measured(folder / "recordings.json", "processor ms of a recording that is known")
    cube = measured(folder / "many.json", "cube, processor time per trial [ms]")
    state = measured(folder / "many.json", "state read, processor [s]") / 10_000
    trials, seconds, stored = 72 * volunteers, 0.0, 0.0
    for stage in STAGES_OF_TRIAL:
        indices = [json.loads(path.read_text()) for path in (store / stage).glob("*.json")]
        seconds += sum(index["seconds"] for index in indices) / len(indices)
        size = sum(path.stat().st_size for path in (store / stage).iterdir()) / len(indices)
        stored += size
    persons = [json.loads(path.read_text()) for path in (store / "baselines").glob("*.json")]
    others = len({index["label"].split()[0] for index in persons}) - 1
    baseline = sum(index["seconds"] for index in persons) / len(persons)
    elapsed = trials * seconds / workers
    rows = [
        ("trials", f"{trials:,}"),
        ("computing time per trial in this study [s]", f"{seconds:.1f}"),
        ("core-hours", f"{trials * seconds / 3600:,.0f}"),
        (f"trials with {workers} workers [h]", hours(elapsed)),
        ("stored per trial [kB]", f"{stored / 1e3:.0f}"),
        ("stored [GB]", f"{trials * stored / 1e9:,.0f}"),
        ("files [millions]", f"{2 * len(STAGES_OF_TRIAL) * trials / 1e6:.1f}"),
        ("written by all workers [MB/s]", f"{trials * stored / elapsed / 1e6:.1f}"),
        ("through the scheduler [MB/s]", f"{trials * RECORD / elapsed / 1e6:.2f}"),
        ("journal [GB]", f"{trials * RECORD / 1e9:.1f}"),
        ("driver, share of a core", f"{trials * DRIVER / elapsed:.2f}"),
        (f"baselines per volunteer and instruction, {others} other volunteers [s]", f"{baseline:.1f}"),
        (f"baselines with {workers} workers and {MOST_OTHERS} other volunteers, at most [h]",
         hours(6 * volunteers * baseline * MOST_OTHERS / others / workers)),
        (f"recordings read by {workers} workers [h]", hours(24 * volunteers * read / 1e3 / workers)),
        ("recordings known again by the driver [h]", hours(24 * volunteers * known / 1e3)),
        ("journal read by the driver [h]", hours(trials * state)),
        ("cube written by the driver [h]",
         hours(trials * cube / 1e3 + 6 * volunteers * reading(store))),
    ]  # fmt: skip
    return [{"quantity": name, "value": value} for name, value in rows]


def reading(store: Path) -> float:
    """Processor time of adding a stored baseline to a part of the cube [s]."""
    cube = read_netcdf(store.parent / "cube.nc", "cube")
    laboratory: Any = SimpleNamespace(store=Store(store))
    digests = [path.stem for path in (store / "baselines").glob("*.nc")]
    digests *= -(-6 * AT_A_TIME // len(digests))  # as many as in a part of a large study
    began = time.process_time()
    with_stored_baselines(cube, laboratory, digests)
    return (time.process_time() - began) / len(digests)


def hours(seconds: float) -> str:
    """Duration in hours."""
    return f"{seconds / 3600:.2g}"
