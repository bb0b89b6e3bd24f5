"""Generated EMG and marker positions without faults, to which the tests of quality add faults."""

import numpy as np
import xarray as xr
from scipy.spatial.transform import Rotation

from emgface.muscles import CHANNELS, FACE_MARKERS, LIP_MARKERS
from emgface.recordings.quality.markers import LAYOUT
from emgface.volunteers.emg import band_limited_noise

RATE = 2048.0
MARKERS = FACE_MARKERS + LIP_MARKERS


def noise(rows: int = 14, seconds: float = 8.0, seed: int = 1) -> np.ndarray:
    """Return muscle-like noise of 50 uV with a second of rest at both ends, over 2 uV of noise."""
    rng = np.random.default_rng(seed)
    n = int(seconds * RATE)
    time = np.arange(n) / RATE
    drive = np.where((time > 1) & (time < seconds - 1), 50e-6, 0.0)
    return drive * band_limited_noise(rows, n, RATE, rng) + 2e-6 * rng.normal(size=(rows, n))


def emg(values: np.ndarray, names: tuple[str, ...] = CHANNELS) -> xr.DataArray:
    time = np.arange(values.shape[1]) / RATE
    coords = {"channel": list(names[: len(values)]), "time_emg": ("time_emg", time, {"units": "s"})}
    return xr.DataArray(values, coords, ("channel", "time_emg"), "emg", {"units": "V"})


def face(frames: int = 200, seed: int = 0, deform: float = 0.1) -> np.ndarray:
    """Return the markers of a turned, shifted, scaled and deformed face in motion [m]."""
    rng = np.random.default_rng(seed)
    rest = np.array([LAYOUT[m] for m in MARKERS])
    size = np.linalg.norm(rest, axis=1, keepdims=True)
    rest = 0.026 * (rest + deform * size * rng.normal(size=rest.shape) / 3)
    turn = Rotation.random(random_state=seed).as_matrix()
    move = 0.004 * np.sin(0.05 * np.arange(frames) + rng.uniform(0, 6, size=(len(rest), 3, 1)))
    return (rest @ turn.T + rng.normal(size=3))[:, :, None] + move


def positions(values: np.ndarray) -> xr.DataArray:
    time = ("time_marker", np.arange(values.shape[2]) / 100, {"units": "s"})
    coords = {"marker": list(MARKERS), "axis": ["x", "y", "z"], "time_marker": time}
    return xr.DataArray(
        values, coords, ("marker", "axis", "time_marker"), "position", {"units": "m"}
    )


def recording(values: np.ndarray, places: np.ndarray | None = None) -> xr.Dataset:
    parts = {"emg": emg(values)} | ({} if places is None else {"position": positions(places)})
    return xr.Dataset(parts, attrs={"origin": "simulated"})
