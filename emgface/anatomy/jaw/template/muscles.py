"""Muscles of the generated jaw: attachments by landmarks, strength and fibre length.

Attachments: Standring (ed.), Gray's Anatomy, chapters Infratemporal and pterygopalatine fossae and
temporomandibular joint, Neck, and Larynx: origin and insertion of each muscle. A muscle is the
line between the middle of both areas; where the middle lies relative to the landmarks is chosen.

Strength: cross-sections of the jaw-closing and pterygoid muscles of Weijs and Hillen 1985 times
40 N/cm2, as listed by Peck et al. 2000, Arch Oral Biol 45:483-493; of geniohyoid, mylohyoid and
stylohyoid the length of the mean vectors of Pearson et al. 2011, Dysphagia 26:345-351, times the same
(found); of the others, and fibre lengths, van Eijden et al. 1997, Anat Rec 248:464-474, rounded and as
commonly quoted.
"""

from collections.abc import Mapping
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from emgface.anatomy.jaw.model import JawLine

Floats = NDArray[np.float64]


class JawMuscle(NamedTuple):
    """Bodies, places and architecture of the muscle of a side.

    A place is a landmark and the displacement from it to the right, forward and up [mm]; the first
    number of a landmark in the midline is the distance from it. ``force`` is the largest active force
    [N], ``fibre`` the optimal length of the fibres [mm], and ``stretch`` that length over their length
    at rest.
    """

    title: str
    bodies: tuple[str, str]
    origin: tuple[str, float, float, float]
    insertion: tuple[str, float, float, float]
    force: float
    fibre: float
    stretch: float = 1.0


CLOSED: Final = 1.13
"""Optimal over closed length of the fibres of closers: 2.73 um of optimal human sarcomeres over 2.41 um,
the middle of 2.27 to 2.55 um in masseters of closed jaws (van Eijden and Raadsheer 1992, Anat Rec
232:78-84)."""

# fmt: off
MUSCLES: Final = {
    "at": JawMuscle("anterior temporalis", ("skull", "jaw"),
                 ("condyle", 9, 40, 62), ("coronoid", -1, 2, -1), 158.0, 30, CLOSED),
    "mt": JawMuscle("middle temporalis", ("skull", "jaw"),
                 ("condyle", 16, 10, 66), ("coronoid", 0, 0, -2), 95.6, 30, CLOSED),
    "pt": JawMuscle("posterior temporalis", ("skull", "jaw"),
                 ("condyle", 17, -24, 44), ("coronoid", 0, -3, -4), 75.6, 28, CLOSED),
    "sm": JawMuscle("superficial masseter", ("skull", "jaw"),
                 ("zygoma", 2, 1, -2), ("gonion", 3, 8, 8), 190.4, 26, CLOSED),
    "dm": JawMuscle("deep masseter", ("skull", "jaw"),
                 ("arch", 0, 2, -2), ("gonion", 5, 16, 22), 81.6, 20, CLOSED),
    "mp": JawMuscle("medial pterygoid", ("skull", "jaw"),
                 ("condyle", -29, 32, -11), ("gonion", -4, 9, 6), 174.8, 18, CLOSED),
    "sp": JawMuscle("superior lateral pterygoid", ("skull", "jaw"),
                 ("condyle", -25, 29, 5), ("condyle", -3, 3, -1), 28.7, 22),
    "ip": JawMuscle("inferior lateral pterygoid", ("skull", "jaw"),
                 ("condyle", -29, 30, -13), ("condyle", -3, 3, -6), 66.9, 24),
    "ad": JawMuscle("anterior digastric", ("jaw", "hyoid"),
                 ("chin_back", 5, 1, -2), ("hyoid", 12, -4, 1), 40.0, 34),
    "am": JawMuscle("anterior mylohyoid", ("jaw", "hyoid"),
                 ("chin_back", 16, -6, 13), ("hyoid", 3, 1, 0), 18.0, 30),
    "pm": JawMuscle("posterior mylohyoid", ("jaw", "hyoid"),
                 ("gonion", -10, 33, 1), ("hyoid", 7, -2, 0), 18.0, 32),
    "gh": JawMuscle("geniohyoid", ("jaw", "hyoid"),
                 ("chin_back", 2, 2, 7), ("hyoid", 4, 1, 1), 18.0, 36),
    "pd": JawMuscle("posterior digastric", ("skull", "hyoid"),
                 ("condyle", 2, -21, -22), ("hyoid", 13, -5, 1), 40.0, 42),
    "sh": JawMuscle("stylohyoid", ("skull", "hyoid"),
                 ("condyle", -13, -7, -22), ("hyoid", 12, -6, 0), 10.5, 40),
    "th": JawMuscle("thyrohyoid", ("hyoid", "thyroid"),
                 ("hyoid", 12, -9, -1), ("notch", 13, -12, -6), 20.0, 18),
    "stet": JawMuscle("sternothyroid", ("thyroid", "sternum"),
                   ("notch", 13, -13, -9), ("sternum", 9, -2, 0), 20.0, 52),
    "steh": JawMuscle("sternohyoid", ("hyoid", "sternum"),
                   ("hyoid", 5, 0, -2), ("sternum", 12, 1, 0), 50.0, 70),
    "oh": JawMuscle("omohyoid, superior belly", ("hyoid", "sternum"),
                 ("hyoid", 11, -3, -2), ("sternum", 27, -20, 38), 50.0, 45),
    "act": JawMuscle("anterior cricothyroid", ("thyroid", "cricoid"),
                  ("thyroid_low", 7, -6, 1), ("cricoid", 4, 11, 2), 20.0, 8),
    "pct": JawMuscle("posterior cricothyroid", ("thyroid", "cricoid"),
                  ("thyroid_low", 12, -15, 1), ("cricoid", 8, 8, -2), 20.0, 9),
}
# fmt: on
"""Muscles of the right side by their usual abbreviation."""

