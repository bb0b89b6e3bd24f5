"""Begins of the records of an EDF+ or BDF+ file, and its annotations.

The first annotation of each record states when the record begins. Source: Kemp and Olivan 2003, Clin
Neurophysiol 114:1755 (EDF+): time-stamped annotation lists.
"""

import re
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from emgface.recordings.marks import Mark

_HEADER = 256
_LABELS = (b"EDF Annotations", b"BDF Annotations")
_ONSET = re.compile(rb"\x00*([+-]\d+(?:\.\d*)?)(?:\x15(\d+(?:\.\d*)?))?\x14([^\x00]*)\x00?")
_IN_RANGE = 1 << 20  #: bit of the BioSemi status that is set while the electrodes are in range


class Records(NamedTuple):
    """Begin of each record [s], duration of one [s], and the annotations."""

    starts: np.ndarray
    duration: float
    marks: tuple[Mark, ...]


def records_of(data: bytes) -> Records | None:
    """Return the begins of the records of a file of checked length, None without annotations."""
    signals = int(data[252:256])
    width = 3 if data[:1] == b"\xff" else 2
    labels = [data[_HEADER + 16 * i : _HEADER + 16 * (i + 1)].strip() for i in range(signals)]
    first = _HEADER + 216 * signals
    counts = [int(data[first + 8 * i : first + 8 * (i + 1)]) for i in range(signals)]
    annotated = [i for i, label in enumerate(labels) if label in _LABELS]
    if not annotated:
        return None
    start, size = int(data[184:192]), width * sum(counts)
    starts: list[float] = []
    marks: list[Mark] = []
    for record in range(int(data[236:244])):
        for number, i in enumerate(annotated):
            at = start + record * size + width * sum(counts[:i])
            lists = list(_ONSET.finditer(data[at : at + width * counts[i]]))
            if number == 0 and not lists:
                return None
            if number == 0:
                starts.append(float(lists[0].group(1)))
            for onset in lists:
                text = onset.group(3).decode("utf-8", "replace").strip("\x14")
                if text.strip():
                    span = float(onset.group(2) or 0.0)
                    marks.append(Mark(float(onset.group(1)) - starts[0], span, text.strip()))
    return Records(np.array(starts) - starts[0], float(data[244:252]), tuple(marks))


def out_of_range(channels: Mapping[str, np.ndarray]) -> np.ndarray | None:
    """Samples in which the status of a BioSemi amplifier states that electrodes are out of range.

    None without a status channel, or if its bit is never set, as in files of other programs.
    """
    for label, values in channels.items():
        if label.strip().lower() != "status" or not values.size:
            continue
        inside = (np.rint(values).astype(np.int64) & _IN_RANGE) != 0
        if inside.any() and not inside.all():
            return ~inside
    return None
