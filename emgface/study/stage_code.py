"""Stages of one trial, each with the modules whose source determines its results."""

from emgface.run.mechanics import MECHANICS, OF_HEADS
from emgface.run.store import Stage

_SIGNALS = (
    "emgface.signals.running",
    "emgface.signals.activation",
    "emgface.signals.doubtful",
    "emgface.signals.envelope",
    "emgface.signals.features",
    "emgface.signals.mapping",
    "emgface.signals.montage",
    "emgface.signals.normalisation",
    "emgface.signals.resampling",
    "emgface.signals.filters",
    "emgface.signals.strategies",
    "emgface.signals.truth",
)
_ALIGNMENT = (
    "analysis.align",
    "analysis.arguments",
    "analysis.components",
    "analysis.lag",
    "analysis.matching",
    "analysis.noise",
    "analysis.trajectory",
    "analysis.typed",
    "emgface.recordings.finding_codes",
    "emgface.recordings.findings",
    "emgface.recordings.head",
    "emgface.signals.doubtful",
    "emgface.signals.running",
    "emgface.signals.resampling",
    "emgface.signals.filters",
    "emgface.face.measured",
    "emgface.texts",
)

_FINDINGS = (
    "emgface.recordings.check",
    "emgface.recordings.counters",
    "emgface.recordings.fillers",
    "emgface.recordings.finding_codes",
    "emgface.recordings.findings",
    "emgface.recordings.head",
    "emgface.recordings.kinds",
    "emgface.recordings.labels",
    "emgface.recordings.quality",
    "emgface.recordings.repeated",
    "emgface.recordings.trial_names",
    "emgface.recordings.verdicts",
    "emgface.schema",
    "emgface.signals.doubtful",
    "emgface.signals.running",
    "emgface.texts",
)
"""Modules of the findings that results repeat."""

RANGE = Stage("range", tuple(dict.fromkeys((*_SIGNALS, *_FINDINGS))))
ACTIVATION = Stage("activation", tuple(dict.fromkeys((*_SIGNALS, *_FINDINGS))))
REST = Stage("rest", MECHANICS)
MOTION = Stage("motion", (*MECHANICS, "emgface.face.sigma_max"))
MOTION_OF_HEAD = Stage("motion", (*OF_HEADS, "emgface.face.sigma_max"))
ACTIVATION_OF_HEAD = Stage("activation", (*ACTIVATION.modules, "emgface.anatomy"))
ALIGNED = Stage("aligned", _ALIGNMENT)
SCORES = Stage(
    "scores",
    (
        *(f"analysis.{name}" for name in ("flags", "noise", "scores", "trajectory", "typed")),
        *_FINDINGS,
        "emgface.signals.filters",
    ),
)
SCORES_OF_HEAD = Stage(
    "scores",
    (
        *dict.fromkeys((*SCORES.modules, *_ALIGNMENT)),
        "emgface.anatomy.jaw",
        "emgface.anatomy.head.incisor",
    ),
)
INVERSE = Stage(
    "inverse",
    tuple(
        dict.fromkeys(
            (
                *MECHANICS,
                *_SIGNALS,
                *_FINDINGS,
                *_ALIGNMENT,
                "emgface.inverse.assumptions",
                "emgface.inverse.calibration",
                "emgface.inverse.configuration",
                "emgface.inverse.doubts",
                "emgface.inverse.kept",
                "emgface.inverse.markers",
                "emgface.inverse.mixing",
                "emgface.inverse.parameters",
                "emgface.inverse.posterior",
                "emgface.inverse.problem",
                "emgface.inverse.refine",
                "emgface.inverse.run",
                "emgface.inverse.signals",
                "emgface.inverse.strategy",
                "emgface.inverse.variants",
                "emgface.recordings.belonging",
            )
        )
    ),
)
STAGES = (RANGE, ACTIVATION, REST, MOTION, ALIGNED, SCORES)
