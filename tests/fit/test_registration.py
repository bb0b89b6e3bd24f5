"""Registration of surfaces: known motions, closed forms of the smooth map, published bones."""

import tracemalloc

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from emgface.anatomy.jaw.template import template_jaw
from emgface.errors import FitError
from emgface.fit.bones import surface_volume, surfaces_of
from emgface.fit.registration import SmoothMap, closest_points, smooth_map
from emgface.fit.similarity import Similarity
from emgface.fit.triangulated import Surface

STILL = Similarity(1.0, np.eye(3), np.zeros(3))


@pytest.fixture(scope="module")
def mandible() -> Surface:
    return surfaces_of(template_jaw())["jaw"]


def _apart(transform: Similarity, truth: Similarity, points: np.ndarray) -> tuple[float, float]:
    turn = Rotation.from_matrix(transform.rotation @ truth.rotation.T).magnitude()
    return np.degrees(turn), float(np.abs(transform(points) - truth(points)).max())


@pytest.mark.parametrize("seed", range(10))
def test_closest_points_find_a_motion_from_random_starts(mandible, seed):
    rng = np.random.default_rng(seed)
    axis = rng.standard_normal(3)
    turn = Rotation.from_rotvec(np.radians(15.0) * rng.random() * axis / np.linalg.norm(axis))
    centre = mandible.points.mean(axis=0)
    shift = rng.uniform(-1, 1, 3) * 0.015 / np.sqrt(3)
    truth = Similarity(1.0, turn.as_matrix(), centre + shift - turn.as_matrix() @ centre)
    moved = Surface(truth(mandible.points), mandible.triangles)
    transform = closest_points(mandible, moved)
    degrees, metres = _apart(transform, truth, mandible.points)
    assert degrees < 0.05 and metres < 1e-4
    assert np.linalg.det(transform.rotation) == pytest.approx(1.0)


def test_a_similarity_is_found_despite_a_hole(mandible):
    turn = Rotation.from_rotvec([0.1, -0.05, 0.08]).as_matrix()
    truth = Similarity(1.06, turn, np.array([0.004, -0.003, 0.002]))
    kept = mandible.points[mandible.triangles].mean(axis=1)[:, 0] > -0.03
    moved = Surface(truth(mandible.points), mandible.triangles[kept])
    start = closest_points(mandible, moved)
    transform = closest_points(mandible, moved, start, scaled=True)
    assert transform.scale == pytest.approx(1.06, abs=1e-3)
    assert _apart(transform, truth, mandible.points)[1] < 2e-4


def test_surfaces_without_agreeing_normals_are_refused(mandible):
    flat = np.array([[-1.0, 0, 0], [1, 0, 0], [0, 0, -1]])
    with pytest.raises(FitError, match="agreeing normal"):
        closest_points(mandible, Surface(0.05 * flat - [0, 0.2, 0], np.array([[0, 1, 2]])))


def test_the_published_jaw_is_found_at_its_other_position(shared):
    """Two positions of one bone, related by a published rigid motion of 1.9 degrees and 5 mm."""
    from emgface.fit.readers.surfaces import read_surface

    folder = shared / "artisynth_models"
    scan = read_surface(folder / "face_badin" / "badinjaw.obj", unit="m").surface
    text = (folder / "jaw_tongue_face" / "XBadinJawToSymmetric.txt").read_text()
    rows = np.array([float(v) for v in text.strip(" []\n").split()]).reshape(4, 4)[:3]
    truth = Similarity(1.0, rows[:, :3], 1e-3 * rows[:, 3])
    transform = closest_points(scan, Surface(truth(scan.points), scan.triangles))
    degrees, metres = _apart(transform, truth, scan.points)
    assert degrees < 0.05 and metres < 1e-4


def test_the_smooth_map_is_the_similarity_where_nothing_deviates():
    rng = np.random.default_rng(0)
    motion = Similarity(1.1, Rotation.random(random_state=0).as_matrix(), rng.normal(size=3))
    points = 0.05 * rng.normal(size=(40, 3))
    mapping = SmoothMap.through(motion, points, motion(points), np.full(40, 1e-3))
    far = rng.normal(size=(10, 3))
    np.testing.assert_allclose(mapping(far), motion(far), atol=1e-9)
    np.testing.assert_allclose(mapping.gradient(far[0]), 1.1 * motion.rotation, atol=1e-6)
    # a constant deviation is kept beyond the data
    shifted = SmoothMap.through(motion, points, motion(points) + 2e-3, np.full(40, 1e-4))
    np.testing.assert_allclose(shifted(far), motion(far) + 2e-3, atol=1e-6)


def test_a_smooth_deformation_of_a_bone_is_recovered(mandible):
    def bend(x):
        return x + np.column_stack(
            [0.08 * x[:, 0], 2e-3 * np.sin(30 * x[:, 0]), 3e-3 * np.cos(25 * x[:, 1])]
        )

    target = Surface(bend(mandible.points), mandible.triangles)
    start = closest_points(mandible, target, scaled=True)
    smoothed = smooth_map(start, [(mandible, target)])
    moved = Surface(smoothed(mandible.points), mandible.triangles)
    distance = target.nearest(moved.samples[0]).distance
    before = target.nearest(start(mandible.samples[0])).distance
    assert distance.mean() < 0.2e-3 and distance.mean() < 0.15 * before.mean()
    assert surface_volume(moved) == pytest.approx(surface_volume(target), rel=0.01)


def test_nearest_points_of_many_points_need_little_memory(mandible):
    """A scan of 400 000 triangles took 2.9 GB."""
    rng = np.random.default_rng(0)
    lo, hi = mandible.points.min(axis=0), mandible.points.max(axis=0)
    points = rng.uniform(lo, hi, (60_000, 3))
    mandible.tree  # noqa: B018  built beforehand
    peaks = []
    for some in (points[:20_000], points):
        tracemalloc.start()
        nearest = mandible.nearest(some)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 1.5 * peaks[0]
    ends = np.r_[0:10, 59_990:60_000]
    np.testing.assert_array_equal(mandible.nearest(points[ends]).foot, nearest.foot[ends])
