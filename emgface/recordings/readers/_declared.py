"""Statements of a file beyond its sidecar: units, rates, conversions, flags and bad channels."""

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Final

import numpy as np

from emgface.errors import DataError
from emgface.recordings.findings import Finding, Kind
from emgface.recordings.layout import unit_in
from emgface.recordings.readers._arrays import read_array, read_flags
from emgface.recordings.readers._isolated import parsed
from emgface.recordings.readers._parsers import parse_contents
from emgface.recordings.readers._row_flags import is_row_flag
from emgface.recordings.readers._table_models import Table
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
_CONVERSIONS: Final = frozenset(
    "gain gains amplification scale scales scalefactor scalefactors scaling scalingfactor addoffset "
    "offset offsets resolution lsb conversion conversionfactor calibration calibrationfactor multiplier "
    "sensitivity bitvolts".split()
)
"""Names of variables and attributes by which numbers may have to be converted."""
_BAD_LISTS: Final = re.compile(
    r"bads?|(?:bad|rejected|artifact|artefact|excluded|noisy)(?:ch\w*|electrodes?)", re.ASCII
)
_ANY_SIGNAL: Final = frozenset(
    "emg semg signal signals data amplitude channel channels y value values adc amp amplifier voltage "
    "raw marker markers position positions recording file".split()
)
"""Words before these names that do not name another signal."""
_BITS: Final = (8.0, 10.0, 12.0, 14.0, 16.0, 24.0, 32.0)  #: resolutions of converters [bit]
_LINE: Final = re.compile(r"\W*([A-Za-z][\w .-]*?)[\s\"]*[:=,;\t][\s\"]*([^\s,;\t\"]+).*")
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


def statements_near(path: Path, variable: str) -> dict[str, list[float | str]]:
    """Texts and numbers that a file states next to an array, by their names.

    Those of the same group, structure or data set apply, and those of the whole file that no nearer
    ones replace; names that begin with that of another variable do not.
    """
    contents = parsed(path, parse_contents, path)
    every: dict[str, list[float | str]] = contents["statements"]
    homes = (variable, _home(variable))
    others = {_plain(name) for name in contents["variables"] if name != variable} - {""}
    own = _plain(variable)
    near, far = dict[str, list[float | str]](), dict[str, list[float | str]]()
    for name, values in every.items():
        base = _subject(_plain(name))
        if not values or name == variable or base is None:
            continue
        known = base in _ANY_SIGNAL | {""} or base in own or own in base
        if known or (_names_unit(name) and base not in others):
            (near if _home(name) in homes else far).update({name: values})
    nearer = {_plain(name).rstrip("s") for name in near}
    outer = {k: v for k, v in far.items() if not _home(k) and _plain(k).rstrip("s") not in nearer}
    return near | outer


def statements_in_lines(lines: Sequence[str]) -> dict[str, list[float | str]]:
    """Texts and numbers that lines before a table state, such as ``# Unit: uV``, by their names."""
    stated: dict[str, list[float | str]] = {}
    for line in lines:
        match = _LINE.fullmatch(line.strip())
        base = _subject(_plain(match[1])) if match else None
        if match and base is not None and base in _ANY_SIGNAL | {""}:
            try:
                stated[match[1]] = [float(match[2])]
            except ValueError:
                stated[match[1]] = [match[2].strip("[]()")]
    return stated


def require_declared_units(
    path: Path, statements: Mapping[str, list[float | str]], units: Sequence[str], sidecar: Path
) -> None:
    """Raise DataError if a file states only other units of the quantity than its sidecar (`units`)."""
    declared = {spelling(unit) for unit in units}
    quantity = quantity_of(units[0])
    contradicting: list[str] = []
    for name, values in statements.items():
        stated = {spelling(v) for v in values if isinstance(v, str) and quantity_of(v) == quantity}
        if not stated or quantity is None or not _names_unit(name):
            continue
        if stated <= declared:
            return
        contradicting.append(f"{name!r} states {', '.join(sorted(stated))}")
    if contradicting:
        raise DataError(
            f"{path.name}: {contradicting[0]}, and {sidecar.name} {', '.join(sorted(declared))}; "
            "expected the same unit: correct the sidecar, or specify the unit in the table 'units' of a "
            "mapping if the file is wrong."
        )


