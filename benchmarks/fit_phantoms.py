"""Labelled volumes and images with known content: surfaces filled with voxels, in any orientation."""

from typing import Any

import numpy as np

from emgface.fit.readers.volumes import toolkit
from emgface.fit.triangulated import Floats, Surface


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
    found = np.zeros(size[::-1], dtype=bool)
    k = np.arange(size[2])
    for (i, j), z in crossings.items():
        found[:, j, i] = (np.array(z)[:, None] < k).sum(axis=0) % 2 == 1
    return found


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
