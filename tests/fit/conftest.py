"""Simulated persons: landmarks and surfaces of generated faces in a frame of their own."""

import pytest
import xarray as xr

from benchmarks.fit_inputs import MOTION, Person, person_of, ply
from emgface.face.template import template_face

__all__ = ["MOTION", "Person", "person_of", "ply"]


@pytest.fixture(scope="session")
def person() -> Person:
    return person_of(5)


@pytest.fixture(scope="session")
def generic() -> xr.Dataset:
    return template_face(resolution="coarse")
