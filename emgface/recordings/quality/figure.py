"""Overview page of a recording: signals, spectra, markers and findings."""

import textwrap

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from analysis.figures.style import literal
from analysis.tables import origin_of
from emgface.recordings.check import check_recording
from emgface.recordings.quality.emg import MUSCLE, can_be_judged
from emgface.recordings.quality.hum import power_density
from emgface.signals.filters import sampling_rate

VERDICT_COLOURS = {"ok": "0.25", "warning": "#b26b00", "error": "#b00020", "not EMG": "0.6"}
"""Colours of the verdicts, which are also written as words."""
_MOST_ROWS = 24
_POINTS = 2000
_MOST_FINDINGS = 14
_WEAKEST, _STRONGEST = 0.25, 1.25
"""Range of amplitudes, relative to the typical row, that are drawn at the same scale."""


@literal
def overview_figure(recording: xr.Dataset, table: pd.DataFrame | None = None) -> Figure:
    """Draw the overview page of a recording, of 8.3 by 11.7 inches.

    `table` is the result of `emgface.recordings.check.check_recording` (default: computed). The
    page shows every channel and its spectrum, the distance of every marker from its mean position,
    its losses, and the findings as sentences. The verdict is shown by colour and word. At most 24
    rows of each are drawn; the page states the number of the others.
    """
    table = check_recording(recording) if table is None else table
    figure = Figure(figsize=(8.27, 11.69), layout="constrained")
    FigureCanvasAgg(figure)
    has_emg, has_marker = "emg" in recording, "position" in recording
    heights = [3.2 if has_emg else 0.01, 2.4 if has_marker else 0.01, 1.9]
    parts = np.asarray(figure.subfigures(3, 1, height_ratios=heights))
    figure.suptitle(_title(recording, table), fontsize=11)
    if has_emg:
        left, right = parts[0].subplots(1, 2, width_ratios=(2.4, 1))
        _traces(left, recording["emg"], table)
        _spectra(right, recording["emg"], table)
    if has_marker:
        _markers(parts[1].subplots(), recording["position"], table)
    _words(parts[2].subplots(), table)
    return figure


def _title(recording: xr.Dataset, table: pd.DataFrame) -> str:
    attrs = recording.attrs
    named = [str(attrs[n]) for n in ("volunteer", "instruction", "repetition") if n in attrs]
    kind = origin_of(recording) if attrs.get("origin") == "simulated" else "measured"
    kind = kind.replace("simulated", "SIMULATED")
    counts = table["verdict"].value_counts()
    summary = ", ".join(f"{counts.get(v, 0)} {v}" for v in ("ok", "warning", "error"))
    return f"{' '.join(named) or attrs.get('source', 'recording')} ({kind}): {summary}"


def _verdicts(table: pd.DataFrame, kind: str) -> dict[str, str]:
    rows = table[table["kind"] == kind]
    return dict(zip(rows["name"].astype(str), rows["verdict"].astype(str), strict=True))


def _rows(axes: Axes, names: list[str], verdicts: dict[str, str], total: int) -> None:
    """Label the rows of an axes, the first at the top."""
    axes.set_yticks(-np.arange(len(names)), names, fontsize=7)
    for label, name in zip(axes.get_yticklabels(), names, strict=True):
        label.set_color(VERDICT_COLOURS[verdicts.get(name, "ok")])
    axes.set_ylim(-len(names) + 0.3, 0.7)
    axes.tick_params(axis="x", labelsize=7)
    axes.spines[["top", "right"]].set_visible(False)
    if total > len(names):
        axes.text(
            1.0, 0.0, f"{total - len(names)} more are not drawn", transform=axes.transAxes,
            ha="right", va="bottom", fontsize=7,
        )  # fmt: skip


