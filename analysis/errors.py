"""Typed failures of the comparison of trajectories.

Each message is one sentence: what was found, what was expected, what to try.
"""


class AnalysisError(ValueError):
    """Base of all failures of the analysis."""


class TrajectoryError(AnalysisError):
    """A trajectory cannot be used: names, units, gaps, time base, too few samples."""


class AlignmentError(AnalysisError):
    """Two trajectories cannot be aligned: one does not move, or no shift is allowed."""


class CubeError(AnalysisError):
    """Results of trials do not form a cube: unknown label, duplicate, unknown marker."""


class StatisticsError(AnalysisError):
    """A test is not possible: unknown strategy or variable, or an option outside its range."""


class FigureError(AnalysisError):
    """Data cannot be drawn: other dims or units, or nothing to draw."""
