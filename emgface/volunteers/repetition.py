"""Deviations of one repetition of an instruction from the person's habit.

Effort, onset and duration of all bursts, level and onset of each muscle, and the ratio of the sides
are drawn for every repetition. The EMG of a repetition therefore contains information on the motion
of this repetition that the EMG of the other repetitions does not contain.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from emgface.muscles import INSTRUCTIONS, MODELLED, MUSCLES
from emgface.volunteers.instructions import Timing
from emgface.volunteers.recruitment import Recruitment
from emgface.volunteers.world import World

_STREAM: Final = 50  #: random stream, which no other kind of mismatch uses
_TRUNCATION: Final = 2.0  #: of every deviation, in standard deviations


@dataclass(frozen=True)
class Deviation:
    """Deviation of one repetition."""

    effort: float  #: factor on all levels [1]
    onset: float  #: delay of all bursts [s]
    duration: float  #: factor on the duration of all bursts [1]
    levels: Mapping[str, float]  #: factor on the level of each muscle, with side [1]
    shift: Mapping[str, float]  #: delay of each muscle relative to the others, without side [s]

    def timed(self, timing: Timing) -> Timing:
        """Timing of a repetition with this deviation."""
        return replace(
            timing,
            shift=timing.shift + self.onset,
            pace=timing.pace * self.duration,
            effort=timing.effort * self.effort,
        )

    def recruited(self, recruitment: Recruitment | None) -> Recruitment:
        """Recruitment of a person with the delays of this repetition."""
        habit = recruitment or Recruitment({}, {}, dict.fromkeys(MODELLED, 0.0))
        late = {muscle: habit.shift[muscle] + self.shift[muscle] for muscle in MODELLED}
        return replace(habit, shift=late)


def draw_deviation(
    seed: int, index: int, instruction: str, repetition: int, world: World, variability: float
) -> Deviation | None:
    """Draw the deviation of a repetition (1 for the first); None if the world has none.

    `variability` multiplies all deviations: 1.3 for the least skilled person, 0.7 for the best.
    """
    if "repetition" not in world.kinds:
        return None
    position = list(INSTRUCTIONS).index(instruction)
    rng = np.random.default_rng([seed, index, _STREAM + position, repetition])
    drawn = np.clip(
        rng.standard_normal(4 + len(MUSCLES) + len(MODELLED)), -_TRUNCATION, _TRUNCATION
    )
    effort, onset, duration, side = (variability * drawn[:4]).tolist()
    level = variability * world.repetition_level * drawn[4 : 4 + len(MUSCLES)]
    late = variability * world.repetition_timing * drawn[4 + len(MUSCLES) :]
    half = 0.5 * world.repetition_side * side
    return Deviation(
        effort=float(np.exp(world.repetition_effort * effort)),
        onset=world.repetition_onset * onset,
        duration=float(np.exp(world.repetition_duration * duration)),
        levels={
            muscle: float(np.exp(level[k] + (half if muscle.endswith("_L") else -half)))
            for k, muscle in enumerate(MUSCLES)
        },
        shift=dict(zip(MODELLED, late.tolist(), strict=True)),
    )
