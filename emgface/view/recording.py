"""Page of a recording: all channels and markers over time, spectra, findings, and marks of the user."""

import json
import warnings
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
import xarray as xr
from markupsafe import Markup
from numpy.typing import NDArray
from scipy.signal import welch

from emgface.characters import isolated
from emgface.errors import DataError, EmgfaceError, FeatureWarning, SignalError
from emgface.files import write_text
from emgface.muscles import CHANNELS, FACE_MARKERS, LIP_MARKERS
from emgface.pictures.encoding import packed
from emgface.pictures.page import Exact, as_json, environment, policy, style
from emgface.recordings.draft import toml_value
from emgface.recordings.labels import LabelMap, read_label_map
from emgface.signals.filters import bandpass, sampling_rate
from emgface.signals.parameters import FilterParameters
from emgface.view.page import view_resource
from emgface.view.pyramid import GAP, MOST_BINS, as_data, bins_of, coarse_enough
from emgface.view.server import Answer

Floats = NDArray[np.float64]

SPECTRUM: Final = 256  #: number of frequencies of a spectrum
MARKER_BYTES: Final = 1_000_000  #: largest size of the positions of markers in a page [bytes]
PADDING: Final = 1.0  #: time by which a part is extended before it is filtered [s]
MICROMETRES: Final = 50.0e-6  #: unit of the positions of markers in a page [m]


def recording_page(recording: xr.Dataset) -> str:
    """Write the page of a recording as HTML without network requests."""
    name = str(recording.attrs.get("source", "")) or "recording"
    return RecordingPage(recording, Path(name).name, findings_shown(recording)).html()


def findings_shown(recording: xr.Dataset) -> list[dict[str, Any]]:
    """Findings of `emgface.recordings.check` for the page."""
    from emgface.recordings.check import check_recording
    from emgface.recordings.findings import findings_in

    stored = [
        {
            "verdict": one.verdict,
            "kind": one.kind,
            "name": one.name,
            "text": one.clause,
            **({"at": float(one.values["at"])} if "at" in one.values else {}),
        }
        for one in findings_in(recording)
    ]
    table = check_recording(recording)
    doubtful = table[(table["verdict"] != "ok") & (table["reason"] != "")]
    known = {(one["name"], one["text"]) for one in stored}
    return stored + [
        {"verdict": row["verdict"], "kind": row["kind"], "name": row["name"], "text": text}
        for row in doubtful.to_dict("records")
        for text in str(row["reason"]).split("; ")
        if (row["name"], text) not in known
    ]


