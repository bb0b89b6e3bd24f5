"""How far a motion is from another: in millimetres, and as what it changes of a score."""

from dataclasses import dataclass
from typing import Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from analysis.scores import correlation_3d
from emgface.bench.drives import SAMPLE, activation_of
from emgface.face.template.gestures import gesture_activation
from sim import Activation

Floats = NDArray[np.float64]

LATE: Final = 0.03
"""How much later the motion moves that the scores are taken against [s]."""
FACTORS: Final = (1.3, 0.7)
"""Factors on the activation of every other muscle in that motion."""


@dataclass(frozen=True)
class Errors:
    """Distance of the lip markers over a motion.

    Attributes
    ----------
    rms, largest : float
        Over markers and instants [m].
    rho : float
        Largest change of a marker's rho [1].
    """

    rms: float
    largest: float
    rho: float


def other_person(instruction: str, muscles: tuple[str, ...], duration: float) -> Activation:
    """Drive of the motion that stands in for a measured one.

    The same gesture, muscles alternately stronger and weaker, and later: a score of a motion against
    itself would hide errors, since rho is stationary there.
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


def errors(found: xr.Dataset, exact: xr.Dataset, measured: xr.Dataset) -> Errors:
    """Compare a motion with the exact one, and the scores of both against a measured one.

    Parameters
    ----------
    found, exact, measured : Dataset
        ``position(marker, axis, time)`` [m] at the same instants.
    """
    same = [d["position"].transpose("marker", "axis", "time") for d in (found, exact, measured)]
    here, there, goal = (d.assign_coords(time=same[1]["time"]) for d in same)
    distance = np.linalg.norm(here.values - there.values, axis=1)[:, 1:]  # without the start
    change = correlation_3d(goal, here) - correlation_3d(goal, there)
    return Errors(
        float(np.sqrt((distance**2).mean())), float(distance.max()), float(np.abs(change).max())
    )
