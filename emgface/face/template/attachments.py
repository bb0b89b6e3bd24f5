"""Attachments of the template to bone, and nodes of its markers."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from emgface.face.parts import FREE, MANDIBLE, SKULL
from emgface.face.surface import boundary_faces
from emgface.face.template.grid import LAYER_COUNT, MARKER_RAY, Grid
from emgface.face.template.surface import Surfaces

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

_POWER: Final = 4.0  #: exponent of the superellipse within which the inner surface is free


def fixed_nodes(surfaces: Surfaces, grid: Grid) -> NDArray[np.int8]:
    """Attachment of every node: rim and inner surface outside lips and cheeks are fixed to bone.

    The inner surface is free between the upper and lower fornix of the vestibule, which is near the
    root of the lips in the midline and widens towards the cheek, as far as the masseter. The values
    (nodes,) are those of `emgface.face.parts`: free, mandible (below the mouth) or skull.
    """
    m = surfaces.measures
    q, lip = grid.left_rays
    place = surfaces.places(q, lip, grid.s)
    xi, tau = place[..., 0], place[..., 1]
    cheek = np.clip(xi / (0.30 * m.face_width), 0.0, 1.0) ** 2
    upper = 0.70 * m.upper_lip_height + cheek * (0.30 * m.upper_lip_height + 0.12 * m.nose_height)
    lower = 0.75 * m.lower_lip_height + cheek * (0.60 * m.chin_height - 0.75 * m.lower_lip_height)
    height = np.where(tau >= 0.0, upper, lower)
    outside = (xi / (0.58 * m.face_width)) ** _POWER + (np.abs(tau) / height) ** _POWER >= 1.0
    fixed = np.zeros((*outside.shape, LAYER_COUNT + 1), dtype=bool)
    fixed[..., 0] = outside
    fixed[:, -1, :] = True
    bone = np.where(tau >= 0.0, SKULL, MANDIBLE)[..., None]
    return grid.unfold(np.where(fixed, bone, FREE)).reshape(-1).astype(np.int8)


def lip_surfaces(grid: Grid, position: Floats, corner: float) -> dict[str, Integers]:
    """Named parts of the boundary: nodes of each facet, outward.

    `position` (nodes, 3) and `corner`, the half width of the mouth, are in [m]. For upper and lower
    lip the parts are ``_inner``, the lining of lip and cheek within the middle curve of the
    outline, which may touch the teeth; ``_margin``, the faces at the slit, which may touch each
    other; and ``_vermilion``.
    """
    faces, element = boundary_faces(grid.connectivity)
    ray, ring = (index[element] for index in grid.element_place)
    upper = np.minimum(ray, grid.rays - 1 - ray) < grid.rays // 4
    sheet = np.arange(np.prod(grid.shape)).reshape(grid.shape)
    inner = np.isin(faces, sheet[..., 0]).all(axis=1) & (ring < sum(grid.rings[:3]))
    margin = np.isin(faces, sheet[:, 0]).all(axis=1)
    red = np.isin(faces, sheet[..., -1]).all(axis=1) & (ring < grid.rings[0])
    # The vermilion tapers towards the corner, which is surrounded by the rings.
    aside = np.clip(np.abs(position[faces, 0]).mean(axis=1) / corner, 0.0, 1.0)
    red &= (ring + 0.5) / grid.rings[0] < 5.0 * np.sqrt(1.0 - aside**2)
    parts = {"inner": inner, "margin": margin, "vermilion": red}
    return {
        f"{lip}_lip_{name}": faces[chosen & side]
        for lip, side in (("upper", upper), ("lower", ~upper))
        for name, chosen in parts.items()
    }


def lip_marker_nodes(grid: Grid) -> Integers:
    """Nodes of the lip markers, on the vermilion border, in the order of `LIP_MARKERS`."""
    quarter = grid.rays // 4
    lateral, paramedian = (round(MARKER_RAY[k] * quarter) for k in ("lateral", "paramedian"))
    half = grid.rays // 2
    left = [quarter, lateral, paramedian, half - lateral, half - paramedian]
    corner, upper_lateral, upper_paramedian, lower_lateral, lower_paramedian = left
    rays = [
        corner,
        upper_lateral,
        upper_paramedian,
        -upper_paramedian,
        -upper_lateral,
        -corner,
        lower_lateral,
        lower_paramedian,
        -lower_paramedian,
        -lower_lateral,
    ]
    return grid.index[np.array(rays) % grid.rays, grid.rings[0], LAYER_COUNT]


def lip_opening_nodes(grid: Grid) -> Integers:
    """Midline nodes of the upper and the lower margin, on the skin side."""
    return grid.index[[0, grid.rays // 2], 0, LAYER_COUNT]


def face_marker_positions(surfaces: Surfaces) -> Floats:
    """Rigid points in the order of `FACE_MARKERS` [m].

    Temple, nasion and rhinion are on the skin; the forehead is above the template, where the
    markers of a recording are on skin that moves with the skull.
    """
    m = surfaces.measures
    top = m.upper_lip_height
    place = np.array(
        [
            (0.66 * m.face_width, top + 0.35 * m.nose_height),
            (0.0, top + 0.98 * m.nose_height),
            (0.0, top + 0.70 * m.nose_height),
        ]
    )
    temple, nasion, rhinion = surfaces.points(place, np.ones(3))
    nasion[0] = rhinion[0] = 0.0
    forehead = nasion + [-0.22 * m.face_width, -0.06 * m.face_depth, 0.35 * m.nose_height]
    mirror = np.array([-1.0, 1.0, 1.0])
    return np.array([forehead, forehead * mirror, temple, temple * mirror, nasion, rhinion])
