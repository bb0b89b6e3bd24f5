"""Figure of a sound: area function, formants over time, spectrogram and waveform."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr
from scipy.signal import spectrogram

from analysis.figures.style import (
    COLOURS,
    MARKS,
    SHADES,
    blank,
    encoded_figure,
    grid,
    legend,
    styled,
)
from emgface.anatomy.airway.sound import sample_rate
from emgface.files import replace_file

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@styled
def draw_sound(data: xr.Dataset, title: str = "sound of a vocal tract") -> "Figure":
    """Draw what a dataset of the kind "sound" holds; "(simulated)" is added to the title."""
    rows = 2 + 2 * ("sound" in data)
    figure = blank(7.0, 2.1 * rows)
    panels = [row[0] for row in grid(figure, rows, 1)]
    _areas(panels[0], data)
    lines = _formants(panels[1], data)
    if "sound" in data:
        t, p = data["time_sound"].values, data["sound"].values
        rate = sample_rate(data)
        f, s, power = spectrogram(
            p, rate, window="hann", nperseg=int(0.006 * rate), noverlap=int(0.005 * rate)
        )
        level = 10.0 * np.log10(np.maximum(power, 1e-6 * power.max(initial=1e-300)))
        low = f < 5000.0
        panels[2].pcolormesh(
            t[0] + s, f[low] / 1e3, level[low], cmap="Greys", shading="nearest", rasterized=True
        )
        panels[2].set(ylabel="frequency [kHz]", xlabel="time [s]", xlim=(t[0], t[-1]))
        panels[3].plot(t, p, color="black", lw=0.5)
        panels[3].set(ylabel="sound [Pa]", xlabel="time [s]", xlim=(t[0], t[-1]))
    legend(figure, lines, [line.get_label() for line in lines])
    figure.suptitle(f"{title} ({data.attrs['origin']})")
    return figure


def _areas(panel: Any, data: xr.Dataset) -> None:
    areas, n = data["area"].transpose("time", "section").values, data.sizes["time"]
    for k in sorted({*np.linspace(0, n - 1, min(n, 5)).astype(int).tolist()}):
        length = 100.0 * float(data["length"].values[k])
        edges = np.linspace(0.0, length, areas.shape[1] + 1)
        colour = "black" if n == 1 else _shade(k / (n - 1))
        label = f"{float(data['time'].values[k]):.2f} s" if n > 1 else None
        panel.stairs(1e4 * areas[k], edges, color=colour, label=label)
    if n > 1:
        panel.legend(fontsize="small", ncols=2)
    panel.set(ylabel="area [cm\u00b2]", xlabel="distance from the glottis [cm]", ylim=(0.0, None))


def _shade(share: float) -> Any:
    import matplotlib

    return matplotlib.colormaps[SHADES](0.9 * share)


def _formants(panel: Any, data: xr.Dataset) -> list[Any]:
    if "formant_frequency" not in data:
        panel.set_visible(False)
        return []
    t, values = data["time"].values, data["formant_frequency"].transpose("time", "formant").values
    if "time_sound" in data:
        panel.set_xlim(data["time_sound"].values[[0, -1]])
    lines = [
        panel.plot(t, values[:, k] / 1e3, color=COLOURS[k % 7], label=f"F{k + 1}",
                   marker=MARKS[k % 7] if len(t) < 40 else "")[0]
        for k in range(values.shape[1])
    ]  # fmt: skip
    panel.set(ylabel="formants [kHz]", xlabel="time [s]", ylim=(0.0, 5.0))
    return lines


def write_sound_figure(data: xr.Dataset, path: Path, title: str) -> Path:
    """Write the figure of `draw_sound`."""
    content = encoded_figure(draw_sound(data, title), path.suffix, dpi=130)
    replace_file(path, lambda part: part.write_bytes(content))
    return path
