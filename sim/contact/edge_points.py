"""Points on the sharp edges of a surface, which may touch a rigid shell like its vertices."""

import numpy as np

from sim.contact.connectivity import sides_of
from sim.contact.signed_distance import SignedFaces
from sim.scene import Index
from sim.state import Array

SHARP = 0.7  #: cosine of the angle of the faces of an edge, below which it is sharp


def points_on_edges(faces: SignedFaces, X: Array, number: int) -> tuple[Index, Array]:
    """Ends (n, 2) and fractions (n,) of a number of points on each sharp convex edge at rest."""
    triangles, across = faces.triangles, faces.across.ravel()
    ends, normal = sides_of(triangles), faces.normals(X)[0]
    beyond = np.roll(triangles, 1, axis=1).ravel()
    once = np.flatnonzero((across >= 0) & (ends[:, 0] < ends[:, 1]))
    own, other = normal[once // 3], normal[across[once]]
    convex = np.einsum("ki,ki->k", other, X[beyond[once]] - X[ends[once, 0]]) < 0.0
    sharp = once[convex & (np.einsum("ki,ki->k", own, other) < SHARP)]
    share = np.arange(1, number + 1) / (number + 1)
    return np.repeat(ends[sharp], number, axis=0), np.tile(share, len(sharp))
