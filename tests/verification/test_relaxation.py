"""Quasi-linear viscoelasticity compared with closed forms, and the memory of states."""

import functools
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad

import sim
from sim.integrators import INTEGRATORS
from tests.bodies import crossed_muscles, dense, fixed_block, grid, solid_system

PRONY = sim.Prony((0.3, 0.25), (0.05, 0.8))
NONE = np.zeros(0)
MESH = grid((2, 1, 1), wedges=(0,))


def stretched(amount):
    return MESH.X * np.array([1.0 + amount, 1.0 - 0.4 * amount, 1.0 - 0.3 * amount])


def path_forces(law, path, h, steps):
    """Nodal forces during motion along a path, over the elastic ones at the end."""
    system = solid_system(MESH, law, relaxation=PRONY)
    elastic = solid_system(MESH, law)
    state, forces = system.rest_state(), []
    for i in range(1, steps + 1):
        q = path(i * h)
        step = system.during(state, h)
        forces.append(step.force(q, step.control(NONE)).f)
        state = sim.State(i * h, q, state.v, step.remember(q))
    return np.array(forces), elastic.force(path(steps * h), elastic.control(NONE)).f


LAWS = [sim.LinearElastic(), sim.CoRotational(), sim.Fung(), sim.Ogden(), sim.MooneyRivlin()]


@pytest.mark.parametrize("law", LAWS, ids=lambda law: type(law).__name__)
@pytest.mark.parametrize("h", [0.01, 0.3])
def test_stress_relaxation_at_any_step(law, h):
    """Stretched within the first step, then held: S = G(t) S_e after a ramp of length h.

    The recursion is exact for stresses that change linearly within a step, so the closed form is
    the mean of G over the ramp: 1/h int_(t-h)^t G ds. The bulk law does not relax.
    """
    bulk = None if type(law) in (sim.LinearElastic, sim.CoRotational) else sim.QuadraticBulk(0.0)
    solid = (sim.Material(law, bulk), sim.Material(law, bulk, relaxation=PRONY))
    axes = np.broadcast_to(np.eye(3), (MESH.n_elements, 3, 3))
    elastic, system = (
        sim.compile_scene(sim.Scene(MESH, (sim.Solid((m,), axes=axes),))) for m in solid
    )
    q, state = stretched(0.2), system.rest_state()
    f = elastic.force(q, elastic.control(NONE)).f
    for i in range(1, 6):
        step = system.during(state, h)
        expected = quad(PRONY.at, (i - 1) * h, i * h, epsabs=1e-13)[0] / h
        here = step.force(q, step.control(NONE)).f
        np.testing.assert_allclose(here, expected * f, atol=1e-12 * np.abs(f).max())
        state = sim.State(i * h, q, state.v, step.remember(q))
    system = system.during(state, np.inf)
    relaxed = system.force(q, system.control(NONE)).f
    np.testing.assert_allclose(relaxed, PRONY.relaxed * f, atol=1e-12 * np.abs(f).max())


def test_error_in_the_step_is_of_second_order_along_a_smooth_path():
    """S(t) = int G(t - s) dS_e/ds ds by quadrature, for a linear law under a sine of displacement."""
    T, rate = 0.5, 7.0
    law = sim.LinearElastic()

    def path(t):
        return stretched(0.2 * np.sin(rate * t))

    elastic = solid_system(MESH, law)
    unit = elastic.force(stretched(1.0), elastic.control(NONE)).f
    history = quad(lambda s: PRONY.at(T - s) * 0.2 * rate * np.cos(rate * s), 0, T, epsabs=1e-12)[0]
    errors = []
    for steps in (16, 32, 64):
        forces, _ = path_forces(law, path, T / steps, steps)
        errors.append(np.abs(forces[-1] - history * unit).max())
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    np.testing.assert_allclose(orders, 2.0, atol=0.1)


