"""Dynamics compared with closed forms, and measured convergence orders."""

import numpy as np
import pytest

import sim
from sim.integrators import INTEGRATORS
from sim.integrators.stage import Converged
from tests.bodies import crossed_muscles, dense, fixed_block, free_components, grid, solid_system

G = np.array([0.0, 0.0, -9.8])


def tight(cls):
    """The integrator with an iteration error far below that of the time step."""
    options = {"tolerance": 1e-13, "residual_tolerance": 1e-11}
    return cls(**options) if issubclass(cls, Converged) else cls()


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_free_fall(integrator):
    """An unattached body falls without stress: v = g t, x = g t^2/2.

    The two forms of implicit Euler and the symplectic one give x = g h^2 n(n + 1)/2.
    """
    mesh = grid((2, 1, 1), wedges=(0,))
    system = solid_system(mesh, terms=(sim.Gravity(tuple(G)),))
    h, n = (1e-4 if integrator.stability == "conditional" else 0.01), 20
    euler = (sim.LinearlyImplicitEuler, sim.ConvergedEuler, sim.SymplecticEuler)
    trajectory, end = sim.simulate(
        system,
        sim.resting(0),
        duration=n * h,
        integrator=tight(integrator),
        steps=sim.FixedStep(h),
        probes=(sim.SmallestJ(), sim.Energies()),
    )
    np.testing.assert_allclose(end.v, np.tile(G * n * h, (mesh.n_nodes, 1)), atol=1e-9)
    fallen = mesh.X + G * h * h * n * (n + (1 if integrator in euler else 0)) / 2
    np.testing.assert_allclose(end.q, fallen, atol=1e-10)
    np.testing.assert_allclose(trajectory.smallest_J, 1.0, atol=1e-9)


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_momentum_of_a_free_body_is_conserved(integrator):
    mesh = grid((2, 1, 1))
    system = solid_system(mesh, muscles=crossed_muscles(mesh))
    rng = np.random.default_rng(0)
    start = sim.State(0.0, mesh.X.copy(), rng.normal(size=mesh.X.shape) * 0.05)
    activation = sim.Activation(np.array([0.0, 0.05]), np.array([[0.0, 0.0], [0.5, 0.2]]))
    _, end = sim.simulate(
        system,
        activation,
        duration=0.1,
        integrator=tight(integrator),
        steps=sim.FixedStep(2e-4 if integrator.stability == "conditional" else 0.005),
        initial=start,
    )
    before, after = (system.node_mass @ s.v for s in (start, end))
    assert np.abs(after - before).max() < 1e-9 * np.abs(before).max()


def contracting_block():
    mesh, damping = grid((2, 2, 2), wedges=(1,)), sim.Rayleigh(19.0, 0.02)
    return fixed_block(mesh, sim.Blemker(20e3), terms=(sim.Gravity(),), damping=damping)


def smooth_block(damping):
    """A block whose forces are smooth functions of positions and time."""
    mesh, law = grid((2, 2, 2), wedges=(1,)), sim.NeoHooke(2500.0)
    return fixed_block(mesh, sim.Constant(5e3), law, terms=(sim.Gravity(),), damping=damping)


def measured_order(integrator, damping, duration, steps, activation=None):
    """Order from the last three steps: differences of successive solutions decrease by 2^order."""
    system = smooth_block(damping)
    time = np.linspace(0.0, duration, 3)  # Steps end at the kinks of the activation.
    activation = activation or sim.Activation(time, np.array([[0.0, 0.0], [0.3, 0.1], [0.2, 0.3]]))
    solutions = [
        sim.simulate(
            system,
            activation,
            duration=duration,
            integrator=tight(integrator),
            steps=sim.FixedStep(h),
        )[1].q
        for h in steps
    ]
    differences = [np.abs(a - b).max() for a, b in zip(solutions, solutions[1:], strict=False)]
    return np.log2(differences[-2] / differences[-1])


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_convergence_order_in_time(integrator):
    """The declared order, with activations that vary and a damping that depends on the positions."""
    if integrator.stability == "conditional":
        damping, duration, largest = (
            sim.Rayleigh(19.0, 1e-5),
            0.016,
            4e-4 if integrator.order > 1 else 1e-4,
        )
    else:
        damping, duration, largest = (
            sim.Rayleigh(19.0, 0.005),
            0.04,
            2e-3 if integrator.order > 1 else 5e-4,
        )
    order = measured_order(integrator, damping, duration, largest / 2.0 ** np.arange(3))
    assert order == pytest.approx(integrator.order, abs=0.1)


