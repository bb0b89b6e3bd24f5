"""Worth of a fit: means and intervals of known scores, faces of a person, and their labels."""

import numpy as np
import pytest
import xarray as xr
from scipy.stats import t

from benchmarks.fit_worth import (
    GEOMETRIES,
    MEASURES,
    interval,
    per_person,
    spread_of_thickness,
    worth_figure,
    worth_table,
)

PERSONS, MARKERS = 5, 4


@pytest.fixture(scope="module")
def cube() -> xr.Dataset:
    """Scores whose means per person are known: z rises by 0.1 per geometry."""
    rng = np.random.default_rng(0)
    shape = (len(GEOMETRIES), PERSONS, 2, 1, 1, MARKERS)
    dims = ("geometry", "volunteer", "instruction", "repetition", "strategy", "marker")
    z = 0.5 + 0.1 * np.arange(len(GEOMETRIES)).reshape(-1, 1, 1, 1, 1, 1)
    z = z + 0.05 * rng.standard_normal((1, *shape[1:]))
    ratio = np.exp(0.2 * rng.standard_normal((1, *shape[1:]))) * np.ones(shape)
    rmse = 1e-3 * np.ones(shape)
    rmse[GEOMETRIES.index("own")] = 0.5e-3
    rho = np.tanh(z)
    rho[0, 0, 0, 0, 0, 0] = np.nan  # then this cell counts for no geometry
    return xr.Dataset(
        {"rho": (dims, rho), "amplitude_ratio": (dims, ratio), "rmse": (dims, rmse)},
        coords={
            "geometry": list(GEOMETRIES),
            "volunteer": [f"S{k:02d}" for k in range(1, PERSONS + 1)],
        },
    )


def test_the_same_cells_count_for_every_geometry(cube):
    values = per_person(cube, MEASURES[0])
    differences = values - values.sel(geometry="generic")
    for k in range(len(GEOMETRIES)):
        np.testing.assert_allclose(differences.isel(geometry=k), 0.1 * k, atol=1e-12)


def test_intervals_are_those_of_student():
    values = np.array([1.0, 2.0, 4.0, np.nan])
    mean, low, high = interval(values)
    half = t.ppf(0.975, 2) * np.std(values[:3], ddof=1) / np.sqrt(3)
    np.testing.assert_allclose([mean, low, high], [7 / 3, 7 / 3 - half, 7 / 3 + half])
    assert np.isnan(interval(np.array([1.0, 2.0]))[1])


def test_the_table_has_means_changes_and_improved_persons(cube):
    table = worth_table({"matched": cube})
    rows = {(row[1], row[2]): row for row in table.rows}
    own = rows["rho", "own"]
    step = 0.1 * GEOMETRIES.index("own")
    assert own[6] == pytest.approx(step) and own[7] == pytest.approx(step)
    assert own[9] == PERSONS and rows["rho", "generic"][9] == 0
    assert np.arctanh(own[3]) == pytest.approx(float(per_person(cube, MEASURES[0])[-1].mean()))
    assert rows["marker error [mm]", "own"][3] == pytest.approx(0.5)
    assert rows["marker error [mm]", "own"][9] == PERSONS
    assert rows["amplitude ratio", "skin"][6] == pytest.approx(0.0)
    assert table.origin == "simulated" and "simulated" in table.title


def test_the_figure_says_that_it_is_simulated(cube):
    figure = worth_figure({"matched": cube, "mismatched": cube})
    assert "simulated" in figure.get_suptitle()
    assert len(figure.axes) == 2 * len(MEASURES)
    said = spread_of_thickness({"matched": cube})[0]
    half = 0.5 * np.abs(cube["rho"].sel(geometry="thicker") - cube["rho"].sel(geometry="thinner"))
    assert f"{float(np.sqrt((half**2).mean())):.3f}" in said
