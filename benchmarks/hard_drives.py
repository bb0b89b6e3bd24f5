"""Activations that no model of sEMG generates: switches, spikes, chirps and square waves.

Every drive has random times, levels and muscles. Samples are 0.1 ms apart, so that a switch takes 0.1
ms. The groups of muscles are those of one movement, on both sides or one.
"""

from collections.abc import Callable, Iterator, Sequence

import numpy as np
import xarray as xr

Floats = np.ndarray
DURATION, SAMPLE = 0.4, 1e-4  # s
GROUPS = (("ZYG", "LLSAN"), ("OOP", "OOM"), ("DAO", "DLI"), ("RIS", "BUC"), ("MEN", "OOP"))


def _switch(t: Floats, rng: np.random.Generator) -> Floats:
    """On and off at random instants."""
    on = rng.uniform(0.01, 0.1)
    off = rng.uniform(on + 0.05, 0.3)
    return ((t >= on) & (t < off)).astype(float)


def _off(t: Floats, rng: np.random.Generator) -> Floats:
    """A slow rise that is switched off at a random instant."""
    off = rng.uniform(0.08, 0.3)
    return np.where(t < off, np.clip(t / 0.08, 0.0, 1.0), 0.0)


def _spikes(t: Floats, rng: np.random.Generator) -> Floats:
    """Spikes of 1 to 3 ms at a fixed period with a random phase."""
    width, period = rng.uniform(1e-3, 3e-3), rng.choice([0.01, 0.0137, 0.02])
    return (((t + rng.uniform(0.0, period)) % period) < width).astype(float)


def _chirp(t: Floats, rng: np.random.Generator) -> Floats:
    """Rising frequency up to 20 to 200 Hz."""
    last, phase = rng.uniform(20.0, 200.0), rng.uniform(0.0, 2.0 * np.pi)
    return 0.5 - 0.5 * np.cos(phase + np.pi * last * t**2 / DURATION)


def _square(t: Floats, rng: np.random.Generator) -> Floats:
    """Square wave of 5 to 60 Hz with a random phase."""
    rate = rng.uniform(5.0, 60.0)
    return ((rate * t + rng.uniform()) % 1.0 < rng.uniform(0.2, 0.8)).astype(float)


SHAPES: dict[str, Callable[[Floats, np.random.Generator], Floats]] = {
    "switch": _switch, "off": _off, "spikes": _spikes, "chirp": _chirp, "square": _square,
}  # fmt: skip


def hard_drives(muscles: Sequence[str], seed: int = 0) -> Iterator[tuple[str, xr.DataArray, None]]:
    """Label and activation (muscle, time) of one drive after another, without an end."""
    t = SAMPLE * np.arange(round(DURATION / SAMPLE) + 1)
    k = 0
    while True:
        rng = np.random.default_rng([seed, k])
        kind = list(SHAPES)[k % len(SHAPES)]
        group = GROUPS[int(rng.integers(len(GROUPS)))]
        sides = rng.choice(["LR", "L", "R"], p=[0.6, 0.2, 0.2])
        level = rng.uniform(0.2, 0.7)
        values = np.zeros((len(muscles), len(t)))
        shape = level * SHAPES[kind](t, rng)
        for row, name in enumerate(muscles):
            if name[:-2] in group and name[-1] in sides:
                values[row] = shape
        coords = {"muscle": list(muscles), "time": ("time", t, {"units": "s"})}
        drive = xr.DataArray(values, dims=("muscle", "time"), coords=coords, attrs={"units": "1"})
        yield f"{kind} {k} {'+'.join(group)} {sides} {level:.2f}", drive, None
        k += 1


def closing_drives(
    muscles: Sequence[str], seed: int = 0
) -> Iterator[tuple[str, xr.DataArray, None]]:
    """Label and activation of rises of both parts of the orbicularis oris, without an end.

    Levels are 0.2 to 1, rises take 0.05 to 0.3 s; sides of every second drive differ by up to half.
    """
    t = SAMPLE * np.arange(round(DURATION / SAMPLE) + 1)
    k = 0
    while True:
        rng = np.random.default_rng([seed, k, 1])
        level, rise, weaker = rng.uniform(0.2, 1.0), rng.uniform(0.05, 0.3), rng.uniform(0.5, 1.0)
        weaker = weaker if k % 2 else 1.0
        values = np.zeros((len(muscles), len(t)))
        for row, name in enumerate(muscles):
            if name[:-2] in ("OOP", "OOM"):
                side = weaker if name[-1] == "L" else 1.0
                values[row] = side * level * np.clip(t / rise, 0.0, 1.0)
        coords = {"muscle": list(muscles), "time": ("time", t, {"units": "s"})}
        drive = xr.DataArray(values, dims=("muscle", "time"), coords=coords, attrs={"units": "1"})
        yield f"closing {k} {level:.2f} {weaker:.2f} in {rise:.2f} s", drive, None
        k += 1
