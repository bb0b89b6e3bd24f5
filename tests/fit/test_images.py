"""Images of phantoms: bias, three stacks, registration, contours and regions with known truth."""

from importlib.util import find_spec

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.fit_phantoms import image_of
from emgface.errors import FitError
from emgface.fit.images import (
    clicks_of,
    combined_stacks,
    contour_through,
    region_around,
    registered_images,
    without_bias,
)
from emgface.fit.readers.volumes import toolkit

if find_spec("SimpleITK") is None:
    pytest.skip("SimpleITK is not installed", allow_module_level=True)
SimpleITK = toolkit()
CENTRE = np.array([0.01, -0.02, 0.03])
RADII = np.array([0.03, 0.022, 0.02])
UNMOVED = np.eye(3), np.zeros(3)
PLANES = {
    "axial": np.eye(3),
    "coronal": np.eye(3)[:, [0, 2, 1]],
    "sagittal": np.eye(3)[:, [1, 2, 0]],
}


def _intensity(points):
    """Head (100), an ellipsoid in it (60), a cavity (10), air (0), with soft edges."""

    def inside(radii, centre):
        r = np.linalg.norm((points - centre) / radii, axis=-1)
        return 1.0 / (1.0 + np.exp((r - 1.0) * radii.min() / 0.4e-3))

    head = 100.0 * inside(1.5 * RADII, CENTRE)
    tongue = inside(0.6 * RADII, CENTRE + [0.0, 0.004, -0.003])
    cavity = inside(0.25 * RADII, CENTRE + [0.005, -0.02, 0.012])
    return head - 40.0 * tongue - 90.0 * cavity


def _stack(spacing, axes, motion=UNMOVED, noise=2.0, seed=0, margin=1.7):
    """Image of the phantom moved by a rigid motion, in axes of its own, and its map from indices."""
    half = np.abs(axes.T) @ (margin * RADII)
    size = np.ceil(2 * half / spacing).astype(int)
    affine = np.eye(4)
    affine[:3, :3] = axes * spacing
    affine[:3, 3] = CENTRE - axes @ half
    index = np.stack(np.meshgrid(*(np.arange(n) for n in size[::-1]), indexing="ij"), axis=-1)[
        ..., ::-1
    ]
    points = index @ affine[:3, :3].T + affine[:3, 3]
    values = _intensity((points - motion[1]) @ motion[0])
    rng = np.random.default_rng(seed)
    noisy = np.hypot(
        values + noise * rng.standard_normal(values.shape),
        noise * rng.standard_normal(values.shape),
    )
    return image_of(noisy.astype(np.float32), affine), points


def _values(image):
    return SimpleITK.GetArrayFromImage(image)


def test_bias_is_removed():
    image, points = _stack(np.full(3, 2e-3), np.eye(3))
    x = (points - CENTRE) / RADII
    field = np.exp(0.35 * x[..., 0] + 0.2 * x[..., 1] ** 2)
    biased = image * 1.0
    wrong = SimpleITK.GetImageFromArray((_values(image) * field).astype(np.float32))
    wrong.CopyInformation(biased)
    found = _values(without_bias(wrong))
    tissue = np.abs(_intensity(points) - 100.0) < 2.0
    before, after = (v[tissue].std() / v[tissue].mean() for v in (_values(wrong), found))
    assert after < 0.4 * before and after < 0.08, (before, after)
    with pytest.raises(FitError, match="negative or no values"):
        without_bias(wrong - 1e4)


