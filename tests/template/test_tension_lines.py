"""Tension lines of a face and the prestretch along them."""

import numpy as np
import xarray as xr

from emgface.face.tension_lines import skin_axes, skin_prestretch


def test_tension_lines_cross_the_muscles_and_mirror(coarse: xr.Dataset) -> None:
    element, axes = skin_axes(coarse)
    assert len(element) == int((coarse["layer"].values == 2).sum())
    np.testing.assert_allclose(
        axes @ axes.transpose(0, 2, 1), np.tile(np.eye(3), (len(axes), 1, 1)), atol=1e-12
    )
    X = coarse["position"].values
    centre = X[coarse["connectivity"].values[element]].mean(axis=1)
    assert (axes[centre[:, 1] > np.quantile(centre[:, 1], 0.8), 2, 1] > 0).all(), (
        "outwards in front"
    )
    # At the philtrum the fibres of the ring muscle are horizontal and the lines vertical.
    upper = int(coarse["lip_opening_node"].values[0])
    above = centre - X[upper]
    lip = np.linalg.norm(above, axis=1) < 0.012
    assert lip.sum() >= 2 and (np.abs(axes[lip, 0, 0]) < 0.5).all()
    mirror = np.argmin(np.linalg.norm(centre[:, None] * [-1, 1, 1] - centre[None], axis=2), axis=1)
    cosine = np.abs((axes[:, 0] * [-1, 1, 1] * axes[mirror, 0]).sum(axis=1))
    np.testing.assert_allclose(cosine, 1.0, atol=1e-6)


def test_the_prestretch_of_a_face_is_that_of_its_skin(coarse: xr.Dataset) -> None:
    stretch = np.array([1.2, 0.95, 0.9])
    F0 = skin_prestretch(coarse, stretch)
    element, axes = skin_axes(coarse)
    np.testing.assert_allclose(
        np.einsum("eij,ekj->eik", F0[element], axes)[:, :, 0], 1.2 * axes[:, 0]
    )
    np.testing.assert_allclose(np.linalg.det(F0[element]), stretch.prod(), rtol=1e-12)
    rest = np.setdiff1d(np.arange(coarse.sizes["element"]), element)
    assert (F0[rest] == np.eye(3)).all()