class RecordingPage:
    """Page of a recording, its details, and the mapping file that its user writes.

    Parameters
    ----------
    recording : Dataset
        With ``emg`` (channel, time_emg) [V] or ``position`` (marker, axis, time_marker) [m], or both.
    name : str
        Title of the page.
    findings : sequence of mapping
        Findings with ``verdict``, ``kind``, ``name``, ``text`` and, if known, ``at`` [s].
    mapping : Path, optional
        File that is written when the user saves in a page that is served.
    given : LabelMap, optional
        Mapping with which the recording was read; the file that is written contains it, too.
    """

    def __init__(
        self,
        recording: xr.Dataset,
        name: str,
        findings: list[dict[str, Any]] | None = None,
        mapping: Path | None = None,
        given: LabelMap | None = None,
    ) -> None:
        if "emg" not in recording and "position" not in recording:
            raise DataError("the recording contains neither sEMG nor positions of markers")
        self._recording, self._name, self._mapping = recording, name, mapping
        self._findings, self._given = findings or [], given or LabelMap()
        self._emg = _rows(recording, "emg", ("channel", "time_emg"))
        self._filter, self._scales = FilterParameters(), dict[bool, Floats]()

    def html(self, *, served: bool = False) -> str:
        """The page; with `served` it asks its server for details and saves the mapping there."""
        from emgface import __version__

        script = view_resource("traces.js") + view_resource("recording.js")
        return environment("emgface.view").get_template("recording.html").render(
            title=self._name,
            badge=f"{self._recording.attrs.get('origin', 'measured')} recording",
            simulated=self._recording.attrs.get("origin") == "simulated",
            data=as_json(self._data(served=served)),
            version=__version__,
            style=style(),
            own_style=Markup(view_resource("live.css") + view_resource("recording.css")),
            script=Markup(script),
            policy=policy(script, connects=served),
        )  # fmt: skip

    def _data(self, *, served: bool) -> dict[str, Any]:
        data: dict[str, Any] = {
            "served": served,
            "saves": served and self._mapping is not None,
            "gap": GAP,
            "findings": self._findings,
            "events": _events(self._recording),
            "names": {"channel": list(CHANNELS), "marker": [*FACE_MARKERS, *LIP_MARKERS]},
            "exact": self._exact(),
            "original": {
                Exact(name): Exact(label)
                for table in (self._given.channels, self._given.markers)
                for label, name in (table or {}).items()
            },
            "unusable": _unusable(self._given),
            "prefix": [Exact(line) for line in _prefix(self._given)],
        }
        if len(self._emg):
            time = self._recording["time_emg"].values
            data["emg"] = {
                "labels": [str(c) for c in self._recording["channel"].values],
                "start": float(time[0]),
                "rate": _rate(time),
                "samples": len(time),
                "raw": self._bins(filtered=False),
                "spectra": self._spectra(),
            }
            try:
                data["emg"]["filtered"] = self._bins(filtered=True)
                data["emg"]["band"] = [self._filter.low, self._filter.high]
            except SignalError as error:
                data["emg"]["unfiltered"] = str(error)
        if "position" in self._recording:
            data["markers"] = _markers(self._recording["position"])
        return data

    def _exact(self) -> dict[Exact, Exact]:
        """Labels that the page displays in other characters, by what it displays."""
        dims = (dim for dim in ("channel", "marker") if dim in self._recording.coords)
        labels = (str(label) for dim in dims for label in self._recording[dim].values)
        pairs = ((isolated(one), one) for one in labels)
        return {Exact(displayed): Exact(one) for displayed, one in pairs if displayed != one}

    def _rows(self, start: int, stop: int, *, filtered: bool) -> Iterator[Floats]:
        """Samples start to stop of each channel; the filter begins and ends `PADDING` outside."""
        if not filtered:
            yield from self._emg[:, start:stop]
            return
        padding = round(PADDING * _rate(self._recording["time_emg"].values))
        first, last = max(start - padding, 0), stop + padding
        emg = self._recording["emg"].transpose("channel", "time_emg")
        for k in range(len(self._emg)):
            row = emg.isel(channel=[k], time_emg=slice(first, last))
            gaps = ~np.isfinite(row.values[0])
            with warnings.catch_warnings():  # a narrower band is reported by the check
                warnings.simplefilter("ignore", FeatureWarning)
                samples = np.where(gaps, np.nan, bandpass(row.fillna(0.0), self._filter).values[0])
            yield samples[start - first : stop - first]

    def _bins(self, *, filtered: bool) -> dict[str, Any]:
        rows, samples = self._emg.shape
        size = coarse_enough(2 * rows, samples)
        bins = bins_of(self._rows(0, samples, filtered=filtered), size)
        self._scales[filtered] = bins.scale
        return as_data(bins)

    def _spectra(self) -> dict[str, Any]:
        """Power spectral density of each channel [V^2/Hz], in dB over the smallest."""
        rate = _rate(self._recording["time_emg"].values)
        size = min(2 * SPECTRUM, self._emg.shape[1])
        power = np.array(
            [
                welch(np.where(np.isfinite(row), row, 0.0), rate, nperseg=size)[1]
                for row in self._emg
            ]
        )
        decibel = 10.0 * np.log10(np.maximum(power, 1e-30))
        return {
            "largest": rate / 2.0,
            "count": decibel.shape[1],
            "decibel": packed(np.round(10.0 * decibel).astype("<i2")),
        }

    def span(self, query: Mapping[str, str]) -> Answer:
        """Bins of a part of the recording, for a page that is served.

        The query contains start and stop [samples], columns, and filtered (0 or 1). The answer is the
        number of bins and of samples in a bin as int32, then low and high (channels, bins) as int16,
        in the units of the page.
        """
        try:
            start, stop, columns = (int(query[k]) for k in ("start", "stop", "columns"))
        except (KeyError, ValueError):
            return Answer(b"", status=400)
        samples = self._emg.shape[1]
        if not (0 <= start < stop <= samples and 0 < columns <= MOST_BINS):
            return Answer(b"", status=400)
        filtered = query.get("filtered") == "1" and True in self._scales
        size = max(1, -(-(stop - start) // columns))
        bins = bins_of(self._rows(start, stop, filtered=filtered), size, self._scales[filtered])
        head = np.array([bins.low.shape[1], size], dtype="<i4").tobytes()
        return Answer(head + bins.low.astype("<i2").tobytes() + bins.high.astype("<i2").tobytes())

    def save(self, body: bytes) -> Answer:
        """Check the mapping of the page and write it to the file given at the start."""
        from emgface.texts import toml_in

        try:
            if self._mapping is None:
                raise DataError("no mapping file was given: start with --mapping FILE")
            text = body.decode("utf-8")
            read_label_map(toml_in(text, "the mapping of the page"))
            write_text(self._mapping, text)
            said = {"wrote": self._mapping.name}
        except (EmgfaceError, UnicodeDecodeError) as error:
            said = {"why": str(error)}
        return Answer(as_json(said).encode(), "application/json")


def _prefix(given: LabelMap) -> list[str]:
    """Lines of a mapping file for what the page does not change, such as trial, units and marks."""
    entries = given.model_dump(
        exclude={"channels", "markers", "unusable", "files"}, exclude_defaults=True
    )
    tables = {key: value for key, value in entries.items() if isinstance(value, dict)}
    lines = [f"{key} = {toml_value(entries[key])}" for key in entries if key not in tables]
    for key, table in tables.items():
        lines += [f"[{key}]", *(f"{toml_value(k)} = {toml_value(v)}" for k, v in table.items())]
    return [*lines, ""] if lines else []


def _unusable(given: LabelMap) -> dict[str, list[Any]]:
    """Labels and lines of a mapping file for what it calls unusable, which the page completes."""
    known = given.unusable
    spans = [one.model_dump(exclude_defaults=True) for one in known.spans]
    return {
        "channels": [Exact(label) for label in known.channels],
        "markers": [Exact(label) for label in known.markers],
        "spans": [[Exact(f"{k} = {toml_value(v)}") for k, v in span.items()] for span in spans],
    }


def _rows(recording: xr.Dataset, name: str, dims: tuple[str, str]) -> Floats:
    if name not in recording:
        return np.empty((0, 0))
    return recording[name].transpose(*dims).values


def _rate(time: Floats) -> float:
    try:
        return sampling_rate(time)
    except SignalError:
        return float((len(time) - 1) / max(time[-1] - time[0], 1e-9)) if len(time) > 1 else 1.0


def _events(recording: xr.Dataset) -> list[dict[str, Any]]:
    """Events stored with a recording: time [s] and label."""
    try:
        events = json.loads(str(recording.attrs.get("events", "[]")))
        return [{"at": float(e["onset"]), "label": str(e.get("label", ""))} for e in events]
    except (ValueError, TypeError, KeyError):
        return []


def _markers(position: xr.DataArray) -> dict[str, Any]:
    """Positions of markers about their common mean, in `MICROMETRES`, thinned to `MARKER_BYTES`."""
    values = position.transpose("time_marker", "marker", "axis").values
    every = max(1, -(-values.size * 2 // MARKER_BYTES))
    values, time = values[::every], position["time_marker"].values[::every]
    centre = np.nanmean(values.reshape(-1, 3), axis=0) if np.isfinite(values).any() else np.zeros(3)
    steps = np.round((values - centre) / MICROMETRES)
    finite = np.isfinite(steps)
    whole = np.where(finite, np.clip(np.where(finite, steps, 0.0), -32767, 32767), GAP)
    flat = whole.astype("<i2").reshape(len(whole), -1)
    planes = np.frombuffer(np.ascontiguousarray(flat.T).tobytes(), dtype=np.uint8).reshape(-1, 2)
    return {
        "labels": [str(m) for m in position["marker"].values],
        "time": np.round(time, 6).tolist(),
        "unit": MICROMETRES,
        "position": packed(np.concatenate([planes[:, 0], planes[:, 1]])),
        "every": every,
    }
