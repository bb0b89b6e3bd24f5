"""The eleven rows of the battery, and the table that they make."""

from collections.abc import Callable, Sequence
from dataclasses import fields

import numpy as np
import xarray as xr

from emgface.bench.integrators import CONVERGED, STATIC
from emgface.bench.stability.face_rows import face_trials
from emgface.bench.stability.input_rows import bad_input
from emgface.bench.stability.material_rows import bulk_moduli, masses, slivers, stiff_layers
from emgface.bench.stability.motion_rows import (
    TURNING,
    bad_starts,
    gravity_and_rotation,
    jumps,
    quiet,
    time_steps,
    turned,
)
from emgface.bench.stability.trial import Outcome, run

Progress = Callable[[int, int], None]

BLOCK_ROWS = (
    bulk_moduli, stiff_layers, time_steps, jumps, bad_starts, gravity_and_rotation, slivers, masses,
    bad_input, quiet,
)  # fmt: skip
"""Rows on small bodies; a new one is a function here. Row 9 needs a face."""


def run_battery(
    face: xr.Dataset | None = None,
    *,
    rows: Sequence[int] | None = None,
    progress: Progress | None = None,
) -> xr.Dataset:
    """Run the battery.

    Parameters
    ----------
    face : Dataset, optional
        Face model for the rows on a whole face (3, 4, 9 and 11); left out if absent.
    rows : sequence of int, optional
        Rows to run, all by default.
    progress : callable, optional
        Called as ``progress(done, total)``.

    Returns
    -------
    Dataset
        Dim ``run``: ``row``, ``title``, ``case``, ``parameter`` that the row sweeps and its ``value``,
        ``integrator``, ``outcome`` ("ok", "refused: <error>" or "WRONG: <what>"), ``smallest_J``,
        ``iterations`` per output interval, ``rejected`` steps and ``energy_drift``, the largest growth
        of the energy in one interval over its size where no muscle drives.
    """
    trials = [trial for make in BLOCK_ROWS for trial in make()]
    if face is not None:
        trials += face_trials(face)
    chosen = [t for t in trials if rows is None or t.row in rows]
    plan = [(trial, name) for trial in chosen for name in trial.integrators]
    outcomes: list[Outcome] = []
    for i, (trial, name) in enumerate(plan):
        outcomes.append(run(trial, name))
        if progress is not None:
            progress(i + 1, len(plan))
    if rows is None or 6 in rows:
        wrong = turned(1000)
        outcome = f"WRONG: {wrong}" if wrong else "ok"
        outcomes.append(Outcome(6, TURNING, "1000 turns", "", float("nan"), "any", outcome))
    outcomes.sort(key=lambda o: o.row)
    columns = {f.name: [getattr(o, f.name) for o in outcomes] for f in fields(Outcome)}
    return xr.Dataset(
        {
            name: ("run", np.array(values, dtype=object if isinstance(values[0], str) else None))
            for name, values in columns.items()
        },
        attrs={
            "origin": "simulated",
            "face": "" if face is None else str(face.attrs.get("name", "")),
            "converged": ", ".join(CONVERGED | STATIC),
        },
    )
