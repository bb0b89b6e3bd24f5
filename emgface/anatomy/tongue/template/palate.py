"""Surface of the hard palate between the teeth of the upper arch, for contact with the tongue."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from emgface.anatomy.tongue.template.shape import Floats, fitted_shape
from emgface.face.parts import SKULL, Arch
from emgface.face.template.arches import inner_wall

VAULT = ((89, 3.5), (86, 9), (80, 14.5), (72, 18.5), (62, 20.5), (52, 20.5), (42, 18))
"""Midline of the palate of the man of `emgface.anatomy.tongue.template.shape.DRAWN`, y and z [mm]: about
17 mm above the first molars, and 47 mm long; both as commonly quoted for adults."""
PALATE_SECTIONS, POINTS_ACROSS = 12, 13
"""Sections and points of each."""
THICKNESS = 4e-3
"""Thickness of the closed body behind the surface [m]; not visible to the tongue."""
_CREST = 3e-3
"""Height of the rim of the vault above the lips [m], next to the crowns of the teeth."""


def palate(places: Mapping[str, Floats], arches: tuple[Arch, Arch]) -> Arch:
    """Closed body (k, 3) [m] of the palate, fixed to the skull; it reaches the inner side of the teeth.

    A section at y has the half width W(y) of the arch and the height
    z = r + (z_m - r) (1 - |x/W|^2.5)^(1/2) over its rim r.
    """
    drawn = np.array([(0.0, y, z) for y, z in VAULT]) * 1e-3
    middle = fitted_shape(drawn, places, arches)
    at = np.linspace(0.0, 1.0, PALATE_SECTIONS) * (len(drawn) - 1)
    y, z = (np.interp(at, np.arange(len(drawn)), middle[:, k]) for k in (1, 2))
    wall = inner_wall(next(arch for arch in arches if arch.bone == SKULL))
    side = wall[len(wall) // 2 :, 2]  # from the midline to the last tooth, next to the gums
    x = np.abs(side[:, 0])
    order = np.argsort(side[:, 1])
    width = np.maximum(np.interp(y, side[order, 1], x[order]), 3e-3)
    s = np.sin(0.5 * np.pi * np.linspace(-1.0, 1.0, POINTS_ACROSS))  # denser at the steep sides
    rim = np.minimum(_CREST, z - 1e-3)[:, None]
    height = rim + (z[:, None] - rim) * np.sqrt(np.clip(1.0 - np.abs(s) ** 2.5, 0.0, None))
    low = np.stack([width[:, None] * s, np.broadcast_to(y[:, None], height.shape), height], axis=-1)
    high = low + [0.0, 0.0, THICKNESS]
    return Arch(SKULL, np.concatenate([low.reshape(-1, 3), high.reshape(-1, 3)]), _closed())


def _closed() -> NDArray[np.int64]:
    """Triangles of both sheets and of the rim between them, outward; mirrored diagonals."""
    lower = np.arange(PALATE_SECTIONS * POINTS_ACROSS).reshape(PALATE_SECTIONS, POINTS_ACROSS)
    upper = lower + lower.size
    # stations run backwards and columns to the right: this order faces down
    below = _quads(lower)
    above = _quads(upper)[:, ::-1]
    loop = np.concatenate([lower[0, :-1], lower[:-1, -1], lower[-1, :0:-1], lower[:0:-1, 0]])
    after = np.roll(loop, -1)
    rim = np.stack([loop, loop + lower.size, after + lower.size, after], axis=1)
    quads = np.concatenate([below, above, rim])
    column = np.tile(np.arange(POINTS_ACROSS), 2 * PALATE_SECTIONS)[quads].mean(axis=1)
    right = column > 0.5 * (POINTS_ACROSS - 1)
    quads[right] = np.roll(quads[right], 1, axis=1)
    return np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])


def _quads(index: NDArray[np.int64]) -> NDArray[np.int64]:
    corners = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
    return np.stack(corners, axis=-1).reshape(-1, 4)
