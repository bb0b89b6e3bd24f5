"""Pre-stress by both methods, and stress stiffening, compared with closed forms."""

from dataclasses import replace
from inspect import signature

import numpy as np
import pytest

import sim
from sim import IN_VIVO, initial_stretch, stretch_field
from sim.assembly import slots
from sim.terms import TERMS
from tests.bodies import (
    crossed_muscles,
    dense,
    free_components,
    grid,
    mean_stress,
    rotation,
    solid_system,
    tetrahedra,
)

C10, C20, KAPPA = 2500.0, 1175.0, 250e3  # softer bulk cannot bear the pressure of 89.4 kPa
TISSUE = sim.Material(sim.MooneyRivlin(C10, C20), sim.LogarithmicBulk(KAPPA))
MESH = grid((2, 2, 2), wedges=(0,), distort=0.1)
N = MESH.n_elements


def closed_form(stretch):
    """Principal Cauchy stresses of the Mooney-Rivlin law with logarithmic bulk."""
    J = np.prod(stretch)
    squares = J ** (-2 / 3) * np.asarray(stretch) ** 2
    slope = C10 + 2 * C20 * (squares.sum() - 3)
    return 2 / J * slope * (squares - squares.sum() / 3) + KAPPA * np.log(J) / J


@pytest.mark.parametrize("stress", [(IN_VIVO[0], 0, 0), (IN_VIVO[1], 0, 0), (40e3, 15.9e3, 0)])
def test_initial_stretch_gives_the_stress_of_the_closed_form(stress):
    stretch = initial_stretch(TISSUE, stress)
    np.testing.assert_allclose(closed_form(stretch), stress, rtol=0, atol=1e-6 * max(stress))
    assert (np.argsort(stretch) == np.argsort(stress, stable=True)).all() or stress[1] == 0


def prestressed(stress, axes):
    field = stretch_field(axes, initial_stretch(TISSUE, stress))
    F0 = np.repeat(field, N, axis=0)
    return sim.compile_scene(sim.Scene(MESH, (sim.Solid((TISSUE,), prestretch=F0),)))


@pytest.mark.parametrize("size", IN_VIVO)
def test_a_held_block_bears_exactly_the_prescribed_stress(size):
    """Along an oblique line t, sigma = size t t' at the mesh at rest."""
    axes = rotation(5)[None]
    P = mean_stress(prestressed((size, 0.0, 0.0), axes), np.eye(3), [])
    np.testing.assert_allclose(P, size * np.outer(axes[0, 0], axes[0, 0]), atol=1e-6 * size)


def free_across(slope, axis):
    """Stiffness along one axis without further stress along the others, from the tangent (3, 3)."""
    rest = np.delete(np.arange(3), axis)
    across = np.linalg.solve(slope[np.ix_(rest, rest)], slope[rest, axis])
    return slope[axis, axis] - slope[axis, rest] @ across


@pytest.mark.parametrize("size", IN_VIVO)
def test_tension_raises_the_stiffness_along_itself(size):
    """Stiffness along and across the line, compared with derivatives of the closed form."""
    axes, h = rotation(5)[None], 1e-4
    n = axes[0]

    def measured(system):
        def stress(axis, change):
            P = mean_stress(system, np.eye(3) + change * np.outer(n[axis], n[axis]), [])
            return np.diag(n @ P @ n.T)  # force over the area in the mesh

        slope = [(stress(k, h) - stress(k, -h)) / (2 * h) for k in range(3)]
        return [free_across(np.array(slope).T, k) for k in range(3)]

    def expected(stretch):
        def stress(axis, change):
            grown = np.ones(3)
            grown[axis] += change
            return closed_form(stretch * grown) * grown.prod() / grown

        slope = [(stress(k, h) - stress(k, -h)) / (2 * h) for k in range(3)]
        return [free_across(np.array(slope).T, k) for k in range(3)]

    tense = measured(prestressed((size, 0, 0), axes))
    slack = measured(prestressed((0, 0, 0), axes))
    stretch = initial_stretch(TISSUE, (size, 0, 0))
    np.testing.assert_allclose(tense, expected(stretch), rtol=1e-6)
    np.testing.assert_allclose(slack, expected(np.ones(3)), rtol=1e-6)
    assert tense[0] > 2.0 * slack[0] and tense[0] > 2.0 * tense[1]


