"""Statements of a file that contradict its sidecar: units in labels, and rates stored with an array."""

from collections.abc import Iterable
from pathlib import Path
from typing import Final

from emgface.errors import DataError
from emgface.recordings.findings import Finding
from emgface.recordings.layout import unit_in
from emgface.recordings.readers._isolated import parsed
from emgface.recordings.readers._parsers import parse_contents
from emgface.recordings.timebase import RATE_STATEMENTS_AGREE, differing
from emgface.schema.units import quantity_of, spelling

RATE_NAMES: Final = frozenset(
    "fs rate samplingrate samplerate srate samplingfrequency freq hz".split()
)
"""Names of variables and attributes that contain a sampling rate."""


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
    return {
        key: value
        for key, value in numbers.items()
        if "".join(c for c in key.rpartition("/")[2].rpartition(".")[2].lower() if c.isalpha())
        in RATE_NAMES
    }


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
