"""Known activations of the six instructions, as smooth bursts of the relevant muscles.

The muscles of an instruction are those of Table 1 of Eskes et al. 2017; all other muscles
co-contract slightly. Levels and timing are chosen to be plausible; they are not measured.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
import xarray as xr

from emgface.errors import ConfigurationError
from emgface.muscles import LETTERS, MUSCLES
from emgface.texts import module_toml
from emgface.volunteers.recruitment import Recruitment

TRIAL_DURATION: Final = 1.8
"""Duration of one trial [s]: 160 steps of 10 ms and half a window of 200 ms at each end."""


@dataclass(frozen=True)
class Phase:
    """One burst of an instruction, from `start` to `end` as fractions of the trial.

    `levels` are peak activations (0-1) by muscle name without side, `sides` the factors of the
    sides: ``{"L": 1.0, "R": 1.0}`` for a symmetric burst.
    """

    start: float
    end: float
    levels: Mapping[str, float]
    sides: Mapping[str, float]


INSTRUCTION_PHASES: Final[Mapping[str, tuple[Phase, ...]]] = {
    instruction: tuple(Phase(**burst) for burst in bursts)
    for instruction, bursts in module_toml(__file__).items()
}
"""Bursts of every instruction, of ``instructions.toml``."""


@dataclass(frozen=True)
class Timing:
    """Deviation of one repetition from the table of phases.

    All bursts are delayed by `shift` [s]; `pace` multiplies burst times relative to the middle of
    the trial, and `effort` all levels.
    """

    shift: float = 0.0
    pace: float = 1.0
    effort: float = 1.0


def strongest_muscle(instruction: str) -> str:
    """Muscle with the highest level of an instruction, the first if several are equal."""
    highest: dict[str, float] = {}
    for phase in INSTRUCTION_PHASES[instruction]:
        for muscle, level in phase.levels.items():
            highest[muscle] = max(level, highest.get(muscle, 0.0))
    return max(highest, key=lambda muscle: highest[muscle])


def draw_timing(
    rng: np.random.Generator, *, speed: float = 1.0, variability: float = 1.0
) -> Timing:
    """Draw the deviations of a repetition.

    Shift N(0, 0.03 s), pace U(0.92, 1.08) divided by the `speed` of the person, effort U(0.9, 1.1),
    all deviations multiplied by `variability`, which is small for a skilled person.
    """
    shift = float(np.clip(rng.normal(0.0, 0.03), -0.06, 0.06))
    pace, effort = rng.uniform(0.92, 1.08), rng.uniform(0.9, 1.1)
    return Timing(
        variability * shift,
        float(1.0 + variability * (pace - 1.0)) / speed,
        float(1.0 + variability * (effort - 1.0)),
    )


def burst(time: np.ndarray, start: float, end: float) -> np.ndarray:
    """Rise from 0 to 1 in the first third of a burst, plateau, and fall in the last third.

    The flanks are ``6 s^5 - 15 s^4 + 10 s^3``, so that value, rate and curvature are continuous.
    Times are in seconds, with start < end.
    """
    third = (end - start) / 3.0

    def flank(s: np.ndarray) -> np.ndarray:
        s = np.clip(s, 0.0, 1.0)
        return s**3 * (10.0 - 15.0 * s + 6.0 * s**2)

    return flank((time - start) / third) * flank((end - time) / third)


def true_activation(
    instruction: str,
    *,
    timing: Timing | None = None,
    levels: Mapping[str, float] | None = None,
    co_contraction: float = 0.03,
    recruitment: Recruitment | None = None,
    duration: float = TRIAL_DURATION,
    tail: float = 0.0,
    sampling_rate: float = 1000.0,
) -> xr.DataArray:
    """Activation (muscle, time_true) [1] of the twenty muscles during one instruction "A" to "F".

    An unknown instruction raises ConfigurationError. `timing` is the deviation of this repetition,
    `levels` the factor of each muscle with side, e.g. ``{"ZYG_L": 1.1}`` (default: 1),
    `co_contraction` the peak activation of the muscles that do not belong to the instruction, and
    `recruitment` the deviations of the person's muscles from the table. `duration` [s] is the
    length of the trial, `tail` [s] that of the rest after it; `sampling_rate` is in Hz.
    """
    if instruction not in INSTRUCTION_PHASES:
        raise ConfigurationError(
            f"instruction {instruction!r} is unknown, expected one of {LETTERS}"
        )
    timing, levels = timing or Timing(), levels or {}
    time = np.arange(round((duration + tail) * sampling_rate) + 1) / sampling_rate
    values = np.zeros((len(MUSCLES), time.size))
    for phase in INSTRUCTION_PHASES[instruction]:
        start, end = (
            duration * (0.5 + timing.pace * (fraction - 0.5)) + timing.shift
            for fraction in (phase.start, phase.end)
        )
        together = burst(time, start, end)
        for index, muscle in enumerate(MUSCLES):
            name, side = muscle.split("_")
            level, shape = phase.levels.get(name, co_contraction), together
            if recruitment is not None:
                level = level * recruitment.factor.get(name, 1.0)
                level = max(level, recruitment.joining.get(name, 0.0))
                late = recruitment.shift[name]
                shape = burst(time, start + late, end + late)
            own = level * phase.sides[side] * levels.get(muscle, 1.0)
            values[index] += own * (timing.effort * shape)
    return xr.DataArray(
        np.clip(values, 0.0, 1.0),
        coords={
            "muscle": list(MUSCLES),
            "time_true": ("time_true", time, {"units": "s"}),
        },
        dims=("muscle", "time_true"),
        attrs={"units": "1", "long_name": "activation that drives the simulated volunteer"},
    )