def test_a_prestretch_of_one_has_no_effect():
    none = solid_system(MESH, muscles=crossed_muscles(MESH))
    unit = sim.Solid(muscles=crossed_muscles(MESH), prestretch=np.tile(np.eye(3), (N, 1, 1)))
    same = sim.compile_scene(sim.Scene(MESH, (unit,)))
    q = MESH.X + np.random.default_rng(0).normal(size=MESH.X.shape) * 5e-4
    control = none.control(np.array([0.2, 0.7]))
    for one, other in zip(none.tangent(q, control), same.tangent(q, control), strict=True):
        if isinstance(one, np.ndarray):
            np.testing.assert_allclose(one, other, rtol=0, atol=1e-12 * np.abs(one).max())
        else:
            np.testing.assert_allclose(one.f, other.f, rtol=0, atol=1e-12 * np.abs(one.f).max())


def test_fibres_under_prestretch_pull_along_their_direction_in_the_mesh():
    """A constant active stress adds sigma_max (a a' - I/3) stretch, stretch = |F0 a0| / J0^(1/3)."""
    axes, a = rotation(5)[None], rotation(2)[0]
    stretch = np.array([1.3, 0.9, 0.9])
    F0 = np.repeat(stretch_field(axes, stretch), N, axis=0)
    rows = np.arange(N), np.zeros(N, int), np.tile(a, (N, 1))
    muscles = sim.Muscles(("m",), *rows, sim.Constant(50e3))
    system = sim.compile_scene(sim.Scene(MESH, (sim.Solid((TISSUE,), None, muscles, F0),)))
    P = [mean_stress(system, np.eye(3), [level]) for level in (0.0, 1.0)]
    own = np.linalg.solve(F0[0], a)
    J0 = stretch.prod()
    along = J0 ** (-1 / 3) / np.linalg.norm(own)
    expected = 50e3 * along / J0 * (np.outer(a, a) - np.eye(3) / 3)
    np.testing.assert_allclose(P[1] - P[0], expected, atol=1e-9 * 50e3)


def test_nodes_displaced_in_a_first_step_leave_the_uniaxial_stress():
    """A bar shortened by 0.8 with its ends displaced back: stress at the stretch 1/0.8."""
    mesh = grid((4, 1, 1), (0.8 * 0.04, 0.01, 0.01))
    ends = np.flatnonzero(np.isclose(mesh.X[:, 0] % mesh.X[:, 0].max(), 0.0))
    corner = np.array([0])  # prevents rigid motion: y, z of a corner and z of another
    reductions = (
        sim.Fixed(ends, (0,)),
        sim.Fixed(corner),
        sim.Fixed(np.array([2]), (2,)),
    )
    tissue = sim.Material(sim.MooneyRivlin(C10, C20), sim.LogarithmicBulk(KAPPA))
    system = sim.compile_scene(sim.Scene(mesh, (sim.Solid((tissue,)),), reductions))
    target = mesh.X / np.array([0.8, 1.0, 1.0])
    state = sim.displace_held(system, system.rest_state(), target, steps=4)
    np.testing.assert_allclose(state.q[ends, 0], target[ends, 0], atol=1e-15)
    assert (
        np.abs(free_components(system, system.force(state.q, system.control(np.zeros(0))).f)).max()
        < 2e-6
    )
    across = np.ptp(state.q[:, 1]) / np.ptp(mesh.X[:, 1])
    stress = closed_form([1.25, across, across])
    assert abs(stress[1]) < 1.0
    right = ends[mesh.X[ends, 0] > 0]
    pull = -system.force(state.q, system.control(np.zeros(0))).f[right, 0].sum()
    assert pull == pytest.approx(stress[0] * (0.01 * across) ** 2, rel=1e-4)


