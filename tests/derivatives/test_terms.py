"""Every registered law in the element loop: force = -dE/dq, tangent = -df/dq, frame indifference."""

import itertools

import numpy as np
import pytest

import sim
from sim.constraints import CONSTRAINTS
from sim.damping import DAMPING_LAWS
from sim.laws import BULK_LAWS, FIBRE_LAWS, ISOCHORIC_LAWS, TENSOR_LAWS
from sim.scene import CompiledTerm, Contribution, Term
from sim.state import Pose
from sim.terms import TERMS
from tests.bodies import crossed_muscles, dense, grid, rotation, solid_system, tetrahedra

MESH = grid((2, 1, 1), (0.02, 0.01, 0.01), wedges=(1,))
LAWS = list(itertools.product(ISOCHORIC_LAWS, BULK_LAWS, FIBRE_LAWS)) + [
    (law, None, fibre) for law, fibre in zip(TENSOR_LAWS, itertools.cycle(FIBRE_LAWS), strict=False)
]
FINITE_LAWS = [laws for laws in LAWS if laws[0] is not sim.LinearElastic]


def name(laws):
    return "-".join(law.__name__ for law in laws if law)


def system_of(law, bulk, fibre, mesh=MESH, **scene):
    muscles = crossed_muscles(mesh, fibre(sigma_max=40e3))
    return solid_system(mesh, law(), bulk() if bulk else None, muscles, **scene)


def deformed(seed=0, size=8e-4, mesh=MESH):
    return mesh.X + np.random.default_rng(seed).normal(size=mesh.X.shape) * size


EXAMPLES = {
    sim.Solid: lambda: sim.Solid(muscles=crossed_muscles(MESH)),
    sim.Gravity: lambda: sim.Gravity((1.0, 2.0, -9.8)),
    sim.ElementVolume: sim.ElementVolume,
    sim.NodalVolume: sim.NodalVolume,
    sim.LineMuscles: lambda: sim.LineMuscles(
        ("inside", "edge"),
        (
            sim.LineFibre(0, np.array([[3, 2, 4], [9, 6, 3], [14, 4, 8]]) * 1e-3, share=0.7),
            sim.LineFibre(1, np.array([0, 4, 8])),
        ),
        (sim.Peck(0.8, stretch_max=1.4, tendon_ratio=0.1), sim.ConstantForce(2.0, 0.1)),
        stiffness=30.0,
    ),
    sim.AxialSprings: lambda: sim.AxialSprings(
        (np.array([0, 4, 8]), np.array([1, 5])), 30.0, 2.0, np.array([0.01, 0.02])
    ),
    sim.Stiffening: lambda: sim.Stiffening(
        ("driven", "other"), np.array([2, 1, 2]), np.array([0, 1, 1]), sim.Solid(), 7.0
    ),
    sim.Support: lambda: sim.Support(
        np.array([0, 4, 7, 4]), rotation(4)[[0, 1, 2, 0]], stiffness=300.0, gap=2e-4
    ),
    sim.NodeLoad: lambda: sim.NodeLoad(np.array([1, 4, 1]), np.arange(9.0).reshape(3, 3)),
}
"""One term of each class; a registered class without one fails below."""


class Weightless(Term, CompiledTerm):
    """Mass without force, so that a term can be examined alone."""

    def node_mass(self, mesh):
        return np.full(mesh.n_nodes, 1e-3)

    def compile(self, layout):
        return self

    def add(self, q, control, f, K=None):
        return Contribution(0.0)


class Driven(Weightless):
    """Mass with muscles, for terms that are driven by the muscles of other terms."""

    def muscle_names(self):
        return "driven", "other"


def derivatives_agree(system, activation):
    mesh, h = system.scene.mesh, 1e-7
    control, q = system.control(np.array(activation)), deformed(mesh=mesh)
    at_q, K = system.tangent(q, control)
    n = q.size
    slope, stiffness = np.empty(n), np.empty((n, n))
    for i in range(n):
        step = np.zeros(n)
        step[i] = h
        above = system.force(q + step.reshape(-1, 3), control)
        below = system.force(q - step.reshape(-1, 3), control)
        slope[i] = (above.energy - below.energy) / (2 * h)
        stiffness[i] = -(above.f - below.f).ravel() / (2 * h)
    assert np.abs(at_q.f.ravel() + slope).max() < 1e-7 * np.abs(slope).max()
    assert np.abs(dense(system, K) - stiffness).max() <= 1e-7 * np.abs(stiffness).max()
    alone = system.force(q, control).f  # the same sums, possibly in another order
    np.testing.assert_allclose(alone, at_q.f, atol=1e-14 * np.abs(at_q.f).max())


