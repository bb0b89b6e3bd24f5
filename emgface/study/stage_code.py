"""Stages of one trial, each with the modules that compute its results."""

from emgface.run.mechanics import HEAD_MECHANICS, MECHANICS
from emgface.run.store import Stage

_FINDINGS = "emgface.recordings.repeated"
"""Module of the findings that results repeat."""

RANGE = Stage("range", ("emgface.signals.activation", "emgface.signals.truth", _FINDINGS))
ACTIVATION = Stage("activation", RANGE.modules)
REST = Stage("rest", MECHANICS)
MOTION = Stage("motion", (*MECHANICS, "emgface.face.sigma_max"))
MOTION_OF_HEAD = Stage("motion", (*HEAD_MECHANICS, "emgface.face.sigma_max"))
ACTIVATION_OF_HEAD = Stage("activation", (*ACTIVATION.modules, "emgface.anatomy.head.recorded"))
ALIGNED = Stage("aligned", ("analysis.align", "emgface.face.measured"))
SCORES = Stage("scores", ("analysis.flags", "analysis.noise", "analysis.scores", _FINDINGS))
SCORES_OF_HEAD = Stage(
    "scores",
    (
        *SCORES.modules,
        *ALIGNED.modules,
        "emgface.anatomy.head.incisor",
        "emgface.anatomy.head.recorded",
    ),
)
INVERSE = Stage("inverse", ("emgface.inverse.run", "emgface.inverse.strategy", _FINDINGS))
STAGES = (RANGE, ACTIVATION, REST, MOTION, ALIGNED, SCORES)
