"""Contact of a face as a part of its scene."""

import numpy as np
import xarray as xr

from emgface.face.lip_shape import has_mouth
from emgface.face.lips import lining, lip_surface
from emgface.face.parts import LIPS, MANDIBLE, arches_of
from emgface.face.simulation_parameters import SimulationParameters
from sim.contact import ConstraintContact, NodeSurface, Pairing, RigidShell
from sim.scene import Term

EDGE_POINTS = 3
"""Number of points on each edge of the margins of the lips that may touch teeth, about 1 mm apart on the
coarse face: an edge would otherwise lose its support once a vertex of a tooth slides off it."""


def touching(face: xr.Dataset, parameters: SimulationParameters) -> tuple[str, ...]:
    """Return the surfaces in contact, "lips" and "teeth": as specified, or those of the face.

    If walls behind the inner sheet represent the teeth (`support`), those of the face are omitted.
    """
    contact = parameters.contact
    if contact.method == "none":
        return ()
    if contact.between is not None:
        return contact.between
    lips = ("lips",) if "lip_triangle" in face or has_mouth(face) else ()
    teeth = ("teeth",) if arches_of(face) and parameters.support == 0.0 else ()
    return (*lips, *teeth)


def contact_pairings(
    face: xr.Dataset, between: tuple[str, ...] = ("lips", "teeth")
) -> tuple[Pairing, ...]:
    """Pair the surfaces of a face that may touch.

    The pairings are upper on lower lip, and the lining of the mouth on each bone. The lips are closed
    surfaces, because constraints distinguish inside and outside. Raises FaceError as
    `emgface.face.lips.lip_surface` and `emgface.face.lips.lining`, and ContactFailure if a surface
    is not valid (`sim.contact`).
    """
    pairings: list[Pairing] = []
    if "lips" in between:
        lips = [lip_surface(face, lip) for lip in LIPS]
        upper, lower = (
            NodeSurface(lip, f"{name} lip") for name, lip in zip(LIPS, lips, strict=True)
        )
        pairings.append(Pairing(upper, lower))
    if "teeth" in between:
        soft = NodeSurface(lining(face), "lining of the mouth")
        for arch in arches_of(face):
            name = "mandible" if arch.bone == MANDIBLE else "maxilla"
            pairings.append(
                Pairing(soft, RigidShell(arch.points, arch.triangles.astype(np.int64), name))
            )
    return tuple(pairings)


def contact_terms(face: xr.Dataset, parameters: SimulationParameters) -> tuple[Term, ...]:
    """Contact terms of the scene of a face, if any; errors as of `contact_pairings`."""
    between = touching(face, parameters)
    if not between:
        return ()
    return (declared_contact(contact_pairings(face, between), parameters),)


def declared_contact(pairings: tuple[Pairing, ...], parameters: SimulationParameters) -> Term:
    """Contact of some pairings with the chosen parameters."""
    contact = parameters.contact
    return ConstraintContact(
        pairings,
        friction=contact.friction,
        initial_penetration=contact.initial_penetration,
        removal_speed=contact.removal_speed,
        edge_points=EDGE_POINTS,
        renewals=contact.renewals_with(parameters.solver),
    )
