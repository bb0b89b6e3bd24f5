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
from emgface.texts import module_rows

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


CLOSERS_STRETCH: Final = 1.13
"""Optimal over closed length of the fibres of closers: 2.73 um of optimal human sarcomeres over 2.41 um,
the middle of 2.27 to 2.55 um in masseters of closed jaws (van Eijden and Raadsheer 1992, Anat Rec
232:78-84)."""


def _muscle(row: Mapping[str, str]) -> JawMuscle:
    def end(name: str) -> tuple[str, float, float, float]:
        right, forward, up = (float(row[f"{name[0]}_{way}"]) for way in ("right", "forward", "up"))
        return row[name], right, forward, up

    return JawMuscle(
        row["title"],
        (row["from"], row["to"]),
        end("origin"),
        end("insertion"),
        float(row["force"]),
        float(row["fibre"]),
        CLOSERS_STRETCH if row["closer"] else 1.0,
    )


JAW_MUSCLES: Final = {row["name"]: _muscle(row) for row in module_rows(__file__)}
"""Muscles of the right side by their usual abbreviation, of ``muscles.csv``."""

MUSCLE_GROUPS: Final = {
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

TEMPLATE_PASSIVE_FRACTION: Final = 0.015
"""Largest passive over largest active force (Peck et al. 2000)."""
STRETCH_MAX: Final = 1.5
"""Stretch of the fibres at which the passive force is largest; that of `sim.Peck`."""
MUSCLE_DAMPING: Final = 1.0
"""Damping of every muscle [N s/m], in place of its force-velocity relation (Stavness et al. 2006)."""
MIRROR: Final = {"_L": np.array([-1.0, 1.0, 1.0]), "_R": np.ones(3)}
"""From the right to each side."""


def muscle_lines(places: Mapping[str, Floats]) -> list[JawLine]:
    """Muscles of both sides between landmarks [m]; the sides are exact mirror images."""
    lines = list[JawLine]()
    for name, muscle in JAW_MUSCLES.items():
        ends = np.array([place(places, muscle.origin), place(places, muscle.insertion)])
        length = float(np.linalg.norm(ends[1] - ends[0]))
        fibre = min(1e-3 * muscle.fibre, length)
        optimal = length + fibre * (1.0 - 1.0 / muscle.stretch)
        values = {
            "force_max": muscle.force,
            # of the whole muscle, whose tendon keeps its length
            "stretch_max": 1.0 + (STRETCH_MAX - 1.0) * fibre / optimal,
            "tendon_ratio": 1.0 - fibre / optimal,
            "passive_fraction": TEMPLATE_PASSIVE_FRACTION,
            "damping": MUSCLE_DAMPING,
            "stretch_opt": optimal / length,
        }
        lines += [
            JawLine(name + side, muscle.bodies, ends * mirror, values)
            for side, mirror in MIRROR.items()
        ]
    return lines


def place(places: Mapping[str, Floats], at: tuple[str, float, float, float]) -> Floats:
    """Position of a place relative to a landmark [m]."""
    return places[at[0]] + 1e-3 * np.array(at[1:])
