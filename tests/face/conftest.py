"""Faces for several tests: imported ones, read once, and a small one."""

from collections.abc import Callable
from functools import cache, partial
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from emgface.face.artisynth import import_artisynth
from emgface.face.model import build_face
from emgface.face.parts import Bundle, Fibre
from emgface.muscles import MUSCLES


@pytest.fixture(scope="session")
def models(shared: Path) -> Path:
    return shared / "artisynth_models"


@pytest.fixture(scope="session")
def reference_face(imported: Callable[..., xr.Dataset]) -> xr.Dataset:
    return imported()


@pytest.fixture(scope="session")
def imported(models: Path) -> Callable[..., xr.Dataset]:
    """Import of the reference face with options, once for each of them; not to be changed."""
    return cache(partial(import_artisynth, models))


@pytest.fixture
def small_face() -> xr.Dataset:
    """Two cubes of 1 cm and a prism on top of one, nodes of the lowest sheet fixed."""
    grid = [(x, y, z) for z in (0, 1, 2) for y in (0, 1) for x in (0, 1)]
    position = 0.01 * np.array([*grid, (0, 0, 3), (1, 0, 3)], dtype=float)
    connectivity = np.array(
        [
            [0, 1, 3, 2, 4, 5, 7, 6],
            [4, 5, 7, 6, 8, 9, 11, 10],
            [8, 10, 12, 9, 11, 13, -1, -1],
        ]
    )
    fibre = position[[4, 8]] + 0.001
    return build_face(
        position=position,
        connectivity=connectivity,
        layer=np.array([0, 1, 2]),
        fixed=np.array([2, 2, 2, 2] + [0] * 10),
        fibres=[Fibre(muscle, fibre) for muscle in MUSCLES],
        bundles=[
            Bundle(muscle, np.array([1, 2]), np.array([[0.0, 0.0, 1.0]] * 2)) for muscle in MUSCLES
        ],
        marker_node=np.arange(13, 3, -1),  # the upper lip is named before the lower one
        face_marker_position=position[[0, 1, 2, 3, 0, 1]],
        lip_opening_node=np.array([4, 5]),
        name="two cubes and a prism",
        origin="generated",
        source="test",
    )
