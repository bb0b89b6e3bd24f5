"""Surfaces of the lips of treated faces, which contact requires."""

import numpy as np
import pytest
import xarray as xr

import emgface as ef
from emgface.face.closed import open_edges, volume
from emgface.face.lips import _lip_columns, _without_folds, lip_surface
from emgface.face.quality import element_quality

DEEP = [
    {"lip": "lower", "shape": "V", "width": 12.0, "height": 17.0},
    {"lip": "upper", "shape": "rectangle", "width": 10.0, "height": 14.0, "place": 0.63},
    {
        "lip": "lower",
        "shape": "shield",
        "width": 8.0,
        "height": 17.0,
        "place": 0.6,
        "method": "elements",
    },
]
"""Wounds that reach tissue that is attached to bone, whose edges stay apart there."""


@pytest.mark.parametrize("step", DEEP, ids=["V", "rectangle", "shield"])
def test_lips_of_a_wound_that_reaches_bone_enclose_their_elements(coarse, step):
    treated = ef.treat(coarse, {"step": [{"kind": "wedge", **step}]})
    position, connectivity = treated["position"].values, treated["connectivity"].values
    for lip in ("upper", "lower"):
        elements = connectivity[_lip_columns(treated, lip)]
        inside = element_quality(position, elements).volume.sum()
        # the diagonals of bilinear facets change the volume slightly
        assert volume(position, lip_surface(treated, lip)) == pytest.approx(inside, rel=0.03)


def test_such_a_face_moves_with_contact(coarse):
    treated = ef.treat(coarse, {"step": [{"kind": "wedge", **DEEP[0]}]})
    coords = {"muscle": ["OOP_L", "OOP_R"], "time": [0.0, 0.05]}
    activation = xr.DataArray([[0.0, 0.3]] * 2, coords, attrs={"units": "1"})
    activation = activation.reindex(muscle=treated["muscle"].values, fill_value=0.0)
    moved = ef.simulate(activation, treated, accuracy="draft")
    assert np.isfinite(moved["position"].values).all()


def test_opposite_triangles_on_the_same_nodes_enclose_nothing():
    tetrahedron = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
    other = np.array([[0, 1, 2], [0, 4, 1], [1, 4, 2], [0, 2, 4]])  # on the other side of 0, 1, 2
    both = _without_folds(np.concatenate([tetrahedron, other]))
    assert len(both) == 6
    assert not len(open_edges(both))
    same = np.concatenate([tetrahedron, tetrahedron[:1]])
    assert len(_without_folds(same)) == 5  # a repeated triangle is a fault, and stays
