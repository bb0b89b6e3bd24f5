"""Contact of a face as a part of its scene."""

import numpy as np
import xarray as xr

from emgface.face.contact_parameters import ContactParameters
from emgface.face.lips import exposed, lining, lip_surface
from emgface.face.parts import LIPS, MANDIBLE, arches_of
from sim.contact import BarrierContact, ConstraintContact, NodeSurface, Pairing, RigidShell
from sim.scene import Term


def contact_pairings(face: xr.Dataset, contact: ContactParameters) -> tuple[Pairing, ...]:
    """Return the pairs of surfaces of a face that may touch.

    Parameters
    ----------
    face : Dataset
        Face model.
    contact : ContactParameters
        Its method and what touches what.

    Returns
    -------
    tuple of Pairing
        Upper on lower lip, closed for 'constraint', which distinguishes inside and outside, and
        without what runs through the tissue for 'barrier'; the lining of the mouth on each bone.

    Raises
    ------
    FaceError
        As `emgface.face.lips.lip_surface` and `emgface.face.lips.lining`.
    ContactFailure
        A surface is unfit, see `sim.contact`.
    """
    pairings: list[Pairing] = []
    if "lips" in contact.between:
        lips = [lip_surface(face, lip) for lip in LIPS]
        if contact.method == "barrier":
            lips = [lip[exposed(face, lip)] for lip in lips]
        upper, lower = (
            NodeSurface(lip, f"{name} lip") for name, lip in zip(LIPS, lips, strict=True)
        )
        pairings.append(Pairing(upper, lower))
    if "teeth" in contact.between:
        soft = NodeSurface(lining(face), "lining of the mouth")
        for arch in arches_of(face):
            name = "mandible" if arch.bone == MANDIBLE else "maxilla"
            pairings.append(
                Pairing(soft, RigidShell(arch.points, arch.triangles.astype(np.int64), name))
            )
    return tuple(pairings)


def contact_term(face: xr.Dataset, contact: ContactParameters) -> Term:
    """Contact term of the scene of a face; arguments and errors as in `contact_pairings`."""
    pairings = contact_pairings(face, contact)
    return METHODS[contact.method](pairings, contact)


def _constraint(pairings: tuple[Pairing, ...], contact: ContactParameters) -> Term:
    return ConstraintContact(
        pairings,
        friction=contact.friction,
        initial_penetration=contact.initial_penetration,
        removal_speed=contact.removal_speed,
    )


def _barrier(pairings: tuple[Pairing, ...], contact: ContactParameters) -> Term:
    return BarrierContact(pairings, friction=contact.friction)


METHODS = {"constraint": _constraint, "barrier": _barrier}
"""Part of the scene by the name of the method."""
