"""Shared fixtures: template faces; published geometry and recordings, if available."""

import os
import shutil
from collections.abc import Callable
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before NumPy is loaded
os.environ.setdefault("MKL_NUM_THREADS", "1")

import pytest
import xarray as xr

from tests.specification import (  # hooks and fixture of this folder
    pytest_addoption,  # noqa: F401
    pytest_terminal_summary,  # noqa: F401
    specified,  # noqa: F401
)

ROOT = Path(__file__).resolve().parents[1]
MadeOnce = Callable[[str, Callable[[Path], object]], Path]


def shared_folder() -> Path | None:
    """Folder of third-party material: EMGFACE_SHARED, or ../shared next to the checkout."""
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
def real_c3d(shared: Path) -> Path:
    """Measured C3D file with markers and sEMG."""
    path = shared / "recordings" / "pyomeca" / "markers_analogs.c3d"
    if not path.is_file():
        pytest.skip("the recording of markers and EMG is not there")
    return path


@pytest.fixture(scope="session")
def root() -> Path:
    return ROOT


@pytest.fixture(scope="session")
def made_once(tmp_path_factory) -> MadeOnce:
    """Folder by name, which one of the parallel processes of a run fills; not to be changed."""
    from sim._kernels.cache import in_one_process

    own = tmp_path_factory.getbasetemp()
    common = own.parent if "PYTEST_XDIST_WORKER" in os.environ and os.name == "posix" else own

    def made(name: str, fill: Callable[[Path], object]) -> Path:
        folder = common / name
        with in_one_process(common / f"{name}.lock"):
            if not (folder / "complete").exists():
                shutil.rmtree(folder, ignore_errors=True)
                folder.mkdir()
                fill(folder)
                (folder / "complete").touch()
        return folder

    return made


def template(made_once: MadeOnce, resolution: str) -> xr.Dataset:
    from emgface.face.file import load_face, save_face  # not all tests need them
    from emgface.face.template import template_face

    def fill(folder: Path) -> None:
        save_face(template_face(resolution=resolution), folder / "face.nc")

    return load_face(made_once(f"face-{resolution}", fill) / "face.nc")


@pytest.fixture(scope="session")
def coarse(made_once: MadeOnce) -> xr.Dataset:
    return template(made_once, "coarse")


@pytest.fixture(scope="session")
def medium(made_once: MadeOnce) -> xr.Dataset:
    return template(made_once, "medium")


@pytest.fixture(scope="session")
def fine(made_once: MadeOnce) -> xr.Dataset:
    return template(made_once, "fine")