def _envelope(values: np.ndarray, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Minimum and maximum of each segment, so that spikes remain visible."""
    if values.size <= 2 * _POINTS:
        return time, values
    size = values.size // _POINTS
    cut = values[: values.size // size * size].reshape(-1, size)
    both = np.stack([np.min(cut, axis=1), np.max(cut, axis=1)], axis=1).ravel()
    return np.repeat(time[: cut.size : size], 2), both


def scale_factor(strength: float, unit: float) -> float:
    """Return the factor by which a row is scaled to be visible.

    It is 1 for a row of about the usual amplitude `unit` [V], otherwise 1, 2 or 5 times a power of
    ten; `strength` [V] is 0 or NaN for a constant row.
    """
    if not strength > 0.0 or _WEAKEST <= strength / unit <= _STRONGEST:
        return 1.0
    wanted = unit / strength
    power = 10.0 ** np.floor(np.log10(wanted))
    step = max(s for s in (1.0, 2.0, 5.0) if s * power <= wanted * (1.0 + 1e-9))
    return float(f"{step * power:.6g}")


def _traces(axes: Axes, emg: xr.DataArray, table: pd.DataFrame) -> None:
    verdicts, time = _verdicts(table, "channel"), emg["time_emg"].values
    names = [str(c) for c in emg["channel"].values][:_MOST_ROWS]
    shown = emg.values[: len(names)]
    centred = shown - np.nanmean(np.where(np.isfinite(shown), shown, np.nan), axis=1, keepdims=True)
    strong = np.nanpercentile(np.abs(centred), 99.5, axis=1)
    unit = float(np.nanmedian(strong[strong > 0])) if (strong > 0).any() else 1.0
    for row, (name, values) in enumerate(zip(names, centred, strict=True)):
        # The usual amplitude is half a row; rows far from it state their own scale.
        factor = scale_factor(float(strong[row]), unit)
        t, drawn = _envelope(np.clip(0.45 * factor * values / unit, -0.6, 0.6), time)
        axes.plot(t, drawn - row, lw=0.4, color=VERDICT_COLOURS[verdicts.get(name, "ok")])
        if factor != 1.0:
            text = f"\u00d7 {factor:g}" if factor > 1.0 else f"\u00f7 {1.0 / factor:g}"
            axes.text(
                1.0, -row, text, transform=axes.get_yaxis_transform(), ha="right",
                va="center", fontsize=6.5, bbox={"fc": "white", "ec": "none", "pad": 0.8},
            )  # fmt: skip
    _rows(axes, names, verdicts, emg.sizes["channel"])
    axes.set_xlabel("time [s]", fontsize=8)
    high = 2.0 * unit / 0.9
    text = f"{high * 1e6:.3g} \u00b5V" if high < 1e-3 else f"{high * 1e3:.3g} mV"
    axes.set_title(
        f"EMG, one row is {text} high, or scaled as indicated by \u00d7 or \u00f7", fontsize=9
    )


def _spectra(axes: Axes, emg: xr.DataArray, table: pd.DataFrame) -> None:
    verdicts, rate = _verdicts(table, "channel"), sampling_rate(emg["time_emg"])
    names = [str(c) for c in emg["channel"].values][:_MOST_ROWS]
    for row, (name, values) in enumerate(zip(names, emg.values, strict=False)):
        if not can_be_judged(values, rate):
            continue
        frequency, density = power_density(values, rate)
        inside = (frequency >= 2.0) & (frequency <= min(550.0, 0.5 * rate))
        level = 10.0 * np.log10(np.maximum(density[inside], 1e-30))
        if np.ptp(level) == 0.0:
            continue
        # A row shows 60 dB below the strongest line.
        drawn = np.clip((level - level.max()) / 60.0, -1.0, 0.0) * 0.9 + 0.5
        colour = VERDICT_COLOURS[verdicts.get(name, "ok")]
        axes.plot(frequency[inside], drawn - row, lw=0.5, color=colour)
    _rows(axes, names, verdicts, len(names))
    axes.set_yticklabels([])
    for edge in MUSCLE:
        axes.axvline(edge, lw=0.5, ls=":", color="0.6")
    axes.set_xlabel("frequency [Hz]", fontsize=8)
    axes.set_title("spectrum, rows of 67 dB", fontsize=9)


def _markers(axes: Axes, position: xr.DataArray, table: pd.DataFrame) -> None:
    verdicts, time = _verdicts(table, "marker"), position["time_marker"].values
    names = [str(m) for m in position["marker"].values][:_MOST_ROWS]
    values = position.transpose("marker", "axis", "time_marker").values[: len(names)]
    seen = np.asarray(np.isfinite(values).all(axis=1))
    mean = np.where(seen[:, None], values, 0.0).sum(axis=2, keepdims=True)
    mean = mean / np.maximum(seen.sum(axis=1), 1)[:, None, None]
    way = np.linalg.norm(values - mean, axis=1)
    unit = float(np.nanmax(way)) if np.isfinite(way).any() and np.nanmax(way) > 0 else 1.0
    for row, (name, one, there) in enumerate(zip(names, way, seen, strict=True)):
        axes.plot(
            time,
            0.85 * one / unit - row - 0.4,
            lw=0.7,
            color=VERDICT_COLOURS[verdicts.get(name, "ok")],
        )
        lost = time[~there]
        axes.plot(lost, np.full(lost.size, -row - 0.4), "|", ms=4, color=VERDICT_COLOURS["error"])
    _rows(axes, names, verdicts, position.sizes["marker"])
    axes.set_xlabel("time [s]", fontsize=8)
    axes.set_title(
        f"markers: distance from the mean position, one row is {unit * 1e3 / 0.85:.3g} mm high; "
        "ticks: marker lost", fontsize=9,
    )  # fmt: skip


def _words(axes: Axes, table: pd.DataFrame) -> None:
    axes.set_axis_off()
    ranked = [
        (f"{row.verdict}: {row.kind} {row.name_}: {row.reason}", str(row.verdict))
        for verdict in ("error", "warning")
        for row in table[table["verdict"] == verdict].rename(columns={"name": "name_"}).itertuples()
    ]
    lines: list[tuple[str, str]] = []
    for text, verdict in ranked[:_MOST_FINDINGS]:
        lines += [
            (line, verdict) for line in textwrap.wrap(text, 132, subsequent_indent="    ")[:2]
        ]
    if len(ranked) > _MOST_FINDINGS:
        lines.append((f"and {len(ranked) - _MOST_FINDINGS} more, see the table", "ok"))
    if not ranked:
        lines.append(("No findings.", "ok"))
    for i, (line, verdict) in enumerate(lines):
        axes.text(
            0.0, 1.0 - i / 24, line, transform=axes.transAxes, va="top", fontsize=7.5,
            color=VERDICT_COLOURS[verdict],
        )  # fmt: skip
