"""Sound and picture of the acoustics page: lips that close and open before /a/ (simulated)."""

from pathlib import Path

import numpy as np
import typer
import xarray as xr
from scipy.signal import butter, sosfiltfilt

import emgface as ef
from emgface.acoustics import Folds
from emgface.anatomy.airway.area_function import ideal_vowel, lips_of_trial, with_lips
from emgface.anatomy.airway.figure import write_sound_figure
from emgface.anatomy.airway.sound import synthesise, with_formants, write_wave
from emgface.muscles import MUSCLES
from emgface.schema.netcdf import read_netcdf, write_netcdf

CLOSING = {"OOM": 0.7, "MEN": 0.4}
"""Muscles that close the lips, and their largest activation."""
OPENING = {"DLI": 0.5, "LLSAN": 0.5}
"""Muscles that open them."""
SEAL = 1.5e-6
"""Opening in front view that counts as closed [m^2]: lips in contact leave gaps at the corners."""
LAG = 0.02
"""Time in which an activation begins or ends [s]."""
ABDUCTED, BEFORE, AFTER = 3e-5, 0.05, 0.05
"""Area of the open glottis at rest [m^2], and how long before the closure of the lips it begins to open
and after their release it is closed [s]: the voiceless gesture of a /p/, as commonly quoted."""


def drive() -> xr.DataArray:
    """Activations: closing from 0.12 to 0.26 s, opening from 0.25 to 0.33 s."""
    time = np.arange(0.0, 0.5001, 0.005)
    values = np.zeros((len(MUSCLES), len(time)))
    for level, first, last in ((CLOSING, 0.12, 0.25), (OPENING, 0.25, 0.33)):
        closed = np.interp(time, [first, first + LAG, last, last + LAG], [0.0, 1.0, 1.0, 0.0])
        for k, muscle in enumerate(MUSCLES):
            values[k] += level.get(muscle.split("_")[0], 0.0) * closed
    dims = {"muscle": list(MUSCLES), "time": time}
    return xr.DataArray(values, dims, ("muscle", "time"), attrs={"units": "1"})


def voice(first: float, last: float, duration: float) -> Folds:
    """Folds that open while the lips are closed from `first` to `last` [s]."""
    t = np.arange(0.0, duration, 1e-3)
    share = np.interp(t, [first - BEFORE, first, last, last + AFTER], [0.0, 1.0, 1.0, 0.0])
    rest = 5e-6 + (ABDUCTED - 5e-6) * 0.5 * (1.0 - np.cos(np.pi * share))
    return Folds(rest_area=rest, rate=1000.0)


def measures(sound: xr.Dataset) -> dict[str, float]:
    """Levels [dB] in the closure and at the release relative to the vowel before, and times [s]."""
    t, p = sound["time_sound"].values, sound["sound"].values
    rate = 1.0 / float(t[1] - t[0])
    high = sosfiltfilt(butter(4, 2000.0, "highpass", fs=rate, output="sos"), p)
    area, at = sound["area"].values[:, -1], sound["time"].values
    closed = at[area < 1e-7]
    levels = {"smallest area [mm2]": 1e6 * float(area.min())}
    if not len(closed):
        return levels
    first, last = float(closed[0]), float(closed[-1])

    def level(signal: np.ndarray, begin: float, end: float) -> float:
        here = (t >= begin) & (t < end)
        return 20.0 * np.log10(signal[here].std() + 1e-12)

    vowel, hiss = level(p, first - 0.06, first - 0.02), level(high, first - 0.06, first - 0.02)
    after = at > last
    slope = np.diff(area[after][:3]).max() / (at[1] - at[0])
    before = slice(np.searchsorted(at, first) - 6, np.searchsorted(at, first))
    F = sound["formant_frequency"].values
    pulses = np.flatnonzero((t > last) & (np.abs(p) > 0.2 * np.abs(p).max()))
    burst = level(high, last, last + 0.01)
    return levels | {
        "closed from [s]": first,
        "closed to [s]": last,
        "opening at the release [cm2/s]": 1e4 * float(slope),
        "closure, all frequencies [dB]": level(p, first + 0.03, last - 0.01) - vowel,
        "10 ms after the release, above 2 kHz, over the closure [dB]":
            burst - level(high, first + 0.03, last - 0.01),
        "10 ms after the release, above 2 kHz, over the vowel before [dB]": burst - hiss,
        "voice begins after the release [ms]": 1e3 * float(t[pulses[0]] - last),
        "F1 30 ms before the closure [Hz]": float(F[before][0, 0]),
        "F1 in the closure [Hz]": float(F[np.searchsorted(at, 0.5 * (first + last)), 0]),
        "F1 80 ms after the release [Hz]": float(F[np.searchsorted(at, last + 0.08), 0]),
        "largest value of the wave file": float(np.abs(p).max() / sound.attrs["full_scale"]),
    }  # fmt: skip


def main(out: Path) -> None:
    """Write motion, sound, wave file and picture to a folder, and print their measures."""
    out.mkdir(parents=True, exist_ok=True)
    stored = out / "apa.nc"
    if not stored.exists():
        motion = ef.simulate(drive(), ef.face(resolution="coarse"), accuracy="draft", output=0.005)
        write_netcdf(motion, stored, "trajectory")
    motion = read_netcdf(stored, "trajectory")
    area, forward, time = lips_of_trial(motion)
    area = np.maximum(area - SEAL, 0.0)
    tract = with_formants(with_lips(ideal_vowel("a"), area, forward, time))
    closed = time[tract["area"].values[:, -1] < 1e-7]
    sound = synthesise(tract, voice(float(closed[0]), float(closed[-1]), float(time[-1])))
    write_netcdf(sound, out / "apa-sound.nc", "sound")
    write_wave(sound, out / "apa.wav")
    write_sound_figure(sound, out / "apa.png", "apa: lips moved by muscles before a fixed tract")
    for name, value in measures(sound).items():
        print(f"{name}: {value:.3g}")


if __name__ == "__main__":
    typer.run(main)
