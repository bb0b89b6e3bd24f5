"""Movies and files for ParaView: contents and errors."""

import base64
import re
import stat
import sys
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from PIL import Image

from emgface.errors import DataError
from emgface.face.parts import arches_of
from emgface.pictures import movie
from emgface.pictures.movie import write_movie
from emgface.pictures.surface import drawn_surface
from emgface.pictures.vtk import write_vtk


@pytest.fixture
def short(motion: xr.Dataset, monkeypatch: pytest.MonkeyPatch) -> xr.Dataset:
    monkeypatch.setattr(movie, "PANEL", 80)
    return motion.isel(frame=[0, 5])


def test_surface_of_a_trajectory(motion: xr.Dataset, face: xr.Dataset) -> None:
    body, skin, frames = drawn_surface(motion)
    np.testing.assert_allclose(motion["frame_time"], [0.0, 0.04, 0.08, 0.12, 0.16, 0.2])
    np.testing.assert_allclose(frames[:, :, 2] - frames[0, :, 2], 40e-3 * np.tile(
        motion["frame_time"].values[:, None], frames.shape[1]), atol=1e-7)  # fmt: skip
    assert body.n == len(skin.node) == frames.shape[1]
    assert len(body.teeth) == sum(len(arch.points) for arch in arches_of(face))
    with pytest.raises(DataError, match="contains markers only.*--surface"):
        drawn_surface(motion.drop_vars("surface_position"))


def test_gif(short: xr.Dataset, tmp_path: Path) -> None:
    done: list[tuple[int, int]] = []
    path = write_movie(short, tmp_path / "a.gif", progress=lambda *p: done.append(p))
    with Image.open(path) as picture:
        assert picture.n_frames == 2 and picture.info["duration"] == 200
        assert b"simulated" in picture.info["comment"]
        pixels = []
        for k in (0, 1):
            picture.seek(k)
            pixels.append(np.asarray(picture.convert("RGB")).astype(int))
    rows = [np.flatnonzero(np.ptp(p[:-30], axis=2).max(axis=1) > 30)[0] for p in pixels]
    assert done == [(1, 2), (2, 2)] and rows[1] < rows[0], "the face rises"
    with pytest.raises(DataError, match=r"a.avi is not a movie, expected .*\.gif or \.mp4"):
        write_movie(short, tmp_path / "a.avi")


def test_mp4_needs_ffmpeg(
    short: xr.Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(movie.shutil, "which", lambda name: None)
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(DataError, match="no program ffmpeg was found.*write a .gif"):
        write_movie(short, tmp_path / "a.mp4")
    assert not (tmp_path / "a.mp4").exists()


@pytest.mark.skipif(sys.platform == "win32", reason="the stand-in is a shell script")
def test_mp4_frames_are_passed_to_ffmpeg(
    short: xr.Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One substitute for ffmpeg stores its input; another one fails like ffmpeg."""
    program = tmp_path / "program"
    program.write_text('#!/bin/sh\necho "$@" > "$0.said"\nfor last; do :; done\ncat > "$last"\n')
    program.chmod(program.stat().st_mode | stat.S_IEXEC)
    monkeypatch.setattr(movie, "ffmpeg", lambda: str(program))
    size = write_movie(short, tmp_path / "a.mp4").stat().st_size
    said = (tmp_path / "program.said").read_text()
    width, height = map(int, re.search(r"-s (\d+)x(\d+)", said).groups())
    assert size == 2 * 3 * width * height and height % 2 == 0
    assert "-r 5 " in said and "simulated" in said
    program.write_text("#!/bin/sh\ncat > /dev/null\necho unknown codec >&2\nexit 1\n")
    with pytest.raises(DataError, match="could not write the movie .unknown codec.: update it"):
        write_movie(short, tmp_path / "b.mp4")
    assert not (tmp_path / "b.mp4").exists()


def arrays(path: Path) -> dict[str, np.ndarray]:
    """Decode all data of a .vtu file."""
    kinds = {"Float64": "<f8", "Float32": "<f4", "Int64": "<i8", "UInt8": "u1"}
    values = {}
    for kind, name, width, text in re.findall(
        r'<DataArray type="(\w+)" Name="(\w+)"(?: NumberOfComponents="(\d)")? format="binary">([^<]*)',
        path.read_text(),
    ):
        raw = base64.b64decode(text)
        assert int.from_bytes(raw[:8], "little") == len(raw) - 8
        values[name] = np.frombuffer(raw[8:], kinds[kind]).reshape(-1, int(width or 1))
    return values


def test_files_for_paraview(face: xr.Dataset, tmp_path: Path) -> None:
    rest = face["position"].values
    moved = np.stack([rest, rest * [1.0, 1.0, 1.1]])
    path = write_vtk(tmp_path / "out", face, moved, np.array([0.0, 0.04]))
    listed = re.findall(r'timestep="([\d.]+)" part="(\d)" file="([^"]+)"', path.read_text())
    assert listed == [("0", "0", "simulated_0000.vtu"), ("0.04", "0", "simulated_0001.vtu"),
                      ("0", "1", "teeth.vtu"), ("0.04", "1", "teeth.vtu")]  # fmt: skip
    arrays_read = arrays(tmp_path / "out" / "simulated_0001.vtu")
    np.testing.assert_array_equal(arrays_read["Points"], moved[1])
    np.testing.assert_array_equal(arrays_read["displacement"], moved[1] - rest)
    np.testing.assert_array_equal(arrays_read["fixed"][:, 0], face["fixed"].values)
    cells = face["connectivity"].values
    np.testing.assert_array_equal(arrays_read["connectivity"][:, 0], cells[cells >= 0])
    assert (
        set(arrays_read["types"][:, 0]) == {12}
        and arrays_read["offsets"][-1, 0] == (cells >= 0).sum()
    )
    teeth = arrays(tmp_path / "out" / "teeth.vtu")
    assert len(teeth["Points"]) == face.sizes["arch_point"]
    corners = np.concatenate([arch.points[arch.triangles] for arch in arches_of(face)])
    np.testing.assert_array_equal(
        teeth["Points"][teeth["connectivity"][:, 0]], corners.reshape(-1, 3)
    )
    np.testing.assert_array_equal(teeth["offsets"][:, 0], 3 * np.arange(1, len(corners) + 1))
    assert "imulated by emgface" in (tmp_path / "out" / "simulated_0000.vtu").read_text()
    with pytest.raises(DataError, match="record all nodes of this face"):
        write_vtk(tmp_path, face, moved[:, :5], np.array([0.0, 0.04]))


def test_vtk_reads_what_was_written(face: xr.Dataset, tmp_path: Path) -> None:
    vtk = pytest.importorskip("vtkmodules.vtkIOXML", reason="VTK is not installed")
    rest = face["position"].values[None]
    write_vtk(tmp_path, face, rest, np.zeros(1))
    reader = vtk.vtkXMLUnstructuredGridReader()
    reader.SetFileName(str(tmp_path / "simulated_0000.vtu"))
    reader.Update()
    grid = reader.GetOutput()
    assert grid.GetNumberOfCells() == face.sizes["element"]
    assert grid.GetPoint(7) == pytest.approx(rest[0, 7])
