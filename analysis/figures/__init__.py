"""Figures of a study. Every one says whether its recordings were measured or simulated."""

from analysis.figures.activations import activation_heat_map, feature_boxes
from analysis.figures.alignment import marker_traces, synchronisation
from analysis.figures.baselines import baseline_plot
from analysis.figures.boxes import box_plots
from analysis.figures.choices import sensitivity_plot
from analysis.figures.contact import opening_over_time
from analysis.figures.cost import cost_of_parts
from analysis.figures.emg import emg_with_features
from analysis.figures.faces import rendered_faces
from analysis.figures.growth import growth
from analysis.figures.stability import limits_table, stability_table
from analysis.figures.start import first_results
from analysis.figures.style import save
from analysis.figures.work_precision import error_control, work_precision

__all__ = [
    "activation_heat_map",
    "baseline_plot",
    "box_plots",
    "cost_of_parts",
    "emg_with_features",
    "error_control",
    "feature_boxes",
    "first_results",
    "growth",
    "limits_table",
    "marker_traces",
    "opening_over_time",
    "rendered_faces",
    "save",
    "sensitivity_plot",
    "stability_table",
    "synchronisation",
    "work_precision",
]
