"""Names of muscles, channels and markers of the study, and its relevance table.

Source: Eskes et al. 2017, Methods and Table 1 (data: doi:10.17605/OSF.IO/DUX3W). Muscle index
1-10 is the left side, 11-20 the right.
"""

from typing import Final

SIDES: Final = ("L", "R")

MEASURED: Final = ("OOS", "OOI", "RIS", "ZYG", "LLSAN", "DAO", "MEN")
"""The seven muscles per side with electrodes."""

MODELLED: Final = ("ZYG", "RIS", "LLSAN", "LAO", "BUC", "OOP", "OOM", "DLI", "DAO", "MEN")
"""The ten muscles per side of the face model, in the paper's order of Fig. 1."""

NEIGHBOURS: Final = (
    ("OOS", "OOI"),
    ("OOS", "LLSAN"),
    ("OOS", "ZYG"),
    ("OOI", "DAO"),
    ("OOI", "MEN"),
    ("DAO", "MEN"),
    ("DAO", "RIS"),
    ("RIS", "ZYG"),
    ("ZYG", "LLSAN"),
)
"""Pairs of neighbouring channels of one side (Eskes et al. 2017, Fig. 1)."""

CHANNELS_AT_MIDLINE: Final = ("OOS", "OOI", "MEN")
"""Channels whose left and right electrodes are neighbours across the midline."""

MUSCLE_NAMES: Final = {
    "ZYG": "zygomaticus major",
    "RIS": "risorius",
    "LLSAN": "levator labii superioris alaeque nasi",
    "LAO": "levator anguli oris",
    "BUC": "buccinator",
    "OOP": "orbicularis oris peripheralis",
    "OOM": "orbicularis oris marginalis",
    "DLI": "depressor labii inferioris",
    "DAO": "depressor anguli oris",
    "MEN": "mentalis",
    "OOS": "orbicularis oris superior",
    "OOI": "orbicularis oris inferior",
}

CHANNELS: Final = tuple(f"{name}_{side}" for side in SIDES for name in MEASURED)
MUSCLES: Final = tuple(f"{name}_{side}" for side in SIDES for name in MODELLED)

INSTRUCTIONS: Final = {
    "A": "purse lips",
    "B": "raise upper lip",
    "C": "depress mouth corners",
    "D": "voluntary smile",
    "E": "left-right-left with closed mouth",
    "F": "purse lips, closed mouth smile, purse lips",
}
LETTERS: Final = ", ".join(f"{letter} ({what})" for letter, what in INSTRUCTIONS.items())
"""Instructions in messages: a letter alone tells nobody what it stands for."""

RELEVANT: Final = {
    "A": ("OOP", "OOM", "BUC"),
    "B": ("LLSAN",),
    "C": ("DAO", "MEN"),
    "D": ("LLSAN", "RIS", "ZYG", "LAO", "DAO", "DLI"),
    "E": ("OOP", "OOM", "LLSAN", "RIS", "ZYG", "LAO", "BUC"),
    "F": ("OOP", "OOM", "LLSAN", "RIS", "ZYG", "LAO", "BUC"),
}
"""Table 1: muscles of the strategy act_rel per instruction, both sides."""

LIP_MARKERS: Final = (
    "corner_left",
    "upper_lateral_left",
    "upper_paramedian_left",
    "upper_paramedian_right",
    "upper_lateral_right",
    "corner_right",
    "lower_lateral_left",
    "lower_paramedian_left",
    "lower_paramedian_right",
    "lower_lateral_right",
)

FACE_MARKERS: Final = (
    "forehead_left",
    "forehead_right",
    "temple_left",
    "temple_right",
    "nasion",
    "rhinion",
)
"""Six markers on skin that moves with the skull, for the head frame."""

AXES: Final = ("x", "y", "z")
"""Frame of the face: x lateral (+x is the subject's right), y anterior, z superior."""
