"""Scene of a tongue: tissue, muscles, damping and attachments as parts of `sim`."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import NDArray

import sim
from emgface.anatomy.tongue.model import attached_nodes
from emgface.anatomy.tongue.parameters import TongueParameters
from emgface.errors import TongueError
from emgface.face.parts import Floats
from emgface.face.quality import element_quality, is_wedge
from emgface.face.recipe import DAMPING_BY_STIFFNESS, GRAVITY
from sim.kinematics.members import Member, NodeMotion
from sim.scene import Term

Indices = NDArray[np.int64]

LINE_ENDING = ":line"
"""Ending of the name, in a scene, of the lines of a muscle that also has element fibres."""


@dataclass(frozen=True, eq=False)
class TonguePart:
    """A tongue as parts of a scene that may contain bodies.

    Attributes
    ----------
    mesh : sim.Mesh
    terms : of the tissue and its muscles, without gravity.
    damping, constraints : as of `sim.Scene`.
    attached : nodes that follow each body, and the points outside the mesh on it, by its name, numbered
        after the nodes and points before.
    points : (k, 3) points outside the mesh [m].
    """

    mesh: sim.Mesh
    terms: tuple[Term, ...]
    damping: sim.Rayleigh | sim.PassiveRayleigh | sim.RestRayleigh | None
    constraints: tuple[sim.HardElementVolume, ...]
    attached: Mapping[str, Indices]
    points: Floats


def tongue_part(tongue: xr.Dataset, p: TongueParameters, *, before: int = 0) -> TonguePart:
    """Lay out a tongue after `before` nodes of other tissue.

    Raises
    ------
    TongueError
        Line muscles have a point inside an element, or no forces.
    SceneError
        A parameter is out of range.
    """
    connectivity = tongue["connectivity"].values
    wedge = is_wedge(connectivity)
    if wedge[:-1][~wedge[1:]].any():
        raise TongueError("a wedge precedes a hexahedron, expected all hexahedra first")
    blocks = {"hex8": connectivity[~wedge], "wedge6": connectivity[wedge, :6]}
    mesh = sim.mesh_from_arrays(
        tongue["position"].values, **{k: v for k, v in blocks.items() if len(v)}
    )
    names = tuple(map(str, tongue["muscle"].values))
    rows = tongue["bundle_index"].values, tongue["bundle_muscle"].values.astype(np.int64)
    weight = tongue["bundle_weight"].values if "bundle_weight" in tongue else None
    tissue = sim.Solid((_material(p),))
    terms: list[Term] = []
    numbers, points = _numbers(tongue, before)
    if p.muscles == "elements":
        law = sim.Blemker(p.sigma_max, p.stretch_opt, p.lambda_star)
        fibres = sim.Muscles(names, *rows, tongue["bundle_direction"].values, law, weight)
        terms.append(sim.Solid(tissue.materials, muscles=fibres))
        terms += _outside_lines(tongue, numbers, p)
    else:
        terms += [tissue, _lines(tongue, numbers)]
    soft = p.law == "mooney_rivlin"
    if soft:
        terms.append(sim.ElementVolume(p.kappa))
    if p.stiffening > 1.0:
        kappa = p.kappa if soft else None
        terms.append(sim.Stiffening(names, *rows, tissue, p.stiffening, weight, kappa))
    return TonguePart(
        mesh,
        tuple(terms),
        DAMPING_BY_STIFFNESS[p.damping_tangent](p.alpha, p.beta) if p.alpha or p.beta else None,
        (sim.HardElementVolume(),) if p.incompressibility == "hard" else (),
        _attachments(tongue, before, numbers),
        points,
    )


def tongue_scene(
    tongue: xr.Dataset,
    p: TongueParameters,
    *,
    paths: Mapping[str, NodeMotion] | None = None,
) -> sim.Scene:
    """Scene of a tongue on bodies that stay, or whose nodes have prescribed positions.

    Parameters
    ----------
    tongue : xarray.Dataset
        A tongue_model.
    p : TongueParameters
    paths : mapping, optional
        Positions over time of the nodes that follow a body, in the order of `attached_nodes`.

    Raises
    ------
    TongueError, SceneError
        As `tongue_part`, or a path is given for a body without nodes.
    """
    part, paths = tongue_part(tongue, p), paths or {}
    nodes = attached_nodes(tongue)
    for body in paths:
        if body not in nodes:
            raise TongueError(f"no node follows {body!r}, expected one of {', '.join(nodes)}")
    members: list[Member] = [sim.PrescribedNodes(nodes[b], path) for b, path in paths.items()]
    still = [fixed for body, fixed in part.attached.items() if body not in paths]
    if still:
        members.append(sim.Fixed(np.concatenate(still)))
    terms = (*part.terms, sim.Gravity(GRAVITY)) if p.gravity else part.terms
    return sim.Scene(
        part.mesh, terms, tuple(members), part.damping, part.constraints, points=part.points
    )


def tongue_activation(tongue: xr.Dataset, system: sim.System, values: Floats) -> Floats:
    """Activation (time, muscles of the scene) from that of the muscles of a tongue (time, muscle).

    Muscles of the scene that are not of the tongue are not active.
    """
    column = {str(m): k for k, m in enumerate(tongue["muscle"].values)}
    own = [column.get(name.removesuffix(LINE_ENDING), -1) for name in system.muscles]
    padded = np.concatenate([values, np.zeros((len(values), 1))], axis=1)
    return padded[:, own]


def segment_forces(tongue: xr.Dataset) -> Floats:
    """Largest force of the segment after every fibre point [N], 0 after the last of a fibre.

    F_s = F_max v_s / (sum over the fibres of the muscle of the largest v), with the volume v_s of the
    muscle's elements that contain both ends, or else the mean volume of its elements at the first end
    that has any. Source: the published program (ArtiSynth Models, tongue).
    """
    connectivity = tongue["connectivity"].values
    volume = element_quality(tongue["position"].values, connectivity).volume
    node, fibre = tongue["fibre_node"].values, tongue["fibre_of_point"].values
    muscle, force = tongue["fibre_muscle"].values, tongue["muscle_force_max"].values
    forces = np.zeros(len(node))
    for m in range(tongue.sizes["muscle"]):
        at: dict[int, set[int]] = {}
        for e in tongue["bundle_index"].values[tongue["bundle_muscle"].values == m].tolist():
            for n in connectivity[e].tolist():
                at.setdefault(n, set()).add(e)
        largest = 0.0
        for f in np.flatnonzero(muscle == m):
            points = np.flatnonzero(fibre == f)
            for a, b in zip(points[:-1], points[1:], strict=True):
                first, second = (at.get(int(node[k]), set[int]()) for k in (a, b))
                both = sorted(first & second)
                either = sorted(first or second)
                if both:
                    forces[a] = volume[both].sum()
                elif either:
                    forces[a] = volume[either].mean()
            largest += forces[points].max()
        own = np.isin(fibre, np.flatnonzero(muscle == m))
        if not largest > 0.0:
            raise TongueError(
                f"no fibre of {tongue['muscle'].values[m]} passes along its elements: expected fibres "
                "along edges, or muscles = 'elements'"
            )
        forces[own] *= force[m] / largest
    return forces


def _material(p: TongueParameters) -> sim.Material:
    if p.law == "linear":
        return sim.Material(sim.CoRotational(p.young, p.poisson), density=p.density)
    return sim.Material(sim.MooneyRivlin(p.C10, p.C20), sim.QuadraticBulk(0.0), p.density)


def _numbers(tongue: xr.Dataset, before: int) -> tuple[Indices, Floats]:
    """Number in the scene of every fibre point, and the distinct positions of those outside the mesh."""
    node, outside = tongue["fibre_node"].values.astype(np.int64), tongue["fibre_body"].values >= 0
    X = tongue["fibre_position"].values
    points, index = np.unique(X[outside], axis=0, return_inverse=True)
    node[outside] = tongue.sizes["node"] + index.ravel()
    return np.where(node < 0, node, node + before), points


def _attachments(tongue: xr.Dataset, before: int, numbers: Indices) -> dict[str, Indices]:
    attached = {body: nodes + before for body, nodes in attached_nodes(tongue).items()}
    names = [str(b) for b in tongue["body"].values]
    for k, body in enumerate(names):
        on = np.unique(numbers[tongue["fibre_body"].values == k])
        if len(on):
            attached[body] = np.concatenate([attached.get(body, on[:0]), on])
    return attached


def _segments(tongue: xr.Dataset, numbers: Indices, share: Floats) -> list[sim.LineFibre]:
    """One line per segment with a share of the force."""
    fibre = tongue["fibre_of_point"].values
    chosen = np.flatnonzero((fibre[1:] == fibre[:-1]) & (share[:-1] > 0.0))
    if (numbers[[*chosen, *(chosen + 1)]] < 0).any():
        raise TongueError(
            "a fibre has points inside elements, expected nodes and points on bodies: use muscles = "
            "'elements'"
        )
    muscle = tongue["fibre_muscle"].values[fibre]
    return [sim.LineFibre(int(muscle[k]), numbers[[k, k + 1]], float(share[k])) for k in chosen]


def _lines(tongue: xr.Dataset, numbers: Indices) -> sim.LineMuscles:
    names = tuple(map(str, tongue["muscle"].values))
    fibres = _segments(tongue, numbers, segment_forces(tongue))
    return sim.LineMuscles(names, fibres, sim.ConstantForce(1.0))


def _outside_lines(tongue: xr.Dataset, numbers: Indices, p: TongueParameters) -> list[Term]:
    """Lines of the muscles that leave the mesh, whose element fibres end at its surface."""
    fibre, muscle = tongue["fibre_of_point"].values, tongue["fibre_muscle"].values
    leaving = np.unique(muscle[fibre[tongue["fibre_body"].values >= 0]])
    if not len(leaving) or not p.outside_force:
        return []
    share = np.where(np.isin(muscle[fibre], leaving), p.outside_force, 0.0)
    names = tuple(f"{tongue['muscle'].values[m]}{LINE_ENDING}" for m in leaving)
    rank = {int(m): k for k, m in enumerate(leaving)}
    fibres = [
        sim.LineFibre(rank[line.muscle], line.points, line.share)
        for line in _segments(tongue, numbers, share)
    ]
    return [sim.LineMuscles(names, fibres, sim.ConstantForce(1.0))]