def test_the_linearised_trapezoidal_rule_is_second_order_under_a_constant_drive():
    order = measured_order(
        sim.LinearlyImplicitTrapezoidal,
        sim.RestRayleigh(19.0, 0.005),
        0.08,
        0.004 / 2.0 ** np.arange(4),
        sim.Activation(np.zeros(1), np.array([[0.3, 0.2]])),
    )
    assert order == pytest.approx(2.0, abs=0.1)


def test_both_solvers_approach_the_same_solution():
    system = contracting_block()
    activation = sim.Activation(np.array([0.0, 0.1]), np.array([[0.0, 0.0], [0.4, 0.2]]))

    def end(cls, h):
        return sim.simulate(
            system, activation, duration=0.16, integrator=cls(), steps=sim.FixedStep(h)
        )[1].q

    gaps = [
        np.abs(end(sim.LinearlyImplicitEuler, h) - end(sim.ConvergedEuler, h)).max()
        for h in (0.008, 0.002)
    ]
    assert gaps[1] < 0.4 * gaps[0]  # a first-order difference falls to a quarter


def test_converged_step_solves_the_implicit_euler_equation():
    """M (v1 - v0)/h + D0 v1 = f(q1), with independently assembled matrices."""
    system = contracting_block()
    control, h = system.control(np.array([0.6, 0.1])), 0.01
    start = system.rest_state()
    integrator = sim.ConvergedEuler(tolerance=1e-12, residual_tolerance=1e-9)
    end, report = integrator.step(system, start, control, h, sim.Workspace(system))
    D0 = dense(system, system.damping(start.q, control))
    v1 = free_components(system, end.v)
    balance = (
        system.mass * v1 / h + D0 @ v1 - free_components(system, system.force(end.q, control).f)
    )
    assert np.abs(balance).max() < 2e-9
    assert report.residual <= 1e-9
    np.testing.assert_allclose(end.q, start.q + h * end.v, atol=1e-15)


def test_linearly_implicit_step_is_one_linear_solution():
    system = contracting_block()
    control, h = system.control(np.array([0.2, 0.1])), 0.005
    start = system.rest_state()
    end, _ = sim.LinearlyImplicitEuler().step(system, start, control, h, sim.Workspace(system))
    evaluation, K = system.tangent(start.q, control)
    D = system.damping(start.q, control)
    A = np.diag(system.mass) + h * dense(system, D) + h * h * dense(system, K)
    expected = np.linalg.solve(A, h * free_components(system, evaluation.f))
    np.testing.assert_allclose(free_components(system, end.v), expected, rtol=1e-8, atol=1e-12)


def test_energy_does_not_increase_without_drive():
    system = contracting_block()
    start = system.rest_state()
    trajectory, _ = sim.simulate(
        system,
        sim.resting(2),
        duration=2.0,
        steps=sim.FixedStep(0.02),
        probes=(sim.Energies(),),
        initial=start,
    )
    total = (trajectory.kinetic_energy + trajectory.potential_energy).values
    assert (np.diff(total) < 1e-9 * np.abs(total).max()).all()
    assert trajectory.kinetic_energy[-1] < 1e-9 * trajectory.kinetic_energy.max()