def test_storage_and_loss_modulus():
    """G* = G_inf + sum g i w tau/(1 + i w tau) in steady oscillation; the loss is dissipated energy.

    Steps of 1/64 period cause a relative error of (w h)^2/12 = 8e-4.
    """
    w, periods, n = 7.0, 7, 64
    h, amplitude = 2 * np.pi / w / n, 0.05
    law = sim.LinearElastic()
    forces, _ = path_forces(law, lambda t: stretched(amplitude * np.sin(w * t)), h, periods * n)
    elastic = solid_system(MESH, law)
    unit = elastic.force(stretched(amplitude), elastic.control(NONE)).f
    ratio = np.einsum("tni,ni->t", forces[-n:], unit) / (unit**2).sum()
    phase = w * h * np.arange((periods - 1) * n + 1, periods * n + 1)
    moduli = 2 * np.mean(ratio * np.sin(phase)), 2 * np.mean(ratio * np.cos(phase))
    times = 1j * w * np.array(PRONY.tau)
    expected = PRONY.relaxed + (np.array(PRONY.g) * times / (1 + times)).sum()
    assert moduli == pytest.approx((expected.real, expected.imag), rel=2e-3)
    assert moduli[1] > 0.0


def column(relaxation):
    """A column that hangs from its top, with negligible inertia."""
    mesh = grid((1, 1, 4), (0.01, 0.01, 0.04))
    top = np.isclose(mesh.X[:, 2], mesh.X[:, 2].max())
    material = sim.Material(sim.LinearElastic(15e3, 0.3), density=1e-3, relaxation=relaxation)
    scene = sim.Scene(
        mesh,
        (sim.Solid((material,)), sim.Gravity((0.0, 0.0, -5e4))),
        reductions=(sim.Fixed(np.flatnonzero(top)),),
    )
    return sim.compile_scene(scene)


def creep_compliance(prony, t):
    """J(t)/J(0) of one relaxation time: (1 - (1 - G_inf) exp(-G_inf t/tau))/G_inf.

    The inverse of G in the sense of convolution (standard linear solid).
    """
    G = prony.relaxed
    return (1.0 - (1.0 - G) * np.exp(-G * t / prony.tau[0])) / G


def test_creep_under_a_constant_load():
    """The displacement of a linear solid is that of the elastic one times J(t)/J(0)."""
    prony = sim.Prony((0.6,), (0.5,))
    elastic, system = column(None), column(prony)
    exact = sim.Static(residual_tolerance=1e-12)
    state, _ = exact.step(
        elastic, elastic.rest_state(), elastic.control(NONE), 1.0, sim.Workspace(elastic)
    )
    u0 = state.q - system.scene.mesh.X
    errors = []
    for h in (0.05, 0.025):
        trajectory, _ = sim.simulate(
            system,
            sim.resting(0),
            duration=1.0,
            integrator=sim.ConvergedEuler(tolerance=1e-12, residual_tolerance=1e-12),
            steps=sim.FixedStep(h),
            probes=(sim.Positions(),),
        )
        u = trajectory["node_position"].transpose("time", "node", "axis").values
        u = u - system.scene.mesh.X
        expected = creep_compliance(prony, trajectory.time.values)[1:, None, None] * u0
        errors.append(np.abs(u[1:] - expected).max() / np.abs(u0).max())
    # The load increases over the first step, which delays it by half a step.
    assert np.log2(errors[0] / errors[1]) == pytest.approx(1.0, abs=0.1)
    assert errors[-1] < 0.03


def driven(alpha=19.0, beta=0.02, gravity=9.8, **more):
    mesh, terms = grid((2, 2, 2), wedges=(1,)), (sim.Gravity((0.0, 0.0, -gravity)),)
    damping = sim.RestRayleigh(alpha, beta)
    return fixed_block(mesh, sim.Blemker(30e3), terms=terms, damping=damping, **more)


