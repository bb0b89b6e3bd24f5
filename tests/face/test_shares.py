"""Fraction of an element filled by a muscle: closed forms, and the same muscle on other meshes."""

import numpy as np
import pytest

from emgface.errors import FaceError
from emgface.face.quality import element_quality
from emgface.face.shares import shares_within
from tests.bodies import grid

AXIS = np.array([[-1.0, 0.021, 0.019], [0.5, 0.021, 0.019], [2.0, 0.021, 0.019]])


def block(cells: tuple[int, int, int], skew: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """A block of 60 x 40 x 40 mm whose inner nodes are displaced."""
    mesh = grid(cells, (0.06, 0.04, 0.04))
    x = mesh.X.copy()
    x[:, 1] += skew * np.sin(np.pi * x[:, 1] / 0.04) * np.sin(np.pi * x[:, 0] / 0.06)
    x[:, 2] += skew * np.sin(np.pi * x[:, 2] / 0.04) * np.cos(np.pi * x[:, 0] / 0.06)
    return x, mesh.blocks[0].nodes


@pytest.mark.parametrize("cells", [(3, 2, 2), (5, 4, 3), (12, 9, 8)])
@pytest.mark.parametrize("skew", [0.0, 4e-3])
def test_the_shares_add_up_to_the_tube(cells: tuple[int, int, int], skew: float) -> None:
    position, connectivity = block(cells, skew)
    share = shares_within(position, connectivity, [AXIS], 8e-3)
    assert ((share >= 0) & (share <= 1)).all()
    volume = element_quality(position, connectivity).volume
    assert share @ volume == pytest.approx(np.pi * 8e-3**2 * 0.06, rel=0.01)


def test_a_ball_round_a_short_fibre() -> None:
    position, connectivity = block((6, 5, 5))
    fibre = np.array([[0.0299, 0.02, 0.02], [0.0301, 0.02, 0.02]])
    share = shares_within(position, connectivity, [fibre], 0.012)
    volume = element_quality(position, connectivity).volume
    exact = 4.0 / 3.0 * np.pi * 0.012**3 + np.pi * 0.012**2 * 0.0002
    assert share @ volume == pytest.approx(exact, rel=0.01)


def test_all_none_and_a_finer_division() -> None:
    position, connectivity = block((5, 4, 4), 2e-3)
    assert (shares_within(position, connectivity, [AXIS], 1.0) == 1.0).all()
    assert (shares_within(position, connectivity, [AXIS + 0.5], 1e-3) == 0.0).all()
    rough = shares_within(position, connectivity, [AXIS], 6e-3)
    close = shares_within(position, connectivity, [AXIS], 6e-3, spacing=0.4e-3)
    np.testing.assert_allclose(rough, close, atol=0.02)


def test_impossible_lengths() -> None:
    position, connectivity = block((2, 2, 2))
    with pytest.raises(FaceError, match="the muscle radius is 0.0 m"):
        shares_within(position, connectivity, [AXIS], 0.0)
    with pytest.raises(FaceError, match="the spacing of the samples is -1.0 m"):
        shares_within(position, connectivity, [AXIS], 1e-3, spacing=-1.0)
