"""Figures of faces: contents, labels and errors."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from matplotlib import image

from analysis.figures.style import title_of
from emgface.errors import DataError
from emgface.muscles import MODELLED
from emgface.pictures.body import body_of, skin_of
from emgface.pictures.stills import face_figure, states_figure, write_figure
from emgface.report.faces import study_faces


def test_face_with_muscles(face: xr.Dataset, tmp_path: Path) -> None:
    figure = face_figure(face.assign_attrs(origin="imported", name="reference"))
    assert len(figure.axes) == 6 and title_of(figure).startswith("reference (imported")
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert [one.split()[0] for one in labels if one.split()[0] in MODELLED] == list(MODELLED)
    assert any(one.startswith("fixed to mandible") for one in labels)
    assert "lip markers" in labels and "face markers" in labels
    path = write_figure(figure, tmp_path / "new" / "face.png", dpi=50)
    upper, lower = np.array_split(image.imread(path)[..., :3], 2, axis=0)
    front = upper[:, : upper.shape[1] // 3]
    red = (front[..., 0] > 1.5 * front[..., 1]) & (front[..., 0] > 0.3)
    assert 0.003 < red.mean() < 0.05, "the red of the lips"
    green = lower[..., 1] > 1.3 * np.maximum(lower[..., 0], lower[..., 2])
    assert green.mean() > 0.001, "the levator of the upper lip and the wing"


def test_states_differ_where_the_face_has_moved(face: xr.Dataset, tmp_path: Path) -> None:
    rest = face["position"].values
    shown = {"rest": rest, "raised": rest + [0.0, 0.0, 4e-3] * (rest[:, 2:] > 0.0)}
    figure = states_figure(
        face, shown, title="simulated", views=("front",), displacement=True, lips=True
    )
    panels = [axes for axes in figure.axes if axes.images]
    assert len(panels) == 2 and len(figure.axes) == 3, "two states and the scale"
    first, second = (panel.images[0].get_array() for panel in panels)
    assert np.abs(first.astype(float) - second).max() > 60
    assert image.imread(write_figure(figure, tmp_path / "states.png", dpi=40)).std() > 0.05


def study(face: xr.Dataset) -> tuple[xr.Dataset, np.ndarray]:
    skin = skin_of(face)
    rest = face["position"].values[skin.node]
    position = np.tile(rest, (2, 1, 1, 1))
    position[1] = np.nan
    lips = np.tile(face["position"].values[face["marker_node"].values], (2, 1, 1, 1))
    dims = ("instruction", "strategy")
    faces = xr.Dataset(
        {
            "position": ((*dims, "node", "axis"), position),
            "simulated": ((*dims, "marker", "axis"), lips),
            "measured": ((*dims, "marker", "axis"), lips + 1e-3),
        },
        coords={"instruction": ["B", "E"], "strategy": ["act_all"]},
        attrs={"origin": "simulated", "world": "mismatched world"},
    )
    return faces, lips


def test_faces_of_a_study(face: xr.Dataset) -> None:
    faces, lips = study(face)
    figure = study_faces(faces, body_of(face))
    assert "simulated recordings, mismatched world" in title_of(figure)
    assert [axes.get_title() for axes in figure.axes] == ["B", "E"]
    assert len(figure.axes[0].images) == 1 and not figure.axes[1].images
    assert figure.axes[1].texts[-1].get_text() == "none"
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels == ["simulated by the face model", "simulated recording"]
    # The subject's left is on the right of the picture.
    drawn = figure.axes[0].lines[0].get_xdata()
    np.testing.assert_allclose(drawn, -1e3 * lips[0, 0, :, 0], atol=1e-9)


def test_unknown_format_and_unwritable_place(face: xr.Dataset, tmp_path: Path) -> None:
    from matplotlib.figure import Figure

    with pytest.raises(DataError, match=r"face.doc has no known picture format, expected one of"):
        write_figure(Figure(), tmp_path / "face.doc")
    (tmp_path / "file").write_text("")
    with pytest.raises(DataError, match="Cannot write"):
        write_figure(Figure(), tmp_path / "file" / "face.png")
