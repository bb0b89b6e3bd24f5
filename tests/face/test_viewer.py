"""Shaded pictures by pyvista, and what happens without it."""

import sys
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from matplotlib import image
from typer.testing import CliRunner

from emgface.cli import app
from emgface.errors import FaceError
from emgface.face import viewer
from emgface.face.file import save_face
from emgface.face.template import template_face


@pytest.fixture(scope="module")
def face() -> xr.Dataset:
    return template_face(resolution="coarse")


@pytest.fixture
def without_pyvista(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyvista", None)
    monkeypatch.setattr(viewer, "find_spec", lambda name: None)


def test_without_pyvista_matplotlib_draws(
    without_pyvista: None, face: xr.Dataset, tmp_path: Path
) -> None:
    path, picture = save_face(face, tmp_path / "face.nc"), tmp_path / "face.png"
    assert not viewer.viewer_is_available()
    result = CliRunner().invoke(app, ["face", "show", str(path), "--out", str(picture)])
    assert result.exit_code == 0, result.output
    assert np.mean(np.ptp(image.imread(picture)[..., :3], axis=2) > 0.08) > 0.03


def test_without_pyvista_the_error_says_what_to_install(
    without_pyvista: None, face: xr.Dataset, tmp_path: Path
) -> None:
    for draw in (
        lambda: viewer.draw_shaded(face, tmp_path / "a.png"),
        lambda: viewer.open_window(face),
    ):
        with pytest.raises(FaceError, match=r"pyvista is not installed.*emgface\[viewer\]"):
            draw()
    assert not (tmp_path / "a.png").exists()


def test_pixel_formats_alone(face: xr.Dataset, tmp_path: Path) -> None:
    with pytest.raises(FaceError, match=r"face.pdf has no pixel format, expected one of .png"):
        viewer.draw_shaded(face, tmp_path / "face.pdf")


def test_shaded_picture(face: xr.Dataset, tmp_path: Path) -> None:
    """Six panels; skin, red of the lips and teeth in the upper row, muscle colours in the lower."""
    pytest.importorskip("pyvista", reason="pyvista, which draws shaded pictures, is not installed")
    pixels = image.imread(viewer.draw_shaded(face, tmp_path / "new" / "face.png"))[..., :3]
    assert pixels.shape == (1200, 1920, 3)
    for row in np.array_split(pixels, 2, axis=0):
        for panel in np.array_split(row, 3, axis=1):
            assert 0.15 < np.mean(panel.min(axis=2) < 0.95) < 0.8
    upper, lower = np.array_split(pixels[:, :640], 2, axis=0)
    red = (upper[..., 0] > 1.5 * upper[..., 1]) & (upper[..., 0] > 0.3)
    assert 0.003 < red.mean() < 0.05, "the red of the lips"
    green = lower[..., 1] > 1.4 * np.maximum(lower[..., 0], lower[..., 2])
    assert green.mean() > 0.002, "the levator of the upper lip and the wing"
    assert not ((upper[..., 1] > 1.4 * np.maximum(upper[..., 0], upper[..., 2])).any())


def test_no_window_without_a_display(face: xr.Dataset, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("pyvista", reason="pyvista, which opens windows, is not installed")
    if sys.platform in ("win32", "darwin"):
        pytest.skip("this system always has a display")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(FaceError, match="there is no display for a window"):
        viewer.open_window(face)
