"""From a face model and its parameters to the scene that is simulated."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from emgface.face.simulation_parameters import SimulationParameters
from sim import (
    Blemker,
    ElementVolume,
    Fixed,
    Generic,
    InvertedElement,
    LogarithmicBulk,
    Material,
    MooneyRivlin,
    Muscles,
    NodalVolume,
    PassiveRayleigh,
    QuadraticBulk,
    Rayleigh,
    RestRayleigh,
    Scene,
    Solid,
    mesh_from_arrays,
)
from sim.scene import Term
from sim.terms import Gravity

GRAVITY = (0.0, 0.0, -9.8)
"""Acceleration [m/s^2] (Eskes et al. 2017)."""

DAMPING = {"current": Rayleigh, "passive": PassiveRayleigh, "rest": RestRayleigh}
"""Damping law by the stiffness it takes."""


@dataclass(frozen=True)
class ElementOrder:
    """How the elements of a face are numbered in the scene: hexahedra first, then wedges.

    Attributes
    ----------
    face_index : array of int, shape (n_elements,)
        Element of the face at each place of the scene.
    scene_index : array of int, shape (n_elements,)
        Place in the scene of each element of the face.
    """

    face_index: NDArray[np.int64]
    scene_index: NDArray[np.int64]


def element_order(face: xr.Dataset) -> ElementOrder:
    """Order the elements of a face by type.

    Parameters
    ----------
    face : Dataset
        Face model.

    Returns
    -------
    ElementOrder
    """
    wedge = face["connectivity"].values[:, -1] < 0
    face_index = np.concatenate([np.flatnonzero(~wedge), np.flatnonzero(wedge)])
    scene_index = np.empty_like(face_index)
    scene_index[face_index] = np.arange(len(face_index))
    return ElementOrder(face_index, scene_index)


def compose_scene(face: xr.Dataset, parameters: SimulationParameters) -> Scene:
    """Declare the scene of a face: tissue with muscles, gravity, damping, fixed nodes.

    Parameters
    ----------
    face : Dataset
        Face model.
    parameters : SimulationParameters
        Laws and loads.

    Returns
    -------
    Scene
    """
    connectivity = face["connectivity"].values
    wedge = connectivity[:, -1] < 0
    blocks = {"hex8": connectivity[~wedge], "wedge6": connectivity[wedge, :6]}
    mesh = mesh_from_arrays(
        face["position"].values, **{kind: nodes for kind, nodes in blocks.items() if len(nodes)}
    )
    p = parameters
    if p.fibre_law == "blemker":
        law = Blemker(sigma_max=p.sigma_max, stretch_star=p.lambda_star, P1=p.P1, P2=p.P2)
    else:
        law = Generic(sigma_max=p.sigma_max, stretch_star=p.lambda_star, P1=p.P1, P2=p.P2)
    pointwise = p.kappa if p.incompressibility == "pointwise" else 0.0
    logarithmic = p.bulk_potential == "logarithmic"
    bulk = LogarithmicBulk(pointwise) if logarithmic else QuadraticBulk(pointwise)
    order = element_order(face)
    muscles = Muscles(
        names=tuple(map(str, face["muscle"].values)),
        element=order.scene_index[face["bundle_index"].values],
        muscle=face["bundle_muscle"].values.astype(np.int64),
        direction=face["bundle_direction"].values,
        law=law,
        weight=face["bundle_weight"].values if "bundle_weight" in face else None,
    )
    tissue = Material(MooneyRivlin(p.C10, p.C20), bulk, density=p.density)
    solid = Solid(materials=(tissue,), muscles=muscles)
    terms: list[Term] = [solid]
    if p.incompressibility == "element":
        terms.append(ElementVolume(p.kappa))
    elif p.incompressibility == "nodal":
        terms.append(NodalVolume(p.kappa))
    if p.gravity:
        terms.append(Gravity(GRAVITY))
    damping = DAMPING[p.damping_tangent](p.alpha, p.beta) if p.alpha or p.beta else None
    fixed = np.flatnonzero(face["fixed"].values)
    return Scene(mesh=mesh, terms=tuple(terms), reductions=(Fixed(fixed),), damping=damping)


@contextmanager
def named_elements(face: xr.Dataset) -> Iterator[None]:
    """Name an inverted element by its id in the face model instead of its place in the scene."""
    try:
        yield
    except InvertedElement as error:
        if error.element < 0:
            raise
        index = element_order(face).face_index[error.element]
        name = int(face["element_id"].values[index])
        raise InvertedElement(name, error.det_F, error.time) from error
