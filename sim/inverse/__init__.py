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

__all__ = [
    "ActiveForces",
    "MeasuredActivation",
    "Minimum",
    "PointTarget",
    "Posterior",
    "Response",
    "Target",
    "Together",
    "Weights",
    "equilibrium_response",
    "in_words",
    "laplace",
    "minimise_in_box",
    "require_affine",
    "step_response",
    "track",
]
