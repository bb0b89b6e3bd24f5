"""Figures of a study, each labelled as measured or simulated."""

from analysis.figures.activations import activation_heat_map, difference_map, feature_boxes
from analysis.figures.alignment import marker_traces, synchronisation
from analysis.figures.baselines import baseline_plot
from analysis.figures.boxes import box_plots
from analysis.figures.choices import sensitivity_plot
from analysis.figures.emg import emg_with_features
from analysis.figures.formants import formant_plot
from analysis.figures.style import save

__all__ = [
    "activation_heat_map",
    "baseline_plot",
    "box_plots",
    "difference_map",
    "emg_with_features",
    "feature_boxes",
    "formant_plot",
    "marker_traces",
    "save",
    "sensitivity_plot",
    "synchronisation",
]
