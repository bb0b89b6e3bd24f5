"""Contact: surfaces, search, distance, and constraints."""

from sim.contact.constraint import ConstraintContact
from sim.contact.surfaces import NodeSurface, Pairing, RigidShell, body_surfaces, boundary_surface

__all__ = [
    "ConstraintContact",
    "NodeSurface",
    "Pairing",
    "RigidShell",
    "body_surfaces",
    "boundary_surface",
]
