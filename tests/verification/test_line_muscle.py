"""Line muscles compared with closed forms: one fibre in a cube, momentum, embedding, strings, errors."""

import numpy as np
import pytest

import sim
from sim.elements import ELEMENT_TYPES
from tests.bodies import boundary, free_components, grid, rotation

UNIT = sim.mesh_from_arrays(ELEMENT_TYPES["hex8"].corners * 0.5 + 0.5, hex8=[range(8)])


def with_lines(mesh, fibres, law=None, names=("line",), **more):
    lines = sim.LineMuscles(names, fibres, law or sim.ConstantForce(2.0), **more)
    system = sim.compile_scene(sim.Scene(mesh, (sim.Solid(), lines)))
    return system, sim.compile_scene(sim.Scene(mesh, (sim.Solid(),)))


def line_force(mesh, fibres, q=None, activation=1.0, **more):
    """Difference of the forces with and without lines."""
    with_them, without = with_lines(mesh, fibres, **more)
    q = mesh.X if q is None else q
    level = with_them.control(np.full(len(with_them.muscles), activation))
    return with_them.force(q, level).f - without.force(q, without.control(np.zeros(0))).f


def test_a_single_fibre_in_a_unit_cube_pulls_its_ends_together():
    """Points (0.25, 0.5, 0.5) and (0.75, 0.5, 0.5), 2 N at 0.7: weights are 3/16 and 1/16."""
    ends = np.array([[0.25, 0.5, 0.5], [0.75, 0.5, 0.5]])
    f = line_force(UNIT, (sim.LineFibre(0, ends),), activation=0.7)
    near = UNIT.X[:, 0] == 0.0
    expected = np.zeros((8, 3))
    # 3/16 of the force at its own end minus 1/16 of the other
    expected[near, 0] = 1.4 * (3 - 1) / 16
    expected[~near, 0] = -1.4 * (3 - 1) / 16
    np.testing.assert_allclose(f, expected, rtol=0, atol=1e-15)


@pytest.mark.parametrize("law", [sim.ConstantForce(2.0, 0.1), sim.Peck(2.0)])
def test_internal_fibres_keep_momentum_and_turn_with_the_body(law):
    mesh = grid((3, 2, 2), wedges=(1,), distort=0.2)
    rng = np.random.default_rng(2)
    points = rng.uniform(0.15, 0.85, (5, 3)) * mesh.X.max(axis=0)
    fibres = (sim.LineFibre(0, points), sim.LineFibre(0, np.array([0, 5, 20])))
    q = mesh.X + rng.normal(size=mesh.X.shape) * 5e-4
    Q = rotation(1)
    here = line_force(mesh, fibres, q, law=law)
    there = line_force(mesh, fibres, q @ Q.T + 0.2, law=law)
    size = np.abs(here).sum()
    assert np.abs(here.sum(axis=0)).max() < 1e-14 * size
    assert np.abs(np.cross(q, here).sum(axis=0)).max() < 1e-14 * size * 0.02
    assert np.abs(there - here @ Q.T).max() < 1e-12 * np.abs(here).max()


def test_points_embedded_at_nodes_are_those_nodes_to_rounding():
    mesh = grid((2, 2, 2), distort=0.25, wedges=(0,))
    nodes = np.array([0, 13, 26, 25])
    q = mesh.X + np.random.default_rng(0).normal(size=mesh.X.shape) * 5e-4
    edge = line_force(mesh, (sim.LineFibre(0, nodes),), q, law=sim.Peck(2.0))
    inside = line_force(mesh, (sim.LineFibre(0, mesh.X[nodes]),), q, law=sim.Peck(2.0))
    np.testing.assert_allclose(inside, edge, rtol=0, atol=1e-12)


@pytest.mark.parametrize("kind", ELEMENT_TYPES.values(), ids=lambda kind: kind.name)
def test_embedding_finds_the_point_that_the_map_gives(kind):
    """Points mapped from known natural coordinates of a distorted element are recovered."""
    rng = np.random.default_rng(3)
    X = kind.corners + rng.normal(size=kind.corners.shape) * 0.08
    mesh = sim.mesh_from_arrays(X, **{kind.name: [range(kind.n_nodes)]})
    share = rng.dirichlet(np.ones(kind.n_nodes), 40)
    N, _ = kind.shape(share @ kind.corners)
    embedded = sim.embed(mesh, N @ X)
    np.testing.assert_allclose(embedded.weights[:, : kind.n_nodes], N, rtol=0, atol=1e-12)
    assert (embedded.weights[:, kind.n_nodes :] == 0.0).all() and (embedded.element == 0).all()


def test_the_force_on_a_via_point_is_along_the_bisector():
    """At a right angle the force on the via point is along the bisector, for any lengths of the legs."""
    mesh = grid((2, 2, 1), (0.02, 0.04, 0.01))
    corner, along, across = 0, 12, 2
    f = line_force(mesh, (sim.LineFibre(0, np.array([along, corner, across])),))
    np.testing.assert_allclose(f[corner], [2.0, 2.0, 0.0], atol=1e-15)
    np.testing.assert_allclose(f[along], [-2.0, 0.0, 0.0], atol=1e-15)
    np.testing.assert_allclose(f[across], [0.0, -2.0, 0.0], atol=1e-15)


