"""Inference on a cube: tests and intervals whose unit is the volunteer.

`study_statistics` runs them all; the single tests are in the modules of this package.
"""

from analysis.statistics.summary import conclusions, statistics_table, study_statistics

__all__ = ["conclusions", "statistics_table", "study_statistics"]
