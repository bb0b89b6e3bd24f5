"""Labelled volumes and images with known content: surfaces filled with voxels, stacks of a phantom."""

from typing import Any

import numpy as np

from emgface.fit.readers.volumes import toolkit
from emgface.fit.triangulated import Floats, Surface

CENTRE = np.array([0.01, -0.02, 0.03])
RADII = np.array([0.03, 0.022, 0.02])
UNMOVED = np.eye(3), np.zeros(3)
PLANES = {
    "axial": np.eye(3),
    "coronal": np.eye(3)[:, [0, 2, 1]],
    "sagittal": np.eye(3)[:, [1, 2, 0]],
}


def filled(surface: Surface, to_index: Floats, size: tuple[int, int, int]) -> np.ndarray:
    """Voxels (k, j, i) whose centres are inside a closed surface, by parity along the axis k.

    `to_index` (4, 4) maps points [m] to indices (i, j, k).
    """
    x = surface.points @ to_index[:3, :3].T + to_index[:3, 3]
    crossings: dict[tuple[int, int], list[float]] = {}
    for a, b, c in x[surface.triangles]:
        low = np.maximum(np.ceil(np.minimum(np.minimum(a, b), c)[:2]), 0).astype(int)
        high = np.floor(np.maximum(np.maximum(a, b), c)[:2]).astype(int)
        area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        if area == 0.0:
            continue
        for i in range(low[0], min(high[0], size[0] - 1) + 1):
            for j in range(low[1], min(high[1], size[1] - 1) + 1):
                v = ((i - a[0]) * (c[1] - a[1]) - (j - a[1]) * (c[0] - a[0])) / area
                w = ((b[0] - a[0]) * (j - a[1]) - (b[1] - a[1]) * (i - a[0])) / area
                if v >= 0.0 and w >= 0.0 and v + w <= 1.0:
                    z = a[2] + v * (b[2] - a[2]) + w * (c[2] - a[2])
                    crossings.setdefault((i, j), []).append(z)
    mask = np.zeros(size[::-1], dtype=bool)
    k = np.arange(size[2])
    for (i, j), z in crossings.items():
        mask[:, j, i] = (np.array(z)[:, None] < k).sum(axis=0) % 2 == 1
    return mask


def image_of(values: np.ndarray, affine: Floats) -> Any:
    """SimpleITK image of values (k, j, i), with the map (4, 4) from (i, j, k) to LPS [m]."""
    image: Any = toolkit().GetImageFromArray(values)
    spacing = np.linalg.norm(affine[:3, :3], axis=0)
    image.SetSpacing([float(s) for s in np.round(1e3 * spacing, 9)])
    image.SetDirection([float(d) for d in (affine[:3, :3] / spacing).ravel()])
    image.SetOrigin([float(x) for x in 1e3 * affine[:3, 3]])
    return image


def box_around(
    points: Floats, spacing: Floats, rotation: Floats, margin: float = 6e-3
) -> tuple[Floats, tuple[int, int, int]]:
    """Map (4, 4) from indices to points, and size, of a volume around points; spacing (3,) [m]."""
    own = points @ rotation
    low, high = own.min(axis=0) - margin, own.max(axis=0) + margin
    # a fraction of a voxel off, so that no point lies on a row of voxels
    low = low + spacing * np.array([0.137, 0.219, 0.071])
    affine = np.eye(4)
    affine[:3, :3] = rotation * spacing
    affine[:3, 3] = rotation @ low
    size = tuple(int(n) for n in np.ceil((high - low) / spacing))
    return affine, (size[0], size[1], size[2])


def intensity(points):
    """Head (100), an ellipsoid in it (60), a cavity (10), air (0), with soft edges."""

    def inside(radii, centre):
        r = np.linalg.norm((points - centre) / radii, axis=-1)
        return 1.0 / (1.0 + np.exp((r - 1.0) * radii.min() / 0.4e-3))

    head = 100.0 * inside(1.5 * RADII, CENTRE)
    tongue = inside(0.6 * RADII, CENTRE + [0.0, 0.004, -0.003])
    cavity = inside(0.25 * RADII, CENTRE + [0.005, -0.02, 0.012])
    return head - 40.0 * tongue - 90.0 * cavity


def stack(spacing, axes, motion=UNMOVED, noise=2.0, seed=0, margin=1.7):
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
    values = intensity((points - motion[1]) @ motion[0])
    rng = np.random.default_rng(seed)
    noisy = np.hypot(
        values + noise * rng.standard_normal(values.shape),
        noise * rng.standard_normal(values.shape),
    )
    return image_of(noisy.astype(np.float32), affine), points
