"""Similarity x -> s R x + t between paired points, and thin-plate splines with smoothing."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RBFInterpolator
from scipy.spatial.distance import cdist

Floats = NDArray[np.float64]

GROWTH: Final = 1.25e-4
"""Half the variance that the shape of two faces differs by, per distance of two points [m].

After a similarity, faces differ by about 5 mm over 100 mm: 25 mm2 / (2 x 100 mm).
"""


@dataclass(frozen=True)
class Similarity:
    """Map of points (n, 3): x -> scale * rotation x + shift, with det(rotation) = 1."""

    scale: float
    rotation: Floats  #: (3, 3)
    shift: Floats  #: (3,) [m]

    def __call__(self, points: Floats) -> Floats:
        """Return the mapped points."""
        return self.scale * points @ self.rotation.T + self.shift

    @property
    def angle(self) -> float:
        """Angle of the rotation [degrees]."""
        return float(np.degrees(np.arccos(np.clip((np.trace(self.rotation) - 1) / 2, -1, 1))))


def similarity(
    source: Floats, target: Floats, *, scaled: bool = True, mirrored: bool = False
) -> Similarity:
    """Least-squares similarity of paired points (n, 3), by singular values (Umeyama 1991).

    With H = sum (source - mean)(target - mean)', H = U S V', the rotation is V D U' with
    D = diag(1, 1, det(V U')), and the scale tr(S D) / sum |source - mean|^2; a rigid motion if not
    `scaled`. `mirrored` returns the best improper map (det -1) instead.
    """
    p, q = source.mean(axis=0), target.mean(axis=0)
    U, S, Vt = np.linalg.svd((source - p).T @ (target - q))
    sign = np.sign(np.linalg.det(Vt.T @ U.T)) * (-1.0 if mirrored else 1.0)
    D = np.array([1.0, 1.0, sign])
    rotation = Vt.T @ np.diag(D) @ U.T
    scale = float((S * D).sum() / ((source - p) ** 2).sum()) if scaled else 1.0
    return Similarity(scale, rotation, q - scale * rotation @ p)


def rigid_of(values: Floats) -> Similarity:
    """Rigid motion of the rows of rotation and shift (12,) [m]."""
    rows = np.asarray(values, dtype=np.float64).reshape(3, 4)
    return Similarity(1.0, rows[:, :3], rows[:, 3])


def misfit(map_: Similarity, source: Floats, target: Floats) -> float:
    """Root mean square distance of the mapped points from their targets [m]."""
    return float(np.sqrt(((map_(source) - target) ** 2).sum(axis=1).mean()))


def thin_plate(
    source: Floats, target: Floats, noise: float | Floats, growth: float = GROWTH
) -> RBFInterpolator:
    """Thin-plate spline x -> A x + t + sum_k w_k |x - p_k| through uncertain points (n, 3).

    In space the kernel of least bending is U(r) = r, with sum w = 0 and sum w p' = 0 (Bookstein 1989
    has the plane). `noise` [m] is the standard deviation of the targets, one or one for each; the
    smoothing on the diagonal is noise^2 / growth, for which the spline is the expectation of shapes
    whose differences grow by `growth`. The result is a function of points (n, 3).
    """
    spread = np.broadcast_to(np.asarray(noise, dtype=np.float64), (len(source),))
    return RBFInterpolator(source, target, kernel="linear", degree=1, smoothing=spread**2 / growth)


def growth_of(source: Floats, target: Floats, noise: float) -> float:
    """Growth of the difference of two shapes that points (n, 3) with `noise` [m] show, at most `GROWTH`.

    It maximises the restricted likelihood of the points about an affine map: what noise explains is no
    difference of shape, and bends nothing.
    """
    if len(source) < 7:
        return GROWTH
    P = np.column_stack([np.ones(len(source)), source - source.mean(axis=0)])
    Q = np.linalg.qr(P, mode="complete")[0][:, P.shape[1] :]
    values, vectors = np.linalg.eigh(-Q.T @ cdist(source, source) @ Q)
    square = ((vectors.T @ Q.T @ target) ** 2).sum(axis=1)
    growths = GROWTH * np.geomspace(1e-3, 1.0, 61)
    variance = growths[:, None] * values + noise**2
    loss = (target.shape[1] * np.log(variance) + square / variance).sum(axis=1)
    return float(growths[np.argmin(loss)])
