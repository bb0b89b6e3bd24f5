"""Filters that a file states for its channels: edges within the band of EMG, and processed signals."""

import re
from collections.abc import Collection, Mapping
from typing import Any, Final

import numpy as np
import pandas as pd

from emgface.recordings.findings import Finding

HIGHEST_LOW: Final = 30.0  #: highest edge of a high-pass that removes little of the EMG [Hz]
LOWEST_HIGH: Final = 400.0  #: lowest edge of a low-pass that does so [Hz]
_NUMBER = r"(?:(?!\b[LHBN]P?F?\b)[^\d,;(]){0,12}?(\d+(?:\.\d*)?)\s*(k?)(?:Hz)?"
_LOW = r"\b(?:HPF?|high[ _-]?pass|low[ _-]?cut(?:[ _-]?off)?)"
_HIGH = r"\b(?:LPF?|low[ _-]?pass|high[ _-]?cut(?:[ _-]?off)?)"
_EDGES = {
    "low": re.compile(_LOW + _NUMBER, re.IGNORECASE),
    "high": re.compile(_HIGH + _NUMBER, re.IGNORECASE),
}
_BAND = re.compile(
    r"\b(?:BPF?|band[ _-]?pass)[^\d,;(]{0,12}?(\d+(?:\.\d*)?)\s*(?:Hz)?\s*(?:-|to|\.\.|\u2013)\s*"
    r"(\d+(?:\.\d*)?)\s*(k?)(?:Hz)?",
    re.IGNORECASE,
)
_PROCESSED = re.compile(
    r"\brms\b|rectif|\brect\b|envelope|smooth|moving av|integrat|averaged|gleichger|h\u00fcllkurve|"
    r"enveloppe|redress",
    re.IGNORECASE,
)


def stated_processing(name: str, text: str) -> list[Finding]:
    """Finding on a text of a file, such as a label, by which a channel is processed."""
    return (
        [Finding("processed", "channel", name, {"text": text.strip()[:80]})]
        if _PROCESSED.search(text)
        else []
    )


def filters_of_description(description: Mapping[str, Any], names: Collection[str]) -> list[Finding]:
    """Findings on ``SoftwareFilters`` and ``HardwareFilters`` of a JSON file of BIDS, by channel."""
    texts: list[str] = []
    for kind in ("SoftwareFilters", "HardwareFilters"):
        filters = description.get(kind)
        for name, entries in filters.items() if isinstance(filters, Mapping) else ():
            entries = entries if isinstance(entries, Mapping) else {"": entries}
            edges = [
                v for key, v in entries.items() if re.search("cut|freq|^$", key, re.IGNORECASE)
            ]
            words = [f"{key} {value}" for key, value in entries.items() if value not in edges]
            texts.append(
                ", ".join([f"{name} {edge}" for edge in edges] or [name]) + ", ".join(["", *words])
            )
    return [finding for text in texts for finding in stated_filters(dict.fromkeys(names, text))]


def stated_filters(filters: Mapping[str, str]) -> list[Finding]:
    """Findings on texts such as ``HP:100Hz LP:150Hz N:50Hz`` by channel, as EDF states them."""
    findings: list[Finding] = []
    for name, text in filters.items():
        findings += stated_processing(name, text)
        edges = {
            edge: float(match.group(1)) * (1e3 if match.group(2) else 1.0)
            for edge, form in _EDGES.items()
            if (match := form.search(text)) is not None
        }
        if band := _BAND.search(text):
            edges |= {"low": float(band[1]), "high": float(band[2]) * (1e3 if band[3] else 1.0)}
        findings += stated_band(name, edges.get("low"), edges.get("high"))
    return findings


def stated_band(name: str, low: float | None, high: float | None) -> list[Finding]:
    """Finding on the edges [Hz] of the band to which a channel was filtered, if they narrow the EMG.

    None, 0 and values that are not finite are no edge.
    """
    said: list[str] = []
    if low is not None and np.isfinite(low) and low > HIGHEST_LOW:
        said.append(f"a high-pass of {low:g} Hz")
    if high is not None and np.isfinite(high) and 0.0 < high < LOWEST_HIGH:
        said.append(f"a low-pass of {high:g} Hz")
    return [Finding("prefiltered", "channel", name, {"what": " and ".join(said)})] if said else []


def bands_of_table(table: pd.DataFrame, names: Collection[str]) -> list[Finding]:
    """Findings on ``low_cutoff`` and ``high_cutoff`` [Hz] of some channels in a table of BIDS."""
    findings: list[Finding] = []
    for row in table.to_dict("records"):
        low, high = (_number(row.get(column)) for column in ("low_cutoff", "high_cutoff"))
        if row["name"] in names:
            findings += stated_band(str(row["name"]), low, high)
    return findings


def _number(cell: object) -> float | None:
    try:
        return float(str(cell))
    except ValueError:
        return None
