"""Table of the points of a compiled solid, with deformation gradients as functions of coordinates."""

import numpy as np

from sim._kernels.lanes import LANES
from sim._kernels.laws import FibreTable
from sim._kernels.reduced import PointTable
from sim.errors import SceneError
from sim.scene import Index
from sim.state import Array
from sim.system import System
from sim.terms.load import Gravity
from sim.terms.solid import CompiledSolid


def solid_of(system: System) -> CompiledSolid:
    """The solid of a scene whose other forces are constant.

    Raises SceneError if the scene has another term, a constraint, a body or a joint.
    """
    solids = [term for term in system.terms if isinstance(term, CompiledSolid)]
    others = [t for t in system.scene.terms if not isinstance(t, Gravity)]
    names = [type(t).__name__ for t in (*others, *system.scene.constraints, *system.scene.joints)]
    if len(solids) != 1 or len(names) != 1 or system.scene.bodies:
        raise SceneError(
            f"a reduced model supports one Solid and Gravity, the scene has {', '.join(names)}: use "
            "pointwise incompressibility without contact, walls and bodies, or full order"
        )
    return solids[0]


def point_table(
    solid: CompiledSolid, q0: Array, modes: Array, elements: Index | None = None
) -> PointTable:
    """Points of weight one of all or some elements, for the modes (3 n_nodes, n) about q0."""
    found = solid.pointwise
    place, F0, G, volume = list[Index](), list[Array](), list[Array](), list[Array]()
    nodal = modes.reshape(len(q0), 3, -1)
    for part in found.parts:
        points = len(part.slope) // 3
        own = np.arange(len(part.element))
        if elements is not None:
            own = np.flatnonzero(np.isin(part.element, elements))
        d = part.slope.reshape(points, 3, -1)  # (point, axis l, node)
        A = part.inverse.reshape(-1, 3, 3, part.inverse.shape[1])[own][
            ..., :points
        ]  # (element, l, J, point)
        g = np.einsum("pla,elJp->epaJ", d, A)
        nodes = part.nodes[own]
        q = q0[nodes] - q0[nodes[:, :1]]  # the derivatives sum to zero
        F0.append(np.einsum("epaJ,eai->epiJ", g, q).reshape(-1, 9))
        of_modes = np.einsum("epaJ,eain->epiJn", g, nodal[nodes], optimize=True)
        G.append(of_modes.reshape(len(own) * points, 9, nodal.shape[2]))
        place.append((8 * part.element[own][:, None] + np.arange(points)).ravel())
        volume.append(part.volume[own, :points].ravel())
    places = np.concatenate(place)
    owner = places // 8
    return PointTable(
        place=places,
        F0=np.concatenate(F0),
        G=_in_lanes(np.concatenate(G)),
        volume=np.concatenate(volume),
        laws=found.laws._replace(region=found.laws.region[owner]),
        fibres=_fibres_of(found.fibres, owner),
    )


def weighted(table: PointTable, points: Index, weights: Array) -> PointTable:
    """The chosen points of a table with factors on their volumes."""
    rows = len(table.G) // max(len(table.volume), 1) or 1
    return table._replace(
        place=table.place[points],
        F0=table.F0[points],
        G=table.G.reshape(-1, rows, LANES)[points].reshape(-1, LANES),
        volume=table.volume[points] * weights,
        laws=table.laws._replace(region=table.laws.region[points]),
        fibres=_fibres_of(table.fibres, points),
    )


def _in_lanes(G: Array) -> Array:
    """Rows of eight numbers of (p, 9, n), filled with zeros."""
    p, _, n = G.shape
    blocks = -(-n // LANES)
    found = np.zeros((p, 9, blocks * LANES))
    found[..., :n] = G
    return found.reshape(-1, LANES)


def _fibres_of(fibres: FibreTable, owners: Index) -> FibreTable:
    """Fibres of the elements or points `owners`, one after the other."""
    counts = np.diff(fibres.start)[owners]
    start = np.append(0, np.cumsum(counts)).astype(np.int64)
    first: Index = np.repeat(fibres.start[owners] - start[:-1], counts)
    row = first + np.arange(int(start[-1]), dtype=np.int64)
    return fibres._replace(
        start=start,
        muscle=fibres.muscle[row],
        direction=np.ascontiguousarray(fibres.direction[row]),
        weight=fibres.weight[row],
    )