@pytest.mark.parametrize("laws", LAWS, ids=name)
def test_every_law_force_is_minus_the_derivative_of_energy_and_tangent_that_of_force(laws):
    derivatives_agree(system_of(*laws, terms=(sim.Gravity(),)), [0.3, 0.8])


@pytest.mark.parametrize("term", TERMS)
def test_every_term_force_is_minus_the_derivative_of_energy_and_tangent_that_of_force(term):
    example = EXAMPLES[term]()
    system = sim.compile_scene(sim.Scene(MESH, (Driven(), example)))
    derivatives_agree(system, np.resize([0.3, 0.8], len(system.muscles)))


@pytest.mark.parametrize("volume", [None, sim.ElementVolume, sim.NodalVolume])
def test_tetrahedra_with_every_volume_term(volume):
    mesh = tetrahedra((2, 1, 1), (0.02, 0.01, 0.01))
    muscles = crossed_muscles(mesh, sim.Blemker(40e3))
    system = solid_system(mesh, muscles=muscles, terms=() if volume is None else (volume(),))
    derivatives_agree(system, [0.3, 0.8])


@pytest.mark.parametrize("volume", [sim.ElementVolume, sim.NodalVolume])
def test_every_element_may_have_its_own_bulk_modulus(volume):
    kappa = np.linspace(1e4, 4e4, MESH.n_elements)
    kappa[0] = 0.0
    both = sim.compile_scene(sim.Scene(MESH, (Weightless(), volume(kappa))))
    derivatives_agree(both, [])
    even = np.full(MESH.n_elements, 25e3)
    even[0] *= 1 + 1e-12  # takes the path of unequal moduli
    systems = [sim.compile_scene(sim.Scene(MESH, (Weightless(), volume(k)))) for k in (even, 25e3)]
    unequal, equal = (s.force(deformed(), s.control(np.zeros(0))).f for s in systems)
    np.testing.assert_allclose(unequal, equal, atol=1e-11 * np.abs(equal).max())


@pytest.mark.parametrize(
    ("kappa", "said"),
    [
        (np.ones(7), "has shape \\(7,\\)"),
        (np.zeros(MESH.n_elements), "expected a number > 0"),
        (np.array([1.0, -1.0]), "expected a number > 0"),
        (0.0, "expected a number > 0"),
    ],
)
def test_an_impossible_bulk_modulus_is_refused(kappa, said):
    for volume in (sim.ElementVolume, sim.NodalVolume):
        with pytest.raises(sim.SceneError, match=said):
            sim.compile_scene(sim.Scene(MESH, (Weightless(), volume(kappa))))


@pytest.mark.parametrize("law", TENSOR_LAWS)
def test_laws_of_the_strain_tensor_on_tetrahedra(law):
    mesh = tetrahedra((2, 1, 1), (0.02, 0.01, 0.01))
    derivatives_agree(system_of(law, None, sim.Blemker, mesh), [0.3, 0.8])


def test_a_tetrahedron_gives_each_node_a_quarter_of_its_volume():
    """E = kappa/2 V_n (v_n/V_n - 1)^2 summed over nodes, from volumes by determinants."""
    mesh = tetrahedra((2, 1, 1), (0.02, 0.01, 0.01))
    q, kappa = deformed(size=4e-4), 25e3
    tets, nodal = mesh.blocks[0].nodes, []
    for x in (mesh.X, q):
        volume = np.linalg.det(x[tets[:, 1:]] - x[tets[:, :1]]) / 6
        nodal.append(np.bincount(tets.ravel(), np.repeat(volume / 4, 4)))
    expected = 0.5 * kappa * (nodal[0] * (nodal[1] / nodal[0] - 1) ** 2).sum()
    system = sim.compile_scene(sim.Scene(mesh, (Weightless(), sim.NodalVolume(kappa))))
    assert system.force(q, system.control(np.zeros(0))).energy == pytest.approx(expected, rel=1e-12)


