"""Scores of the lower incisor in the cube of a study on heads: a cube of their own, and a table."""

from typing import Any, Final

import numpy as np
import xarray as xr

from analysis.cube import MARKER_DIMS, OF_INCISOR, PER_MARKER
from analysis.errors import CubeError
from analysis.tables import Column, Table, origin_of, recordings
from analysis.typed import relabelled, scored_values, selected

INCISOR: Final = "lower_incisor"


def has_incisor(cube: xr.Dataset) -> bool:
    """Return True if the incisor is scored in some trial."""
    return "incisor_rho" in cube and bool(np.isfinite(cube["incisor_rho"].values).any())


def of_incisor(cube: xr.Dataset) -> xr.Dataset:
    """Cube whose only marker is the lower incisor, for descriptives and `analysis.statistics`.

    `cube` has the variables `analysis.cube.OF_INCISOR`. The result has ``rho`` [1],
    ``amplitude_ratio`` [1] and ``rmse`` [m] over trials and marker, and the variables of trials.
    Raises CubeError without incisor.
    """
    if "incisor_rho" not in cube:
        raise CubeError(
            "the cube has no scores of the incisor, expected incisor_rho, incisor_amplitude_ratio and "
            "incisor_rmse: run a study on a head with recordings of the lower incisor"
        )
    result = cube.drop_dims("marker").drop_vars(list(OF_INCISOR))
    added = {name: cube[f"incisor_{name}"].expand_dims("marker", axis=-1) for name in PER_MARKER}
    extra = [dim for dim in cube["incisor_rho"].dims if dim not in MARKER_DIMS]
    added = {name: v.transpose(*MARKER_DIMS, *extra) for name, v in added.items()}
    result = result.assign(added)
    return relabelled(result, {"marker": np.array([INCISOR])})


def incisor_table(cube: xr.Dataset) -> Table | None:
    """Tabulate the scores of the incisor; one row per instruction and strategy, medians over trials.

    None if no trial has one.
    """
    if not has_incisor(cube):
        return None
    columns = [Column("instruction"), Column("strategy"), Column("trials"), Column("rho", "1", "1")]
    columns += [Column(f"rho, {end} quartile", "1", "1") for end in ("lower", "upper")]
    columns += [Column("amplitude ratio", "1", "1"), Column("rmse", "m", "mm", 1e3)]
    rows, scored = list[tuple[Any, ...]](), scored_values(cube)
    for instruction in cube["instruction"].values:
        for strategy in cube["strategy"].values:
            one = selected(scored, {"instruction": instruction, "strategy": strategy})
            rho, ratio, rmse = (one[name].values.ravel() for name in OF_INCISOR)
            known = np.isfinite(rho)
            if not known.any():
                continue
            quartiles = np.quantile(rho[known], [0.5, 0.25, 0.75])
            rest = [float(np.nanmedian(x)) for x in (ratio, rmse)]
            row = (str(instruction), str(strategy), int(known.sum()))
            rows.append((*row, *map(float, quartiles), *rest))
    origin = origin_of(cube)
    note = (
        "Medians over trials. The incisor is relative to the skull, shifted by at most 0.2 s. It is not "
        "a marker of the lips and is not part of their medians and tests."
    )
    title = f"scores of the lower incisor in all trials, {recordings(origin)}"
    return Table(title, tuple(columns), tuple(rows), origin, note)
