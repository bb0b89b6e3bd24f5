"""Forces that depend on the rate of stretch: Hill's equation, derivatives, power and order in time."""

import numpy as np
import pytest

import sim
from sim.system import damping_matrix
from tests.bodies import dense, grid, rotation, solid_system

RELATION = sim.ForceVelocity(v_max=3.0, curvature=0.3, lengthening=1.5)
TIGHT = {"tolerance": 1e-13, "residual_tolerance": 1e-11}


def block(law=None, relation=RELATION, **more):
    """A block with two line muscles with a force-velocity relation."""
    mesh = grid((2, 1, 1), distort=0.1, seed=3)
    paths = mesh.X[[0, -1, 1]] * 0.9 + 0.001, mesh.X[[2, 9]] * 0.9 + 0.0005
    lines = sim.LineMuscles(
        ("one", "other"),
        tuple(sim.LineFibre(k, path) for k, path in enumerate(paths)),
        law or sim.Peck(0.3),
        relation=relation,
    )
    return solid_system(mesh, sim.NeoHooke(2500.0), terms=(lines, sim.Gravity()), **more)


def rate_force(system, q, v, control):
    """Sum of the forces (n, 3) of a rate, and their matrix over all unknowns."""
    f, D = np.zeros_like(q), np.zeros(system.point_pattern.nnz)
    for term in system.rate_terms:
        term.add_rate_force(q, v, control, f, D)
    return f, dense(system, D)


def test_the_relation_is_that_of_hill_with_its_derivative():
    """(F + a)(v + b) = (F0 + a) b in shortening, with a = 0.3 F0 and b = 0.3 v_max."""
    rate = np.linspace(-3.0, 12.0, 61)
    factor, slope = RELATION.evaluate(rate)
    v = -rate[rate <= 0.0]
    np.testing.assert_allclose((factor[rate <= 0.0] + 0.3) * (v + 0.9), 1.3 * 0.9, rtol=1e-13)
    assert RELATION.evaluate(np.array([-9.0, 0.0, 1e9]))[0] == pytest.approx([0.0, 1.0, 1.5])
    h = 1e-6
    difference = (RELATION.evaluate(rate + h)[0] - RELATION.evaluate(rate - h)[0]) / (2 * h)
    np.testing.assert_allclose(slope[1:], difference[1:], rtol=2e-6)
    assert ((factor - 1.0) * rate >= 0.0).all()


@pytest.mark.parametrize("load", [0.3, 0.7, 1.2])
def test_a_loaded_muscle_reaches_the_speed_of_hills_equation(load):
    """A muscle of 1 N and 1 m moves a light body against a load at constant speed."""
    body = sim.Body("block", 1e-3, 1e-3 * np.eye(3), (1.0, 0.0, 0.0))
    muscle = sim.LineMuscles(
        ("m",), (sim.LineFibre(0, np.array([0, 1])),), sim.ConstantForce(1.0), relation=RELATION
    )
    scene = sim.Scene(
        sim.NO_TISSUE,
        (muscle, sim.NodeLoad(np.array([1]), np.array([[load, 0.0, 0.0]]))),
        (sim.Fixed(np.array([0])), sim.OnBody("block", np.array([1]))),
        bodies=(body,),
        points=np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]),
    )
    system = sim.compile_scene(scene)
    _, end = sim.simulate(
        system,
        sim.Activation(np.zeros(1), np.ones((1, 1))),
        duration=0.05,
        integrator=sim.LinearlyImplicitEuler(),
        steps=sim.FixedStep(1e-3),
    )
    u = (load - 1.0) / (1.0 + load / 0.3) if load < 1.0 else 0.2 * 0.5 / (1.3 / 0.3) / 0.3
    assert end.v[1, 0] == pytest.approx(3.0 * u, rel=1e-4)


def test_damping_is_the_derivative_of_the_force_and_power_is_dissipated():
    system, rng = block(), np.random.default_rng(1)
    X, control = system.mesh.X, system.control(np.array([0.6, 0.8]))
    q, v = X + 4e-4 * rng.normal(size=X.shape), 0.05 * rng.normal(size=X.shape)
    f, D = rate_force(system, q, v, control)
    h, columns = 1e-6, []
    for i in range(X.size):
        step = np.zeros(X.size)
        step[i] = h
        ends = (rate_force(system, q, v + s * step.reshape(-1, 3), control)[0] for s in (1, -1))
        columns.append((next(ends) - next(ends)).ravel() / (2 * h))
    np.testing.assert_allclose(D, -np.array(columns), atol=1e-7 * np.abs(D).max())
    assert (f * v).sum() < 0.0
    assert np.linalg.eigvalsh(D).min() > -1e-12 * np.abs(D).max()
    size = np.abs(f).max()
    assert np.abs(f.sum(axis=0)).max() < 1e-12 * size
    assert np.abs(np.cross(q, f).sum(axis=0)).max() < 1e-12 * size
    turning = np.cross([1.0, -2.0, 0.5], q)  # a rotation has no rate of stretch
    assert np.abs(rate_force(system, q, turning, control)[0]).max() < 1e-10 * size
    Q = rotation(2)
    turned = rate_force(system, q @ Q.T, v @ Q.T, control)[0]
    np.testing.assert_allclose(turned, f @ Q.T, atol=1e-10 * size)


def test_damping_matrix_with_its_offset_is_the_tangent_at_given_velocities():
    fixed = sim.Fixed(np.arange(4))
    system, rng = (
        block(reductions=(fixed,), damping=sim.Rayleigh(5.0, 0.01)),
        np.random.default_rng(4),
    )
    state, control = system.rest_state(), system.control(np.array([0.6, 0.8]))
    w = 0.05 * rng.normal(size=system.pattern.n)
    v = system.kinematics.displacements(w, state.pose)
    D = damping_matrix(system, state.pose, v, control)
    f, own = rate_force(system, state.q, v, control)
    linear = dense(system, system.damping(state.q, control))
    exact = linear @ w - system.kinematics.generalised_force(f, state.pose)
    np.testing.assert_allclose(D.force(w), exact, atol=1e-11 * np.abs(exact).max())
    np.testing.assert_allclose(dense(system, D.values), linear + own, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize(
    "integrator",
    [
        sim.LinearlyImplicitEuler(),
        sim.ConvergedEuler(**TIGHT),
        sim.Trapezoidal(**TIGHT),
        sim.Sdirk2(**TIGHT),
    ],
    ids=lambda i: type(i).__name__,
)
def test_order_in_time_with_forces_of_a_rate(integrator):
    """The declared order under a smooth drive; rates reach a fifth of v_max."""
    system = block(
        sim.ConstantForce(0.3),
        sim.ForceVelocity(v_max=3.0),
        reductions=(sim.Fixed(np.array([0, 3, 6, 9])),),
        damping=sim.Rayleigh(19.0, 0.005),
    )
    drive = sim.Activation(np.array([0.0, 0.02]), np.array([[0.0, 0.0], [0.2, 0.15]]))
    ends = [
        sim.simulate(
            system, drive, duration=0.02, integrator=integrator, steps=sim.FixedStep(step)
        )[1].q
        for step in 5e-4 / 2.0 ** np.arange(3)
    ]
    differences = [np.abs(a - b).max() for a, b in zip(ends, ends[1:], strict=False)]
    assert np.log2(differences[0] / differences[1]) == pytest.approx(integrator.order, abs=0.1)


def test_a_relation_without_a_largest_rate_is_refused():
    with pytest.raises(sim.SceneError, match="v_max"):
        sim.ForceVelocity(v_max=0.0)