def moved(system, q, d):
    out = q.copy()
    out.reshape(-1)[system.free] += d
    return out


def posed(q):
    return Pose(q, np.zeros((0, 7)), 0.0)


@pytest.mark.parametrize("constraint", CONSTRAINTS)
def test_every_constraint_G_is_the_derivative_of_c_and_its_curvature_that_of_G(constraint):
    fixed = sim.Fixed(np.array([0, 1, 2, 3]))
    scene = sim.Scene(MESH, (Weightless(),), (fixed,), constraints=(constraint(),))
    system = sim.compile_scene(scene)
    conditions, q = system.constraints, deformed()
    rng = np.random.default_rng(2)
    multiplier, size = rng.normal(size=conditions.n), 1e-6
    curvature = np.zeros(system.pattern.nnz)
    G = conditions.matrix(conditions.evaluate(posed(q))[1]).toarray()
    conditions.add_curvature(q, multiplier, curvature)
    for i in range(system.pattern.n):
        step = np.zeros(system.pattern.n)
        step[i] = size
        above = conditions.evaluate(posed(moved(system, q, step)))
        below = conditions.evaluate(posed(moved(system, q, -step)))
        slope = (above[0] - below[0]) / (2 * size)
        assert np.abs(slope - G[:, i]).max() < 1e-7 * np.abs(G).max()
        bend = (
            (conditions.matrix(above[1]) - conditions.matrix(below[1])).T @ multiplier / (2 * size)
        )
        expected = dense(system, curvature)[i]
        assert np.abs(bend - expected).max() < 1e-7 * np.abs(curvature).max()


@pytest.mark.parametrize("laws", FINITE_LAWS, ids=name)
def test_frame_indifference(laws):
    system = system_of(*laws)
    control, q, Q = system.control(np.array([0.3, 0.8])), deformed(), rotation()
    here, there = system.force(q, control), system.force(q @ Q.T + 0.3, control)
    assert there.energy == pytest.approx(here.energy, rel=1e-11)
    assert np.abs(there.f - here.f @ Q.T).max() < 1e-10 * np.abs(here.f).max()
    assert np.abs(here.f.sum(axis=0)).max() < 1e-12 * np.abs(here.f).sum()
    torque = np.cross(q - q.mean(axis=0), here.f).sum(axis=0)
    assert np.abs(torque).max() < 1e-10 * np.abs(here.f).sum() * 0.02


@pytest.mark.parametrize("laws", FINITE_LAWS, ids=name)
def test_a_rigid_motion_of_a_resting_body_gives_no_force(laws):
    system = system_of(*laws)
    q = MESH.X @ rotation(3).T + np.array([0.1, -0.2, 0.3])
    f = system.force(q, system.control(np.zeros(2))).f
    scale = system.tangent(MESH.X, system.control(np.zeros(2)))[1].max() * 0.02
    assert np.abs(f).max() < 1e-12 * scale


@pytest.mark.parametrize("law", DAMPING_LAWS)
def test_rayleigh_damping_is_alpha_M_plus_beta_K(law):
    system = system_of(*LAWS[0], damping=law(alpha=7.0, beta=0.03))
    q, control = deformed(), system.control(np.array([0.3, 0.8]))
    resting = system.control(np.zeros(2))
    where = {
        sim.Rayleigh: (q, control),
        sim.PassiveRayleigh: (q, resting),
        sim.RestRayleigh: (MESH.X, resting),
    }[law]
    expected = 7.0 * np.diag(system.mass) + 0.03 * dense(system, system.tangent(*where)[1])
    D = dense(system, system.damping(q, control))
    np.testing.assert_allclose(D, expected, rtol=1e-14, atol=0)
    at_hand = system.damping(q, control, system.tangent(q, control)[1])
    np.testing.assert_allclose(dense(system, at_hand), expected, rtol=1e-14, atol=0)


def test_damping_at_rest_dissipates_energy_of_all_motions_except_rigid_ones():
    system = system_of(*LAWS[0], damping=sim.RestRayleigh(alpha=0.0))
    eigenvalues = np.linalg.eigvalsh(dense(system, system.damping(deformed(), None)))
    assert (np.abs(eigenvalues[:6]) < 1e-10 * eigenvalues[-1]).all()
    assert eigenvalues[6] > 1e-4 * eigenvalues[-1]
