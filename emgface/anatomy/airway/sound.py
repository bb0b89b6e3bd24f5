"""Formants and sound of area functions, and wave files."""

import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.io import wavfile

from analysis.arguments import number
from emgface.acoustics import (
    CLOSURE_AREA,
    Flow,
    Folds,
    Medium,
    Source,
    Turbulence,
    formants,
    rosenberg,
    simulate_tube,
)
from emgface.acoustics.errors import AcousticsError
from emgface.acoustics.waves import check_sampling
from emgface.errors import ConfigurationError, DataError, FeatureWarning, listed
from emgface.files import replace_file

Progress = Callable[[int, int], None]
PEAK: Final = 0.9
"""Largest value of a wave file."""
FAINT_PRESSURE: Final = 2e-3
"""Sound pressure below which a wave file is not amplified further [Pa], 40 dB, so that a closed mouth is
quiet."""
OCCLUSION_AREA: Final = 10.0 * CLOSURE_AREA
"""Area up to which a section is closed [m^2]; one that is partly closed has a harmonic mean."""
VOICE_SOURCES: Final = ("folds", "rosenberg")


def with_formants(tract: xr.Dataset, *, count: int = 4, medium: Medium | None = None) -> xr.Dataset:
    """Add the formants of every instant, from the matrix method (`emgface.acoustics.formants`).

    Parameters
    ----------
    tract : Dataset
        Area function, kind "sound".
    count : int
        Formants per instant, ascending; NaN where there are fewer below 5 kHz.
    medium : Medium, optional
        Air, walls and openings.

    Returns
    -------
    Dataset
        With ``formant_frequency`` and ``formant_bandwidth`` (time, formant) [Hz].
    """
    resonances = np.full((2, tract.sizes["time"], count), np.nan)
    areas = tract["area"].transpose("time", "section").values
    for k, length in enumerate(tract["length"].values):
        if k and np.array_equal(areas[k], areas[k - 1]) and length == tract["length"].values[k - 1]:
            resonances[:, k] = resonances[:, k - 1]
            continue
        pair = np.stack(formants(areas[k], float(length), medium=medium))[:, :count]
        resonances[:, k, : pair.shape[1]] = pair
    dims = ("time", "formant")
    return tract.assign(
        formant_frequency=(dims, resonances[0], {"units": "Hz"}),
        formant_bandwidth=(dims, resonances[1], {"units": "Hz"}),
    ).assign_coords(formant=("formant", np.arange(1, count + 1), {"units": "1"}))


def source_of(name: str, duration: float, *, lung: float, pitch: float, tension: float) -> Source:
    """Source by its name: two-mass "folds", pulses of "rosenberg", or the path of a wave file.

    A wave file is the flow of the glottis, with 3e-4 m^3/s at its largest value; it warns
    (FeatureWarning) if it ends before the sound. Raises ConfigurationError if there is neither, and
    DataError if the file is not a wave file, has channels that differ, or is silent.
    """
    if name == "folds":
        return Folds(lung=lung, tension=tension)
    if name == "rosenberg":
        rate = 176_400.0
        return Flow(rosenberg(np.arange(int(duration * rate)) / rate, pitch=pitch), rate)
    if not Path(name).is_file():
        raise ConfigurationError(
            f"unknown source {name!r}, expected {listed(VOICE_SOURCES)} or a wave file"
        )
    flow = _flow_of_wave(Path(name))
    if (ends := len(flow.values) / flow.rate) < duration - 1.0 / flow.rate:
        warnings.warn(
            f"{name} ends at {ends:.3g} s, before the sound of {duration:.3g} s: the flow of the "
            "glottis is 0 from then on",
            FeatureWarning,
            stacklevel=3,
        )
    return flow


def _flow_of_wave(path: Path) -> Flow:
    """Flow of a wave file; samples of 8 bits are unsigned, and 128 is their 0."""
    try:
        rate, values = wavfile.read(path)
    except ValueError as error:
        raise DataError(f"{path} cannot be read as a wave file: {error}") from error
    channels = np.asarray(values, np.float64).reshape(len(values), -1)
    if values.dtype.kind == "u":
        channels = channels - 2.0 ** (8 * values.dtype.itemsize - 1)
    if any(not np.array_equal(one, channels[:, 0], equal_nan=True) for one in channels.T):
        raise DataError(
            f"{path} has {channels.shape[1]} channels that differ, expected the flow of the glottis "
            "alone: write one of them to a file"
        )
    flow = channels[:, 0]
    largest = float(np.abs(flow).max(initial=0.0))
    if not 0.0 < largest < np.inf:
        raise DataError(
            f"{path} is silent or contains values that are not finite, expected the flow of the "
            "glottis: record it again"
        )
    return Flow(3e-4 * flow / largest, float(rate))


