"""Dental arches: clear of the resting tissue, symmetric, facing the lips."""

import numpy as np
import pytest

from emgface.errors import FaceError
from emgface.face.surface import boundary_faces, triangles, winding_number
from emgface.face.template import Measures, dental_arches, template_face
from emgface.face.template.arches import CLEARANCE

MIRROR = np.array([-1.0, 1.0, 1.0])


@pytest.mark.parametrize("bone", ["maxilla", "mandible"])
def test_arch(bone: str) -> None:
    arch = next(a for a in dental_arches(Measures()) if a.bone == bone)
    corners = arch.points[arch.triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (np.linalg.norm(normal, axis=1) > 0).all()
    middle = corners.mean(axis=1)
    front = np.abs(middle[:, 0]) < 15e-3
    assert (normal[front, 1] > 0).all(), "the front faces forward"
    beside = middle[:, 0] > 28e-3
    assert beside.any() and (normal[beside, 0] > 0).all(), "the sides face the cheeks"
    rows = {tuple(point) for point in arch.points.tolist()}
    assert rows == {(-x if x else x, y, z) for x, y, z in arch.points.tolist()}
    # A horseshoe: the front lies before the ends, and each arch on its own side of the mouth.
    assert np.ptp(arch.points[:, 1]) > 15e-3
    sign = 1 if bone == "maxilla" else -1
    assert (sign * arch.points[np.abs(arch.points[:, 0]) < 12e-3, 2] > 0).all()


def test_arches_touch_nothing_at_rest() -> None:
    """No point of an arch lies within the tissue, and the nearest lip node is a clearance away."""
    face = template_face(resolution="medium")
    position = face["position"].values
    faces, _ = boundary_faces(face["connectivity"].values)
    surface = position[triangles(faces, position)]
    for arch in dental_arches(Measures()):
        assert np.abs(winding_number(arch.points, surface)).max() < 0.5
        gap = np.linalg.norm(arch.points[:, None] - position[None], axis=2).min(axis=1)
        assert gap.min() > 0.8 * CLEARANCE


def test_clearance() -> None:
    near, far = (dental_arches(Measures(), clearance=c)[0].points for c in (0.0, 1e-3))
    np.testing.assert_allclose(np.linalg.norm(near - far, axis=1), 1e-3, rtol=1e-6)
    with pytest.raises(FaceError, match="the clearance of the teeth is -0.001 m"):
        dental_arches(Measures(), clearance=-1e-3)
