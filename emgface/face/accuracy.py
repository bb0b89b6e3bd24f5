"""Presets of accuracy, chosen by measured run times."""

import math
import re
from typing import Any, Final

from emgface.schema.units import DIVISORS, spelling

ACCURACY_PRESETS: Final[dict[str, dict[str, Any]]] = {
    "draft": {
        "solver": "sdirk2",
        "step": 0.01,
        "iteration_tolerance": 5e-5,
        "error_tolerance": 5e-4,
    },
    "study": {
        "solver": "sdirk2",
        "step": 0.01,
        "iteration_tolerance": 5e-6,
        "error_tolerance": 1e-4,
    },
    "reference": {
        "solver": "sdirk2",
        "step": 0.005,
        "iteration_tolerance": 1e-6,
        "error_tolerance": 1e-5,
    },
    "published": {"solver": "linearly_implicit", "step": 0.01, "error_tolerance": None},
    "realtime": {"solver": "linearly_implicit", "step": 0.01, "error_tolerance": None},
}
"""Solver, largest step [s], tolerances of the iteration [m] and of the steps [m] of each preset.

`docs/accuracy.md` states the measured error and time of each. "published" is the method of the simulator
of the publication (Eskes et al. 2017: backward Euler, one linear solution per 10 ms). "realtime" is that
of a reduced face (`docs/reduced.md`), without a repetition at full order.
"""
SET_BY_ACCURACY: Final = ("solver", "step", "iteration_tolerance", "error_tolerance")
"""Parameters set by an accuracy unless they are specified."""

_LENGTH = re.compile(r"\s*([0-9.eE+-]+)\s*(\S+)\s*")


def desired_error(accuracy: str) -> float | None:
    """Positive length such as "0.1 mm" [m]; None for anything else."""
    match = _LENGTH.fullmatch(accuracy)
    unit = spelling(match[2]) if match else ""
    try:
        length = float(match[1]) / DIVISORS["m"][unit] if match else 0.0
    except (KeyError, ValueError):
        return None
    return length if 0.0 < length < math.inf else None


def accuracy_settings(accuracy: str) -> dict[str, Any]:
    """Settings of a preset or a desired error: solver, step [s] and tolerances [m].

    `accuracy` is "draft", "study", "reference", "published", "realtime", or a length such as "0.1
    mm", the error of the lip markers that determines the steps. The keys are ``solver``, ``step``,
    ``iteration_tolerance`` and ``error_tolerance``. Raises ValueError for anything but a preset or a
    positive length.
    """
    if accuracy in ACCURACY_PRESETS:
        return dict(ACCURACY_PRESETS[accuracy])
    length = desired_error(accuracy)
    if length is None:
        raise ValueError(
            f"accuracy = {accuracy!r}, expected one of {', '.join(ACCURACY_PRESETS)} or an error "
            "such as '0.1 mm'"
        )
    return {
        "solver": "sdirk2",
        "step": 0.01,
        "iteration_tolerance": min(1e-4, 0.05 * length),
        "error_tolerance": length,
    }
