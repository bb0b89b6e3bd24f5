"""Inverse simulation: activations of muscles from motion, with and without measured activations."""

from sim.inverse.posterior import Posterior, in_words, laplace
from sim.inverse.quadratic import Minimum, minimise_in_box
from sim.inverse.response import (
    ActiveForces,
    Response,
    equilibrium_response,
    require_affine,
    step_response,
)
from sim.inverse.targets import PointTarget, Target, Together
from sim.inverse.track import MeasuredActivation, Weights, track
from sim.inverse.trajectory import (
    Fit,
    Linearised,
    Quadratic,
    Splines,
    ends_of_steps,
    fit,
    linearise,
    prior,
)

__all__ = [
    "ActiveForces",
    "Fit",
    "Linearised",
    "MeasuredActivation",
    "Minimum",
    "PointTarget",
    "Posterior",
    "Quadratic",
    "Response",
    "Splines",
    "Target",
    "Together",
    "Weights",
    "ends_of_steps",
    "equilibrium_response",
    "fit",
    "in_words",
    "laplace",
    "linearise",
    "minimise_in_box",
    "prior",
    "require_affine",
    "step_response",
    "track",
]