def test_three_stacks_are_combined_by_fiducials():
    """Slices of 2 mm in three planes; the combination is nearer to the truth than any stack."""
    rng = np.random.default_rng(3)
    points = CENTRE + rng.uniform(-1.0, 1.0, (6, 3)) * RADII
    stacks, marks, truth = [], [], []
    for k, axes in enumerate(PLANES.values()):
        turn = Rotation.from_rotvec(0.05 * rng.standard_normal(3)).as_matrix() if k else np.eye(3)
        shift = 2e-3 * rng.standard_normal(3) if k else np.zeros(3)
        image, _ = _stack(np.array([0.6e-3, 0.6e-3, 2e-3]), axes, (turn, shift), seed=k)
        stacks.append(image)
        noisy = points @ turn.T + shift + 0.1e-3 * rng.standard_normal(points.shape)
        marks.append({f"f{i}": p for i, p in enumerate(noisy)})
        truth.append((turn, shift))
    found, motions = combined_stacks(stacks, marks, 0.6e-3)
    inner = CENTRE + rng.uniform(-1.0, 1.0, (200, 3)) * RADII
    for motion, (turn, shift) in zip(motions, truth, strict=True):
        off = np.linalg.norm(motion(inner @ turn.T + shift) - inner, axis=1)
        assert 1e3 * off.mean() < 0.2  # target registration error
    one = SimpleITK.Resample(stacks[0], found, SimpleITK.Transform(), SimpleITK.sitkLinear, 0.0)
    size = found.GetSize()
    index = np.stack(np.meshgrid(*(np.arange(n) for n in size[::-1]), indexing="ij"), axis=-1)[
        ..., ::-1
    ]
    D = np.array(found.GetDirection()).reshape(3, 3) * np.array(found.GetSpacing())
    wanted = _intensity(1e-3 * (index @ D.T + np.array(found.GetOrigin())))
    core = tuple(slice(n // 6, -n // 6) for n in wanted.shape)
    errors = [np.sqrt(((_values(v) - wanted)[core] ** 2).mean()) for v in (found, one)]
    assert errors[0] < 0.85 * errors[1], errors
    mirrored = {k: p * [-1.0, 1.0, 1.0] for k, p in marks[0].items()}
    with pytest.raises(FitError, match="are mirrored, or differ"):
        combined_stacks(stacks[:2], [marks[0], mirrored], 1e-3)
    with pytest.raises(FitError, match="2 fiducials in common"):
        combined_stacks(stacks[:2], [marks[0], dict(list(marks[1].items())[:2])], 1e-3)


def test_mutual_information_finds_a_motion_and_the_inverse_contrast():
    """Target registration error at points that were not used."""
    turn = Rotation.from_rotvec([0.06, -0.04, 0.08]).as_matrix()
    shift = np.array([3e-3, -2e-3, 2e-3]) + CENTRE - turn @ CENTRE
    fixed, _ = _stack(np.full(3, 1.5e-3), np.eye(3))
    moving, _ = _stack(np.full(3, 1.5e-3), np.eye(3), (turn, shift), seed=1)
    contrast = (moving - 120.0) * (moving - 120.0) * 0.01
    found = registered_images(fixed, contrast)
    points = CENTRE + np.random.default_rng(1).uniform(-1.0, 1.0, (200, 3)) * RADII
    off = np.linalg.norm(found.motion(points @ turn.T + shift) - points, axis=1)
    before = np.linalg.norm(points @ turn.T + shift - points, axis=1)
    assert 1e3 * off.mean() < 0.5 and off.mean() < 0.2 * before.mean(), 1e3 * off.mean()
    far = image_of(_values(fixed), np.diag([1.5e-3, 1.5e-3, 1.5e-3, 1.0]) + np.eye(4, k=3) * 5.0)
    with pytest.raises(FitError, match="expected"):
        registered_images(fixed, far)


def test_a_contour_follows_the_edge_between_few_clicks():
    image, points = _stack(np.full(3, 1e-3), np.eye(3))
    k = len(points) // 2
    values = _values(image)[k]
    x = points[k][0, :, 0], points[k][:, 0, 1]
    angles = np.linspace(0.0, 2 * np.pi, 8, endpoint=False)
    z = (points[k][0, 0, 2] - CENTRE[2]) / (1.5 * RADII[2])
    rim = 1.5 * RADII[:2] * np.sqrt(1.0 - z**2)
    edge = CENTRE[:2] + rim * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    clicks = np.stack(
        [np.searchsorted(x[1], edge[:, 1]), np.searchsorted(x[0], edge[:, 0])], axis=1
    )
    found = contour_through(values, clicks)
    at = np.stack([x[0][found[:, 1]], x[1][found[:, 0]]], axis=1)
    off = np.abs(np.linalg.norm((at - CENTRE[:2]) / rim, axis=1) - 1.0) * rim.mean()
    assert 1e3 * off.mean() < 1.0 and 1e3 * off.max() < 2.5
    with pytest.raises(FitError, match="outside the slice"):
        contour_through(values, clicks + 1000)
    with pytest.raises(FitError, match="at least three clicks"):
        contour_through(values, clicks[:2])


def test_a_region_is_found_from_two_clicks(tmp_path):
    """Dice of the cavity and the tissue around it; clicks from a file of landmarks."""
    image, points = _stack(np.full(3, 1.2e-3), np.eye(3), margin=1.8)
    truth = _intensity(points) > 50.0
    inside = CENTRE + np.array([[0.0, 0.025, 0.0], [0.0, -0.02, -0.005]])
    rows = [f"inside_{k},{','.join(f'{1e3 * v:.3f}' for v in p)}" for k, p in enumerate(inside)]
    (tmp_path / "clicks.csv").write_text("\n".join(["name,x_mm,y_mm,z_mm", *rows]))
    mask = region_around(image, clicks_of(tmp_path / "clicks.csv", "inside"))
    dice = 2.0 * (mask & truth).sum() / (mask.sum() + truth.sum())
    assert dice >= 0.95, dice
    with pytest.raises(FitError, match="outside the image"):
        region_around(image, 1e3 * inside)
    with pytest.raises(FitError, match="no point whose name begins"):
        clicks_of(tmp_path / "clicks.csv", "outside")