def test_stiffening_multiplies_all_passive_moduli_and_no_active_stress():
    """s = 1 + 9 min(1, sum a): 5.5 at 0.2 + 0.3, 10 at 0.8 + 0.9; only in the muscles' elements."""
    n = N
    muscles = crossed_muscles(MESH, sim.Constant(30e3))
    F = np.eye(3) + 0.1 * np.random.default_rng(1).normal(size=(3, 3))
    tissue = sim.Solid((TISSUE,))

    def system(*terms):
        return sim.compile_scene(sim.Scene(MESH, (sim.Solid((TISSUE,), None, muscles), *terms)))

    rows = ("first", "second"), np.tile(np.arange(n), 2), np.repeat([0, 1], n)
    plain, stiff = system(), system(sim.Stiffening(*rows, tissue))
    half = system(sim.Stiffening(*rows, tissue, weight=np.full(2 * n, 0.5)))
    passive = mean_stress(plain, F, [0, 0])
    np.testing.assert_array_equal(mean_stress(stiff, F, [0, 0]), passive)
    for level, s, s_half in (([0.2, 0.3], 5.5, 3.25), ([0.8, 0.9], 10.0, 8.65)):
        active = mean_stress(plain, F, level) - passive
        for body, factor in ((stiff, s), (half, s_half)):
            stress = mean_stress(body, F, level)
            np.testing.assert_allclose(stress, factor * passive + active, atol=1e-9 * 30e3)
    some = system(sim.Stiffening(("first",), np.array([3]), np.array([0]), tissue))
    q = MESH.X @ F.T
    level = plain.control(np.array([1.0, 0.0]))
    change = some.force(q, level).f - plain.force(q, level).f

    others = np.setdiff1d(np.arange(MESH.n_nodes), slots(MESH)[0][3])
    assert np.abs(change).max() > 0 and (change[others] == 0.0).all()


def test_impossible_prestress_and_stiffening_are_refused():
    bad = np.tile(np.eye(3), (N, 1, 1))
    bad[4, 0, 0] = -1.0
    with pytest.raises(sim.SceneError, match="prestretch of element 4"):
        sim.compile_scene(sim.Scene(MESH, (sim.Solid(prestretch=bad),)))
    with pytest.raises(sim.SceneError, match=r"prestretch has shape \(3, 3\)"):
        sim.compile_scene(sim.Scene(MESH, (sim.Solid(prestretch=np.eye(3)),)))
    with pytest.raises(sim.SceneError, match="no stretch of the material gives the stress"):
        initial_stretch(TISSUE, (0.0, 0.0, np.inf))
    with pytest.raises(sim.SceneError, match="no stretch of the material gives the stress"):
        initial_stretch(TISSUE, (100e3, 100e3, 100e3))  # kappa ln J / J never exceeds kappa / e
    rows = np.array([0]), np.array([0]), sim.Solid()
    with pytest.raises(sim.SceneError, match="muscle 'm', which no term of the scene has"):
        sim.compile_scene(sim.Scene(MESH, (sim.Solid(), sim.Stiffening(("m",), *rows))))
    with pytest.raises(sim.SceneError, match="factor = 0.5"):
        sim.Stiffening(("m",), *rows, 0.5)
    with pytest.raises(sim.SceneError, match="arrays differ"):
        sim.Stiffening(("m",), np.array([0, 1]), *rows[1:])
    with pytest.raises(sim.SceneError, match="target of held nodes has shape"):
        system = solid_system(MESH, reductions=(sim.Fixed(np.array([0])),))
        sim.displace_held(system, system.rest_state(), np.zeros((2, 3)))


