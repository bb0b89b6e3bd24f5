"""Measures of the quality of a recording.

`emgface.recordings.check.check_recording` includes them in its table.
"""

from emgface.recordings.quality.cross_talk import cross_talk
from emgface.recordings.quality.emg import emg_quality
from emgface.recordings.quality.hum import mains_hum, remove_hum
from emgface.recordings.quality.markers import marker_quality, swapped_markers
from emgface.recordings.quality.sides import swapped_sides

__all__ = [
    "cross_talk",
    "emg_quality",
    "mains_hum",
    "marker_quality",
    "remove_hum",
    "swapped_markers",
    "swapped_sides",
]