def declared_voltage(statements: Mapping[str, list[float | str]]) -> str | None:
    """Return the unit of voltage that a file states next to an array, None for none or several."""
    stated = {
        spelling(value)
        for name, values in statements.items()
        for value in values
        if isinstance(value, str) and quantity_of(value) == "voltage" and _names_unit(name)
    }
    return stated.pop() if len(stated) == 1 else None


def _names_unit(name: str) -> bool:
    return _plain(name).endswith(("unit", "units"))


def declared_conversions(
    path: Path,
    statements: Mapping[str, list[float | str]],
    kind: Kind,
    converted: bool,
    *,
    conversion: str = "conversion",
) -> list[Finding]:
    """Findings on conversions, unless the sidecar states one (`converted`), and on bad channels.

    `conversion` is the code of the former, ``unapplied_conversion`` for a file without a sidecar.
    """
    findings: list[Finding] = []
    for name, values in statements.items():
        plain = _plain(name)
        numbers = [value for value in values if isinstance(value, float)]
        code = ""
        if any(plain.endswith(word) for word in _CONVERSIONS):
            neutral = {0.0} if "offset" in plain else {0.0, 1.0}
            neutral |= set(_BITS) if "resolution" in plain else set()
            code = "" if converted or set(numbers) <= neutral else conversion
        elif _BAD_LISTS.fullmatch(plain) and any(value not in ("", 0.0) for value in values):
            code = "bad_list"
        if code:
            texts = [v if isinstance(v, str) else f"{v:g}" for v in values[:5]]
            stated = {"what": f"{name!r} in {path.name}", "value": ", ".join(texts)}
            findings.append(Finding(code, kind, "", stated))
    return findings


def _plain(name: str) -> str:
    """Letters of the last part of a name, in lower case."""
    return "".join(c for c in re.split(r"[/.]", name)[-1].lower() if c.isalpha())


def _subject(plain: str) -> str | None:
    """Begin of a name that ends in a unit or a conversion or lists bad channels; None for another."""
    if _BAD_LISTS.fullmatch(plain):
        return ""
    words = sorted((*_CONVERSIONS, "unit", "units"), key=len, reverse=True)
    return next((plain.removesuffix(word) for word in words if plain.endswith(word)), None)


def flags_in(
    path: Path, table: Table, labels: Sequence[str], samples: int
) -> dict[str, np.ndarray]:
    """Variables next to an array that may state which samples are good, by their names.

    One with the shape of the array states it of each channel and is named by its label, too.
    """
    variable = str(table.variable)
    shapes: dict[str, tuple[tuple[int, ...], str]]
    shapes = parsed(path, parse_contents, path)["variables"]
    whole = shapes.get(variable, ((), ""))[0]
    flags: dict[str, np.ndarray] = {}
    for name, (shape, kind) in shapes.items():
        leaf = re.split(r"[/.]", name)[-1]
        near = _home(name) in ("", variable, _home(variable)) and name != variable
        if kind not in "biuf" or not (name in table.flags or (near and is_row_flag(leaf))):
            continue
        if samples in shape and max(shape) == int(np.prod(shape)):
            flags[name] = read_flags(path, name).ravel()
        elif shape == whole and table.dims in (("time", "channel"), ("channel", "time")):
            values = read_flags(path, name)
            rows = values if table.dims[0] == "channel" else values.T
            flags |= {f"{label} {leaf}": row for label, row in zip(labels, rows, strict=True)}
    return flags


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


def home_of(table: Table) -> str:
    """Begin of the names of variables next to an array, empty for a text table."""
    home = _home(table.variable or "")
    return table.variable[: len(home) + 1] if table.variable and home else ""


def _home(name: str) -> str:
    """Group, structure or data set to which a variable or attribute belongs; empty for the file."""
    place = max(name.rfind("/"), name.rfind("."))
    return name[: max(place, 0)]
