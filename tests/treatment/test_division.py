"""Division of the pieces of a cut surface, and area of a suture."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from emgface.treatment.plane import triangulated
from emgface.treatment.treat import _wall_area


def triangulations(i: int, j: int) -> list[list[tuple[int, int, int]]]:
    """All divisions of the convex polygon with the vertices i to j into triangles."""
    return [[]] if j - i < 2 else [
        [(i, k, j), *first, *second]
        for k in range(i + 1, j) for first in triangulations(i, k) for second in triangulations(k, j)
    ]  # fmt: skip


def quality(x: np.ndarray) -> float:
    """Area of a triangle over the sum of its squared edges."""
    a, b = x[1] - x[0], x[2] - x[0]
    return 0.5 * (a[0] * b[1] - a[1] * b[0]) / float(((x - np.roll(x, 1, axis=0)) ** 2).sum())


@pytest.mark.parametrize("n", [5, 6])
def test_no_other_division_has_a_better_worst_triangle(n: int) -> None:
    rng = np.random.default_rng(n)
    for _ in range(20):
        angle = np.sort(rng.uniform(0.0, 2.0 * np.pi, n))
        x = np.column_stack([2.0 * np.cos(angle), np.sin(angle)])
        surface: Any = SimpleNamespace(flat=x)
        worst = min(quality(x[part]) for part in triangulated(surface, list(range(n))))
        best = max(min(quality(x[list(t)]) for t in each) for each in triangulations(0, n - 1))
        assert worst == pytest.approx(best, rel=1e-6)


def test_the_area_of_a_suture_is_that_of_faces_between_two_elements() -> None:
    """Of two cubes one on the other; a face with sutured nodes of one element alone does not count."""
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    position = 1e-2 * np.array([[*xy, z] for z in range(3) for xy in square])
    cubes = np.array([np.arange(8), np.arange(4, 12)])
    nodes = np.arange(4, 12)  # those between the cubes, and those on top
    wound: Any = SimpleNamespace(connectivity=cubes, pairs=np.column_stack([nodes, nodes]))
    assert _wall_area(position, wound, np.arange(12)) == pytest.approx(1e-4)