def test_stress_free_corners_are_equivalent_to_a_uniform_prestretch():
    """x = F0 X with the corners X before: the same energy and forces, also of the fibres."""
    F0 = np.array([[1.1, 0.05, 0.0], [0.0, 0.95, 0.02], [0.0, 0.0, 1.03]])
    before = MESH.X @ np.linalg.inv(F0).T
    corners = np.zeros((N, 8, 3))
    first = 0
    for block in MESH.blocks:
        n, k = block.nodes.shape
        corners[first : first + n, :k] = before[block.nodes]
        first += n
    muscles = crossed_muscles(MESH)
    one = sim.Solid((TISSUE,), muscles=muscles, prestretch=np.tile(F0, (N, 1, 1)))
    two = sim.Solid((TISSUE,), muscles=muscles, stress_free=corners)
    systems = [sim.compile_scene(sim.Scene(MESH, (solid,))) for solid in (one, two)]
    q = MESH.X + 0.02 * np.random.default_rng(3).standard_normal(MESH.X.shape) * np.ptp(MESH.X)
    q = MESH.X + 0.1 * (q - MESH.X)
    control = systems[0].control(np.full(len(systems[0].muscles), 0.4))
    forces = [system.force(q, control) for system in systems]
    assert forces[1].energy == pytest.approx(forces[0].energy, rel=1e-12)
    np.testing.assert_allclose(
        forces[1].f, forces[0].f, rtol=1e-10, atol=1e-12 * np.abs(forces[0].f).max()
    )
    masses = [solid.node_mass(MESH).sum() for solid in (one, two)]
    assert masses[1] * np.linalg.det(F0) == pytest.approx(masses[0], rel=1e-12)


WITH_FREE = sim.Solid, sim.ElementVolume, sim.NodalVolume
"""Terms whose energy is that of a stress-free shape, if one is given."""


def test_every_term_with_a_stress_free_shape_is_listed():
    assert {one for one in TERMS if "stress_free" in signature(one).parameters} == {*WITH_FREE}


@pytest.mark.parametrize("term", WITH_FREE)
@pytest.mark.parametrize("kind", ["hexahedra and wedges", "tetrahedra"])
def test_stress_free_corners_give_the_forces_of_the_mesh_that_has_them(term, kind):
    """The same positions, energy, forces and tangent, whatever the mesh at rest is."""
    mesh = MESH if kind != "tetrahedra" else tetrahedra((2, 1, 1))
    rng = np.random.default_rng(3)
    size = 0.02 * np.ptp(mesh.X)
    before, q = (mesh.X + size * rng.standard_normal(mesh.X.shape) for _ in range(2))
    corners = before[slots(mesh)[0]]
    free = replace(mesh, X=before)
    carrier = sim.Solid()  # gives the mass
    forces = []
    for own, given in ((mesh, {"stress_free": corners}), (free, {})):
        system = sim.compile_scene(sim.Scene(own, (carrier, term(**given))))
        alone = sim.compile_scene(sim.Scene(own, (carrier,)))
        control = system.control(np.zeros(0))
        (one, K), (none, K0) = system.tangent(q, control), alone.tangent(q, control)
        forces.append(
            (one.energy - none.energy, one.f - none.f, dense(system, K) - dense(alone, K0))
        )
    assert forces[0][0] == pytest.approx(forces[1][0], rel=1e-9) and forces[0][0] > 0.0
    for one, two in zip(forces[0][1:], forces[1][1:], strict=True):
        np.testing.assert_allclose(one, two, atol=1e-9 * np.abs(two).max())


@pytest.mark.parametrize("term", WITH_FREE)
def test_bad_stress_free_corners_are_refused(term):
    for bad in (np.zeros((N, 8, 3)), np.zeros((3, 3)), np.full((N, 8, 3), np.nan)):
        with pytest.raises(sim.SceneError, match="stress"):
            sim.compile_scene(sim.Scene(MESH, (sim.Solid(), term(stress_free=bad))))
