"""Contact surfaces of rigid bodies: massless points at the vertices of their surfaces."""

from collections.abc import Mapping

import numpy as np

from sim.contact.surfaces import NodeSurface
from sim.kinematics.members import OnBody
from sim.scene import Index
from sim.state import Array


def body_surfaces(
    shapes: Mapping[str, tuple[Array, Index]], first: int = 0
) -> tuple[Array, tuple[OnBody, ...], dict[str, NodeSurface]]:
    """Points and members of a scene that carry the surfaces of bodies, and these surfaces.

    Parameters
    ----------
    shapes : mapping of str to ((n, 3) array, (m, 3) array of int)
        Name of a body, and the vertices of its surface at rest [m] with its triangles,
        counter-clockwise seen from outside.
    first : number of the first of these points in the scene: that of the nodes of the mesh and of other
        points before them.

    Returns
    -------
    points : (k, 3) array
        For `Scene.points`.
    members : tuple of OnBody
        For `Scene.reductions`.
    surfaces : dict of str to NodeSurface
        For the pairings of a `ConstraintContact`, by name of the body.
    """
    members: list[OnBody] = []
    surfaces: dict[str, NodeSurface] = {}
    for name, (X, triangles) in shapes.items():
        members.append(OnBody(name, first + np.arange(len(X))))
        surfaces[name] = NodeSurface(triangles + first, name)
        first += len(X)
    points = np.vstack([np.empty((0, 3)), *(X for X, _ in shapes.values())])
    return points, tuple(members), surfaces
