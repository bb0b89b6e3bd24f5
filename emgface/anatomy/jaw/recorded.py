"""Jaw recordings: simulated sEMG and incisor of a motion, and scores of a motion against a recording."""

from typing import Final

import numpy as np
import xarray as xr

from analysis.align import align
from analysis.incisor import INCISOR
from analysis.scores import score
from emgface.anatomy.jaw.emg import JAW_CHANNELS
from emgface.anatomy.jaw.skull import in_skull
from emgface.errors import MarkerError
from emgface.muscles import AXES
from emgface.schema.validation import validate
from emgface.signals.resampling import resample
from emgface.volunteers.emg import band_limited_noise

JAW_PICKUP: Final = {
    "TEM": {"at": 1.0},
    "MAS": {"sm": 0.8, "dm": 0.2},
    "DIG": {"ad": 0.7, "am": 0.3},
}
"""Muscles under every electrode pair, with their shares of its amplitude (assumption)."""
CROSS_TALK: Final = 0.05
"""Amplitude of the other channels of a side in each channel, relative to theirs (assumption)."""
RATE: Final = 2048.0, 100.0
"""Sampling rates of sEMG and incisor [Hz]."""
AMPLITUDE: Final = 400e-6, 0.3
"""Median root mean square at full activation [V], and its standard deviation between channels of a
person (of the logarithm); assumptions of the order of published maximum clenching."""
JAW_NOISE: Final = 5e-6, 0.1e-3
"""Root mean square of the noise of a channel [V], and of a coordinate of the incisor [m]."""
LARGEST_SHIFT: Final = 0.2
"""Largest shift of a motion that sEMG drives [s], the window of the features; delays between sEMG and
motion are shorter."""
LARGEST_JAW_PATH: Final = 0.2
"""Distance of two places of a point of a jaw [m], beyond any opening."""


def simulated_recording(motion: xr.Dataset, *, person: int = 0, repetition: int = 1) -> xr.Dataset:
    """Simulate the recording of a motion: sEMG of six channels, and the lower incisor.

    Parameters
    ----------
    motion : xarray.Dataset
        A jaw_motion.
    person : int
        Seed of the amplitudes of the channels, which all recordings of a person share.
    repetition : int
        Seed of the signals, from 1.

    Returns
    -------
    xarray.Dataset
        Of schema recording, origin "simulated"; positions are relative to the skull.

    Raises
    ------
    SignalError
        The motion is shorter than a period of 15 Hz.
    """
    names = [f"{name}{side}" for side in ("_L", "_R") for name in JAW_CHANNELS]
    amplitude = np.random.default_rng(person).lognormal(
        np.log(AMPLITUDE[0]), AMPLITUDE[1], len(names)
    )
    rng = np.random.default_rng([person, repetition])
    t = motion["time"].values
    time_emg = t[0] + np.arange(round((t[-1] - t[0]) * RATE[0]) + 1) / RATE[0]
    muscles = [str(name) for name in motion["muscle"].values]
    drive = np.zeros((len(names), len(t)))
    for k, name in enumerate(names):
        for muscle, share in JAW_PICKUP[name[:-2]].items():
            a = motion["activation"].values[muscles.index(muscle + name[-2:])]
            drive[k] += share * a
    envelope = np.array([np.interp(time_emg, t, row) for row in drive])
    own = envelope * band_limited_noise(len(names), len(time_emg), RATE[0], rng)
    side = np.array([name[-2:] for name in names])
    mixing = np.where(side[:, None] == side, CROSS_TALK, 0.0)
    np.fill_diagonal(mixing, 1.0)
    emg = mixing @ (amplitude[:, None] * own) + JAW_NOISE[0] * rng.standard_normal(own.shape)
    x = in_skull_of(motion, INCISOR)
    times = t[0] + np.arange(int((t[-1] - t[0]) * RATE[1] + 1e-9) + 1) / RATE[1]
    frames = np.array([np.interp(times, t, column) for column in x.T])
    frames += JAW_NOISE[1] * rng.standard_normal(frames.shape)
    recording = xr.Dataset(
        {
            "emg": (("channel", "time_emg"), emg, {"units": "V"}),
            "position": (("marker", "axis", "time_marker"), frames[None], {"units": "m"}),
        },
        coords={
            "channel": names,
            "marker": [INCISOR],
            "axis": list(AXES),
            "time_emg": ("time_emg", time_emg, {"units": "s"}),
            "time_marker": ("time_marker", times, {"units": "s"}),
        },
        attrs={
            "origin": "simulated",
            "volunteer": f"jaw {person}",
            "instruction": str(motion.attrs.get("task", "jaw")),
            "repetition": repetition,
            "source": f"simulated motion of the {motion.attrs['jaw']}",
        },
    )
    return validate(recording, "recording")


