"""Walls behind the inner surface of a face, which represent teeth and bone."""

from typing import Final

import numpy as np
import xarray as xr

from emgface.errors import FaceError
from emgface.face.check import sheet_nodes
from emgface.face.parts import FREE, INNER
from emgface.face.surface import faces_among
from sim import Support

WALL: Final = 1000.0  #: stiffness of a wall that represents teeth [N/m]


def inner_support(face: xr.Dataset, stiffness: float) -> Support:
    """Return a frictionless wall behind every free node of the inner surface, at its rest position.

    The normal of a wall is the mean normal of the faces of the inner sheet at the node, into the
    tissue. The lips can thus separate from the teeth and slide on them, but not penetrate them.
    `stiffness` is that of each wall [N/m]. Raises FaceError if no node of the inner sheet is free.
    """
    position = face["position"].values
    inner = sheet_nodes(face, INNER)
    faces, _ = faces_among(face["connectivity"].values, inner)
    corners = position[faces]
    area = 0.5 * np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    normal = np.zeros_like(position)
    for corner in range(4):
        np.add.at(normal, faces[:, corner], -area)  # normals of faces are outward
    length = np.linalg.norm(normal, axis=1)
    nodes = inner[(face["fixed"].values[inner] == FREE) & (length[inner] > 0.0)]
    if not len(nodes):
        raise FaceError("no node of the inner surface is free, expected some to be supported")
    return Support(nodes, normal[nodes] / length[nodes, None], stiffness)
