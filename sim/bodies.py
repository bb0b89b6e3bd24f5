"""Rigid bodies: mass, inertia and rest frame, given or computed from a closed surface and a density."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from sim.checks import real_numbers
from sim.errors import MeshError, SceneError
from sim.pattern import Array, Index

Motion = Callable[[float], tuple[ArrayLike, ArrayLike]]
"""Position (3,) [m] and unit quaternion (4,), scalar first, at a time [s]."""


@dataclass(frozen=True, eq=False)
@real_numbers
class Body:
    """A rigid body. Its axes at rest are those of space, with the quaternion (1, 0, 0, 0)."""

    name: str
    mass: float = 0.0  #: mass [kg]; 0 for a body that is fixed or follows a prescribed motion
    #: about the centre of mass, in the axes of space at rest [kg m^2], positive definite
    inertia: Array | None = None
    centre: tuple[float, float, float] | Array = (0.0, 0.0, 0.0)  #: (3,) centre of mass at rest [m]
    #: (2,) damping of the translation [kg/s] and of the rotation [kg m^2/s] relative to space
    damping: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        finite = np.isfinite([self.mass, *self.damping, *self.centre]).all()
        if not finite or self.mass < 0.0 or min(self.damping) < 0.0:
            raise SceneError(
                f"body {self.name}: mass {self.mass!r}, damping {self.damping!r} and centre "
                f"{self.centre!r}, expected finite numbers, mass and damping at least 0"
            )
        if self.mass == 0.0:
            return
        inertia = np.asarray(self.inertia if self.inertia is not None else np.nan, dtype=float)
        good = inertia.shape == (3, 3) and np.isfinite(inertia).all()
        good = good and np.abs(inertia - inertia.T).max() <= 1e-9 * np.abs(inertia).max()
        if not (good and np.linalg.eigvalsh(inertia).min() > 0.0):
            raise SceneError(
                f"body {self.name}: inertia {self.inertia!r}, expected a symmetric positive definite "
                "3 x 3 matrix [kg m^2] for a body with mass"
            )


def body_of_surface(name: str, X: Array, triangles: Index, density: float, **more: object) -> Body:
    """Rigid body of the volume within a closed surface, of uniform density.

    Parameters
    ----------
    name : str
    X : (n, 3) vertices [m].
    triangles : (m, 3) vertex indices, counter-clockwise seen from outside.
    density : float
        Density [kg/m^3].
    **more
        Passed to `Body`.

    Raises
    ------
    MeshError
        The surface is open, an edge belongs to two faces in one direction, or the volume is
        negative.

    Notes
    -----
    Each face and a point near the surface span a tetrahedron. Over a tetrahedron with corners a, b,
    c and the origin, int x x' dV = V/20 (s s' + a a' + b b' + c c') with s = a + b + c. Source:
    Tonon 2004, Explicit exact formulas for the 3-D tetrahedron inertia tensor, J. Math. Stat. 1,
    8-11.
    """
    _require_closed(name, triangles)
    base = X.mean(axis=0)
    corners = (X - base)[triangles]
    volume = np.linalg.det(corners) / 6.0
    total = float(volume.sum())
    if not total > 0.0:
        raise MeshError(
            f"surface {name} encloses {total:.3g} m^3, expected a positive volume: reverse the "
            "order of the vertices of its faces"
        )
    s = corners.sum(axis=1)
    first = volume @ s / 4.0
    second = np.einsum("f,fi,fj->ij", volume, s, s) / 20.0
    second += np.einsum("f,fki,fkj->ij", volume, corners, corners) / 20.0
    centre = first / total
    second -= total * np.outer(centre, centre)
    inertia = density * (np.trace(second) * np.eye(3) - second)
    return Body(name, density * total, inertia, base + centre, **more)  # pyright: ignore[reportArgumentType]


def _require_closed(name: str, triangles: Index) -> None:
    edges = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    known, counts = np.unique(edges, axis=0, return_counts=True)
    forward = {(int(a), int(b)) for a, b in known}
    lonely = [edge for edge in sorted(forward) if edge[::-1] not in forward]
    if lonely or counts.max(initial=0) > 1:
        shown = lonely or [tuple(int(i) for i in known[np.argmax(counts)])]
        raise MeshError(
            f"surface {name} is not closed: {len(lonely)} edges have a face on one side only, or more "
            f"than two, first {shown[:5]}: close it, or specify mass and inertia"
        )
