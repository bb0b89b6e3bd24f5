"""Distance of two motions in millimetres, and the resulting change of a score."""

from typing import Final

import numpy as np
import xarray as xr

from analysis.scores import correlation_3d
from benchmarks.drives import SAMPLE, activation_of
from emgface.face.template.gestures import gesture_activation
from sim import Activation

LATE: Final = 0.03  #: delay of the reference motion of the scores [s]
FACTORS: Final = (1.3, 0.7)  #: factors on the activations of alternate muscles in that motion


def other_person(instruction: str, muscles: tuple[str, ...], duration: float) -> Activation:
    """Activation of the motion that represents a measured one.

    The same gesture with alternately stronger and weaker muscles, and later. The score of a motion
    with itself would hide errors, because rho is stationary there.
    """
    levels = gesture_activation(instruction)
    factor = {name: FACTORS[i % 2] for i, name in enumerate(muscles)}
    drive = activation_of(
        {name: min(level * factor.get(name, 1.0), 1.0) for name, level in levels.items()},
        muscles,
        duration,
    )
    late = round(LATE / SAMPLE)
    values = np.concatenate([np.repeat(drive.values[:1], late, axis=0), drive.values[:-late]])
    return Activation(drive.time, values)


def errors(computed: xr.Dataset, exact: xr.Dataset, measured: xr.Dataset) -> dict[str, float]:
    """Compare a motion with the exact one, and the scores of both with a measured one.

    Datasets contain ``position(marker, axis, time)`` [m] at the same instants. Returns root mean
    square and largest distance of a lip marker [mm], and the largest change of a marker's rho.
    """
    same = [d["position"].transpose("marker", "axis", "time") for d in (computed, exact, measured)]
    here, there, goal = (d.assign_coords(time=same[1]["time"]) for d in same)
    distance = 1e3 * np.linalg.norm(here.values - there.values, axis=1)[:, 1:]  # without the start
    change = correlation_3d(goal, here) - correlation_3d(goal, there)
    return {
        "error rms mm": float(np.sqrt((distance**2).mean())),
        "error max mm": float(distance.max()),
        "change of rho": float(np.abs(change).max()),
    }
