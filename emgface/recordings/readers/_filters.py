"""Filters that a file states for its channels: edges within the band of EMG, and processed signals."""

import re
from collections.abc import Collection, Mapping
from typing import Final

import numpy as np
import pandas as pd

from emgface.recordings.findings import Finding

HIGHEST_LOW: Final = 30.0  #: highest edge of a high-pass that removes little of the EMG [Hz]
LOWEST_HIGH: Final = 400.0  #: lowest edge of a low-pass that does so [Hz]
_EDGES = {
    name: re.compile(rf"\b{word}\s*[:=]?\s*(\d+(?:\.\d*)?)\s*(k?)(?:Hz)?", re.IGNORECASE)
    for name, word in (("low", "HP"), ("high", "LP"))
}
_PROCESSED = re.compile(r"\brms\b|rectif|envelope|smooth|moving|integrat|averag", re.IGNORECASE)


def stated_filters(filters: Mapping[str, str]) -> list[Finding]:
    """Findings on texts such as ``HP:100Hz LP:150Hz N:50Hz`` by channel, as EDF states them."""
    findings: list[Finding] = []
    for name, text in filters.items():
        if _PROCESSED.search(text):
            findings.append(Finding("processed", "channel", name, {"text": text.strip()[:80]}))
        edges = {
            edge: float(match.group(1)) * (1e3 if match.group(2) else 1.0)
            for edge, form in _EDGES.items()
            if (match := form.search(text)) is not None
        }
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
