"""The generated tongue: quality, size, symmetry, and its place between the bones and the lips."""

import numpy as np
import pytest

from emgface.anatomy.jaw.template import template_jaw
from emgface.anatomy.tongue.template import template_palate, template_tongue
from emgface.errors import TongueError
from emgface.face.quality import element_quality
from emgface.face.recipe import compose_scene
from emgface.face.simulation_parameters import SimulationParameters
from emgface.face.template import template_face
from sim.contact.surfaces import boundary_surface

VOLUMES = {"man": (89.9e-6, 11.5e-6), "woman": (68.9e-6, 7.0e-6)}
"""Mean and standard deviation of 35 men and 35 women (Liégeois et al. 2010, Eur J Orthod 32:381-386)."""


@pytest.mark.parametrize(
    ("preset", "resolution"),
    [("man", "fine"), ("woman", "medium"), ("boy", 150), ("older_woman", "coarse"), ("girl", 1500)],
)
def test_elements_are_of_good_quality_and_symmetric(preset: str, resolution: str | int) -> None:
    tongue = template_tongue(preset=preset, resolution=resolution)
    X = tongue["position"].values
    quality = element_quality(X, tongue["connectivity"].values)
    assert quality.scaled_jacobian.min() > 0.1
    own, mirrored = (np.unique(np.round(X * [sign, 1.0, 1.0], 12), axis=0) for sign in (1.0, -1.0))
    assert np.abs(own - mirrored).max() < 1e-11
    filled = np.bincount(tongue["bundle_index"].values, tongue["bundle_weight"].values)
    assert filled.max() <= 1.0 + 1e-12
    if preset in VOLUMES:
        mean, deviation = VOLUMES[preset]
        assert abs(quality.volume.sum() - mean) < 2.0 * deviation


@pytest.mark.parametrize(("preset", "seed"), [("man", None), ("girl", None), ("woman", 5)])
def test_tongue_lies_outside_bones_palate_and_face(preset: str, seed: int | None) -> None:
    tongue = template_tongue(preset=preset, seed=seed, resolution="coarse")
    nodes = np.unique(tongue["facet_node"].values)
    X = tongue["position"].values[nodes]
    X = X[X[:, 0] >= 0.0]
    jaw = template_jaw(preset=preset, seed=seed)
    face = template_face(preset=preset, seed=seed, resolution="coarse")
    mesh = compose_scene(face, SimulationParameters()).mesh
    palate = template_palate(preset=preset, seed=seed)
    shapes = [(mesh.X, boundary_surface(mesh).triangles), (palate.points, palate.triangles)]
    points, triangles = jaw["surface_position"].values, jaw["surface_triangle"].values
    # each closed part of the bones by itself
    starts = np.flatnonzero(np.diff(triangles.min(axis=1), prepend=-1) < -1)
    shapes += [(points, part) for part in np.split(triangles, starts) if len(part)]
    for V, T in shapes:
        assert not (_winding(X, V[T]) > 0.5).any()
    # a point in the body of the mandible is found to be inside
    symphysis = jaw["point_position"].sel(point="lower_incisor").values - [0.0, 4e-3, 22e-3]
    assert max(_winding(symphysis[None], points[triangles])) > 0.5


def _winding(X: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Winding number of closed surfaces (m, 3, 3) about points (n, 3): 1 inside, 0 outside."""
    d = corners - X[:, None, None]
    a, b, c = np.moveaxis(d, 2, 0)
    la, lb, lc = (np.linalg.norm(x, axis=-1) for x in (a, b, c))
    ab, bc, ca = ((x * y).sum(axis=-1) for x, y in ((a, b), (b, c), (c, a)))
    angle = np.arctan2(np.linalg.det(d), la * lb * lc + ab * lc + bc * la + ca * lb)
    return angle.sum(axis=1) / (2.0 * np.pi)


def test_impossible_resolution_is_refused() -> None:
    with pytest.raises(TongueError, match="expected coarse, medium, fine or a number"):
        template_tongue(resolution="tiny")
    with pytest.raises(TongueError, match="expected 120 to 60000"):
        template_tongue(resolution=3)
