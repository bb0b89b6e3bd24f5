"""Activations that train and calibrate a reduced face.

The plan is a function of the muscles and a seed:

* a ramp of each muscle to 1, held until the face is nearly still;
* the same of both sides of each muscle;
* sequences: those of `emgface.reduced.study_plan`, or random ones with 1 to 20 active muscles, unequal
  sides and noise, in which every muscle may reach 1;
* further sequences of the same kind, which only calibrate the estimated error.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

RAMP_DURATION: Final = 0.4
"""Duration of a ramp [s]: 0.1 s up, 0.15 s held, 0.1 s down."""
RANDOM_DURATION: Final = 1.0
"""Duration of a random sequence [s]."""
PURPOSES: Final = ("training", "calibration", "test")
"""Purposes of drives; random sequences of different purposes are independent."""
SAMPLE_INTERVAL: Final = 0.01
"""Time between samples of an activation [s]."""


@dataclass(frozen=True, eq=False)
class TrainingDrive:
    """Activation (n, n_muscles) [1] of all muscles at times (n,) [s].

    ``purpose`` is "training", "calibration" or "test".
    """

    label: str
    purpose: str
    time: Floats
    values: Floats

    def scaled(self, factor: float) -> "TrainingDrive":
        """The same drive with a smaller activation."""
        return TrainingDrive(self.label, self.purpose, self.time, factor * self.values)


Sequences = Callable[[Sequence[str], int, str, int], list[TrainingDrive]]
"""Drives for muscles, in some number, for a purpose and with a seed."""


def training_plan(
    muscles: Sequence[str],
    drives: Sequences,
    *,
    seed: int = 0,
    ramps: bool = True,
    sequences: int = 36,
    calibration: int = 39,
) -> list[TrainingDrive]:
    """Drives of the training and of the calibration, for muscles named with their side."""
    names = list(dict.fromkeys(m.rsplit("_", 1)[0] for m in muscles))
    groups = [[i] for i in range(len(muscles))]
    groups += [[i for i, m in enumerate(muscles) if m.rsplit("_", 1)[0] == n] for n in names]
    plan = [_ramp(muscles, group) for group in groups if ramps and len(group)]
    plan += drives(muscles, sequences, "training", seed)
    return plan + drives(muscles, calibration, "calibration", seed)


def random_drives(muscles: Sequence[str], n: int, purpose: str, seed: int) -> list[TrainingDrive]:
    """Random sequences; those of different purposes are independent."""
    stream = PURPOSES.index(purpose)
    return [
        _random(
            muscles,
            f"{purpose} sequence {k + 1}",
            purpose,
            np.random.default_rng([seed, stream, k]),
        )
        for k in range(n)
    ]


def _ramp(muscles: Sequence[str], active: Sequence[int]) -> TrainingDrive:
    time = np.array([0.0, 0.1, 0.25, 0.35, RAMP_DURATION])
    values = np.zeros((len(time), len(muscles)))
    values[1:3, active] = 1.0
    label = "ramp of " + " and ".join(muscles[i] for i in active)
    return TrainingDrive(label, "training", time, values)


def _random(
    muscles: Sequence[str], label: str, purpose: str, rng: np.random.Generator
) -> TrainingDrive:
    time: Floats = SAMPLE_INTERVAL * np.arange(
        round(RANDOM_DURATION / SAMPLE_INTERVAL) + 1, dtype=np.float64
    )
    names = list(dict.fromkeys(m.rsplit("_", 1)[0] for m in muscles))
    count = int(rng.choice([1, 2, 3, len(names) // 2, len(names)], p=[0.1, 0.1, 0.3, 0.2, 0.3]))
    chosen = set(rng.choice(names, max(count, 1), replace=False))
    level = dict(zip(names, rng.uniform(0.1, 1.0, len(names)), strict=True))
    values = np.zeros((len(time), len(muscles)))
    shared = np.sort(rng.uniform(0.0, 0.8 * RANDOM_DURATION, 2))
    for i, muscle in enumerate(muscles):
        name = muscle.rsplit("_", 1)[0]
        if name not in chosen:
            continue
        on, off = np.sort(shared + rng.normal(0.0, 0.05, 2))
        rise, fall = rng.uniform(0.03, 0.2, 2)
        shape = _smooth((time - on) / rise) * (1.0 - _smooth((time - off - 0.1) / fall))
        noise = np.convolve(rng.normal(size=len(time) + 4), np.ones(5) / 5**0.5, "valid")
        side = rng.uniform(0.5, 1.0)
        values[:, i] = level[name] * side * shape * (1.0 + 0.25 * noise)
    return TrainingDrive(label, purpose, time, np.clip(values, 0.0, 1.0))


def _smooth(s: Floats) -> Floats:
    """Smooth step from 0 to 1."""
    s = np.clip(s, 0.0, 1.0)
    return s * s * (3.0 - 2.0 * s)
