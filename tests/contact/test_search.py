"""Search compared with all pairs of points and faces, and with SciPy."""

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.spatial import ConvexHull

import sim
from sim._kernels import triangles as kernel
from sim.contact.search import (
    CachedByPositions,
    Candidates,
    SignedFaces,
    closest_faces,
    crossed_faces,
    nearest_faces,
)
from tests.bodies import grid, rotation
from tests.contact.scenes import entered_by, point_triangle


def hull(n, seed):
    """Convex polyhedron around the origin, its triangles seen from outside."""
    x = np.random.default_rng(seed).normal(size=(n, 3))
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    triangles = ConvexHull(x).simplices.astype(np.int64)
    a, b, c = (x[triangles[:, i]] for i in range(3))
    away = np.einsum("mi,mi->m", np.cross(b - a, c - a), a + b + c) < 0
    triangles[away] = triangles[away][:, ::-1]
    return x, triangles


def test_distances_against_scipy():
    """Random triangles, also flat ones, against constrained minimisation."""
    rng = np.random.default_rng(0)
    for _ in range(60):
        p, t = rng.normal(size=3), rng.normal(size=(3, 3))
        distance, weight = point_triangle(p, t)
        assert np.isclose(np.linalg.norm(weight @ t - p), distance, rtol=1e-12)
        best = minimize(
            lambda w, p=p, t=t: ((np.array([1 - w[0] - w[1], *w]) @ t - p) ** 2).sum(),
            [0.3, 0.3],
            bounds=[(0, 1)] * 2,
            constraints={"type": "ineq", "fun": lambda w: 1 - w[0] - w[1]},
            method="SLSQP",
            options={"ftol": 1e-15},
        ).fun
        assert distance <= np.sqrt(best) * (1 + 1e-12) and np.isclose(
            distance, np.sqrt(best), atol=1e-6
        )


def test_nearest_faces_are_those_of_brute_force_on_1000_configurations():
    rng = np.random.default_rng(1)
    weight = np.zeros(3)
    for case in range(1000):
        n, m = rng.integers(1, 9), rng.integers(1, 13)
        x, p = rng.normal(size=(8, 3)), rng.normal(size=(n, 3))
        triangles = np.array([rng.permutation(8)[:3] for _ in range(m)])
        nodes = rng.integers(-1, 8, size=n)
        own = nodes >= 0
        p[own] = x[nodes[own]]
        radius = rng.choice([0.3, 1.0, np.inf])
        nearest = nearest_faces(p, radius, x, triangles, nodes=nodes)
        for i in range(n):
            d = np.array(
                [
                    np.inf
                    if nodes[i] in t
                    else kernel.point_triangle(p[i], x[t[0]], x[t[1]], x[t[2]], weight)[0]
                    for t in triangles
                ]
            )
            at = np.flatnonzero(nearest.point == i)
            if d.min() < radius**2:
                # Any of several faces with a common nearest point is valid.
                assert d[nearest.face[at[0]]] == pytest.approx(d.min(), rel=1e-12), case
                assert nearest.value[at[0]] ** 2 == pytest.approx(d.min(), rel=1e-12)
            else:
                assert len(at) == 0, case


def first_entry(p0, p1, x0, x1, triangle, t):
    """Instant of the first entry through the front by sampling: (instant, clearance from the sides)."""
    a, b, c = (x0[k] + t[:, None] * (x1[k] - x0[k]) - p0 - t[:, None] * (p1 - p0) for k in triangle)
    n = np.cross(b - a, c - a)
    front = -np.einsum("ti,ti->t", a, n)
    sides = [np.einsum("ti,ti->t", np.cross(u, v), n) for u, v in ((a, b), (b, c), (c, a))]
    clearance = np.min(sides, axis=0) / np.einsum("ti,ti->t", n, n)
    into = np.flatnonzero((front[:-1] > 0) & (front[1:] <= 0) & (clearance[:-1] > -0.02))
    return (t[into[0]], clearance[into[0]]) if len(into) else (2.0, 1.0)


