"""Signals and activations with known time courses, for the tests of the figures."""

import numpy as np
import xarray as xr

STEMS = ("ZYG", "RIS", "LLSAN", "LAO", "BUC", "OOP", "OOM", "DLI", "DAO", "MEN")
CHANNELS = ("OOS_L", "OOI_L", "RIS_L", "ZYG_L", "LLSAN_L", "DAO_L", "MEN_L")


def activation(instruction: str = "A", seed: int = 0, **attrs: object) -> xr.Dataset:
    """Bursts of different amplitude and time; MEN is inactive."""
    rng = np.random.default_rng(seed)
    time = np.linspace(0.0, 1.6, 160)
    muscles = [f"{stem}_{side}" for side in "LR" for stem in STEMS]
    height = rng.uniform(0.2, 1.0, (20, 1)) * np.array([m[:3] != "MEN" for m in muscles])[:, None]
    middle = rng.uniform(0.6, 1.0, (20, 1))
    values = height * np.exp(-0.5 * ((time - middle) / 0.2) ** 2)
    return xr.Dataset(
        {"activation": (("muscle", "time"), values, {"units": "1"})},
        coords={"muscle": muscles, "time": time},
        attrs={"origin": "simulated", "instruction": instruction, "volunteer": f"v{seed}", **attrs},
    )


def signals() -> tuple[xr.DataArray, xr.DataArray, xr.DataArray]:
    """Recorded (with hum and drift) and filtered signals [V], and a feature."""
    rng = np.random.default_rng(2)
    time = np.arange(0, 1.6, 1 / 2048)
    burst = np.exp(-0.5 * ((time - 0.8) / 0.2) ** 2)
    clean = 60e-6 * (0.1 + burst) * rng.normal(size=(7, len(time)))
    hum = 20e-6 * np.sin(2 * np.pi * 50 * time) + 40e-6 * np.sin(2 * np.pi * 0.8 * time)
    coords = {"channel": list(CHANNELS), "time_emg": time}
    dims = ("channel", "time_emg")
    raw = xr.DataArray(clean + hum, coords, dims, attrs={"units": "V"})
    filtered = xr.DataArray(clean, coords, dims, attrs={"units": "V"})
    slow = xr.DataArray(
        400 * burst[None, ::20] * np.linspace(0.4, 1, 7)[:, None],
        {"channel": list(CHANNELS), "time": time[::20]},
        ("channel", "time"),
        name="wamp",
        attrs={"units": "1", "feature": "wamp"},
    )
    return raw, filtered, slow