def synthesise(
    tract: xr.Dataset,
    source: str | Source = "folds",
    *,
    duration: float | None = None,
    rate: int = 44_100,
    lung: float = 785.0,
    pitch: float = 120.0,
    tension: float = 1.0,
    noise: bool = True,
    seed: int = 0,
    sections: int = 60,
    distance: float = 0.3,
    progress: Progress | None = None,
) -> xr.Dataset:
    """Simulate the sound of an area function.

    Parameters
    ----------
    tract : Dataset
        Area function, kind "sound".
    source : str or Source
        As in `source_of`, or a source itself, such as folds of changing lung pressure and opening.
    duration : float, optional
        [s]; by default up to the last instant of a changing shape, or 0.5 s.
    rate : int
        Samples per second [Hz].
    lung, pitch, tension : float
        Lung pressure [Pa] and tension [1] of the folds; frequency of the pulses [Hz].
    noise : bool
        Turbulence at the glottis and the narrowest section.
    seed : int
        Of the noise.
    sections : int
        Cells of the tube.
    distance : float
        From the lips [m].
    progress : callable, optional
        Called as ``progress(done, total)``.

    Returns
    -------
    Dataset
        `tract` with ``sound`` (time_sound) [Pa] and ``glottal_flow`` [m^3/s].

    Raises
    ------
    ConfigurationError, DataError, emgface.acoustics.errors.AcousticsError
        The source, the area function or the sampling is not valid.
    """
    time = tract["time"].values
    lasting = float(time[-1] - time[0]) if len(time) > 1 else 0.5
    lasting = lasting if duration is None else duration
    given = {"duration": lasting, "rate": rate, "lung": lung, "pitch": pitch, "tension": tension}
    for name, value in given.items():
        number(name, value, error=AcousticsError)
    check_sampling(sections, lasting, rate)
    name = source if isinstance(source, str) else type(source).__name__.lower()
    if not (isinstance(source, str) or callable(getattr(source, "flow", None))):
        raise ConfigurationError(
            f"the source is of type {name}, expected {listed(VOICE_SOURCES)}, the name of a wave "
            "file or a source"
        )
    if isinstance(source, str):
        source = source_of(source, lasting, lung=lung, pitch=pitch, tension=tension)
    sound = simulate_tube(
        tract["area"].transpose("time", "section").values,
        tract["length"].values,
        source,
        times=time - time[0],
        duration=lasting,
        rate=float(rate),
        sections=sections,
        turbulence=Turbulence() if noise else Turbulence(gain=0.0),
        seed=seed,
        progress=progress,
    )
    pressure = sound.radiated(float(rate), distance)
    step = round(sound.rate / rate)
    instants = float(time[0]) + np.arange(len(pressure)) / rate
    full = max(float(np.abs(pressure).max(initial=0.0)), FAINT_PRESSURE) / PEAK
    return (
        tract.assign(
            sound=("time_sound", pressure, {"units": "Pa"}),
            glottal_flow=("time_sound", sound.glottis[::step], {"units": "m3 s-1"}),
        )
        .assign_coords(time_sound=("time_sound", instants, {"units": "s"}))
        .assign_attrs(source=name, distance=distance, full_scale=full, origin="simulated")
    )


def write_wave(sound: xr.Dataset, path: Path) -> Path:
    """Write a sound as a wave file of 16 bits with 0.9 at its largest value, or less if it is faint.

    The attribute ``full_scale`` of the dataset is the pressure [Pa] that is 1 in the file.
    """
    if path.suffix.lower() != ".wav":
        raise ConfigurationError(f"{path.name} is not a wave file, expected the suffix .wav")
    rate = sample_rate(sound)
    scale = float(sound.attrs["full_scale"])
    samples: NDArray[np.int16] = np.round(32767.0 * sound["sound"].values / scale).astype(np.int16)
    replace_file(path, lambda target: wavfile.write(target, rate, samples))
    return path


def sample_rate(sound: xr.Dataset) -> int:
    """Samples per second of a sound [Hz], from all of its instants, which may be far from 0."""
    instants = sound["time_sound"].values
    return round((len(instants) - 1) / float(instants[-1] - instants[0]))


def sound_doubts(sound: xr.Dataset) -> list[str]:
    """Sentences on what formants and sound do not mean, empty if nothing: closures, and silence."""
    sentences: list[str] = []
    closed = (sound["area"] <= OCCLUSION_AREA).any("section").values
    if closed.any():
        at = sound["time"].values[closed]
        sentences.append(
            f"the tract is closed at {closed.sum()} of {len(closed)} instants, from {at[0]:.4g} to "
            f"{at[-1]:.4g} s: its formants then are those of a tube with an opening of "
            f"{1e6 * CLOSURE_AREA:.2g} mm2, which are not heard"
        )
    if "sound" in sound and not float(np.abs(sound["sound"]).max()) > FAINT_PRESSURE:
        sentences.append(
            f"the sound does not exceed {FAINT_PRESSURE:g} Pa at {sound.attrs['distance']:g} m, "
            "expected a voice: check that the tract is open, that the lung pressure is in Pa (about "
            "800), and the tension of the folds"
        )
    return sentences
