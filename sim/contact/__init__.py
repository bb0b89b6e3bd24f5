"""Contact: surfaces, search, distance, then rows of a constraint or a potential."""

from sim.contact.barrier import BarrierContact
from sim.contact.surfaces import NodeSurface, Pairing, RigidShell, boundary_surface

__all__ = ["BarrierContact", "NodeSurface", "Pairing", "RigidShell", "boundary_surface"]
