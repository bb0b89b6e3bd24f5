"""Rendered faces, drawn from labelled data."""

import numpy as np
import pytest
import xarray as xr

from analysis.errors import FigureError
from analysis.figures import rendered_faces


def bowl() -> xr.Dataset:
    """A square bump of nodes seen from the front, under two instructions and three strategies."""
    n = 5
    u, w = np.meshgrid(np.linspace(-1, 1, n), np.linspace(-1, 1, n))
    rest = 0.03 * np.stack([u.ravel(), 0.3 * (2 - u.ravel() ** 2 - w.ravel() ** 2), w.ravel()], 1)
    corner = np.arange(n * n).reshape(n, n)
    a, b, c, d = (corner[i : n - 1 + i, j : n - 1 + j].ravel() for i, j in
                  ((0, 0), (0, 1), (1, 1), (1, 0)))  # fmt: skip
    position = np.broadcast_to(rest, (2, 3, n * n, 3)).copy()
    position[1, 2] = np.nan
    return xr.Dataset(
        {
            "position": (("instruction", "strategy", "node", "axis"), position, {"units": "m"}),
            # From +y the x axis points left: this order is counter-clockwise from outside.
            "triangle": (
                ("triangle", "corner"),
                np.concatenate([np.stack([a, c, b], 1), np.stack([a, d, c], 1)]),
            ),
            "simulated": (
                ("instruction", "strategy", "marker", "axis"),
                position[:, :, [6, 8]],
                {"units": "m"},
            ),
        },
        coords={"instruction": ["B", "E"], "strategy": ["act_all", "act_3", "act_rel"]},
        attrs={"origin": "simulated"},
    )


def test_every_instruction_and_strategy_has_its_face() -> None:
    figure = rendered_faces(bowl())
    assert len(figure.axes) == 6 and "simulated recordings" in figure.get_suptitle()
    assert [panel.get_title() for panel in figure.axes[:2]] == ["B", "E"]
    assert [panel.get_ylabel() for panel in figure.axes[::2]] == ["act_all", "act_3", "act_rel"]
    drawn = [len(panel.collections) for panel in figure.axes]
    assert drawn == [1, 1, 1, 1, 1, 0]
    assert figure.axes[5].texts[0].get_text() == "none"
    # All 32 triangles of the bump look at the viewer; turned inside out, none does.
    assert len(figure.axes[0].collections[0].get_paths()) == 32
    turned = bowl()
    turned["triangle"] = turned["triangle"][:, ::-1]
    assert len(rendered_faces(turned).axes[0].collections[0].get_paths()) == 0


def test_the_subjects_right_is_on_the_left() -> None:
    low, high = rendered_faces(bowl()).axes[0].get_xlim()
    assert low > high


def test_the_picture_is_of_the_lips() -> None:
    """Two markers 30 mm apart, at x = -15 and 15: the picture is 1.9 times as wide."""
    high, low = rendered_faces(bowl()).axes[0].get_xlim()
    np.testing.assert_allclose([low, high], [-28.5, 28.5])
    high, low = rendered_faces(bowl().drop_vars("simulated")).axes[0].get_xlim()
    np.testing.assert_allclose([low, high], [-30.0, 30.0])


def test_light_from_above() -> None:
    """The upper half of a bump is brighter than the lower."""
    collection = rendered_faces(bowl()).axes[0].collections[0]
    height = [path.vertices[:3, 1].mean() for path in collection.get_paths()]
    bright = collection.get_facecolor()[:, :3].sum(axis=1)
    assert np.corrcoef(height, bright)[0, 1] > 0.8


def test_faces_that_cannot_be_drawn() -> None:
    with pytest.raises(FigureError, match="expected position with dims"):
        rendered_faces(bowl().drop_vars("position"))
    gone = bowl()
    gone["position"] = (gone["position"] * np.nan).assign_attrs(units="m")
    with pytest.raises(FigureError, match="every trial lacks a simulation"):
        rendered_faces(gone)
    with pytest.raises(FigureError, match="in 'mm', expected 'm'"):
        rendered_faces(bowl().assign(position=bowl()["position"].assign_attrs(units="mm")))
