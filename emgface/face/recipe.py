"""Scene of a face model and its parameters."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr
from numpy.typing import NDArray

import sim
from emgface.face.bundles import project_into_mesh
from emgface.face.check import sheet_nodes
from emgface.face.contact import contact_terms
from emgface.face.parts import INNER, OUTER
from emgface.face.quality import is_wedge
from emgface.face.simulation_parameters import SimulationParameters
from emgface.face.support import inner_support
from emgface.face.tension_lines import skin_prestretch
from emgface.face.tissue import material_axes
from emgface.face.treated import check_treated, stiffened, strengthened, stress_free
from sim.laws import BulkLaw
from sim.scene import Term
from sim.terms import Gravity

GRAVITY = (0.0, 0.0, -9.8)  #: acceleration [m/s^2] (Eskes et al. 2017)

EMBEDDING_TOLERANCE = 0.02
"""Tolerance for fibre points outside an element, as a negative shape function [1]."""

DAMPING_BY_STIFFNESS = {
    "current": sim.Rayleigh,
    "passive": sim.PassiveRayleigh,
    "rest": sim.RestRayleigh,
}
"""Damping law by its stiffness."""


@dataclass(frozen=True)
class ElementOrder:
    """Numbering of the elements of a face in the scene: hexahedra first, then wedges.

    `face_index` maps elements of the scene to the face, `scene_index` those of the face to the
    scene.
    """

    face_index: NDArray[np.int64]
    scene_index: NDArray[np.int64]


def element_order(face: xr.Dataset) -> ElementOrder:
    """Order the elements of a face by type."""
    wedge = is_wedge(face["connectivity"].values)
    face_index = np.concatenate([np.flatnonzero(~wedge), np.flatnonzero(wedge)])
    scene_index = np.empty_like(face_index)
    scene_index[face_index] = np.arange(len(face_index))
    return ElementOrder(face_index, scene_index)


def compose_scene(face: xr.Dataset, parameters: SimulationParameters) -> sim.Scene:
    """Declare the scene of a face: tissue with muscles, gravity, damping, fixed nodes, contact."""
    p = parameters
    check_treated(face, p)
    order = element_order(face)
    materials, region = _tissue(face, order, p)
    muscles = _element_muscles(face, order, p)
    pointwise = p.incompressibility == "pointwise"
    solid = sim.Solid(
        materials=materials if pointwise else tuple(map(_without_bulk, materials)),
        region=region,
        muscles=muscles if p.muscle_form == "elements" else None,
        prestretch=_prestretch(face, order, p, materials, region),
        stress_free=stress_free(face, order, p),
        axes=(
            material_axes(face)[order.face_index] if any(m.needs_axes for m in materials) else None
        ),
    )
    terms: list[Term] = [solid]
    if p.muscle_form == "lines":
        terms.append(_line_muscles(face, p))
    if p.stiffening > 1.0:
        tissue = replace(solid, materials=materials, muscles=None)
        rows = muscles.names, muscles.element, muscles.muscle
        terms.append(sim.Stiffening(*rows, tissue, p.stiffening, muscles.weight))
    if p.incompressibility == "element":
        terms.append(sim.ElementVolume(_kappa(materials, region), solid.stress_free))
    elif p.incompressibility == "nodal":
        terms.append(sim.NodalVolume(_kappa(materials, region), stress_free=solid.stress_free))
    if p.support > 0.0:
        terms.append(inner_support(face, p.support))
    terms.extend(contact_terms(face, p))
    if p.gravity:
        terms.append(Gravity(GRAVITY))
    damping = (
        DAMPING_BY_STIFFNESS[p.damping_tangent](p.alpha, p.beta) if p.alpha or p.beta else None
    )
    fixed = np.flatnonzero(face["fixed"].values)
    return sim.Scene(
        mesh=_mesh(face, p),
        terms=tuple(terms),
        reductions=(sim.Fixed(fixed),),
        damping=damping,
        constraints=(sim.HardElementVolume(),) if p.incompressibility == "hard" else (),
    )


def displacement_scene(face: xr.Dataset, parameters: SimulationParameters) -> sim.Scene:
    """Scene of the first step of a prestress by displaced nodes, with a fixed inner surface."""
    scene = compose_scene(face, parameters)
    inner = sim.Fixed(sheet_nodes(face, INNER))
    return replace(scene, reductions=(*scene.reductions, inner))


def _mesh(face: xr.Dataset, p: SimulationParameters) -> sim.Mesh:
    """Mesh at rest, with a shrunk inner surface for a prestress by displaced nodes."""
    connectivity = face["connectivity"].values
    wedge = is_wedge(connectivity)
    blocks = {"hex8": connectivity[~wedge], "wedge6": connectivity[wedge, :6]}
    position = face["position"].values.copy()
    if p.prestress.method == "displaced":
        inner = sheet_nodes(face, INNER)
        middle = 0.5 * (position.min(axis=0) + position.max(axis=0))
        middle[1] = position[:, 1].min()  # centre of the head instead of the face
        position[inner] = middle + p.prestress.scale * (position[inner] - middle)
    return sim.mesh_from_arrays(
        position, **{kind: nodes for kind, nodes in blocks.items() if len(nodes)}
    )


def _bulk(p: SimulationParameters, kappa: float) -> BulkLaw:
    return (
        sim.LogarithmicBulk(kappa)
        if p.bulk_potential == "logarithmic"
        else sim.QuadraticBulk(kappa)
    )


def _tissue(
    face: xr.Dataset, order: ElementOrder, p: SimulationParameters
) -> tuple[tuple[sim.Material, ...], NDArray[np.int64] | None]:
    """Materials with their bulk laws, and the index of that of each element of the scene."""
    tissue = sim.Material(sim.MooneyRivlin(p.C10, p.C20), _bulk(p, p.kappa), density=p.density)
    skin = sim.Material(
        sim.MooneyRivlin(p.skin.stiffness * p.C10, p.skin.stiffness * p.C20),
        tissue.bulk if p.skin.kappa is None else _bulk(p, p.skin.kappa),
        density=p.density,
    )
    materials, region = [tissue], np.zeros(len(order.face_index), dtype=np.int64)
    if skin != tissue:
        materials.append(skin)
        region[face["layer"].values == OUTER] = 1
    for own in p.tissues:
        bulk = tissue.bulk if own.kappa is None else _bulk(p, own.kappa)
        region[own.chosen(face)] = len(materials)
        materials.append(own.material(bulk, p.density))
    if "tissue_factor" in face:
        materials, region = stiffened(materials, region, face["tissue_factor"].values)
    return tuple(materials), None if len(materials) == 1 else region[order.face_index]


def _without_bulk(material: sim.Material) -> sim.Material:
    """Remove the bulk law if a term or a constraint determines the volume."""
    return material if material.bulk is None else replace(material, bulk=sim.QuadraticBulk(0.0))


def _kappa(
    materials: tuple[sim.Material, ...], region: NDArray[np.int64] | None
) -> float | NDArray[np.float64]:
    """Bulk modulus of every element, or one number if all are equal [Pa]."""
    values = np.array([m.kappa for m in materials])
    return float(values[0]) if region is None else values[region]


def _element_muscles(face: xr.Dataset, order: ElementOrder, p: SimulationParameters) -> sim.Muscles:
    """Return muscles as active stress in elements."""
    if p.fibre_law == "blemker":
        law = sim.Blemker(sigma_max=p.sigma_max, stretch_star=p.lambda_star, P1=p.P1, P2=p.P2)
    else:
        law = sim.Generic(sigma_max=p.sigma_max, stretch_star=p.lambda_star, P1=p.P1, P2=p.P2)
    names = tuple(map(str, face["muscle"].values))
    return sim.Muscles(
        names=names,
        element=order.scene_index[face["bundle_index"].values],
        muscle=face["bundle_muscle"].values.astype(np.int64),
        direction=face["bundle_direction"].values,
        law=strengthened(law, face["muscle_strength"].values) if "muscle_strength" in face else law,
        weight=face["bundle_weight"].values if "bundle_weight" in face else None,
    )


def _line_muscles(face: xr.Dataset, p: SimulationParameters) -> sim.LineMuscles:
    """Return muscles as tension along their fibre lines, embedded in the elements."""
    owner = face["fibre_of_point"].values
    points, _ = project_into_mesh(
        face["fibre_position"].values, face["position"].values, face["connectivity"].values
    )
    fibres = [
        sim.LineFibre(int(muscle), points[owner == k])
        for k, muscle in enumerate(face["fibre_muscle"].values)
    ]
    names = tuple(map(str, face["muscle"].values))
    return sim.LineMuscles(
        names, fibres, sim.ConstantForce(p.line_force), tolerance=EMBEDDING_TOLERANCE
    )


def _prestretch(
    face: xr.Dataset,
    order: ElementOrder,
    p: SimulationParameters,
    materials: tuple[sim.Material, ...],
    region: NDArray[np.int64] | None,
) -> NDArray[np.float64] | None:
    """Initial stretch of every element of the scene, for the most frequent tissue of the skin."""
    if p.prestress.method != "stretch":
        return None
    outer = face["layer"].values[order.face_index] == OUTER
    skin = materials[0 if region is None else int(np.bincount(region[outer]).argmax())]
    stretches = sim.initial_stretch(skin, (p.prestress.along, p.prestress.across, 0.0))
    return skin_prestretch(face, stretches)[order.face_index]


@contextmanager
def named_elements(face: xr.Dataset) -> Iterator[None]:
    """Replace the index of an inverted element in the scene by its id in the face model."""
    try:
        yield
    except sim.InvertedElement as error:
        if error.element < 0:
            raise
        index = element_order(face).face_index[error.element]
        name = int(face["element_id"].values[index])
        raise sim.InvertedElement(name, error.det_F, error.time) from error