def test_forces_and_tangents_during_a_step_have_a_potential():
    """Force = -dE/dq and K = -df/dq with a memory that is not relaxed; K depends on the step."""
    system = solid_system(MESH, sim.Ogden(), relaxation=PRONY)
    state, rng = system.rest_state(), np.random.default_rng(0)
    control = system.control(NONE)
    for i in range(2):
        q = MESH.X + rng.normal(size=MESH.X.shape) * 5e-4
        state = sim.State(0.1 * i, q, state.v, system.during(state, 0.1).remember(q))
    step, q, h = system.during(state, 0.02), MESH.X + rng.normal(size=MESH.X.shape) * 5e-4, 1e-7
    at_q, K = step.tangent(q, control)
    slope, stiffness = np.empty(q.size), np.empty((q.size, q.size))
    for i in range(q.size):
        moved = np.zeros(q.size)
        moved[i] = h
        above = step.force(q + moved.reshape(-1, 3), control)
        below = step.force(q - moved.reshape(-1, 3), control)
        slope[i] = (above.energy - below.energy) / (2 * h)
        stiffness[i] = -(above.f - below.f).ravel() / (2 * h)
    assert np.abs(at_q.f.ravel() + slope).max() < 1e-7 * np.abs(slope).max()
    assert np.abs(dense(step, K) - stiffness).max() < 1e-7 * np.abs(stiffness).max()


EXPLICIT = {sim.SymplecticEuler: 2e-4, sim.RungeKutta4: 2.5e-4}


@functools.cache
def moving():
    """System whose motions are compared; compiled by the first test, not by every collection."""
    return driven(100.0, 2e-3, 0.0, relaxation=PRONY)


def end_of_motion(system, integrator, h):
    activation = sim.Activation(np.array([0.0, 0.1]), np.array([[0.0, 0.0], [0.3, 0.3]]))
    steps = sim.FixedStep(h)
    return sim.simulate(system, activation, duration=0.1, integrator=integrator, steps=steps)[1]


@functools.cache
def reference_motion():
    """Second-order solution with an error of 1e-8 m (difference from Sdirk2)."""
    return end_of_motion(moving(), sim.Trapezoidal(), 0.1 / 320).q


@pytest.mark.parametrize("cls", INTEGRATORS)
def test_every_integrator_updates_the_memory(cls):
    """All integrators converge to the same motion."""
    h = EXPLICIT.get(cls, 0.005)
    ends = [end_of_motion(moving(), cls(), size) for size in (2 * h, h)]
    errors = [np.abs(end.q - reference_motion()).max() for end in ends]
    assert ends[1].memory["Solid[0]"].any()
    assert errors[1] < 0.65 * errors[0] or errors[1] < 1e-8
    assert errors[1] < 2e-4


@pytest.mark.parametrize("fraction", [1.0, PRONY.relaxed], ids=["elastic", "relaxed"])
def test_the_reference_motion_is_neither_elastic_nor_relaxed(fraction):
    law = sim.MooneyRivlin(2500.0 * fraction, 1175.0 * fraction)
    system = driven(100.0, 2e-3, 0.0, law=law)
    other = end_of_motion(system, sim.Trapezoidal(), 0.005).q
    assert np.abs(other - reference_motion()).max() > 4e-4


def test_a_static_equilibrium_is_relaxed():
    system = driven(relaxation=PRONY)
    soft = sim.MooneyRivlin(2500.0 * PRONY.relaxed, 1175.0 * PRONY.relaxed)
    elastic = driven(law=soft)
    ends = []
    for s in (system, elastic):
        control = s.control(np.full(2, 0.2))
        ends.append(sim.Static().step(s, s.rest_state(), control, 1.0, sim.Workspace(s))[0])
    np.testing.assert_allclose(ends[0].q, ends[1].q, atol=1e-9)
    # It continues like a fully relaxed one.
    memory = ends[0].memory["Solid[0]"]
    assert np.abs(memory[:, 1:]).max() == 0.0 and np.abs(memory[:, 0]).max() > 0.0
    still, forgotten = (
        system.during(state, 0.01).force(ends[0].q, system.control(np.full(2, 0.2))).f
        for state in (ends[0], replace(ends[0], memory={}))
    )
    np.testing.assert_allclose(still, forgotten, atol=1e-14)


