"""Small recordings of lip and face markers on the rest positions of a face, and of their sEMG."""

import numpy as np
import xarray as xr

from emgface.muscles import AXES, CHANNELS, FACE_MARKERS, LIP_MARKERS, MUSCLES

SECONDS = {"units": "s"}


def recording_of(face: xr.Dataset, scale: float = 1.0, rate: float = 100.0) -> xr.Dataset:
    """Recording of 1.2 s: the corners move aside by 4 mm times `scale` in the middle.

    Lip and face are larger than the face by `scale`. The true activation is that of both ZYG, with a
    peak of 0.4, and the sEMG follows it.
    """
    rng = np.random.default_rng(0)
    nodes = face["marker_node"].sel(marker=list(LIP_MARKERS)).values.astype(int)
    head = face["face_marker_position"].sel(face_marker=list(FACE_MARKERS), axis=list(AXES)).values
    rest = scale * np.concatenate([head, face["position"].values[nodes]])
    names = [*FACE_MARKERS, *LIP_MARKERS]
    t = np.arange(round(1.2 * rate) + 1) / rate
    x = np.repeat(rest[:, :, None], len(t), axis=2)
    rise = np.exp(-(((t - 0.6) / 0.15) ** 2))
    for name, sign in (("corner_left", -1.0), ("corner_right", 1.0)):
        x[names.index(name), 0] += sign * scale * 4e-3 * rise
    x += 1e-4 * rng.standard_normal(x.shape)
    te = np.arange(round(1.2 * 2048)) / 2048
    drive = np.exp(-(((te - 0.54) / 0.15) ** 2))
    emg = 1e-5 * rng.standard_normal((len(CHANNELS), len(te)))
    a = np.zeros((len(MUSCLES), 121))
    for side in ("L", "R"):
        emg[CHANNELS.index(f"ZYG_{side}")] += 2e-4 * drive * rng.standard_normal(len(te))
        a[MUSCLES.index(f"ZYG_{side}")] = 0.4 * np.exp(
            -(((np.arange(121) / 100 - 0.6) / 0.15) ** 2)
        )
    return xr.Dataset(
        {
            "emg": (("channel", "time_emg"), emg, {"units": "V"}),
            "position": (("marker", "axis", "time_marker"), x, {"units": "m"}),
            "true_activation": (("muscle", "time_true"), a, {"units": "1"}),
        },
        {
            "channel": list(CHANNELS),
            "marker": names,
            "axis": list(AXES),
            "muscle": list(MUSCLES),
            "time_emg": ("time_emg", te, SECONDS),
            "time_marker": ("time_marker", t, SECONDS),
            "time_true": ("time_true", np.arange(121) / 100, SECONDS),
        },
        {"origin": "simulated", "volunteer": "S01", "instruction": "D", "repetition": 1},
    )