def in_skull_of(motion: xr.Dataset, marker: str) -> np.ndarray:
    """Positions (time, axis) of a point relative to the skull [m]."""
    x = motion["position"].sel(marker=marker).transpose("time", "axis").values
    return in_skull(motion, x) if "skull" in motion["body"].values else x


def score_motion(recording: xr.Dataset, motion: xr.Dataset) -> xr.Dataset:
    """Align the recorded points of a jaw with a motion, and score every one.

    Returns
    -------
    xarray.Dataset
        As of `analysis.scores.score`: ``rho`` [1], ``rmse`` [m], ``amplitude_ratio`` [1], ``shift`` [s],
        with ``inaccurate`` if the motion states its error.

    Raises
    ------
    MarkerError
        As of `paired`.
    AnalysisError
        A motion cannot be aligned or compared.
    """
    scores = score(*aligned(recording, motion))
    if "numerical_error" in motion.attrs:
        scores["inaccurate"] = ((), int(inaccurate(motion)), {"units": "1"})
    return scores


def inaccurate(motion: xr.Dataset) -> bool:
    """True if the estimated error of the time steps exceeds a tenth of the largest displacement."""
    moved = np.sqrt(((motion["position"] - motion["position"].isel(time=0)) ** 2).sum("axis")).max()
    return motion.attrs["numerical_error"] > 0.1 * float(moved)


def aligned(recording: xr.Dataset, motion: xr.Dataset) -> tuple[xr.Dataset, xr.Dataset]:
    """Recorded points aligned with a motion, as of `analysis.align.align`, and those of the motion.

    The time of a motion that a recording drives is known, so that it is shifted by at most
    `LARGEST_SHIFT`: a movement that is repeated would otherwise match another repetition.
    """
    given, model = paired_incisors(recording, motion)
    most = LARGEST_SHIFT if "recorded_start" in motion.attrs else None
    return align(given, model, max_shift=most), model


def paired_incisors(recording: xr.Dataset, motion: xr.Dataset) -> tuple[xr.Dataset, xr.Dataset]:
    """Recorded and simulated ``position`` (marker, axis, time) of the points that both have [m].

    The recorded ``position`` is relative to the skull, in axes parallel to those of the motion. A
    motion that a recording drives is paired with the same times. Otherwise the whole recording is,
    which `analysis.align.align` stretches to the duration of the motion. Raises MarkerError if no
    recorded point is one of the motion, none was recorded during it, or one moves farther than a
    jaw can.
    """
    known = [str(name) for name in motion["marker"].values]
    present = [str(m) for m in recording["marker"].values] if "position" in recording else []
    both = [name for name in present if name in known]
    if not both:
        raise MarkerError(
            f"recording has the markers {', '.join(present) or 'none'}, expected one of "
            f"{', '.join(known)}: assign the labels of the file by a mapping"
        )
    t = motion["time"].values
    x = np.array([in_skull_of(motion, name).T for name in both])
    coords = {"marker": both, "axis": list(AXES), "time": ("time", t, {"units": "s"})}
    simulated = xr.DataArray(x, coords, ("marker", "axis", "time"), attrs={"units": "m"})
    measured = recording["position"].sel(marker=both).transpose("marker", "axis", "time_marker")
    _require_jaw(measured)
    times = measured["time_marker"].values
    if "recorded_start" in motion.attrs:
        wanted = motion.attrs["recorded_start"] + t
        inside = (wanted >= times[0] - 1e-9) & (wanted <= times[-1] + 1e-9)
        if inside.sum() < 2:
            raise MarkerError(
                f"markers were recorded from {times[0]:.4g} to {times[-1]:.4g} s, the motion was "
                f"simulated for {wanted[0]:.4g} to {wanted[-1]:.4g} s: expected the recording that "
                "drives it"
            )
        wanted = np.clip(wanted[inside], times[0], times[-1])
        measured = resample(measured, wanted, dim="time_marker")
        simulated, times = simulated.isel(time=inside), t[inside]
    place = {"marker": both, "axis": list(AXES), "time": ("time", times, {"units": "s"})}
    measured = xr.DataArray(measured.values, place, ("marker", "axis", "time"))
    measured.attrs["units"] = "m"
    given = xr.Dataset({"position": measured}, attrs={"origin": recording.attrs["origin"]})
    model = xr.Dataset({"position": simulated})
    return given, model


def _require_jaw(measured: xr.DataArray) -> None:
    """Refuse points that move farther than a jaw can."""
    span = measured.max("time_marker") - measured.min("time_marker")
    far = np.sqrt((span.transpose("marker", "axis").values ** 2).sum(axis=1))
    if (far > LARGEST_JAW_PATH).any():
        name = str(measured["marker"].values[int(np.nanargmax(far))])
        raise MarkerError(
            f"point {name} moves by {np.nanmax(far):.3g} m, expected less than {LARGEST_JAW_PATH:g} m: "
            "check the unit of the positions"
        )