def test_entered_faces_are_those_of_brute_force_on_1000_configurations():
    """Brute force: sign changes of the volume of point and face at 2000 instants, for each face.

    Cases in which a point passes very close to an edge are omitted.
    """
    rng = np.random.default_rng(2)
    t = np.linspace(0.0, 1.0, 2001)
    entered = compared = 0
    triangles = np.array([[0, 1, 2], [3, 4, 5], [0, 2, 4]])
    while compared < 1000:
        x0, p0 = rng.normal(size=(6, 3)), 0.3 * rng.normal(size=(1, 3))
        moves = rng.choice([0.3, 2.0])
        x1, p1 = (y + rng.normal(size=y.shape) * moves for y in (x0, p0))
        if compared % 3 == 0:
            x1 = x0  # a shell at rest
        sampled = [first_entry(p0[0], p1[0], x0, x1, nodes, t) for nodes in triangles]
        if min(clearance for _, clearance in sampled) < 0.02:
            continue
        compared += 1
        best, which = min((when, f) for f, (when, _) in enumerate(sampled))
        crossings = entered_by(p0, p1, x0, x1, triangles)
        assert len(crossings.point) == (best < 2.0)
        if best < 2.0:
            assert crossings.value[0] == pytest.approx(best, abs=1e-3)
            assert crossings.face[0] == which
            entered += 1
    assert entered > 100  # sufficient number of cases


def bumpy_sheet(rng):
    """Some hundred small faces of various sizes, and two that span all of them."""
    sheet = grid((20, 15, 1), (1.0, 0.7, 0.3)).X - [0.5, 0.35, 0.15]
    x = np.r_[sheet + 0.01 * rng.normal(size=sheet.shape), [[-2.0, -2, 0], [3, -2, 0.5], [0, 4, 0]]]
    near = np.argsort(((sheet[:, None] - sheet) ** 2).sum(axis=2), axis=1)[:, 1:9]
    fans = np.c_[np.arange(len(sheet)), rng.permuted(near, axis=1)[:, :2]]
    last = len(sheet) + np.arange(3)
    wide = [last, last[::-1]]
    return x, np.r_[fans, wide].astype(np.int64)


@pytest.mark.parametrize("radius", [0.0, 0.03, 0.5, np.inf])
def test_search_among_many_faces_is_that_of_brute_force(radius):
    rng = np.random.default_rng(7)
    x, triangles = bumpy_sheet(rng)
    p = rng.uniform([-0.6, -0.5, -0.5], [0.6, 0.5, 0.5], size=(150, 3))
    p[:20] = x[:20]
    nodes = np.r_[np.arange(20), np.full(130, -1)]
    nearest = nearest_faces(p, radius, x, triangles, nodes=nodes)
    weight, expected = np.zeros(3), {}
    for i in range(len(p)):
        for f, t in enumerate(triangles):
            d = kernel.point_triangle(p[i], x[t[0]], x[t[1]], x[t[2]], weight)[0]
            if nodes[i] not in t and d < min(radius**2, expected.get(i, (np.inf, 0))[0]):
                expected[i] = d, f
    np.testing.assert_array_equal(nearest.point, list(expected))
    np.testing.assert_allclose(nearest.value**2, [d for d, _ in expected.values()], rtol=1e-12)
    if len(nearest.point):
        assert (nearest.face == [f for _, f in expected.values()]).mean() > 0.95  # ties at corners


def test_entries_among_many_faces_are_those_of_each_face_alone():
    rng = np.random.default_rng(8)
    x0, triangles = bumpy_sheet(rng)
    x1 = x0 + 0.02 * rng.normal(size=x0.shape)
    before = rng.uniform([-0.6, -0.5, -0.5], [0.6, 0.5, 0.5], size=(200, 3))
    after = before + rng.normal(size=before.shape) * rng.choice([0.05, 0.5], size=(200, 1))
    crossings = entered_by(before, after, x0, x1, triangles)
    first = np.full(len(before), np.inf)
    for face in triangles:
        alone = entered_by(before, after, x0, x1, face[None])
        first[alone.point] = np.minimum(first[alone.point], alone.value)
    np.testing.assert_array_equal(crossings.point, np.flatnonzero(first < np.inf))
    np.testing.assert_array_equal(crossings.value, first[crossings.point])
    assert 20 < len(crossings.point) < 160


def test_a_search_ends_if_positions_are_not_numbers():
    x, triangles = bumpy_sheet(np.random.default_rng(9))
    p = np.array([[np.nan, 0.0, 0.0], [0.1, 0.1, 0.0]])
    assert 0 not in nearest_faces(p, 1.0, x, triangles).point
    for node in (*triangles[0], *triangles[-1], 5):
        for nothing in (np.nan, np.inf, -np.inf):
            bad = x.copy()
            bad[node, node % 3] = nothing
            nearest = nearest_faces(p, 1.0, bad, triangles).point
            assert 0 not in nearest
            assert 1 in nearest or np.isinf(nothing)  # despite the NaN
            entered_by(p, p + 1.0, x, bad, triangles)
    entered_by(p, p + 1.0, x, x + 0.1, triangles)
    assert len(nearest_faces(p, 1.0, x * np.nan, triangles).point) == 0


