"""Chunks and colours of elements, positions in the matrix, and skipped elements."""

import numpy as np
import pytest

import sim
from sim.assembly import parts_of
from tests.bodies import crossed_muscles, dense, grid, solid_system
from tests.derivatives.test_terms import deformed, derivatives_agree

MESH = grid((9, 8, 6), (0.09, 0.08, 0.06), wedges=(3, 4, 20), distort=0.1)


@pytest.mark.parametrize("apart", [False, True])
def test_chunks_of_a_colour_have_no_common_node_and_contain_every_element_once(apart):
    mesh = MESH
    if apart:  # two bodies
        X = np.concatenate([mesh.X, mesh.X + 1.0])
        both = [np.concatenate([b.nodes, b.nodes + len(mesh.X)]) for b in mesh.blocks]
        mesh = sim.mesh_from_arrays(X, hex8=both[0], wedge6=both[1])
    parts = parts_of(mesh)
    for part in parts:
        assert part.chunk[-1] == len(part.element)
        assert part.colour[-1] == len(part.chunk) - 1
        for first, last in zip(part.colour[:-1], part.colour[1:], strict=True):
            chunks = [
                np.unique(part.nodes[part.chunk[c] : part.chunk[c + 1]]) for c in range(first, last)
            ]
            assert len(np.unique(np.concatenate(chunks))) == sum(map(len, chunks))
    assert len(parts[0].colour) == 3  # The test requires two colours.
    assert len(parts[0].chunk) > 3
    elements = np.sort(np.concatenate([part.element for part in parts]))
    np.testing.assert_array_equal(elements, np.arange(mesh.n_elements))


@pytest.mark.parametrize("volume", [None, sim.ElementVolume, sim.NodalVolume])
def test_partly_free_nodes_have_the_rows_of_the_free_body(volume):
    mesh, terms = grid((3, 2, 2), wedges=(1,)), () if volume is None else (volume(),)
    control = sim.Control(np.zeros(0))
    body = solid_system(mesh, terms=terms)
    fixed = sim.Fixed(np.arange(5, 14), axes=(1,)), sim.Fixed(np.array([0, 20, 30]), axes=(0, 2))
    system = solid_system(mesh, terms=terms, reductions=fixed)
    q = deformed(mesh=mesh, size=5e-4)
    whole = dense(body, body.tangent(q, control)[1])[np.ix_(system.free, system.free)]
    part = dense(system, system.tangent(q, control)[1])
    np.testing.assert_allclose(part, whole, atol=1e-14 * np.abs(whole).max())


def test_a_hexahedron_with_two_corners_in_one_node():
    X = grid((1, 1, 1)).X
    mesh = sim.mesh_from_arrays(np.delete(X, 7, axis=0), hex8=[[0, 4, 6, 2, 1, 5, 6, 3]])
    derivatives_agree(solid_system(mesh, muscles=crossed_muscles(mesh)), [0.3, 0.8])


@pytest.mark.parametrize("J", [1e-6, 0.03, 0.49, 0.51, 1.0, 1.49, 1.51, 30.0, 1e6])
def test_energy_of_large_changes_of_volume(J):
    """C10 (I1bar - 3) + C20 (I1bar - 3)^2 + kappa/2 (J - 1)^2, stretches in ratio 1 : 1 : 2."""
    mesh, law = grid((1, 1, 1)), sim.MooneyRivlin(2500.0, 1175.0)
    stretch = np.array([1.0, 1.0, 2.0]) * (J / 2.0) ** (1 / 3)
    x = (stretch @ stretch) / J ** (2 / 3) - 3.0
    expected = 2500.0 * x + 1175.0 * x * x + 0.5 * 25e3 * (J - 1.0) ** 2
    system = solid_system(mesh, law, sim.QuadraticBulk(25e3))
    energy = system.force(mesh.X * stretch, system.control(np.zeros(0))).energy
    assert energy == pytest.approx(expected * 0.02**3, rel=1e-13)


@pytest.mark.parametrize("law", [sim.MooneyRivlin(), sim.FiveTermMooneyRivlin()])
def test_resting_muscles_have_no_effect_and_active_ones_do(law):
    mesh = grid((2, 1, 1))
    bulk = sim.QuadraticBulk()
    muscles = crossed_muscles(mesh, sim.Blemker(40e3))
    bare, driven = (solid_system(mesh, law, bulk, m) for m in (None, muscles))
    still, rest, work = sim.Control(np.zeros(0)), driven.control(np.zeros(2)), np.array([0.0, 0.1])
    q = mesh.X * np.array([0.9, 0.9, 0.9])  # isochoric stretches are 1
    (without, K_without), (resting, K) = bare.tangent(q, still), driven.tangent(q, rest)
    np.testing.assert_array_equal(resting.f, without.f)
    np.testing.assert_array_equal(K, K_without)
    moved = driven.force(q, driven.control(work)).f - resting.f
    assert np.abs(moved).max() > 1e-3 * np.abs(resting.f).max()


def test_an_inverted_element_does_not_contribute_and_is_reported():
    mesh = grid((2, 1, 1))
    system = solid_system(mesh)
    q = mesh.X.copy()
    q[mesh.X[:, 0] == 0.02, 0] = 0.005  # the second of two cells is inverted
    tangent, K = system.tangent(q, system.control(np.zeros(0)))
    assert tangent.smallest_J < 0.0
    assert tangent.element == 1
    outer = np.repeat(mesh.X[:, 0] == 0.02, 3)
    assert not tangent.f.reshape(-1)[outer].any()
    assert not dense(system, K)[outer].any()
    q[mesh.X[:, 0] == 0.0] = np.nan
    assert np.isnan(system.force(q, system.control(np.zeros(0))).smallest_J)
