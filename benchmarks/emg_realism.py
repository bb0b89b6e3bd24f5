"""Spectra and amplitudes of simulated EMG and of real recordings, as a figure.

    python -m benchmarks emg_realism SET FOLDER FIGURE.png

SET is a folder written by ``emgface volunteers``; FOLDER contains the public recordings described
by the sidecars in ``docs/recordings``. Only active windows are compared: those of 0.25 s whose
power in the band exceeds a tenth of the 95th percentile. Prints median frequency, amplitude and
kurtosis of every source.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import scipy.signal
import scipy.stats
import xarray as xr
from scipy.ndimage import uniform_filter1d

from analysis.figures.style import COLOURS, MARKS, blank, styled
from benchmarks.report import markdown
from emgface.errors import EmgfaceError
from emgface.muscles import CHANNELS, INSTRUCTIONS
from emgface.recordings.dataset import read_recording
from emgface.recordings.inventory import read_files
from emgface.recordings.quality import remove_hum
from emgface.volunteers.emg import synthesise_emg
from emgface.volunteers.instructions import true_activation
from emgface.volunteers.person import draw_volunteer

BAND = (15.0, 500.0)
LIMB = ("Delt", "Biceps", "Triceps", "Trap", "Gd_dent", "Infra")
WINDOW = 0.25
DOMINANT = (50.0, 150.0)
"""Band of most of the energy of surface EMG [Hz] (De Luca 2002, Surface electromyography: detection and
recording)."""
FACIAL = ((15.0, 25.0), (400.0, 500.0))
"""Lower and upper edges of the band of facial EMG [Hz] (van Boxtel 2001, Psychophysiology 38:22-34)."""


@dataclass
class Signals:
    """Channels of one source (samples and rate), and the upper edge of its band [Hz]."""

    name: str
    top: float
    channels: list[tuple[np.ndarray, float]]


def in_band(values: np.ndarray, rate: float, top: float) -> np.ndarray:
    """Filter to the band without delay."""
    sos = scipy.signal.butter(4, (BAND[0], top), "bandpass", fs=rate, output="sos")
    return scipy.signal.sosfiltfilt(sos, values - values.mean())


def active(values: np.ndarray, rate: float) -> list[np.ndarray]:
    """Windows of activity."""
    size = round(WINDOW * rate)
    pieces = values[: values.size // size * size].reshape(-1, size)
    power = pieces.var(axis=1)
    return list(pieces[power > 0.1 * np.percentile(power, 95)])


def measures(source: Signals):
    """Spectrum, median frequency, amplitude [V] and kurtosis of every channel."""
    spectra, medians, amplitudes, shapes, kurtoses = [], [], [], [], []
    for values, rate in source.channels:
        heard = in_band(values, rate, source.top)
        pieces = active(heard, rate)
        if len(pieces) < 3:
            continue
        frequency, density = scipy.signal.welch(
            np.array(pieces), rate, nperseg=pieces[0].size, detrend="constant", axis=1
        )
        density = density.mean(axis=0)
        inside = (frequency >= BAND[0]) & (frequency <= source.top)
        running = np.cumsum(density[inside])
        medians.append(float(np.interp(0.5 * running[-1], running, frequency[inside])))
        spectra.append(np.interp(np.arange(2.0, 501.0, 2.0), frequency, density, right=np.nan)
                       / density[inside].max())  # fmt: skip
        amplitudes += [float(piece.std()) for piece in pieces]
        strength = np.sqrt(uniform_filter1d(heard**2, round(WINDOW * rate), mode="nearest"))
        level = heard / strength
        kept = level[strength > 0.3 * np.percentile(strength, 95)]
        shapes.append(kept)
        kurtoses.append(float(scipy.stats.kurtosis(kept)))
    numbers = (np.array(values) for values in (medians, amplitudes))
    return (spectra, *numbers, np.concatenate(shapes), np.array(kurtoses))


def simulated(folder: Path) -> Signals:
    """Channels of a set of simulated volunteers: all trials of each channel, joined."""
    joined: dict[tuple[str, str], list[np.ndarray]] = {}
    rate = 2048.0
    for path in sorted((folder / "recordings").glob("*.nc")):
        recording = read_recording(path)
        for channel, values in zip(
            recording["channel"].values, recording["emg"].values, strict=True
        ):
            joined.setdefault((recording.attrs["volunteer"], str(channel)), []).append(values)
    return Signals(
        "simulated, motor units", 500.0, [(np.concatenate(v), rate) for v in joined.values()]
    )


def modulated_noise() -> Signals:
    """Channels of three volunteers, EMG by amplitude-modulated noise."""
    channels = []
    for index in (1, 2, 3):
        person = draw_volunteer(index, 2017)
        trials = [
            synthesise_emg(
                true_activation(instruction, levels=person.efforts),
                gain=[person.gain[c] for c in CHANNELS],
                cross_talk=person.cross_talk,
                baseline_noise=person.baseline_noise,
                mains_hum=person.mains_hum,
                rng=person.rng(instruction, 0),
            ).values
            for instruction in INSTRUCTIONS
        ]
        channels += [(row, 2048.0) for row in np.concatenate(trials, axis=1)]
    return Signals("simulated, noise", 500.0, channels)


def real(folder: Path, sidecars: Path) -> list[Signals]:
    """Channels of the public recordings that contain EMG at a sufficient rate."""
    limb = Signals("real, shoulder (pyomeca)", 500.0, [])
    biceps = Signals("real, biceps (biosignals)", 450.0, [])
    face = Signals("real, face and neck (subvocal, to 110 Hz)", 110.0, [])
    for path, found in read_files(folder, sidecars=sidecars):
        if isinstance(found, EmgfaceError) or "emg" not in found:
            continue
        emg: xr.DataArray = found["emg"]
        rate = float(1.0 / np.mean(np.diff(emg["time_emg"].values)))
        names = [str(name) for name in emg["channel"].values]
        if path.suffix == ".c3d":
            limb.channels += [
                (row, rate)
                for name, row in zip(names, emg.values, strict=True)
                if name.startswith(LIMB)
            ]
        elif path.suffix == ".h5":
            biceps.channels += [(row, rate) for row in emg.values]
        elif path.suffix == ".gz":
            live = emg.isel(channel=slice(0, 4))
            face.channels += [(row, rate) for row in remove_hum(live, 60.0).values]
    return [limb, biceps, face]


@styled
def draw(sources: list[Signals], found: list):
    """Spectra, median frequencies, distribution of samples, amplitudes."""
    figure = blank(9.5, 8.2)
    axes = figure.subplots(2, 2)
    grid = np.arange(2.0, 501.0, 2.0)
    spectrum, medians, shape, size = axes.ravel()
    for low, high in FACIAL:
        spectrum.axvspan(low, high, color="0.88", zorder=0)
    for k, (source, (spectra, *_)) in enumerate(zip(sources, found, strict=True)):
        shown = (grid >= 4.0) & (grid <= source.top)
        middle = np.full(grid.size, np.nan)
        middle[shown] = np.nanmedian(np.array(spectra)[:, shown], axis=0)
        level = 10.0 * np.log10(middle / np.nanmax(middle))
        line = "--" if source.name.startswith("simulated") else "-"
        spectrum.plot(grid[shown], level[shown], line, color=COLOURS[k], label=source.name)
    spectrum.set(xlabel="frequency [Hz]", ylabel="power density, median of channels [dB]",
                 ylim=(-40, 3), title="spectra while active; grey: edges of facial EMG [1]")  # fmt: skip
    spectrum.legend(loc="lower left")
    medians.axhspan(*DOMINANT, color="0.9", zorder=0)
    rng = np.random.default_rng(0)
    for k, (_, values, *_) in enumerate(found):
        medians.scatter(k + rng.uniform(-0.2, 0.2, values.size), values, s=12, color=COLOURS[k],
                        marker=MARKS[k])  # fmt: skip
    medians.set_xticks(range(len(sources)), [s.name.replace(", ", ",\n").replace(" (", "\n(")
                                             for s in sources], fontsize=7)  # fmt: skip
    medians.set(ylabel="median frequency from 15 Hz [Hz]", ylim=(0, 260),
                title="one mark per channel; grey: most energy [2]")  # fmt: skip
    edges = np.linspace(-5.0, 5.0, 81)
    centre = 0.5 * (edges[1:] + edges[:-1])
    for k, (source, (*_, samples, _)) in enumerate(zip(sources, found, strict=True)):
        density, _ = np.histogram(samples, edges, density=True)
        line = "--" if source.name.startswith("simulated") else "-"
        shape.plot(centre, np.where(density > 0, density, np.nan), line, color=COLOURS[k])
    shape.plot(centre, scipy.stats.norm.pdf(centre), ":", color="black", label="normal")
    shape.plot(centre, scipy.stats.laplace.pdf(centre, scale=np.sqrt(0.5)), "-.", color="0.5",
               label="Laplace")  # fmt: skip
    shape.set(yscale="log", ylim=(1e-4, 1.2), xlabel="sample over its root mean square in 0.25 s",
              ylabel="probability density", title="distribution of amplitudes while active")  # fmt: skip
    shape.legend()
    boxes = [1e6 * amplitudes for _, _, amplitudes, *_ in found]
    drawn = size.boxplot(boxes, whis=(5, 95), showfliers=False, patch_artist=True,
                         medianprops={"color": "black"})  # fmt: skip
    for box, colour in zip(drawn["boxes"], COLOURS, strict=False):
        box.set_facecolor(colour)
    size.set_xticks(range(1, len(sources) + 1), medians.get_xticklabels(), fontsize=7)
    size.set_xticklabels([t.get_text() for t in medians.get_xticklabels()], fontsize=7)
    size.set(yscale="log", ylabel="root mean square in 0.25 s [uV]",
             title="size while active; box: quartiles, whiskers: 5 to 95 %")  # fmt: skip
    figure.suptitle("SIMULATED EMG beside real recordings")
    figure.supxlabel(
        "[1] van Boxtel 2001, Psychophysiology 38:22-34.  [2] De Luca 2002, Surface "
        "electromyography: detection and recording.", fontsize=7,
    )  # fmt: skip
    return figure


def main(
    simulations: Path, recordings: Path, out: Path, sidecars: Path = Path("docs/recordings")
) -> None:
    """Read, measure, draw and print."""
    sources = [simulated(simulations), modulated_noise(), *real(recordings, sidecars)]
    found = [measures(source) for source in sources]
    rows: list[dict[str, object]] = []
    for source, (_, medians, amplitudes, _, kurtoses) in zip(sources, found, strict=True):
        low, middle, high = np.percentile(medians, [5, 50, 95])
        a, b, c = 1e6 * np.percentile(amplitudes, [5, 50, 95])
        rows.append(
            {
                "source": source.name,
                "channels": medians.size,
                "median frequency [Hz]": f"{middle:.0f} ({low:.0f}-{high:.0f})",
                "RMS while active [uV]": f"{b:.1f} ({a:.1f}-{c:.0f})",
                "excess kurtosis": float(np.median(kurtoses)),
            }
        )
    print(markdown(pd.DataFrame(rows)))
    out.parent.mkdir(parents=True, exist_ok=True)
    draw(sources, found).savefig(out, dpi=130)
