"""Volume of the tissue within an outline, by sampling the untreated elements."""

from typing import Any, Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from emgface.choices import configure
from emgface.face.quality import is_wedge
from emgface.treatment.columns import columns_of
from emgface.treatment.excise import near_nodes
from emgface.treatment.outline import outline_of
from emgface.treatment.plan import Wedge

Floats = NDArray[np.float64]

SAMPLES_PER_DIRECTION: Final = 24  #: samples along every direction of an element


def sampled_volume(face: xr.Dataset, step: dict[str, Any]) -> float:
    """Volume [m^3] of the columns of a face within the outline of a step, without cutting it.

    The volume of every element is the sum over a regular grid of points of its natural coordinates of
    det(dX/dxi), where the point of the skin in the same column is inside the outline. It is independent
    of the moved nodes and the pieces of a conforming cut.
    """
    own = configure(Wedge, step)
    outline = outline_of(face, own)
    columns = columns_of(face, near_nodes(face, outline, own.lip))
    position = face["position"].values
    connectivity = face["connectivity"].values
    g = (2.0 * np.arange(SAMPLES_PER_DIRECTION) + 1.0) / SAMPLES_PER_DIRECTION - 1.0
    total = 0.0
    for column in range(len(columns.corner)):
        names = columns.nodes(column)
        if len(names) == 3 or is_wedge(connectivity[columns.element[column]]).any():
            total += _of_wedges(position, columns, column, outline)
            continue
        xi, eta = np.meshgrid(g, g, indexing="ij")
        signs = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
        one, two = 1 + xi[..., None] * signs[:, 0], 1 + eta[..., None] * signs[:, 1]
        N = 0.25 * one * two
        d1, d2 = 0.25 * signs[:, 0] * two, 0.25 * signs[:, 1] * one
        stacks = position[[columns.stack[n] for n in names]]  # corner, sheet, axis
        flat = outline.chart.flat(np.einsum("ijk,kx->ijx", N, stacks[:, 0]).reshape(-1, 3))
        a, b, c, d = outline.chart.flat(stacks[:, 0])
        if (b - a)[0] * (d - a)[1] - (b - a)[1] * (d - a)[0] <= 0.0:
            continue  # turned away from the chart
        inside = outline.contains(flat).reshape(xi.shape)
        if not inside.any():
            continue
        for layer in range(columns.layers):
            top, low = stacks[:, layer], stacks[:, layer + 1]
            for z in (-1 / np.sqrt(3), 1 / np.sqrt(3)):
                x = 0.5 * (1 - z) * low + 0.5 * (1 + z) * top
                J = np.stack([np.einsum("ijk,kx->ijx", D, x) for D in (d1, d2)]
                             + [np.einsum("ijk,kx->ijx", N, 0.5 * (top - low))], axis=-1)  # fmt: skip
                total += (
                    float((np.linalg.det(J) * inside).sum()) * (2.0 / SAMPLES_PER_DIRECTION) ** 2
                )
    return total


def _of_wedges(position: Floats, columns: Any, column: int, outline: Any) -> float:
    """Volume of the inner part of a column of wedges."""
    rng = np.random.default_rng(0)
    bary = rng.dirichlet([1.0, 1.0, 1.0], SAMPLES_PER_DIRECTION**2)
    names = columns.nodes(column)
    stacks = position[[columns.stack[n] for n in names]]
    inside = outline.contains(outline.chart.flat(bary @ stacks[:, 0]))
    total = 0.0
    for layer in range(columns.layers):
        top, low = stacks[:, layer], stacks[:, layer + 1]
        for z in (0.21132486540518713, 0.7886751345948129):
            x = (1 - z) * low + z * top
            normal = np.cross(x[1] - x[0], x[2] - x[0])
            through = bary @ (top - low)
            total += 0.25 * float((np.abs(through @ normal) * inside).mean())
    return total