def test_listed_faces_give_the_bits_of_a_search_at_every_position():
    """Points and faces that walk, jump once and change their radii."""
    rng = np.random.default_rng(11)
    x, triangles = bumpy_sheet(rng)
    p = rng.uniform([-0.5, -0.4, -0.1], [0.5, 0.4, 0.1], size=(150, 3))
    p[:20], nodes = x[:20], np.r_[np.arange(20), np.full(130, -1)]
    away = np.tile([0.0, 0.0, 1.0], (150, 1))
    for directions in (np.empty((0, 3)), away):
        lists = [Candidates(triangles, nodes, s, every=len(directions) > 0) for s in (0.0, 0.05)]
        q, y = p, x
        for step in range(40):
            size = 0.3 if step == 20 else 0.002
            q1, y1 = q + size * rng.normal(size=p.shape), y + 0.001 * rng.normal(size=x.shape)
            radius = rng.uniform(0.01, 0.05, size=150) if step % 5 else np.inf
            one, two = (closest_faces(q1, radius, y1, triangles, n, directions) for n in lists)
            for name in ("point", "face", "weight", "value", "feature"):
                np.testing.assert_array_equal(getattr(one, name), getattr(two, name))
            one, two = (crossed_faces(q, q1, y, y1, triangles, n) for n in lists)
            for name in ("point", "face", "weight", "value"):
                np.testing.assert_array_equal(getattr(one, name), getattr(two, name))
            q, y = q1, y1
        assert lists[1].searches < lists[0].searches / 3


def test_results_are_kept_for_the_latest_positions():
    calls = []
    recent = CachedByPositions(lambda x: calls.append(1) or x.sum(), 2)
    a, b, c = np.ones(3), np.zeros(3), np.full(3, 2.0)
    assert [recent(y) for y in (a, b, a, b)] == [3.0, 0.0, 3.0, 0.0]
    assert len(calls) == 2
    recent(c)
    assert recent(a) == 3.0
    assert len(calls) == 4  # a was no longer cached
    a[0] = 5.0
    assert recent(a) == 7.0


def test_signed_distance_against_half_spaces():
    """A convex polyhedron is the intersection of the half-spaces of its faces."""
    x, triangles = hull(40, 3)
    shell = sim.RigidShell(x, triangles)
    p = np.random.default_rng(4).normal(size=(500, 3)) * 0.7
    normal = np.cross(
        x[triangles[:, 1]] - x[triangles[:, 0]], x[triangles[:, 2]] - x[triangles[:, 0]]
    )
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    planes = np.einsum("mi,nmi->nm", normal, p[:, None] - x[triangles[:, 0]])
    within = (planes < 0).all(axis=1)
    assert 50 < within.sum() < 450
    faces = SignedFaces(shell)
    nearest = nearest_faces(p, np.inf, x, triangles)
    gap, out = faces.signed(p, nearest, x)
    np.testing.assert_array_equal(gap < 0, within)
    np.testing.assert_allclose(gap[within], planes[within].max(axis=1), rtol=0, atol=1e-12)
    # the direction is the gradient of the gap
    moved, step = p + 1e-6 * out, 1e-6
    more, _ = faces.signed(moved, nearest_faces(moved, np.inf, x, triangles), x)
    np.testing.assert_allclose((more - gap) / step, 1.0, rtol=0, atol=1e-3)


def test_a_thin_sheet_crossed_in_one_step_is_entered_once():
    """A plate 0.1 mm thick, crossed by 10 mm in one step, straight, at an edge and at a corner."""
    plate = grid((2, 2, 1), (0.02, 0.02, 1e-4))
    sheet = sim.boundary_surface(plate)
    for x, y in ((0.003, 0.004), (0.005, 0.005), (0.01, 0.01), (0.01, 0.002)):
        p0, p1 = np.array([[x, y, 0.005]]), np.array([[x, y, -0.005]])
        crossings = entered_by(p0, p1, plate.X, plate.X, sheet.triangles)
        assert crossings.first().value == pytest.approx([0.49], rel=1e-9)
        # equivalently, the sheet passes the point
        R = rotation(2)
        crossings = entered_by(
            p0 @ R, p0 @ R, plate.X @ R, plate.X @ R + np.array([0, 0, 0.01]) @ R, sheet.triangles
        )
        assert crossings.first().value == pytest.approx([0.49], rel=1e-9)
    away = entered_by(p1, p1 - [0, 0, 0.01], plate.X, plate.X, sheet.triangles)
    assert len(away.point) == 0
