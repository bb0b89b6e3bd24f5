"""Statements of a file that contradict its sidecar: units in labels, and rates stored with an array."""

import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Final

import numpy as np

from emgface.errors import DataError
from emgface.recordings.findings import Finding
from emgface.recordings.layout import unit_in
from emgface.recordings.readers._arrays import read_array
from emgface.recordings.readers._isolated import parsed
from emgface.recordings.readers._parsers import parse_contents
from emgface.recordings.stamps import TIME_LABELS
from emgface.recordings.timebase import RATE_STATEMENTS_AGREE, differing
from emgface.schema.units import quantity_of, spelling

RATE_NAMES: Final = frozenset(
    "fs rate samplingrate samplerate srate samplingfrequency freq hz".split()
)
"""Names of variables and attributes that contain a sampling rate."""
PERIOD_NAMES: Final = frozenset(
    "dt samplinginterval sampleinterval samplingperiod sampleperiod".split()
)
"""Names of those that contain a sampling interval [s]."""
_IN_WORDS: Final = re.compile(
    r"(?:sampl\w*[ _-]?(?:rate|freq\w*)|\bf_?s\b|\bsrate\b)[^\d\n]{0,20}?"
    r"(\d+(?:[.,]\d+)?)\s*(k?)(?:hz)?\b",
    re.IGNORECASE,
)


def require_stated_units(sidecar: Path, labels: Iterable[str], unit: str, entry: str) -> None:
    """Raise DataError if a label ends in another unit of the same quantity than a sidecar states.

    `entry` is the entry of the sidecar that states `unit`.
    """
    for label in labels:
        stated = unit_in(label)
        same = quantity_of(stated) == quantity_of(unit) is not None
        if stated and same and spelling(stated) != spelling(unit):
            raise DataError(
                f"{sidecar.name}: the column {label!r} is in {spelling(stated)} by its label, and in "
                f"{spelling(unit)} by {entry!r}; expected the same unit: correct the sidecar, or "
                "specify the unit in the table 'units' of a mapping if the label is wrong."
            )


def rates_of(numbers: dict[str, float]) -> dict[str, float]:
    """Sampling rates [Hz] among the single numbers of a file, by the name of variable or attribute."""
    plain = {
        key: "".join(c for c in key.rpartition("/")[2].rpartition(".")[2].lower() if c.isalpha())
        for key in numbers
    }
    rates = {key: value for key, value in numbers.items() if plain[key] in RATE_NAMES}
    periods = {
        key: value for key, value in numbers.items() if plain[key] in PERIOD_NAMES and value > 0
    }
    return rates | {key: 1.0 / value for key, value in periods.items()}


def rates_in_lines(lines: Sequence[str]) -> dict[str, float]:
    """Sampling rates [Hz] that lines before a table state, such as ``%Sample Rate = 250.0 Hz``."""
    return {
        f"the line {line.strip()[:60]!r}": float(match[1].replace(",", "."))
        * (1e3 if match[2] else 1)
        for line in lines
        if (match := _IN_WORDS.search(line))
    }


def times_in(path: Path, variable: str, samples: int) -> dict[str, np.ndarray]:
    """Variables of times of the samples in the file of an array, by their names."""
    shapes: dict[str, tuple[tuple[int, ...], str]]
    shapes = parsed(path, parse_contents, path)["variables"]
    names = [
        name
        for name, (shape, kind) in shapes.items()
        if kind in "iuf" and samples in shape and max(shape) == int(np.prod(shape))
        if name != variable and TIME_LABELS.fullmatch(re.split(r"[/.]", name)[-1])
    ]
    return {name: read_array(path, name).ravel() for name in names}


def declared_rates(
    path: Path, variable: str, rate: float, samples: int, by: str
) -> tuple[Finding, ...]:
    """Findings on rates that a file states in addition to an array and that contradict `rate` [Hz].

    Rates of the same group, structure or data set apply, else those of the whole file. None is found
    if one of them agrees, or agrees in kHz, because a file may contain signals of several rates.
    """
    every = rates_of(parsed(path, parse_contents, path)["numbers"])
    near = {k: v for k, v in every.items() if _home(k) in (variable, _home(variable))}
    stated = near or {k: v for k, v in every.items() if not _home(k)}
    if any(
        abs(scale * v / rate - 1.0) <= RATE_STATEMENTS_AGREE
        for v in stated.values()
        for scale in (1, 1e3)
    ):
        return ()
    return differing(rate, by, {f"{key!r} in {path.name}": v for key, v in stated.items()}, samples)


def _home(name: str) -> str:
    """Group, structure or data set to which a variable or attribute belongs; empty for the file."""
    place = max(name.rfind("/"), name.rfind("."))
    return name[: max(place, 0)]
