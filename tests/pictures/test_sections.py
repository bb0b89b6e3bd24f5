"""Sections through the midline and their picture."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from matplotlib.image import imread

from emgface.face.parts import arches_of
from emgface.pictures.sections import cut_section, draw_sections, midline_faces


def test_a_plane_cuts_a_tetrahedron_in_a_triangle() -> None:
    points = np.array([[-1, 0, 0], [1, 0, 0], [1, 2, 0], [1, 0, 2.0]])
    triangles = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    segments = cut_section(points, triangles)
    assert segments.shape == (3, 2, 2)
    ends = {tuple(end) for end in segments.reshape(-1, 2).round(12).tolist()}
    assert ends == {(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)}


def test_section_of_the_template(face: xr.Dataset, tmp_path: Path) -> None:
    rest = face["position"].values
    faces = midline_faces(face)
    rings = face.attrs["rings"]
    assert len(faces) == 2 * 3 * rings  # above and below the mouth, three layers
    for arch in arches_of(face):
        segments = cut_section(arch.points, arch.triangles)
        ends, counts = np.unique(segments.reshape(-1, 2).round(9), axis=0, return_counts=True)
        assert len(ends) > 10 and (counts % 2 == 0).all(), "the section of a closed body is closed"
    moved = rest + [0.0, 5e-3, 0.0]
    path = draw_sections(face, {"rest": rest, "moved": moved}, tmp_path / "s.png", title="t")
    picture = imread(path)
    left, right = np.array_split(picture[..., :3], 2, axis=1)
    assert picture.std() > 0.05 and np.abs(left[:, : right.shape[1]] - right).max() > 0.5
    assert picture.shape[1] == pytest.approx(110 * (3.4 * 2 + 0.4), abs=2)