@pytest.mark.parametrize("cls", INTEGRATORS)
def test_a_rejected_step_changes_nothing(cls):
    """A failed step, followed by its half, gives the same numbers as the half alone."""
    system, h = moving(), 2 * EXPLICIT.get(cls, 0.005)
    control = system.control(np.full(2, 0.3))
    state = system.rest_state()
    for _ in range(3):
        state, _ = cls().step(system, state, control, h, sim.Workspace(system))
    before = {name: array.copy() for name, array in state.memory.items()}
    q, v = state.q.copy(), state.v.copy()
    alone, _ = cls().step(system, state, control, h / 2, sim.Workspace(system))

    wild = replace(state, v=1e5 * np.random.default_rng(0).normal(size=state.v.shape))
    impatient = cls(max_iterations=1) if "max_iterations" in cls.__annotations__ else cls()
    with pytest.raises((sim.NotConverged, sim.InvertedElement, sim.SingularSystem)):
        impatient.step(system, wild, control, h, sim.Workspace(system))
    for name, array in state.memory.items():
        np.testing.assert_array_equal(array, before[name])
    np.testing.assert_array_equal(state.q, q)
    np.testing.assert_array_equal(state.v, v)
    again, _ = cls().step(system, state, control, h / 2, sim.Workspace(system))
    np.testing.assert_array_equal(again.q, alone.q)
    np.testing.assert_array_equal(again.memory["Solid[0]"], alone.memory["Solid[0]"])


def test_rejected_steps_do_not_change_the_motion():
    activation = sim.Activation(np.array([0.0, 0.1]), np.array([[0.0, 0.0], [0.3, 0.3]]))
    trajectory, end = sim.simulate(
        moving(),
        activation,
        duration=0.1,
        integrator=sim.Sdirk2(),
        steps=sim.ErrorControlledStep(h=0.1, tolerance=1e-5),
        probes=(sim.Iterations(),),
    )
    assert trajectory.rejected.sum() > 0
    assert np.abs(end.q - reference_motion()).max() < 1e-5


def test_a_saved_memory_continues_the_motion():
    """A single run equals one that was saved and continued."""
    system = driven(relaxation=PRONY)
    activation = sim.Activation(np.array([0.0, 0.1]), np.array([[0.0, 0.0], [0.3, 0.2]]))
    run = dict(steps=sim.FixedStep(0.01), integrator=sim.LinearlyImplicitEuler())
    _, whole = sim.simulate(system, activation, duration=0.1, **run)
    _, half = sim.simulate(system, activation, duration=0.05, **run)
    copied = sim.State(half.t, half.q.copy(), half.v.copy(), dict(half.memory))
    _, rest = sim.simulate(system, activation, duration=0.05, initial=copied, **run)
    np.testing.assert_allclose(rest.q, whole.q, atol=1e-15)


def test_a_scene_without_relaxation_has_no_memory():
    system = driven()
    assert system.during(system.rest_state(), 0.01) is system
    control = system.control(np.full(2, 0.3))
    for integrator in (sim.LinearlyImplicitEuler(), sim.ConvergedEuler(), sim.Static()):
        state, _ = integrator.step(
            system, system.rest_state(), control, 0.01, sim.Workspace(system)
        )
        assert dict(state.memory) == {}


def test_stiffening_of_viscoelastic_tissue_is_refused():
    tissue = sim.Solid((sim.Material(relaxation=PRONY),), muscles=crossed_muscles(MESH))
    rows = np.arange(MESH.n_elements)
    stiffening = sim.Stiffening(("first",), rows, np.zeros_like(rows), tissue)
    with pytest.raises(sim.SceneError, match="is viscoelastic"):
        sim.compile_scene(sim.Scene(MESH, (tissue, stiffening)))
