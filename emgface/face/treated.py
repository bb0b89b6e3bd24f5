"""Stress-free shape, stiffness and strength of a treated face as parts of its scene.

A treated face (`emgface.treatment`) is a face_model with further variables; without them, no code of
this module changes the scene.
"""

from dataclasses import replace
from typing import Protocol

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from emgface.errors import FaceError
from emgface.face.simulation_parameters import SimulationParameters
from emgface.face.tissue import scaled
from sim import Blemker, Generic, Material
from sim._kernels.element import NODES

Floats = NDArray[np.float64]

WEAKEST = 1e-9  #: factor on the active stress that represents a paralysed muscle


class Order(Protocol):
    """Numbering of the elements of a face in the scene (`emgface.face.recipe.ElementOrder`)."""

    @property
    def face_index(self) -> NDArray[np.int64]:
        """Elements of the face in the order of the scene."""
        ...


def check_treated(face: xr.Dataset, parameters: SimulationParameters) -> None:
    """Refuse parameters that a treated face does not support, with FaceError."""
    p = parameters
    closed = "stress_free_position" in face
    for feature, refused, expected in (
        (
            f"prestress.method = {p.prestress.method!r}",
            closed and p.prestress.method != "none",
            "none",
        ),
        (
            f"incompressibility = {p.incompressibility!r}",
            closed and p.incompressibility == "hard",
            "pointwise', 'element' or 'nodal",
        ),
        (
            f"muscle_form = {p.muscle_form!r}",
            p.muscle_form != "elements" and "treatment" in face.attrs,
            "elements",
        ),
    ):
        if refused:
            raise FaceError(
                f"the face was treated, and {feature} is not implemented for a treated face, expected "
                f"'{expected}': change the parameter, or use the untreated face"
            )


def stress_free(face: xr.Dataset, order: Order, parameters: SimulationParameters) -> Floats | None:
    """Stress-free corners (elements, NODES, 3) [m] in the order of the scene; None if not treated."""
    if "stress_free_position" not in face:
        return None
    corners = face["stress_free_position"].values[order.face_index]
    return np.ascontiguousarray(corners[:, :NODES])


def stiffened(
    materials: list[Material], region: NDArray[np.int64], factor: Floats
) -> tuple[list[Material], NDArray[np.int64]]:
    """Materials times the factor of every element (elements,), and the index of that of each."""
    pairs, place = np.unique(np.stack([region, factor], axis=1), axis=0, return_inverse=True)
    scaled_materials = [scaled(materials[int(row)], float(times)) for row, times in pairs]
    return scaled_materials, place.reshape(-1).astype(np.int64)


def strengthened(law: Blemker | Generic, strength: Floats) -> tuple[Blemker | Generic, ...]:
    """Law of every muscle with its active stress times `strength` (muscles,) and its own passive one.

    The passive stress of Blemker's law is a multiple of sigma_max; P1 is divided by the factor.
    """
    laws: list[Blemker | Generic] = []
    for factor in np.maximum(strength, WEAKEST).tolist():
        own = replace(law, sigma_max=factor * law.sigma_max) if factor != 1.0 else law
        if isinstance(own, Blemker) and factor != 1.0:
            own = replace(own, P1=own.P1 / factor)
        laws.append(own)
    return tuple(laws)
