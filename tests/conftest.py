"""Shared fixtures: where the published geometry and the recordings lie, if at all."""

import os
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]


def shared_folder() -> Path | None:
    """Folder of third-party material: EMGFACE_SHARED, else ../shared beside the checkout."""
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
