"""The report of a face against published counts and closed forms."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from emgface.face.check import face_report, sheet_nodes
from emgface.face.quality import element_quality, is_wedge
from emgface.face.surface import element_edges

COUNTS = {
    "nodes": 8720,
    "elements": 6342,
    "hexahedra": 6024,
    "wedges": 318,
    "hexahedra, inner layer": 2008,
    "hexahedra, centre layer": 2008,
    "hexahedra, outer layer": 2008,
    "wedges, inner layer": 106,
    "wedges, centre layer": 106,
    "wedges, outer layer": 106,
    "fixed nodes": 1052,
    "fixed to mandible": 322,
    "fixed to skull": 730,
    "free nodes": 7668,
    "unknowns": 23004,
    "inverted elements": 0,
    "hexahedra with scaled Jacobian below 0.1": 32,
    "hexahedra with scaled Jacobian below 0.2": 154,
    "hexahedra with scaled Jacobian below 0.3": 396,
    "outer boundary faces": 2114,
    "inner boundary faces": 2114,
    "rim boundary faces": 738,
}
MEASURES = {
    # Published value and half a unit of its last digit.
    "volume": (379256.6, 0.05),
    "volume of hexahedra": (373330.7, 0.05),
    "volume of wedges": (5925.9, 0.05),
    "mass": (0.3944, 5e-5),
    "smallest x": (-71.26, 5e-3),
    "largest x": (71.26, 5e-3),
    "smallest y": (-32.23, 5e-3),
    "largest y": (95.54, 5e-3),
    "smallest z": (-124.70, 5e-3),
    "largest z": (13.10, 5e-3),
    "smallest volume of hexahedra": (0.528, 5e-4),
    "median volume of hexahedra": (31.7, 0.05),
    "largest volume of hexahedra": (601, 0.5),
    "smallest volume of wedges": (0.154, 5e-4),
    "median volume of wedges": (9.58, 5e-3),
    "largest volume of wedges": (180, 0.5),
    "smallest scaled Jacobian of hexahedra": (0.0111, 5e-5),
    "1 % of scaled Jacobian of hexahedra": (0.133, 5e-4),
    "5 % of scaled Jacobian of hexahedra": (0.262, 5e-4),
    "median scaled Jacobian of hexahedra": (0.803, 5e-4),
    "smallest scaled Jacobian of wedges": (0.0070, 5e-5),
    "1 % of scaled Jacobian of wedges": (0.035, 5e-4),
    "5 % of scaled Jacobian of wedges": (0.187, 5e-4),
    "median scaled Jacobian of wedges": (0.572, 5e-4),
    "smallest edge length": (0.184, 5e-4),
    "largest edge length": (16.0, 0.05),
    "largest edge ratio": (34, 0.5),
    "outer area": (39237, 0.5),
    "inner area": (34139, 0.5),
}
MUSCLES_5MM = {
    # elements, hexahedra, wedges, inner, centre, outer, volume mm3, shared left-right
    "ZYG": (22, 19, 3, 17, 5, 0, 4338.5, 0),
    "RIS": (38, 30, 8, 14, 17, 7, 4465.1, 0),
    "LLSAN": (117, 94, 23, 52, 42, 23, 2965.3, 0),
    "LAO": (51, 50, 1, 32, 13, 6, 3830.1, 0),
    "BUC": (47, 41, 6, 42, 5, 0, 5055.1, 0),
    "OOP": (202, 187, 15, 114, 67, 21, 5080.7, 44),
    "OOM": (446, 427, 19, 143, 168, 135, 4982.3, 110),
    "DLI": (83, 81, 2, 43, 30, 10, 3399.7, 10),
    "DAO": (38, 38, 0, 18, 17, 3, 3861.8, 0),
    "MEN": (47, 47, 0, 20, 16, 11, 1741.4, 16),
}


@pytest.fixture(scope="module")
def summary(reference_face: xr.Dataset) -> pd.DataFrame:
    return face_report(reference_face).summary


@pytest.mark.parametrize("quantity", COUNTS)
def test_published_counts(summary: pd.DataFrame, quantity: str) -> None:
    assert summary.loc[quantity, "value"] == COUNTS[quantity]


@pytest.mark.parametrize("quantity", MEASURES)
def test_published_measures(summary: pd.DataFrame, quantity: str) -> None:
    value, half_digit = MEASURES[quantity]
    assert summary.loc[quantity, "value"] == pytest.approx(value, abs=half_digit)


def test_published_muscles_by_radius(imported: Callable[..., xr.Dataset]) -> None:
    report = face_report(imported(oop="radius", oom="radius"))
    columns = ["elements", "hexahedra", "wedges", "inner", "centre", "outer"]
    for muscle, row in MUSCLES_5MM.items():
        for side in "LR":
            muscle_row = report.muscles.loc[f"{muscle}_{side}"]
            assert tuple(muscle_row[columns]) == row[:6], muscle
            assert muscle_row["volume"] == pytest.approx(row[6], abs=0.05), muscle
            assert muscle_row["shared"] == row[7], muscle
    values = report.summary["value"]
    assert values["muscle elements"] == 1556
    assert values["elements of several muscles"] == 374
    assert values["most muscles of one element"] == 4


def test_hand_made_sets(reference_face: xr.Dataset) -> None:
    muscles = face_report(reference_face).muscles
    for muscle, hexahedra, wedges in (("OOP", 304, 18), ("OOM", 450, 16)):
        both = muscles.loc[[f"{muscle}_L", f"{muscle}_R"]].sum()
        assert (both["hexahedra"], both["wedges"], both["shared"]) == (hexahedra, wedges, 0)


def test_quality_per_element_of_the_published_table(
    models: Path, reference_face: xr.Dataset
) -> None:
    expected = pd.read_csv(models / "face_reference" / "derived" / "elements.csv")
    connectivity = reference_face["connectivity"].values
    quality = element_quality(reference_face["position"].values, connectivity)
    # Six significant digits of the volume and four decimals of the Jacobian are printed.
    np.testing.assert_allclose(quality.volume * 1e9, expected["volume_mm3"], rtol=5e-6)
    np.testing.assert_allclose(quality.scaled_jacobian, expected["min_scaled_jacobian"], atol=5e-4)
    assert (is_wedge(connectivity) == (expected["n_nodes"] == 6)).all()


def test_sheets(reference_face: xr.Dataset) -> None:
    assert len(sheet_nodes(reference_face, 0)) == len(sheet_nodes(reference_face, 2)) == 2180


def test_report_of_cubes_and_prism(small_face: xr.Dataset) -> None:
    report = face_report(small_face, density=1000.0)
    value = report.summary["value"]
    # Two cubes of 1 cm3 and half a cube; sqrt(2) cm is the longest edge.
    assert value["volume"] == pytest.approx(2500.0, rel=1e-12)
    assert value["mass"] == pytest.approx(2.5e-3, rel=1e-12)
    assert value["volume of wedges"] == pytest.approx(500.0, rel=1e-12)
    assert value["smallest scaled Jacobian of hexahedra"] == pytest.approx(1.0, rel=1e-12)
    assert value["largest edge length"] == pytest.approx(10.0 * np.sqrt(2.0), rel=1e-12)
    assert value["largest edge ratio"] == pytest.approx(np.sqrt(2.0), rel=1e-12)
    assert (value["free nodes"], value["unknowns"], value["fixed to skull"]) == (10, 30, 4)
    muscle = report.muscles.loc["BUC_R"]
    assert muscle["volume"] == pytest.approx(1500.0, rel=1e-12)
    assert (muscle["fibres"], muscle["hexahedra"], muscle["wedges"]) == (1, 1, 1)
    assert muscle["shared"] == 2


def test_volume_of_a_distorted_hexahedron_and_wedge() -> None:
    """The map x -> A x multiplies the volume of an element by det A, for any first node."""
    rng = np.random.default_rng(8)
    cube = np.array([(x, y, z) for z in (0, 1) for y in (0, 1) for x in (0, 1)], dtype=float)
    a = np.eye(3) + 0.3 * rng.normal(size=(3, 3))
    connectivity = np.array([[0, 1, 3, 2, 4, 5, 7, 6], [0, 1, 2, 4, 5, 6, -1, -1]])
    quality = element_quality(cube @ a.T, connectivity)
    np.testing.assert_allclose(quality.volume, np.linalg.det(a) * np.array([1.0, 0.5]), rtol=1e-13)


def test_equilateral_prism_and_cube_are_ideal() -> None:
    h = np.sqrt(3.0) / 2.0
    prism = np.array([(0, 0, 0), (1, 0, 0), (0.5, h, 0), (0, 0, 2), (1, 0, 2), (0.5, h, 2)])
    quality = element_quality(prism, np.array([[0, 1, 2, 3, 4, 5, -1, -1]]))
    assert quality.scaled_jacobian[0] == pytest.approx(1.0, abs=1e-14)
    assert quality.volume[0] == pytest.approx(h, rel=1e-14)


def test_edges_of_elements_are_the_sides_of_their_faces() -> None:
    """Twelve of a cube, each of length one."""
    cube = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    corners = np.concatenate([cube, cube + [0, 0, 1]])
    edges, element = element_edges(np.arange(8)[None])
    assert len(np.unique(np.sort(edges, axis=1), axis=0)) == 12 and not element.any()
    np.testing.assert_array_equal(
        np.abs(corners[edges[:, 0]] - corners[edges[:, 1]]).sum(axis=1), np.ones(12)
    )
