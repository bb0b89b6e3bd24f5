"""Figures of a study. Every one says whether its recordings were measured or simulated."""

from analysis.figures.alignment import synchronisation
from analysis.figures.boxes import box_plots
from analysis.figures.style import save

__all__ = ["box_plots", "save", "synchronisation"]
