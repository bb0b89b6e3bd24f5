"""Lists of the faces near points, kept while points and faces have moved little."""

import numpy as np

from sim._kernels.grid import grid_of
from sim._kernels.nearest_faces import complete, listed
from sim.scene import Index
from sim.state import Array

Lists = tuple[Index, Index]
"""Places (n + 1,) of the first face of every point, and the faces of all points, ascending."""


ROUNDING = 2e-9  #: additional radius of the lists, for equally close faces and rounding [m]


class Candidates:
    """Faces that points may meet (a Verlet list), which are searched again only after motions.

    A point that has moved by a and a face that has moved by b are closer by at most a + b. Lists of all
    faces within the radius of a point and a skin are valid as long as neither exceeds half the
    skin. The faces found among them are those found among all, so that the skin affects the run
    time alone.

    Parameters
    ----------
    triangles : (m, 3) int
    nodes : (n,) int
        Vertex that every point is, -1 for none; faces that contain it are omitted.
    skin : distance by which points and faces may approach each other before a new search [m].
    every : list all faces within a radius, not only up to the closest one.

    Attributes
    ----------
    searches : number of searches.
    """

    def __init__(
        self, triangles: Index, nodes: Index, skin: float = 0.0, *, every: bool = False
    ) -> None:
        self._triangles, self._nodes, self._used = triangles, nodes, np.unique(triangles)
        self._skin, self._every = skin, every
        self._made_at: tuple[Array, Array, Array, Array] | None = None
        self._lists: Lists = (np.zeros(len(nodes) + 1, np.int64), np.empty(0, np.int64))
        self.searches = 0

    def along(
        self, before: Array, after: Array, x0: Array, x1: Array, radius: Array | float = 0.0
    ) -> Lists:
        """Faces within a radius of points anywhere on their paths.

        Parameters
        ----------
        before, after : (n, 3) points at both ends [m].
        x0, x1 : (k, 3) vertices of the faces at both ends [m].
        radius : (n,) or float [m]; may be infinite.
        """
        every = np.array(np.broadcast_to(radius, len(after)), dtype=np.float64)
        ends = before, after, x0, x1
        if self._made_at is None or not complete(*ends, self._used, every, *self._made_at):
            own = np.sqrt(((before - after) ** 2).sum(axis=1))
            farthest = (
                np.sqrt(((x0 - x1)[self._used] ** 2).sum(axis=1).max()) if x0 is not x1 else 0.0
            )
            moves, reach = own + (farthest + self._skin + ROUNDING), np.empty(len(after))
            first = np.empty(len(after) + 1, np.int64)
            grid = grid_of(x1, x1, self._triangles)
            around = every, moves, self._nodes, x1, self._triangles, grid, self._every
            self._lists = first, listed(after, *around, reach, first)
            self._made_at = after.copy(), x1.copy(), moves, reach
            self.searches += 1
        return self._lists
