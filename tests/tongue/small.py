"""A small tongue: a row of cubes with a muscle along it and one from a bone outside."""

from functools import cache

import numpy as np
import xarray as xr

import sim
from emgface.anatomy.tongue.actions import raised_muscles
from emgface.anatomy.tongue.model import build_tongue
from emgface.anatomy.tongue.run import simulate_tongue
from emgface.face.parts import Bundle, Fibre

SIZE = 0.01


def small_tongue(n: int = 3, **changes: object) -> xr.Dataset:
    """n cubes of 1 cm along y; the first sheet of nodes follows the jaw, a muscle pulls at the last."""
    X = SIZE * np.array(
        [[x, y, z] for x in (0, 1) for y in range(n + 1) for z in (0, 1)], dtype=float
    )
    elements = sim.grid_cells((1, n, 1))

    def at(*point):
        return int(np.argmin(np.linalg.norm(X - SIZE * np.array(point), axis=1)))

    along = np.array([at(0, k, 0) for k in range(n + 1)])
    outside = np.array([[0.0, (n + 1) * SIZE, SIZE]])
    forward = np.array([[0.0, 1.0, 0.0]])
    given = {
        "position": X,
        "connectivity": elements,
        "attachments": {"jaw": np.flatnonzero(X[:, 1] < 1e-9)},
        "fibres": [
            Fibre("GGP_L", X[along], along),
            Fibre(
                "STY_R",
                np.concatenate([X[along[-2:]], outside]),
                np.array([*along[-2:], -1]),
                "skull",
            ),
        ],
        "bundles": [
            Bundle("GGP_L", np.arange(n), np.repeat(forward, n, axis=0)),
            Bundle("STY_R", np.array([n - 1]), forward),
        ],
        "force_max": {"GGP_L": 3.0, "STY_R": 2.0},
        "markers": {"tip": at(1, n, 1), "back": at(1, 1, 1), "base": 0},
        "name": "row of cubes",
        "origin": "generated",
        "source": "test",
    }
    return build_tongue(**(given | changes))


@cache
def _motion() -> xr.Dataset:
    return simulate_tongue(small_tongue(1), raised_muscles("bi_GGP", duration=0.02), duration=0.02)


def small_tongue_motion() -> xr.Dataset:
    """Motion of one cube under a short activation."""
    return _motion().copy(deep=True)
