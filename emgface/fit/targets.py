"""Springs of one iteration of closest points: sheets and surfaces, curves, landmarks."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from emgface.face.check import sheet_nodes
from emgface.face.parts import INNER, OUTER
from emgface.face.surface import faces_among, triangles
from emgface.fit.loops import LoopPair, along, length, pair_loops
from emgface.fit.springs import NO_ROWS, Rows, across, along_normal, at_nodes
from emgface.fit.triangulated import Floats, Integers, Surface

LOOP_BAND = 3e-3  #: width of surface to which the springs of a contour are equivalent [m]
BACK_SPRINGS = 6000  #: number of springs from a target to the mesh
UNCOVERED_RATIO = 0.35
"""Distance from which a point of a fine target is not covered, relative to a triangle of a mesh [1]."""


@dataclass(frozen=True, eq=False)
class Sheet:
    """Skin or inner surface of a mesh, as nodes and triangles of nodes."""

    nodes: Integers
    triangles: Integers
    loops: tuple[Integers, ...]  #: contours: rim of the face, eyes, nostrils, mouth

    @classmethod
    def from_face(cls, face: xr.Dataset, layer: int) -> "Sheet":
        """Return the skin (`OUTER`) or the inner surface (`INNER`) of a face."""
        nodes = sheet_nodes(face, layer)
        faces, _ = faces_among(face["connectivity"].values.astype(np.int64), nodes)
        position = face["position"].values
        own = triangles(faces, position)
        return cls(nodes, own, Surface(position, own).loops)

    def at(self, q: Floats) -> Surface:
        """Surface at positions of all nodes (n_nodes, 3) [m]."""
        return Surface(q, self.triangles)


def sheets(face: xr.Dataset) -> dict[str, Sheet]:
    """Skin and inner surface of a face by name."""
    return {"skin": Sheet.from_face(face, OUTER), "inner": Sheet.from_face(face, INNER)}


@dataclass(frozen=True, eq=False)
class Target:
    """Surface that a sheet, or some of its nodes, are pulled to."""

    name: str  #: of the file or argument, for messages
    sheet: Sheet
    surface: Surface
    #: nodes that it attracts; None: all of the sheet, contours to contours and in both directions
    only: Integers | None = None
    #: -1 if its outward normals oppose those of the tissue, as on a bone
    side: float = 1.0
    #: the surface ends at the rim of the sheet; a scan ends where it was cut off
    rim: bool = False
    #: its open edges are contours; not those of the outer layer of an enclosing surface
    contours: bool = True

    def pairs(self, q: Floats) -> list[LoopPair]:
        """Contours of the sheet with a counterpart on the target."""
        if self.only is not None or not self.contours:
            return []
        loops = sorted(self.sheet.loops, key=lambda loop: -length(q[loop]))
        return pair_loops(tuple(loops if self.rim else loops[1:]), q, self.surface)


@dataclass(frozen=True)
class Pull:
    """Stiffness of the springs of one iteration."""

    stiffness: float  #: along the normals, per area [Pa/m]
    tangential: float  #: share across the normals [1]
    along_curve: float  #: share along contours [1]
    back: float = 1.0  #: factor on the springs from the target to the mesh [1]
    seed: int = 0  #: of the points of the target with springs
    #: distance from which points of a fine target have springs, relative to a triangle of the mesh [1]
    beyond: float = UNCOVERED_RATIO


@dataclass(frozen=True, eq=False)
class LandmarkPoints:
    """Points of the mesh that belong to landmarks, and where the landmarks lie."""

    names: tuple[str, ...]
    source: Floats  #: (n, 3) places on the source mesh [m]
    target: Floats  #: (n, 3) [m]
    nodes: Integers  #: (n, 3) nodes of the nearest triangle of the skin
    weights: Floats  #: (n, 3) barycentric coordinates
    offset: (
        Floats  #: (n, 3) from the point of the triangle, for example to a tip that it cuts off [m]
    )
    on_skin: NDArray[np.bool_]  #: (n,) False of a rigid point beyond the mesh

    def at(self, q: Floats) -> Floats:
        """Points (n, 3) that belong to the landmarks at positions q [m]."""
        return np.einsum("nk,nki->ni", self.weights, q[self.nodes]) + self.offset

    def rows(self, stiffness: float, along: Floats | None = None) -> Rows:
        """Springs of a stiffness [N/m] at the landmarks on the skin.

        If the skin has a target of its own, they act only along it: `along` are positions of the nodes
        from which its normals are computed. Noise of landmarks then makes no dents.
        """
        own = self.on_skin
        W = np.tile(stiffness * np.eye(3), (int(own.sum()), 1, 1))
        if along is not None:
            n = Surface(along, self.nodes[own]).normals
            W = W - stiffness * n[:, :, None] * n[:, None, :]
        return Rows(self.nodes[own], self.weights[own], (self.target - self.offset)[own], W)


def pulling(q: Floats, targets: Sequence[Target], pull: Pull) -> Rows:
    """All springs to surfaces at positions q (n_nodes, 3) [m]."""
    parts = [rows for target in targets for rows in _of_target(q, target, pull)]
    return NO_ROWS.joined(*parts)


def _of_target(q: Floats, target: Target, pull: Pull) -> list[Rows]:
    moving = target.sheet.at(q)
    pairs = target.pairs(q)
    rows = [_to_surface(q, moving, target, pairs, pull)]
    for pair in pairs:
        foot, tangent = along(q[pair.mine], pair.target)
        foot = _on_polygon(foot, pair.target)
        step = np.linalg.norm(q[pair.mine] - np.roll(q[pair.mine], -1, axis=0), axis=1)
        W = across(
            0.5 * LOOP_BAND * (step + np.roll(step, 1)), tangent, pull.stiffness, pull.along_curve
        )
        rows.append(at_nodes(pair.mine, foot, W))
    if target.only is None and pull.back > 0.0:
        rows.append(_from_surface(moving, target, pull))
    return rows


def _to_surface(
    q: Floats, moving: Surface, target: Target, pairs: Sequence[LoopPair], pull: Pull
) -> Rows:
    """Springs from nodes to their nearest points; none where those lie on an open edge."""
    nodes = target.sheet.nodes if target.only is None else target.only
    on_curve = [pair.mine for pair in pairs]
    nodes = np.setdiff1d(nodes, np.concatenate([np.zeros(0, dtype=np.int64), *on_curve]))
    surface = target.surface
    near = surface.nearest(q[nodes], target.side * moving.point_normals[nodes])
    use = near.agrees & ~surface.at_border(near)
    corner = surface.point_normals[surface.triangles[near.triangle]]
    normal = corner.mean(axis=1)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    W = along_normal(moving.point_areas[nodes], normal, pull.stiffness, pull.tangential)
    return at_nodes(nodes[use], near.foot[use], W[use])


def _from_surface(moving: Surface, target: Target, pull: Pull) -> Rows:
    """Springs from points of the target that the mesh does not cover.

    A flat triangle of a convex part lies within a finer scan, although its nodes lie on it: springs of
    all points would push the nodes outwards, on coarse lips by more than a millimetre.
    """
    points, owner, _ = target.surface.samples
    rng = np.random.default_rng(pull.seed)
    pick = rng.choice(len(points), min(BACK_SPRINGS, len(points)), replace=False)
    normal = target.surface.normals[owner[pick]]
    near = moving.nearest(points[pick], target.side * normal, wide=20)
    # chords lie within an arc in proportion to the square of their lengths
    own = moving.areas[near.triangle]
    finer = np.maximum(own - target.surface.areas[owner[pick]], 0.0) * np.sqrt(2.0 / own)
    use = near.agrees & ~moving.at_open_edge[near.triangle] & (near.distance >= pull.beyond * finer)
    share = np.full(len(pick), pull.back * target.surface.areas.sum() / len(pick))
    W = along_normal(share, normal, pull.stiffness, pull.tangential)
    nodes = moving.triangles[near.triangle]
    return Rows(nodes[use], near.weights[use], points[pick][use], W[use])


def _on_polygon(points: Floats, polygon: Floats) -> Floats:
    """Nearest points of a closed polygon to points (n, 3)."""
    start, edge = polygon, np.roll(polygon, -1, axis=0) - polygon
    size = np.maximum((edge**2).sum(axis=1), 1e-30)
    t = np.clip(np.einsum("psi,si->ps", points[:, None] - start[None], edge) / size, 0.0, 1.0)
    foot = start[None] + t[..., None] * edge[None]
    best = ((points[:, None] - foot) ** 2).sum(axis=2).argmin(axis=1)
    return foot[np.arange(len(points)), best]
