"""Outer surface of a mesh."""

import numpy as np

from sim.contact.surfaces import NodeSurface
from sim.mesh import Mesh
from sim.scene import Index

FACES = {
    "hex8": ((0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)),
    "wedge6": ((0, 2, 1), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5)),
    "tet4": ((0, 2, 1), (0, 1, 3), (1, 2, 3), (2, 0, 3)),
}
"""Faces of every element type, counter-clockwise seen from outside (VTK node order)."""


def boundary_surface(mesh: Mesh, name: str = "boundary") -> NodeSurface:
    """Outer surface of a mesh: the faces of one element only, quadrilaterals divided into two.

    It is closed and counter-clockwise seen from outside if the faces of the elements match.
    """
    faces: list[Index] = []
    for block in mesh.blocks:
        for corners in FACES[block.kind.name]:
            face = block.nodes[:, corners]
            faces.append(face if face.shape[1] == 4 else np.c_[face, np.full(len(face), -1)])
    every = np.concatenate(faces)
    _, first, counts = np.unique(
        np.sort(every, axis=1), axis=0, return_index=True, return_counts=True
    )
    outer = every[np.sort(first[counts == 1])]
    quads = outer[outer[:, 3] >= 0]
    triangles = np.concatenate([outer[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    return NodeSurface(triangles, name)
