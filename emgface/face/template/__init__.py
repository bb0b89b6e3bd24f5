"""Parametric lower face: measures, presets and random volunteers, at any resolution."""

from emgface.face.template.arches import dental_arches
from emgface.face.template.build import template_face, volunteer_face
from emgface.face.template.measures import Measures, parse_measures
from emgface.face.template.norms import norms_table
from emgface.face.template.volunteers import GROUP_PRESETS, preset_measures, random_measures

__all__ = [
    "GROUP_PRESETS",
    "Measures",
    "dental_arches",
    "norms_table",
    "parse_measures",
    "preset_measures",
    "random_measures",
    "template_face",
    "volunteer_face",
]
