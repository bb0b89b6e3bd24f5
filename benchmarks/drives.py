"""Activations for measurements: held gestures of the instructions, smooth in time."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from emgface.face.template.gestures import gesture_activation
from sim import Activation

Floats = NDArray[np.float64]

SAMPLE = 0.01  #: time between samples of the activation [s]


def profile(time: Floats, duration: float) -> Floats:
    """Rise over a quarter of the duration, hold, fall over the last quarter; smooth, 0 to 1."""
    ramp = 0.25 * duration
    rise = 0.5 - 0.5 * np.cos(np.pi * np.clip(time / ramp, 0.0, 1.0))
    fall = 0.5 - 0.5 * np.cos(np.pi * np.clip((duration - time) / ramp, 0.0, 1.0))
    return np.minimum(rise, fall)


def activation_of(
    levels: Mapping[str, float], muscles: tuple[str, ...], duration: float
) -> Activation:
    """Activation that brings the named muscles to their levels and back."""
    time = SAMPLE * np.arange(round(duration / SAMPLE) + 1, dtype=np.float64)
    peak = np.array([levels.get(name, 0.0) for name in muscles])
    return Activation(time, profile(time, duration)[:, None] * peak)


def gesture(instruction: str, muscles: tuple[str, ...], duration: float) -> Activation:
    """Activation of the gesture of an instruction, A to F; muscles that the face lacks are omitted."""
    return activation_of(gesture_activation(instruction), muscles, duration)
