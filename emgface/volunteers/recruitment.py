"""Individual recruitment of muscles in an instruction, different from the relevance table."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from emgface.muscles import MODELLED, RELEVANT
from emgface.volunteers.world import World

LEFT_OVER: Final = 0.2  #: fraction of the level of a muscle that a person omits
_MOST_SHIFT: Final = 2.0  #: truncation of the onset of a muscle, in standard deviations


@dataclass(frozen=True)
class Recruitment:
    """Recruitment of one person in one instruction.

    `factor` multiplies the level of each muscle of the table (without side), `joining` contains the
    peak activation of co-contracting muscles that are not in the table, and `shift` the delay of
    each muscle relative to the instruction [s].
    """

    factor: Mapping[str, float]
    joining: Mapping[str, float]
    shift: Mapping[str, float]


def draw_recruitment(
    instruction: str, strongest: str, world: World, rng: np.random.Generator
) -> Recruitment | None:
    """Draw the recruitment of a person in an instruction; None if the world follows the table.

    `strongest` is the muscle of the highest level in the table, which is never omitted.
    """
    if "recruitment" not in world.kinds:
        return None
    relevant = RELEVANT[instruction]
    # Numbers are drawn for all muscles, so that each draw depends only on person and instruction.
    level = np.exp(world.recruitment * rng.standard_normal(len(MODELLED)))
    out = rng.uniform(size=len(MODELLED)) < world.left_out
    joins = rng.uniform(size=len(MODELLED)) < world.joining
    joined = rng.uniform(*world.joining_level, size=len(MODELLED))
    late = np.clip(rng.standard_normal(len(MODELLED)), -_MOST_SHIFT, _MOST_SHIFT)
    factor: dict[str, float] = {}
    joining: dict[str, float] = {}
    for k, muscle in enumerate(MODELLED):
        if muscle in relevant:
            left = LEFT_OVER if out[k] and muscle != strongest else 1.0
            factor[muscle] = float(level[k] * left)
        elif joins[k]:
            joining[muscle] = float(joined[k])
    shift = {muscle: float(world.muscle_timing * late[k]) for k, muscle in enumerate(MODELLED)}
    return Recruitment(factor, joining, shift)
