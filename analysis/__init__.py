"""Comparison of measured and simulated trajectories: alignment, scores, cubes, inference.

All functions take and return labelled xarray objects. Figures are in `analysis.figures` and further
tests in `analysis.statistics`; the first imports matplotlib.
"""

from analysis.align import align
from analysis.axes import combine_cubes, reference_cube
from analysis.baselines import ceiling_of, skill_of, template_correlation, unexplained
from analysis.components import principal_component
from analysis.cube import build_cube
from analysis.descriptives import descriptives
from analysis.errors import (
    AlignmentError,
    AnalysisError,
    CubeError,
    FigureError,
    StatisticsError,
    TrajectoryError,
)
from analysis.flags import flags_of
from analysis.individual import asymmetry, within_instruction
from analysis.listing import counts, trials
from analysis.noise import attenuation, marker_noise
from analysis.registration import mean_motion, registered
from analysis.scores import amplitude_ratio, correlation_3d, rmse, score, undefined_reason
from analysis.sensitivity import sensitivity
from analysis.statistics import conclusions, statistics_table, study_statistics
from analysis.tables import Table, descriptive_table, report_tables, trial_table
from analysis.trial import Trial

__all__ = [
    "AlignmentError",
    "AnalysisError",
    "CubeError",
    "FigureError",
    "StatisticsError",
    "Table",
    "TrajectoryError",
    "Trial",
    "align",
    "amplitude_ratio",
    "asymmetry",
    "attenuation",
    "build_cube",
    "ceiling_of",
    "combine_cubes",
    "conclusions",
    "correlation_3d",
    "counts",
    "descriptive_table",
    "descriptives",
    "flags_of",
    "marker_noise",
    "mean_motion",
    "principal_component",
    "reference_cube",
    "registered",
    "report_tables",
    "rmse",
    "score",
    "sensitivity",
    "skill_of",
    "statistics_table",
    "study_statistics",
    "template_correlation",
    "trial_table",
    "trials",
    "undefined_reason",
    "unexplained",
    "within_instruction",
]
