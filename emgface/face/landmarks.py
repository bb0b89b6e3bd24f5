"""Geometric landmarks of a face: rings around the mouth, rigid face markers."""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components, shortest_path
from scipy.spatial import KDTree

from emgface.errors import FaceError
from emgface.face.parts import SKULL
from emgface.face.surface import faces_among
from sim.indices import index, indices

Floats = NDArray[np.float64]
Integers = NDArray[np.integer]

MIDLINE = 5e-5  #: distance from x = 0 below which nodes are regarded as midsagittal [m]


def ring_of_nodes(
    position: Floats, connectivity: Integers, sheet: Integers, rim_node: int
) -> NDArray[np.int64]:
    """Number the rings of nodes of a surface around an opening, shape (nodes,).

    Ring 0 is the boundary loop of the sheet (its nodes, for instance the skin) that contains
    `rim_node`; the ring of a node is its edge distance from it, and -1 outside the sheet. Raises
    FaceError if `rim_node` is not on a boundary loop of the sheet.
    """
    n = len(position)
    sheet = indices("skin of the mouth", "node", sheet, n, error=FaceError)
    rim_node = index("rim of the mouth", "node", rim_node, n, error=FaceError)
    faces, _ = faces_among(connectivity, sheet)
    edges = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    edges = edges[edges[:, 0] != edges[:, 1]]
    edges, counts = np.unique(edges, axis=0, return_counts=True)
    border = edges[counts == 1]
    _, loop = connected_components(_graph(border, n), directed=False)
    rim = np.intersect1d(np.flatnonzero(loop == loop[rim_node]), border)
    if rim_node not in rim:
        raise FaceError(f"node index {rim_node} lies on no boundary loop of the skin")
    distance = shortest_path(_graph(edges, n), unweighted=True, directed=False, indices=rim)
    nearest = distance.min(axis=0)
    on_sheet = np.isin(np.arange(n), sheet)
    return np.where(np.isfinite(nearest) & on_sheet, nearest, -1).astype(np.int64)


def shift_rings(
    position: Floats,
    connectivity: Integers,
    sheet: Integers,
    rim_node: int,
    nodes: Integers,
    offset: int,
) -> NDArray[np.int64]:
    """Replace nodes of a sheet by the nearest node `offset` rings further from an opening.

    Other arguments as for `ring_of_nodes`. Raises FaceError if there is no such ring, and for nodes that
    are neither numbers nor a mask (`sim.indices`).
    """
    nodes = indices("markers of the mouth", "node", nodes, len(position), error=FaceError)
    if offset == 0:
        return nodes
    ring = ring_of_nodes(position, connectivity, sheet, rim_node)
    moved = nodes.copy()
    for k, node in enumerate(nodes):
        target = np.flatnonzero(ring == ring[node] + offset) if ring[node] + offset >= 0 else []
        if len(target) == 0:
            raise FaceError(
                f"no ring {ring[node] + offset} of skin nodes round the mouth: expected an offset "
                f"from {-int(ring[nodes].min())} to {int(ring.max() - ring[nodes].max())}"
            )
        moved[k] = target[np.argmin(np.linalg.norm(position[target] - position[node], axis=1))]
    return moved


def face_markers(position: Floats, fixed: Integers, inner: Integers, outer: Integers) -> Floats:
    """Six points (6, 3) [m] of the skin that move with the skull, for the reference face.

    Candidates are skin nodes whose nearest node of the inner sheet is fixed to the skull. In the
    upper half of the face: nasion, the most posterior midline candidate; rhinion, the lowest one;
    forehead, the candidate nearest in front view to 40 % of the half width and 95 % of the height;
    temple, the one nearest in side view to the height of the nasion and the middle of the depth.
    The right side mirrors the left; the order is that of `emgface.muscles.FACE_MARKERS`. Raises
    FaceError if there are no candidates.
    """
    below = inner[KDTree(position[inner]).query(position[outer])[1]]
    skin = position[outer[fixed[below] == SKULL]]
    low, high = position.min(axis=0), position.max(axis=0)
    height = high[2] - low[2]
    skin = skin[skin[:, 2] > (low[2] + high[2]) / 2.0]
    midline = skin[np.abs(skin[:, 0]) < MIDLINE]
    left = skin[skin[:, 0] < -MIDLINE]
    if len(midline) < 2 or len(left) < 2:
        raise FaceError("no rigid skin over the upper skull, expected fixed nodes beneath it")
    nasion, rhinion = midline[np.argmin(midline[:, 1])], midline[np.argmin(midline[:, 2])]
    front = np.array([0.4 * low[0], low[2] + 0.95 * height])
    forehead = left[np.argmin(np.linalg.norm(left[:, [0, 2]] - front, axis=1))]
    side = np.array([(low[1] + nasion[1]) / 2.0, nasion[2]])
    temple = left[np.argmin(np.linalg.norm(left[:, [1, 2]] - side, axis=1))]
    mirror = np.array([-1.0, 1.0, 1.0])
    return np.array([forehead, forehead * mirror, temple, temple * mirror, nasion, rhinion])


def _graph(edges: Integers, n: int) -> csr_array:
    return coo_array((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(n, n)).tocsr()
