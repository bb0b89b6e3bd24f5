"""Kind of signal of an analog channel: EMG, or another signal recorded with it."""

import re
from typing import Final, NamedTuple

import numpy as np

from emgface.muscles import CHANNELS
from emgface.recordings.labels import constant_value
from emgface.recordings.quality.hum import LEAST_DURATION, power_density
from emgface.recordings.quality.processed import LEAST_NOISE_V

SLOW_FREQUENCY: Final = 10.0
"""Frequency [Hz] below which joint angles, forces and skin conductance have their power."""
MOSTLY_SLOW: Final = 0.9
"""Share of the power below `SLOW_FREQUENCY` from which a channel may be another signal than EMG."""
#: standard deviation [V] that surface EMG does not reach, drift included
LARGEST_EMG_V: Final = 10e-3
MOST_CODES: Final = 8  #: most distinct values of a switch or a code of events

_NAMES: Final = (
    ("accelerometer", r"acc|accel|acceleration|accelerometer"),
    ("gyroscope", r"gyro|gyr|gyroscope"),
    ("magnetometer", r"mag|magnetometer"),
    ("force plate", r"(f|m|force|moment|mom)[xyz]\d*|force|plate|fp|grf|load cell|loadcell|cop[xyz]?"),
    ("goniometer", r"gonio|goniometer|gon|angle|inclinometer|torsiometer|potentiometer"),
    ("switch or event marker", r"trig|trigger|sync|switch|footswitch|fsw|button|ttl|stim|event|marker"),
    ("skin conductance", r"scr|scl|eda|gsr|skin conductance"),
    ("electrocardiogram", r"ecg|ekg"),
    ("electro-oculogram", r"eog|heog|veog"),
    ("respiration", r"resp|respiration|breathing"),
    ("sound", r"mic|microphone|audio|sound|voice"),
)  # fmt: skip
_UNITS: Final = (
    ("force plate", r"n|kn|lbf?|nmm|n\.?mm|nm|n\.?m|kg"),
    ("goniometer", r"deg|degrees?|\u00b0|rad"),
    ("accelerometer", r"g|m/s\^?2|m/s\u00b2|mm/s\^?2"),
    ("gyroscope", r"deg/s|\u00b0/s|dps|rad/s"),
    ("magnetometer", r"ut|\u00b5t|gauss"),
    ("skin conductance", r"umho|us|\u00b5s|usiemens|microsiemens"),
    ("temperature", r"c|\u00b0c|degc"),
    ("pressure", r"pa|kpa|hpa|mmhg|cmh2o|psi"),
)  # fmt: skip
_INERTIAL: Final = ("accelerometer", "gyroscope", "magnetometer")


class Signal(NamedTuple):
    """Kind of a channel, ``EMG`` or another, and the reason; empty for EMG."""

    kind: str
    reason: str = ""


def kind_of_unit(unit: str) -> str | None:
    """Return the kind of signal that has a unit (in the spelling of a file), None if ambiguous.

    Examples
    --------
    >>> kind_of_unit("Nmm"), kind_of_unit("V")
    ('force plate', None)
    """
    plain = unit.strip().lower()
    return next((kind for kind, known in _UNITS if re.fullmatch(known, plain)), None)


def kind_of_name(label: str) -> str | None:
    """Return the kind of signal stated by a label; None for EMG or an unknown label.

    For sensors that combine EMG and acceleration, whose labels state both, it is the latter.

    Examples
    --------
    >>> kind_of_name("Sensor 3: Acc.X"), kind_of_name("Delt_ant.EMG1")
    ('accelerometer', None)
    """
    spaced = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", label)
    text = " ".join(re.findall(r"[^\W_]+", spaced.lower()))
    words = f" {text} "
    emg = re.search(r" s?emg\d* ", words)
    for kind, known in _NAMES:
        if emg and kind not in _INERTIAL:
            continue
        if re.search(rf" (?:{known})\d* ", words):
            return kind
    return None


def signal_of(label: str, values: np.ndarray, rate: float) -> Signal:
    """Classify a channel in volts (samples,) by its name, its values and its spectrum.

    The kind is ``unused`` for a constant channel; that of the name; ``switch or event marker`` for
    a few levels; ``rectified EMG`` for one that is never negative and reaches zero; ``slow signal``
    for one with nine tenths of its power below 10 Hz and either more than 10 mV in total or less
    than the noise of an electrode above 20 Hz; ``EMG`` otherwise. A channel with a name of the
    study is EMG or unused.
    """
    still = constant_value(values)
    if still is not None:
        return Signal("unused", f"constant at {still:g} V: no sensor is connected")
    if label in CHANNELS:
        return Signal("EMG")
    named = kind_of_name(label)
    if named is not None:
        return Signal(named, f"its name is that of a {named} signal")
    finite = values[np.isfinite(values)]
    if (
        finite.size > 20 * MOST_CODES
        and np.unique(finite[:: max(1, finite.size // 20000)]).size <= MOST_CODES
    ):
        return Signal("switch or event marker", f"it has at most {MOST_CODES} distinct values")
    if finite.size > 20 * MOST_CODES and 0.0 <= finite.min() < 0.5 * np.std(finite):
        return Signal(
            "rectified EMG", "it is never negative and touches zero, which no raw EMG does"
        )
    if (
        finite.size < max(LEAST_DURATION * rate, 8)
        or finite.size < values.size
        or not rate > 4 * SLOW_FREQUENCY
    ):
        return Signal("EMG")  # too short or too slow for a spectrum
    frequency, density = power_density(values, rate)
    share = float(density[frequency < SLOW_FREQUENCY].sum() / density.sum())
    above = float(np.sqrt(np.trapezoid(density[frequency >= 2 * SLOW_FREQUENCY], dx=frequency[1])))
    spread = float(np.std(finite))
    if share > MOSTLY_SLOW and (spread > LARGEST_EMG_V or above < LEAST_NOISE_V):
        evidence = f"{share:.0%} of its power lies below {SLOW_FREQUENCY:g} Hz, with "
        evidence += (
            f"{spread * 1e3:.3g} mV in all and {above * 1e6:.3g} uV above {2 * SLOW_FREQUENCY:g} Hz"
        )
        return Signal("slow signal", f"{evidence}: a force, an angle or skin conductance, not EMG")
    return Signal("EMG")
