"""Building, checking, saving and loading a face model."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from emgface.errors import FaceError, SchemaError, UnitsError
from emgface.face.file import load_face, save_face
from emgface.face.parts import elements_of, fibres_of
from emgface.face.validity import check_face


def test_small_face_is_complete(small_face: xr.Dataset) -> None:
    assert small_face.attrs["schema"] == "face_model"
    assert small_face.sizes["muscle"] == 20 and small_face.sizes["marker"] == 10
    assert small_face["connectivity"].dtype == np.int32
    assert small_face["fixed"].dtype == np.int8
    assert all("units" in small_face[name].attrs for name in small_face.data_vars)
    assert elements_of(small_face, "OOM_R").tolist() == [1, 2]
    assert [fibre.shape for fibre in fibres_of(small_face, "OOM_R")] == [(2, 3)]
    with pytest.raises(ValueError, match="unknown muscle 'OOM'"):
        elements_of(small_face, "OOM")


def test_saved_and_loaded_alike(small_face: xr.Dataset, tmp_path: Path) -> None:
    path = save_face(small_face, tmp_path / "new" / "face.nc")
    xr.testing.assert_identical(load_face(path), small_face)
    assert [file.name for file in path.parent.iterdir()] == ["face.nc"]


def test_failed_save_keeps_the_old_file(small_face: xr.Dataset, tmp_path: Path) -> None:
    path = save_face(small_face, tmp_path / "face.nc")
    before = path.read_bytes()
    broken = small_face.copy(deep=True)
    broken["position"][0, 0] = np.nan
    with pytest.raises(SchemaError):
        save_face(broken, path)
    assert path.read_bytes() == before
    assert len(list(tmp_path.iterdir())) == 1
    with pytest.raises(FaceError, match="Cannot write"):
        save_face(small_face, tmp_path / "face.nc" / "face.nc")


@pytest.mark.parametrize("share", [0.0, 0.3, 0.9])
def test_truncated_file(small_face: xr.Dataset, tmp_path: Path, share: float) -> None:
    path = save_face(small_face, tmp_path / "face.nc")
    data = path.read_bytes()
    path.write_bytes(data[: int(share * len(data))])
    with pytest.raises(FaceError, match=r"face\.nc cannot be read as netCDF"):
        load_face(path)


def test_absent_file(tmp_path: Path) -> None:
    with pytest.raises(FaceError, match="No file .*; expected a face"):
        load_face(tmp_path / "absent.nc")


def test_inverted_element_is_named_with_its_determinant(small_face: xr.Dataset) -> None:
    flipped = small_face.copy(deep=True)
    flipped["element_id"][:] = [11, 12, 13]
    flipped["connectivity"][1] = flipped["connectivity"].values[1, [4, 5, 6, 7, 0, 1, 2, 3]]
    # Mirrored top and bottom: det J = -(h/2)^3 everywhere.
    with pytest.raises(FaceError, match=r"element 12 is inverted at rest: .* is -1\.25e-07 m3"):
        check_face(flipped)


def test_corner_alone_can_be_inverted(small_face: xr.Dataset) -> None:
    dented = small_face.copy(deep=True)
    # Pull a corner of the first cube just beyond the plane of its three neighbours.
    dented["position"][0] = [0.0052, 0.0052, 0.0001]
    with pytest.raises(FaceError, match="element 1 is inverted"):
        check_face(dented)


def test_inverted_wedge(small_face: xr.Dataset) -> None:
    flipped = small_face.copy(deep=True)
    flipped["connectivity"][2] = flipped["connectivity"].values[2, [0, 2, 1, 3, 5, 4, 6, 7]]
    with pytest.raises(FaceError, match="element 3 is inverted"):
        check_face(flipped)


def test_muscle_without_element(small_face: xr.Dataset) -> None:
    keep = small_face["bundle_muscle"].values != 4
    with pytest.raises(FaceError, match="muscle BUC_L has no element"):
        check_face(small_face.isel(bundle_element=keep))


def test_muscle_with_an_element_twice(small_face: xr.Dataset) -> None:
    twice = small_face.copy(deep=True)
    twice["bundle_index"][0] = twice["bundle_index"].values[1]
    with pytest.raises(FaceError, match="muscle ZYG_L lists element 3 twice"):
        check_face(twice)


@pytest.mark.parametrize(("node", "column"), [(14, 0), (-1, 2), (-1, 6)])
def test_node_out_of_range(small_face: xr.Dataset, node: int, column: int) -> None:
    broken = small_face.copy(deep=True)
    broken["connectivity"][0, column] = node
    with pytest.raises(
        FaceError, match=rf"element 1 refers to node index {node}, expected 0 to 13"
    ):
        check_face(broken)


@pytest.mark.parametrize(
    ("variable", "dim"), [("marker_node", "marker"), ("lip_opening_node", "lip")]
)
def test_marker_nodes(small_face: xr.Dataset, variable: str, dim: str) -> None:
    label = small_face[dim].values[1]
    outside = small_face.copy(deep=True)
    outside[variable][1] = 99
    with pytest.raises(FaceError, match=f"{dim} {label} refers to node index 99"):
        check_face(outside)
    on_bone = small_face.copy(deep=True)
    on_bone[variable][1] = 3
    with pytest.raises(FaceError, match=f"{dim} {label} is at node 4, which is fixed"):
        check_face(on_bone)


def test_marker_on_a_node_of_no_element(small_face: xr.Dataset) -> None:
    loose = small_face.isel(element=[0, 1]).copy(deep=True)
    with pytest.raises(SchemaError):
        check_face(loose)
    loose = loose.isel(bundle_element=loose["bundle_index"].values < 2)
    with pytest.raises(
        FaceError, match=r"node 13 belongs to no element \(marker upper_lateral_left"
    ):
        check_face(loose)


def test_schema_is_enforced(small_face: xr.Dataset) -> None:
    with pytest.raises(SchemaError):
        check_face(small_face.drop_vars("layer"))
    no_unit = small_face.copy(deep=True)
    no_unit["position"].attrs["units"] = "mm"
    with pytest.raises(UnitsError):
        check_face(no_unit)
    long = small_face.copy(deep=True)
    long["bundle_direction"][0] = [0.0, 0.0, 0.9]
    with pytest.raises(SchemaError):
        check_face(long)
