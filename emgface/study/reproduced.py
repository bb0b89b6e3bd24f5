"""Comparison of stored results of a study with computed ones."""

import random
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import xarray as xr

from analysis.cube import OF_INCISOR, OF_NOISE, PER_MARKER, PER_TRIAL, TRIAL_DIMS, build_cube
from analysis.trial import Trial
from emgface.errors import DataError
from emgface.files import result_file
from emgface.run.store import Store
from emgface.schema.netcdf import read_netcdf
from emgface.study.audit import Planned, planned_trials
from emgface.study.axes import Label
from emgface.study.configuration import StudyConfiguration
from emgface.study.one_trial import run_trial

MEASURED: Final = ("run_time", "run_time_s")
"""Variables and attributes with measured computing times, which differ between runs."""


@dataclass(frozen=True)
class Compared:
    """Comparison of one trial: label, number of equal results, and one sentence per difference."""

    label: str
    equal: int
    differences: list[str]


def reproduce(
    study: StudyConfiguration,
    folder: Path,
    store: Path,
    *,
    count: int | None = 3,
    seed: int = 0,
    wanted: Sequence[str] = (),
    report: Callable[[str], None] = print,
) -> list[Compared]:
    """Compute trials again in an empty store and compare all results with the stored ones.

    `count` trials are drawn with `seed`, or all of them if it is None. Results are equal if names,
    dims, values and attributes are, except measured computing times. Status and scores are also
    compared with the cube in `folder`, if there is one. Raises DataError if no trial of the study has
    been computed, or the cube cannot be read.
    """
    path = folder / "cube.nc"
    cube = read_netcdf(path, "cube") if path.is_file() else None
    with tempfile.TemporaryDirectory(prefix="emgface-reproduce-") as place:
        fresh = Store(Path(place), report=report)
        planned = [
            one
            for one in planned_trials(study, folder, fresh, wanted)
            if one.last is not None and one.last["stages"]
        ]
        if not planned:
            raise DataError(f"{folder} has no computed trial, expected some: run the study first")
        if count is not None and count < len(planned):
            planned = random.Random(seed).sample(planned, count)
        return [_compared(one, fresh, store, cube) for one in planned]


def _compared(one: Planned, fresh: Store, store: Path, cube: xr.Dataset | None) -> Compared:
    assert one.last is not None, "only computed trials are compared"
    laboratory, last = one.laboratory, one.last
    if last["key"] != one.key and last["sigma_max"] is not None:
        # Another trial of the volunteer required a lower sigma_max.
        laboratory = laboratory.lowered(last["sigma_max"])
    before = len(fresh.events)
    trial = run_trial(laboratory, one.trial, one.extent)
    made = [event for event in fresh.events[before:] if event.stage != "rest"]
    told = [stage for stage in last["stages"] if stage["stage"] != "rest"]
    equal, found = 0, list[str]()
    for event in made:
        stage = next((s for s in told if s["stage"] == event.stage), None)
        if stage is not None:
            told.remove(stage)
        # a run that found a result did not open those from which it follows
        digest = event.digest if stage is None else stage["digest"]
        path = result_file(store, event.stage, digest)
        if not path.is_file():
            if stage is not None:
                found.append(f"{event.stage}: the stored result {path.name} is missing")
            continue
        change = _change(
            content(path), content(result_file(fresh.folder, event.stage, event.digest))
        )
        if change:
            found.append(f"{event.stage}: {change}")
        else:
            equal += 1
    found += [f"{stage['stage']}: it was not computed again" for stage in told]
    change = "" if cube is None else _change_of_cell(cube, trial, one.labels)
    return Compared(one.label, equal, [*found, f"cube: {change}"] if change else found)


def _change_of_cell(cube: xr.Dataset, trial: Trial, labels: Mapping[str, Label]) -> str:
    """First difference of the status and scores of a trial in a cube, empty if they are equal."""
    of_head = "incisor_rho" in cube
    made = build_cube([trial], markers=cube["marker"].values.tolist(), incisor=of_head)
    place = {**labels, **{dim: getattr(trial, dim) for dim in TRIAL_DIMS}}
    try:
        cell = cube.sel(place)
    except KeyError:
        return "it does not contain the trial"
    for name in ("status", *PER_MARKER, *OF_NOISE, *PER_TRIAL, *OF_INCISOR):
        if name in MEASURED or name not in cell:
            continue
        a, b = cell[name].values, made[name].values[0, 0, 0, 0]
        if a.dtype.kind != "f":
            if a != b:
                return f"{name} is {a}, computed again {b}"
        elif not np.array_equal(a, b, equal_nan=True):
            largest = float(np.nanmax(np.abs(a - b), initial=0.0))
            return f"{name} differs by up to {largest:.3g} {made[name].attrs.get('units', '')}"
    return ""


def content(path: Path) -> xr.Dataset:
    """Stored dataset without measured times."""
    dataset = xr.load_dataset(path, decode_times=False)
    dataset = dataset.drop_vars([name for name in MEASURED if name in dataset])
    dataset.attrs = {k: v for k, v in dataset.attrs.items() if k not in MEASURED}
    return dataset


def _change(stored: xr.Dataset, computed: xr.Dataset) -> str:
    """First difference of two datasets, empty if they are equal bit for bit."""
    for name in sorted({*stored.variables, *computed.variables}, key=str):
        if name not in stored.variables or name not in computed.variables:
            return f"only one result contains {name}"
        a, b = stored[name].values, computed[name].values
        if a.shape != b.shape or a.dtype != b.dtype:
            return f"{name} has another shape or type"
        if a.dtype.kind in "fiu":
            if a.tobytes() != b.tobytes():
                largest = float(np.nanmax(np.abs(a.astype(float) - b), initial=0.0))
                return (
                    f"{name} differs by up to {largest:.3g} {stored[name].attrs.get('units', '')}"
                )
        elif not np.array_equal(a, b):
            return f"{name} differs"
    if not stored.identical(computed):
        return "attributes differ"
    return ""
