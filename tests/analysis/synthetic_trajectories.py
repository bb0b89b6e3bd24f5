"""Trajectories of ten markers with known time courses, for the tests of the analysis."""

from collections.abc import Callable

import numpy as np
import xarray as xr
from numpy.typing import NDArray

MARKERS = tuple(f"marker_{index}" for index in range(10))
DURATION = 1.6


def once(t: NDArray[np.float64]) -> NDArray[np.float64]:
    """One movement and back, like pursing the lips; zero before and after."""
    phase = np.clip((t - 0.35) / 0.8, 0, 1)
    return np.sin(np.pi * phase) ** 2 * (1 + 0.4 * np.sin(2 * np.pi * phase))


def there_and_back(t: NDArray[np.float64]) -> NDArray[np.float64]:
    """Left, right, left: one and a half periods of a windowed sine."""
    phase = np.clip((t - 0.2) / 1.2, 0, 1)
    return np.sin(3 * np.pi * phase) * np.sin(np.pi * phase)


def trajectory(
    course: Callable[[NDArray[np.float64]], NDArray[np.float64]] = once,
    *,
    count: int = 160,
    duration: float = DURATION,
    shift: float = 0.0,
    scale: float = 1.0,
    amplitude: float = 5e-3,
    noise: float = 0.0,
    seed: int = 0,
    dim: str = "time",
    **attrs: object,
) -> xr.Dataset:
    """Positions that are `shift` earlier and `scale` times faster than `course`.

    Alignment with ``course`` must therefore find this shift and scale.
    """
    time = np.linspace(0.0, duration, count)
    rng = np.random.default_rng(20)
    rest = rng.normal(0.0, 0.03, (10, 3))
    main = rng.normal(size=(10, 3))
    main /= np.linalg.norm(main)
    side = rng.normal(size=(10, 3))
    side /= np.linalg.norm(side)
    own = scale * time + shift
    position = rest[..., None] + amplitude * np.sqrt(10) * (
        main[..., None] * course(own) + 0.1 * side[..., None] * course(own) ** 2
    )
    position = position + noise * np.random.default_rng(seed).normal(size=position.shape)
    return xr.Dataset(
        {"position": (("marker", "axis", dim), position, {"units": "m"})},
        coords={"marker": list(MARKERS), "axis": list("xyz"), dim: time},
        attrs=attrs,
    )
