"""A trial that is excluded by its status alone is left out by every function of a cube."""

import dataclasses
import importlib
import inspect
import pkgutil
from collections.abc import Callable

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import analysis
from analysis.axes import combine_cubes
from analysis.baselines import BASELINE_VARIABLES, with_baselines
from analysis.cube import OF_INCISOR, PER_TRIAL, TRIAL_DIMS
from analysis.figures.style import encoded_figure
from analysis.statistics.simulated import simulated_scores
from analysis.tables import Table

#: functions that return or describe the cube itself, or numbers of a model and not of its scores
OTHERS = {
    "scored_values", "cube_with_formants", "complete", "with_baselines", "has_baselines",
    "reference_cube", "status_of", "further_axes", "of_incisor", "has_incisor", "levels_of",
    "formant_table", "formant_plot", "sound_cube", "fisher_z", "described", "as_table",
}  # fmt: skip
MORE = {
    "on_scale": {"variable": "rho", "scale": "z", "limit": 0.9999},
    "paired": {"first": "act_3", "second": "act_all"},
}
QUICK = {"draws": 100}


def functions():
    """Every public function of `analysis` whose first argument is a cube."""
    for module in pkgutil.walk_packages(analysis.__path__, "analysis."):
        loaded = importlib.import_module(module.name)
        for name, value in vars(loaded).items():
            if name.startswith("_") or name in OTHERS or not inspect.isfunction(value):
                continue
            if value.__module__ != loaded.__name__:
                continue
            if next(iter(inspect.signature(value).parameters), "") == "cube":
                yield pytest.param(value, id=name)


def cube(values: np.random.Generator) -> xr.Dataset:
    """Cube with every variable that functions of a cube use."""
    made = simulated_scores(4, volunteers=6, instructions=2)
    shape = made["status"].shape
    for name, (units, _) in (PER_TRIAL | OF_INCISOR).items():
        made[name] = (TRIAL_DIMS, values.uniform(0.1, 0.9, shape).round(1), {"units": units})
    for name in ("reason", "computed", "computed_with"):
        made[name] = (TRIAL_DIMS, np.full(shape, "", dtype="U30"))
    variables = {
        name: xr.DataArray(
            values.uniform(0.3, 0.9, [made.sizes[dim] for dim in dims]),
            {dim: made[dim] for dim in dims},
            dims,
        )
        for name, (dims, _, _) in BASELINE_VARIABLES.items()
        if name != "skill"
    }
    return with_baselines(made, variables)


def excluded(made: xr.Dataset, *, blank: bool) -> xr.Dataset:
    """The cube without some trials: their status, and with `blank` also their numbers."""
    status = made["status"].copy(data=made["status"].values.astype("U40"))
    status[1, 0, 0, :], status[2, 1, :, 1], status[0, 0, 1, 2] = "excluded", "failed:X", "missing"
    made = made.assign(status=status)
    if blank:
        for name in ("rho", "amplitude_ratio", "rmse", *OF_INCISOR, *BASELINE_VARIABLES):
            if set(TRIAL_DIMS) <= set(made[name].dims):
                made[name] = made[name].where(status == "ok")
    return made


def shown(given: object) -> object:
    """A result as text, or as the picture of a figure."""
    if hasattr(given, "savefig"):
        return encoded_figure(given, ".svg")
    if isinstance(given, dict):
        return {name: shown(value) for name, value in given.items()}
    if isinstance(given, tuple | list):
        return [shown(value) for value in given]
    if dataclasses.is_dataclass(given) and not isinstance(given, Table):
        return shown(vars(given))
    if isinstance(given, xr.Dataset | xr.DataArray):
        return given.to_dict()
    return given.text() if isinstance(given, Table) else given


@pytest.mark.parametrize("function", functions())
def test_only_scored_trials_count(function: Callable) -> None:
    names = inspect.signature(function).parameters
    given = MORE.get(function.__name__, {}) | {k: v for k, v in QUICK.items() if k in names}
    made = cube(np.random.default_rng(2))
    both = [excluded(made, blank=blank) for blank in (False, True)]
    if function.__name__ == "sensitivity":
        levels = {"level": [1, 2]}
        both = [
            combine_cubes({(1,): one, (2,): one.assign(rho=0.99 * one["rho"])}, levels)
            for one in both
        ]
    with_values, without = (shown(function(one, **given)) for one in both)
    if isinstance(without, pd.DataFrame):
        pd.testing.assert_frame_equal(with_values, without)
    else:
        np.testing.assert_equal(with_values, without)