def test_tension_stiffens_a_line_in_the_perpendicular_direction():
    """A taut string of two segments of length l has the perpendicular stiffness 2 F/l and no other."""
    mesh = grid((2, 1, 1), (0.02, 0.01, 0.01))
    with_them, without = with_lines(mesh, (sim.LineFibre(0, np.array([0, 4, 8])),))
    stiffness = []
    for system in (with_them, without):
        K = system.tangent(mesh.X, system.control(np.ones(len(system.muscles))))[1]
        stiffness.append(K[system.pattern.diagonal[12:15]])
    np.testing.assert_allclose(stiffness[0] - stiffness[1], [0, 400, 400], rtol=1e-12, atol=1e-10)


def test_peck_follows_its_formula():
    """L = 1.2 L_rest, tendon 0.2: n = 1.25, f = 1/2; p = 0.2/0.5."""
    law = sim.Peck(10.0, stretch_max=1.5, tendon_ratio=0.2, passive_fraction=0.015)
    _, F, _ = law.evaluate(np.array([0.12]), np.array([0.1]), np.array([0.6]))
    np.testing.assert_allclose(F, 10.0 * (0.6 * 0.5 + 0.015 * 0.4), rtol=1e-14)


def test_a_line_contracts_a_block_to_the_static_equilibrium():
    """In equilibrium the virtual work of the line equals that of the tissue."""
    mesh = grid((2, 2, 2))
    fixed = sim.Fixed(np.flatnonzero(mesh.X[:, 0] == 0.0))
    fibre = sim.LineFibre(0, np.array([[0.001, 0.009, 0.01], [0.011, 0.01, 0.009], [0.019] * 3]))
    lines = sim.LineMuscles(("m",), (fibre,), sim.ConstantForce(0.4))
    system = sim.compile_scene(sim.Scene(mesh, (sim.Solid(), lines), (fixed,)))
    _, state = sim.simulate(
        system,
        sim.Activation(np.array([0.0, 1.0]), np.array([[0.0], [1.0]])),
        duration=1.0,
        integrator=sim.Static(),
        steps=sim.HalvingStep(0.5),
    )
    f = system.force(state.q, system.control(np.ones(1))).f
    assert np.abs(free_components(system, f)).max() < 2e-6
    assert 1e-3 < np.abs(state.q - mesh.X).max() < 1e-2
    far = np.setdiff1d(boundary(mesh), fixed.nodes)
    assert (state.q - mesh.X)[far, 0].mean() < -3e-4


def test_invalid_lines_are_refused_by_name():
    mesh = grid()
    line = sim.LineFibre(0, np.array([0, 1]))
    with pytest.raises(sim.MeshError, match="point 1 at .* lies in no element"):
        line_force(mesh, (sim.LineFibre(0, np.array([[0.01] * 3, [0.03] * 3])),))
    with pytest.raises(sim.MeshError, match="point 0 to embed is not finite"):
        sim.embed(mesh, np.full((1, 3), np.nan))
    with pytest.raises(sim.SceneError, match=r"refers to node 99, expected 0\.\.26"):
        line_force(mesh, (sim.LineFibre(0, np.array([0, 99])),))
    with pytest.raises(sim.SceneError, match="muscle line has two successive points"):
        line_force(mesh, (sim.LineFibre(0, np.array([3, 3])),))
    with pytest.raises(sim.SceneError, match="has 1 point, expected at least two"):
        sim.LineFibre(0, np.array([0]))
    with pytest.raises(sim.SceneError, match=r"shape \(2, 2\)"):
        sim.LineFibre(0, np.zeros((2, 2)))
    with pytest.raises(sim.SceneError, match="share = -1"):
        sim.LineFibre(0, np.array([0, 1]), share=-1)
    with pytest.raises(sim.SceneError, match="line muscle b has no fibre"):
        sim.LineMuscles(("a", "b"), (line,))
    with pytest.raises(sim.SceneError, match="refers to muscle 1"):
        sim.LineMuscles(("a",), (line, sim.LineFibre(1, np.array([0, 1]))))
    with pytest.raises(sim.SceneError, match="2 line laws for 1"):
        sim.LineMuscles(("a",), (line,), (sim.Peck(), sim.Peck()))
    with pytest.raises(sim.SceneError, match="stiffness = -1"):
        sim.LineMuscles(("a",), (line,), stiffness=-1)
    with pytest.raises(sim.SceneError, match="Peck: tendon_ratio = 1.0"):
        sim.Peck(tendon_ratio=1.0)
    with pytest.raises(sim.SceneError, match="ConstantForce: force_max"):
        sim.ConstantForce(-1.0)
