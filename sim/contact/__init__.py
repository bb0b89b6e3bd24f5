"""Contact: surfaces, search, distance, then rows of a constraint or a potential."""

from sim.contact.barrier import BarrierContact
from sim.contact.constraint import ConstraintContact
from sim.contact.surfaces import NodeSurface, Pairing, RigidShell, boundary_surface

CONTACTS: tuple[type[ConstraintContact] | type[BarrierContact], ...] = (
    ConstraintContact,
    BarrierContact,
)
"""Every method of contact; the tests of closed forms walk this tuple."""

__all__ = [
    "CONTACTS",
    "BarrierContact",
    "ConstraintContact",
    "NodeSurface",
    "Pairing",
    "RigidShell",
    "boundary_surface",
]
