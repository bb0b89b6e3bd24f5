"""Shared fixtures: template faces; published geometry and recordings, if available."""

import os
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before NumPy is loaded
os.environ.setdefault("MKL_NUM_THREADS", "1")

import pytest
import xarray as xr

ROOT = Path(__file__).resolve().parents[1]


def shared_folder() -> Path | None:
    """Folder of third-party material: EMGFACE_SHARED, or ../shared beside the checkout."""
    named = os.environ.get("EMGFACE_SHARED")
    folder = Path(named) if named else ROOT.parent / "shared"
    return folder if (folder / "artisynth_models").is_dir() else None


@pytest.fixture(scope="session")
def shared() -> Path:
    folder = shared_folder()
    if folder is None:
        pytest.skip("third-party models and recordings not found (set EMGFACE_SHARED)")
    return folder


@pytest.fixture(scope="session")
def root() -> Path:
    return ROOT


@pytest.fixture(scope="session")
def coarse() -> xr.Dataset:
    from emgface.face.template import template_face  # not all tests need it

    return template_face(resolution="coarse")


@pytest.fixture(scope="session")
def medium() -> xr.Dataset:
    from emgface.face.template import template_face  # not all tests need it

    return template_face(resolution="medium")


@pytest.fixture(scope="session")
def fine() -> xr.Dataset:
    from emgface.face.template import template_face  # not all tests need it

    return template_face(resolution="fine")