GROUPS: Final = {
    "my": ("am", "pm"),
    "lp": ("ip", "sp"),
    "t": ("at", "mt", "pt"),
    "m": ("dm", "sm"),
    "open": ("ad", "my", "gh", "lp"),
    "close": ("t", "m", "mp"),
    "protracthyoid": ("ad", "gh", "my"),
    "retracthyoid": ("pd", "sh"),
    "suprahyoid": ("ad", "gh", "my", "pd", "sh"),
    "infrahyoid": ("th", "stet", "steh", "oh"),
}
"""Muscles and groups driven together, by function."""

PASSIVE_FRACTION: Final = 0.015
"""Largest passive over largest active force (Peck et al. 2000)."""
STRETCH_MAX: Final = 1.5
"""Stretch of the fibres at which the passive force is largest; that of `sim.Peck`."""
DAMPING: Final = 1.0
"""Damping of every muscle [N s/m], in place of its force-velocity relation (Stavness et al. 2006)."""
MIRROR: Final = {"_L": np.array([-1.0, 1.0, 1.0]), "_R": np.ones(3)}
"""From the right to each side."""


def muscle_lines(places: Mapping[str, Floats]) -> list[JawLine]:
    """Muscles of both sides between landmarks [m]; the sides are exact mirror images."""
    found = list[JawLine]()
    for name, muscle in MUSCLES.items():
        ends = np.array([place(places, muscle.origin), place(places, muscle.insertion)])
        length = float(np.linalg.norm(ends[1] - ends[0]))
        fibre = min(1e-3 * muscle.fibre, length)
        optimal = length + fibre * (1.0 - 1.0 / muscle.stretch)
        values = {
            "force_max": muscle.force,
            # of the whole muscle, whose tendon keeps its length
            "stretch_max": 1.0 + (STRETCH_MAX - 1.0) * fibre / optimal,
            "tendon_ratio": 1.0 - fibre / optimal,
            "passive_fraction": PASSIVE_FRACTION,
            "damping": DAMPING,
            "stretch_opt": optimal / length,
        }
        found += [
            JawLine(name + side, muscle.bodies, ends * mirror, values)
            for side, mirror in MIRROR.items()
        ]
    return found


def place(places: Mapping[str, Floats], at: tuple[str, float, float, float]) -> Floats:
    """Position of a place relative to a landmark [m]."""
    return places[at[0]] + 1e-3 * np.array(at[1:])
