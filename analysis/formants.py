"""Formants of the trials of a cube: variables, and a table of their changes."""

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import xarray as xr

from analysis.cube import TRIAL_DIMS
from analysis.tables import Column, Table, origin_of, recordings
from analysis.typed import relabelled, selected

FORMANTS: Final = 4  #: number of formants
INSTANTS: Final = 41  #: instants of a trial at which formants are given
FORMANT_VARIABLES: Final = {
    "formant_frequency": (
        "Hz",
        "formant of the simulated lips in front of a tract that does not move",
    ),
    "formant_change": (
        "Hz",
        "largest change of a formant from its value at the start of the trial",
    ),
    "simulated_duration": ("s", "duration of the simulated motion"),
}
"""Unit and meaning of the variables of formants."""


def cube_with_formants(
    cube: xr.Dataset,
    formants: Mapping[tuple[str, str, int, str], xr.Dataset],
    assumptions: str,
) -> xr.Dataset:
    """Add the formants of trials to a cube.

    `formants` maps volunteer, instruction, repetition and strategy to ``formant_frequency(time,
    formant)`` [Hz] at `INSTANTS` equidistant instants ``time`` [s]; `assumptions` are stored as
    attribute ``tract``. The result has ``formant_frequency`` (trial, formant, instant), where
    ``instant`` is the fraction of the trial from 0 to 1; ``formant_change`` (trial, formant), the
    signed change that is largest in magnitude; ``simulated_duration`` (trial) [s]. Trials that are
    not in `formants` have NaN.
    """
    shape = tuple(cube.sizes[dim] for dim in TRIAL_DIMS)
    frequency = np.full((*shape, FORMANTS, INSTANTS), np.nan)
    change, lasting = np.full((*shape, FORMANTS), np.nan), np.full(shape, np.nan)
    place = [{label: k for k, label in enumerate(cube[dim].values.tolist())} for dim in TRIAL_DIMS]
    for labels, one in formants.items():
        index = tuple(known[label] for known, label in zip(place, labels, strict=True))
        values = one["formant_frequency"].transpose("formant", "time").values
        frequency[index] = values
        change[index] = _largest(values - values[:, :1])
        lasting[index] = float(one["time"].values[-1] - one["time"].values[0])
    dims = {"formant_frequency": (*TRIAL_DIMS, "formant", "instant"),
            "formant_change": (*TRIAL_DIMS, "formant"), "simulated_duration": TRIAL_DIMS}  # fmt: skip
    arrays = dict(zip(FORMANT_VARIABLES, (frequency, change, lasting), strict=True))
    added = {
        name: (dims[name], arrays[name], {"units": units, "long_name": meaning})
        for name, (units, meaning) in FORMANT_VARIABLES.items()
    }
    number = {"units": "1", "long_name": "number of the formant"}
    instant = {"units": "1", "long_name": "fraction of the duration of the trial"}
    coords = {
        "formant": ("formant", np.arange(1, FORMANTS + 1), number),
        "instant": ("instant", np.linspace(0.0, 1.0, INSTANTS), instant),
    }
    return relabelled(cube.assign(added), coords).assign_attrs(tract=assumptions)


def _largest(change: np.ndarray) -> np.ndarray:
    """Entry of every row that is largest in magnitude; NaN if the row has none."""
    at = np.argmax(np.where(np.isfinite(change), np.abs(change), -1.0), axis=1)
    return np.take_along_axis(change, at[:, None], axis=1)[:, 0]


def formant_table(cube: xr.Dataset) -> Table | None:
    """Tabulate the formants at the start of the trials and their changes, with rho.

    One row per instruction and strategy: medians over trials; for the change of F1 and F2 also the
    quartiles. None if the cube has no formants.
    """
    if "formant_change" not in cube or not np.isfinite(cube["formant_change"].values).any():
        return None
    columns = [Column("instruction"), Column("strategy"), Column("trials"), Column("rho")]
    columns += [Column(f"F{k} at the start", "Hz", "Hz", 1.0, 0) for k in (1, 2)]
    for k in (1, 2):
        columns += [Column(f"change of F{k}", "Hz", "Hz", 1.0, 1)]
        columns += [Column(f"change of F{k}, {end} quartile", "Hz", "Hz", 1.0, 1)
                    for end in ("lower", "upper")]  # fmt: skip
    columns += [Column(f"change of F{k}", "Hz", "Hz", 1.0, 1) for k in (3, 4)]
    rows: list[tuple[Any, ...]] = []
    for instruction in cube["instruction"].values:
        for strategy in cube["strategy"].values:
            one = selected(cube, {"instruction": instruction, "strategy": strategy})
            change = one["formant_change"].transpose(..., "formant").values.reshape(-1, FORMANTS)
            over = one["formant_frequency"].transpose(..., "formant", "instant").values
            start = over.reshape(-1, FORMANTS, INSTANTS)[:, :, 0]
            row: list[Any] = [str(instruction), str(strategy), int(np.isfinite(change[:, 0]).sum())]
            row += [
                _quantile(one["rho"].values, 0.5),
                *(_quantile(start[:, k], 0.5) for k in (0, 1)),
            ]
            row += [_quantile(change[:, k], q) for k in (0, 1) for q in (0.5, 0.25, 0.75)]
            row += [_quantile(change[:, k], 0.5) for k in (2, 3)]
            rows.append(tuple(row))
    origin = origin_of(cube)
    note = (
        "Medians over trials, and over markers for rho. Formants are those of the simulated lips "
        "in front of a tract that does not move; they were not measured. The change is the largest one "
        f"in a trial, with its sign. Assumptions: {cube.attrs.get('tract', 'unknown')}."
    )
    title = f"formants of the simulated lips, {recordings(origin)}"
    return Table(title, tuple(columns), tuple(rows), origin, note)


def _quantile(values: np.ndarray, q: float) -> float:
    known = values[np.isfinite(values)]
    return float(np.quantile(known, q)) if known.size else float("nan")
