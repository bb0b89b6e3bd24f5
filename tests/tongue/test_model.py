"""Domain object of a tongue: contents, files and refusals."""

import numpy as np
import pytest
import xarray as xr

from emgface.anatomy.tongue.model import attached_nodes
from emgface.errors import DataError, TongueError
from emgface.face.parts import Bundle
from emgface.schema.netcdf import read_netcdf, write_netcdf
from tests.tongue.small import small_tongue


def test_a_tongue_survives_its_file(tmp_path):
    tongue = small_tongue()
    again = read_netcdf(
        write_netcdf(tongue, tmp_path / "tongue.nc", "tongue_model"), "tongue_model"
    )
    xr.testing.assert_equal(again, tongue)
    assert list(attached_nodes(again)) == ["jaw"]
    np.testing.assert_array_equal(again["fibre_body"], [-1, -1, -1, -1, -1, -1, 1])
    assert str(again["body"].values[1]) == "skull"
    assert again["exciter_gain"].sel(exciter="bi_GGP").values.tolist() == [1.0, 0.0]


def test_what_cannot_be_simulated_is_refused():
    tongue = small_tongue()
    forward = np.array([[0.0, 1.0, 0.0]])
    turned = tongue["connectivity"].values[:, [3, 2, 1, 0, 7, 6, 5, 4]]
    bundles = [Bundle("GGP_L", np.array([0]), forward), Bundle("STY_R", np.array([9]), forward)]
    fibre_less = {"GGP_L": 1.0, "STY_R": 1.0, "HG_L": 1.0}
    with pytest.raises(TongueError, match=r"element 1 is inverted at rest \(3 such elements\)"):
        small_tongue(connectivity=turned)
    with pytest.raises(TongueError, match="muscle HG_L has no element"):
        small_tongue(force_max=fibre_less)
    with pytest.raises(TongueError, match="marker base is absent"):
        small_tongue(markers={"tip": 0, "back": 1})
    with pytest.raises(TongueError, match="marker tip refers to node index 99, expected 0 to 15"):
        small_tongue(markers={"tip": 99, "back": 1, "base": 0})
    with pytest.raises(TongueError, match="unknown muscle 'STY_R'"):
        small_tongue(force_max={"GGP_L": 1.0})
    with pytest.raises(TongueError, match="STY_R refers to element 9, expected 0..2"):
        small_tongue(bundles=bundles)
    mask = Bundle("STY_R", np.array([False, True]), forward)
    with pytest.raises(TongueError, match="the mask of elements has shape"):
        small_tongue(bundles=[bundles[0], mask])
    with pytest.raises(DataError, match="attachment_node"):
        small_tongue(attachments={"jaw": np.array([0, 0])})
