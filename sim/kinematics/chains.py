"""Resolved attachments: every point as a fixed combination of root nodes and of vectors on bodies."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from sim.bodies import Body
from sim.errors import SceneError
from sim.kinematics.members import Attachment, NodeMotion
from sim.mesh import Mesh
from sim.pattern import Array, Flags, Index


@dataclass(frozen=True, eq=False)
class Chains:
    """Points x = sum_n weights_n x_n + sum_b (share_b c_b + Q_b arm_b) of nodes n and bodies b."""

    dependent: Index  #: (k,) points that are combinations, ascending; all others are roots
    weights: csr_array  #: (k, n_points) of root nodes
    #: (m,), (m,), (m,), (m, 3) of every dependence of a point on a body; the arm is in the axes of the
    #: body [m]
    point: Index
    body: Index
    share: Array
    arm: Array
    fixed: Flags  #: (n_points, 3) fixed components
    paths: tuple[tuple[Index, NodeMotion], ...]  #: nodes with a prescribed path, and their path


@dataclass
class _Row:
    """Combination of one point: weights of nodes, share and arm of bodies."""

    nodes: dict[int, float]
    bodies: dict[int, tuple[float, Array]]


def resolve(
    mesh: Mesh, bodies: Sequence[Body], attachments: Sequence[Attachment], still: Flags
) -> Chains:
    """Resolve chains such as a node in an element whose nodes are on a body.

    Raises SceneError if a node has two members, or depends on itself through others. The mesh has all
    points; `still` (n_bodies,) is True for fixed bodies.
    """
    owner: dict[int, tuple[Attachment, int]] = {}
    fixed = np.zeros((mesh.n_nodes, 3), dtype=bool)
    for attachment in attachments:
        if attachment.axes:
            fixed[np.ix_(attachment.nodes, np.array(attachment.axes))] = True
            continue
        for i, node in enumerate(attachment.nodes.tolist()):
            before = owner.get(node)
            if before is not None or fixed[node].any():
                name = "Fixed" if before is None else before[0].name
                raise SceneError(
                    f"node {node} is held by {name} and by {attachment.name}: remove one"
                )
            owner[node] = attachment, i
    both = [node for node in owner if fixed[node].any()]
    if both:
        raise SceneError(
            f"node {both[0]} is held by Fixed and by {owner[both[0]][0].name}: remove one"
        )

    rows: dict[int, _Row] = {}

    def row_of(node: int, above: tuple[int, ...]) -> _Row:
        if node in rows:
            return rows[node]
        attachment, i = owner.get(node, (None, 0))
        if attachment is None or attachment.path is not None:
            return _Row({node: 1.0}, {})
        if node in above:
            names = [f"node {n} ({owner[n][0].name})" for n in (*above[above.index(node) :], node)]
            raise SceneError(f"attachments form a cycle: {' -> '.join(names)}: free one of them")
        if attachment.body >= 0:
            place = mesh.X[node] if attachment.places is None else attachment.places[i]
            arm = place - np.asarray(bodies[attachment.body].centre)
            row = _Row({}, {attachment.body: (1.0, arm)})
        else:
            row = _Row({}, {})
            for holder, weight in zip(
                attachment.holders[i].tolist(), attachment.weights[i].tolist(), strict=True
            ):
                if weight != 0.0:
                    _add(row, row_of(holder, (*above, node)), weight)
        rows[node] = row
        return row

    for node in owner:
        row_of(node, ())
    dependent = np.array(sorted(rows), dtype=np.int64)
    for node, row in rows.items():
        # Points that depend only on fixed bodies or nodes are fixed.
        stays = [fixed[n] for n in row.nodes] + [np.full(3, still[b]) for b in row.bodies]
        fixed[node] = np.all(stays, axis=0)
    return Chains(
        dependent,
        _weights(dependent, rows, mesh.n_nodes),
        *_arms(dependent, rows),
        fixed,
        tuple((a.nodes, a.path) for a in attachments if a.path is not None),
    )


def _add(row: _Row, other: _Row, weight: float) -> None:
    """Add a multiple of a combination."""
    for node, share in other.nodes.items():
        row.nodes[node] = row.nodes.get(node, 0.0) + weight * share
    for body, (share, arm) in other.bodies.items():
        before = row.bodies.get(body, (0.0, np.zeros(3)))
        row.bodies[body] = before[0] + weight * share, before[1] + weight * arm


def _weights(dependent: Index, rows: dict[int, _Row], n: int) -> csr_array:
    entries = [
        (i, node, weight)
        for i, point in enumerate(dependent.tolist())
        for node, weight in sorted(rows[point].nodes.items())
    ]
    row, column, value = zip(*entries, strict=True) if entries else ((), (), ())
    place = np.array(row, dtype=np.int64), np.array(column, dtype=np.int64)
    return csr_array((np.array(value, dtype=np.float64), place), shape=(len(dependent), n))


def _arms(dependent: Index, rows: dict[int, _Row]) -> tuple[Index, Index, Array, Array]:
    arms = [
        (point, body, *rows[point].bodies[body])
        for point in dependent.tolist()
        for body in sorted(rows[point].bodies)
    ]
    point, body, share, arm = zip(*arms, strict=True) if arms else ((), (), (), ())
    return (
        np.array(point, dtype=np.int64),
        np.array(body, dtype=np.int64),
        np.array(share, dtype=np.float64),
        np.array(arm, dtype=np.float64).reshape(-1, 3),
    )
