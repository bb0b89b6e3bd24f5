"""Descriptives against pandas, group by group."""

import itertools

import numpy as np
import pytest
import xarray as xr
from synthetic_cubes import cube

from analysis.cube import MARKER_DIMS, build_cube
from analysis.descriptives import descriptives
from analysis.errors import CubeError
from analysis.trial import Trial

GROUPINGS = [
    (),
    ("strategy",),
    ("volunteer", "strategy"),
    ("strategy", "instruction"),
    ("marker", "strategy"),
    ("repetition",),
    MARKER_DIMS,
]


@pytest.mark.parametrize("by", GROUPINGS)
@pytest.mark.parametrize("variable", ["rho", "amplitude_ratio", "rmse"])
def test_against_pandas(by: tuple[str, ...], variable: str) -> None:
    """Same numbers as a long table grouped by hand; the counts fill every group."""
    data = cube()
    rows = descriptives(data, by=by, variable=variable)
    table = xr.merge([data[[variable]], data["status"]]).to_dataframe().reset_index()
    labels = [data[dim].values.tolist() for dim in by]
    for label in itertools.product(*labels):
        group, cell = table, rows
        for dim, value in zip(by, label, strict=True):
            group = group[group[dim] == value]
            cell = cell.sel({dim: value})
        values = group[variable].dropna()
        assert int(cell["n"]) == len(values)
        expected = (values.median(), values.mean(), values.std())
        got = [float(cell[name]) for name in ("median", "mean", "standard_deviation")]
        np.testing.assert_allclose(got, expected, rtol=1e-12)
        ok = group["status"] == "ok"
        assert int(cell["n_undefined"]) == int((ok & group[variable].isna()).sum())
        assert int(cell["n_failed"]) == int(group["status"].str.startswith("failed").sum())
        assert int(cell["n_missing"]) == int((group["status"] == "missing").sum())
        assert int(cell["n_excluded"]) == int((group["status"] == "excluded").sum())
        counted = ("n", "n_undefined", "n_failed", "n_excluded", "n_missing")
        total = sum(int(cell[name]) for name in counted)
        assert total == len(group)


def test_by_hand() -> None:
    """Four numbers whose statistics are known: median 0.5, mean 0.4, variance 0.42/3."""
    scores = xr.Dataset(
        {name: ("marker", [0.7, -0.1, 0.4, 0.6]) for name in ("rho", "amplitude_ratio", "rmse")},
        coords={"marker": list("abcd")},
        attrs={"origin": "measured"},
    )
    table = descriptives(build_cube([Trial("v", "A", 1, "s", scores)]), by=())
    assert float(table["median"]) == pytest.approx(0.5)
    assert float(table["mean"]) == pytest.approx(0.4)
    assert float(table["standard_deviation"]) == pytest.approx(np.sqrt(0.38 / 3))
    assert int(table["n"]) == 4


def test_one_value_has_no_standard_deviation() -> None:
    table = descriptives(cube(), by=MARKER_DIMS)
    assert np.isnan(table["standard_deviation"]).all()
    assert int(np.isfinite(table["median"]).sum()) == 56


def test_variable_per_trial() -> None:
    table = descriptives(cube(), variable="run_time")
    assert list(table["n"].values) == [5, 7, 7]
    assert table["median"].attrs["units"] == "s"


def test_origin_and_units_are_kept() -> None:
    table = descriptives(cube(), variable="rmse")
    assert table.attrs["origin"] == "simulated"
    assert table["mean"].attrs["units"] == "m"


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"variable": "status"}, "cannot describe 'status', expected one of rho"),
        ({"variable": "speed"}, "cannot describe 'speed'"),
        ({"by": ("marker",), "variable": "shift"}, "cannot group shift by marker"),
        ({"by": ("group",)}, "cannot group rho by group"),
        ({"by": ("strategy", "strategy")}, "cannot group rho by strategy, strategy"),
    ],
)
def test_unknown_names(options: dict, words: str) -> None:
    with pytest.raises(CubeError, match=words):
        descriptives(cube(), **options)
