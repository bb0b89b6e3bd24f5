"""Reduced models of a solid: few coordinates, forces from weighted points, estimated error.

Positions are q = q0 + Phi y with modes Phi that are orthonormal in the mass. The coordinates y are the
components of points of unit mass in a scene of their own, so that the loop, integrators and step
controls of full order apply to it unchanged.
"""

from sim.reduced.basis import mass_modes, projected, static_responses
from sim.reduced.closure import Closure, fitted_closure
from sim.reduced.conformal import coverage_factor
from sim.reduced.contact import ReducedContact, near_vertices
from sim.reduced.cubature import sampled
from sim.reduced.fused import FusedEuler
from sim.reduced.model import ReducedModel, reduce_system
from sim.reduced.probes import Features, ReducedMarkers, ReductionError

__all__ = [
    "Closure",
    "Features",
    "FusedEuler",
    "ReducedContact",
    "ReducedMarkers",
    "ReducedModel",
    "ReductionError",
    "coverage_factor",
    "fitted_closure",
    "mass_modes",
    "near_vertices",
    "projected",
    "reduce_system",
    "sampled",
    "static_responses",
]
