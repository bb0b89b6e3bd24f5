"""The picture of a face: what it holds and how it fails."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from matplotlib import image

from emgface.errors import FaceError
from emgface.face.drawing import LINING, SKIN, VERMILION, VIEWS, coloured_parts
from emgface.face.show import draw_face, face_figure
from emgface.face.surface import boundary_faces
from emgface.face.template import template_face
from emgface.muscles import MODELLED


def test_figure_says_what_it_shows() -> None:
    figure = face_figure(template_face(resolution="coarse"))
    assert len(figure.axes) == 2 * len(VIEWS)
    assert "generated" in figure.get_suptitle()
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert [label.split()[0] for label in labels if label.split()[0] in MODELLED] == list(MODELLED)
    assert any(label.startswith("fixed to mandible") for label in labels)
    assert "lip markers" in labels and "face markers" in labels


def test_imported_face_says_so(reference_face: xr.Dataset) -> None:
    figure = face_figure(reference_face)
    assert "imported" in figure.get_suptitle()
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert "fixed to mandible (322 of 1052 fixed nodes)" in labels


def test_picture_is_written_in_the_chosen_format(tmp_path: Path) -> None:
    face = template_face(resolution="coarse")
    path = draw_face(face, tmp_path / "new" / "face.png", dpi=50)
    pixels = image.imread(path)
    assert pixels.shape[:2] == (525, 700)
    # Skin covers a good part of the page.
    assert np.mean(np.ptp(pixels[..., :3], axis=2) > 0.08) > 0.03
    assert draw_face(face, tmp_path / "face.pdf").read_bytes().startswith(b"%PDF")


def test_colours_cover_the_boundary_once() -> None:
    for face, colours in (
        (template_face(resolution="coarse"), {SKIN, VERMILION, LINING}),
        (template_face(resolution="coarse").drop_dims(["facet", "surface"]), {SKIN}),
    ):
        parts = coloured_parts(face)
        drawn = np.sort(np.concatenate([nodes for nodes, _ in parts]), axis=1)
        every = np.sort(boundary_faces(face["connectivity"].values)[0], axis=1)
        assert len(np.unique(drawn, axis=0)) == len(drawn) == len(every)
        assert {colour for nodes, colour in parts if len(nodes)} >= colours


def test_unknown_format_and_unwritable_place(tmp_path: Path) -> None:
    face = template_face(resolution="coarse")
    with pytest.raises(FaceError, match="no known picture format"):
        draw_face(face, tmp_path / "face.doc")
    (tmp_path / "file").write_text("")
    with pytest.raises(FaceError, match="cannot be written"):
        draw_face(face, tmp_path / "file" / "face.png")
