"""Inverse simulation: activations of muscles from motion, with and without measured activations."""

from sim.inverse.active_forces import ActiveForces, require_affine
from sim.inverse.force_targets import ContactForceTarget, ForceTarget, RowForceTarget
from sim.inverse.linear_targets import Linearised, LinearTargets, Quadratic
from sim.inverse.objective import MeasuredActivation, Weights
from sim.inverse.quadratic import Minimum, minimise_in_box
from sim.inverse.quasi_static import equilibria
from sim.inverse.response import Response, equilibrium_response, step_response
from sim.inverse.sensitivities import linearise
from sim.inverse.shape_targets import AreaTarget, SeparationTarget
from sim.inverse.splines import Splines, ends_of_steps
from sim.inverse.targets import PointTarget, Target, Together
from sim.inverse.track import track
from sim.inverse.trajectory import Fit, fit

__all__ = [
    "ActiveForces",
    "AreaTarget",
    "ContactForceTarget",
    "Fit",
    "ForceTarget",
    "LinearTargets",
    "Linearised",
    "MeasuredActivation",
    "Minimum",
    "PointTarget",
    "Quadratic",
    "Response",
    "RowForceTarget",
    "SeparationTarget",
    "Splines",
    "Target",
    "Together",
    "Weights",
    "ends_of_steps",
    "equilibria",
    "equilibrium_response",
    "fit",
    "linearise",
    "minimise_in_box",
    "require_affine",
    "step_response",
    "track",
]
