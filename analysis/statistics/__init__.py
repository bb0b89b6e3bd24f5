"""Inference on a cube: tests and intervals whose unit is the volunteer.

`study_statistics` applies all of them. Each test takes a `Comparison` (`compare`) and returns the
dataset described in `finding.collected`; an option outside its range raises `StatisticsError`.
"""

from analysis.statistics.summary import conclusions, statistics_table, study_statistics

__all__ = ["conclusions", "statistics_table", "study_statistics"]
