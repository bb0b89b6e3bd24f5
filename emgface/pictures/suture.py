"""Suture of a treated face, drawn on its skin in the colour of the force across it."""

from typing import Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.spatial import KDTree

from emgface.face.identity import is_treated
from emgface.face.surface import element_edges
from emgface.treatment.plan import NOT_VALIDATED

Floats = NDArray[np.float64]

STITCH: Final = ((0.98, 0.80, 0.25), (0.55, 0.05, 0.10))  #: from no to the largest force
DRAWN_SUTURE_DISTANCE: Final = 1.3e-3  #: distance from the suture within which it is drawn [m]
SUTURE_SENTENCE: Final = "The suture is drawn from yellow (no force) to dark red (largest force)."


def suture_colours(face: xr.Dataset, points: Floats) -> tuple[NDArray[np.bool_], Floats]:
    """Points (n, 3) [m] of the skin at rest that are near a suture, and their colours (k, 3)."""
    none = np.zeros(len(points), dtype=bool), np.zeros((0, 3))
    if "suture_node" not in face:
        return none
    position, node = face["position"].values, face["suture_node"].values
    edges, _ = element_edges(face["connectivity"].values)
    edges = np.unique(edges[np.isin(edges, node).all(axis=1)], axis=0)
    if not len(edges):
        return none
    pull = np.linalg.norm(face["suture_traction"].values, axis=1)
    force = np.zeros(face.sizes["node"])
    force[node] = pull / max(float(pull.max()), 1e-12)
    share = np.linspace(0.0, 1.0, 12)[:, None, None]
    ends = position[edges]
    line = ((1.0 - share) * ends[:, 0] + share * ends[:, 1]).reshape(-1, 3)
    level = (
        (1.0 - share[..., 0]) * force[edges[:, 0]] + share[..., 0] * force[edges[:, 1]]
    ).ravel()
    away, nearest = KDTree(line).query(points)
    near = np.asarray(away) < DRAWN_SUTURE_DISTANCE
    low, high = np.array(STITCH[0]), np.array(STITCH[1])
    return near, low + level[np.asarray(nearest)[near], None] * (high - low)


def treatment_words(shown: xr.Dataset) -> str:
    """Sentences on a treated face, or a motion of one: its suture, and what it is not for.

    An empty text for others.
    """
    words = [SUTURE_SENTENCE] if shown.sizes.get("suture", 0) else []
    words += [f"{NOT_VALIDATED.capitalize()}."] if is_treated(shown.attrs) else []
    return " ".join(words)
