"""Streams of the Lab Streaming Layer that send the activations and markers of a live face."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emgface.errors import ConfigurationError
from emgface.view.moving import Moving

Floats = NDArray[np.float64]


class Outlets:
    """Two streams at the rate of the steps: ``NAME activation`` [1] and ``NAME markers`` [m].

    Raises ConfigurationError if the package pylsl is not installed.
    """

    def __init__(self, name: str, moving: Moving, markers: Sequence[Any]) -> None:
        try:
            import pylsl
        except ImportError as error:
            raise ConfigurationError(
                "sending requires the package pylsl, which is not installed: install 'emgface[stream]'"
            ) from error
        axes = [f"{marker} {axis}" for marker in markers for axis in "xyz"]

        def outlet(what: str, labels: Sequence[str], unit: str) -> Any:
            info = pylsl.StreamInfo(
                f"{name} {what}",
                what,
                len(labels),
                1.0 / moving.step,
                pylsl.cf_float32,
                f"emgface {name} {what}",
            )
            info.desc().append_child_value("origin", "simulated")
            channels = info.desc().append_child("channels")
            for label in labels:
                channel = channels.append_child("channel")
                channel.append_child_value("label", label)
                channel.append_child_value("unit", unit)
            return pylsl.StreamOutlet(info)

        self._activation = outlet("activation", moving.muscles, "1")
        self._markers = outlet("markers", axes, "m")

    def __call__(self, activation: Floats, markers: Floats) -> None:
        """Send one step."""
        self._activation.push_sample(activation.tolist())
        self._markers.push_sample(np.asarray(markers).reshape(-1).tolist())
