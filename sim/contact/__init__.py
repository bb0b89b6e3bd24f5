"""Contact: surfaces, search, distance, and constraints or a potential."""

from sim.contact.barrier import BarrierContact
from sim.contact.bodies import body_surfaces
from sim.contact.constraint import ConstraintContact
from sim.contact.surfaces import NodeSurface, Pairing, RigidShell, boundary_surface

CONTACTS: tuple[type[ConstraintContact] | type[BarrierContact], ...] = (
    ConstraintContact,
    BarrierContact,
)
"""All contact methods, which the tests with closed forms include."""

__all__ = [
    "CONTACTS",
    "BarrierContact",
    "ConstraintContact",
    "NodeSurface",
    "Pairing",
    "RigidShell",
    "body_surfaces",
    "boundary_surface",
]
