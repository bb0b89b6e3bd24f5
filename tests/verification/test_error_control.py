"""Error control meets the requested tolerance, and rejected steps have no effect."""

import functools
import inspect
from dataclasses import dataclass, replace

import numpy as np
import pytest

import sim
from sim.integrators.stage import Converged
from sim.steps import Motion
from tests.bodies import fixed_block, grid
from tests.contact.scenes import box

DURATION, H = 0.2, 0.01
DRIVES = {
    "ramp": lambda t: 0.5 * np.clip(t / 0.1, 0.0, 1.0),
    "burst": lambda t: 0.8 * np.exp(-(((t - 0.1) / 0.03) ** 2)),
    "jump": lambda t: np.where(t > 0.05, 0.6, 0.0),
}


def block(wall=None):
    """Block fixed at its lower side; the muscles press it against a rigid surface at `wall` [m]."""
    mesh = grid((2, 2, 2), wedges=(1,))
    contact = ()
    if wall is not None:
        faced = box([wall, -0.1, -0.1], [wall + 0.1, 0.1, 0.1])
        contact = (sim.ConstraintContact((sim.Pairing(sim.boundary_surface(mesh), faced),)),)
    terms, damping = (sim.Gravity(), *contact), sim.RestRayleigh(19.0, 0.03)
    return fixed_block(mesh, sim.Blemker(30e3), terms=terms, damping=damping)


def drive(name):
    t = np.linspace(0.0, DURATION, 21)
    a = DRIVES[name](t)
    return sim.Activation(t, np.stack([a, 0.3 * a], axis=1))


def motion(system, name, integrator, steps):
    trajectory, _ = sim.simulate(
        system,
        drive(name),
        duration=DURATION,
        integrator=integrator,
        steps=steps,
        probes=(sim.Positions(), sim.Iterations()),
    )
    return trajectory


def solver(cls):
    return cls(tolerance=1e-9, residual_tolerance=1e-8) if issubclass(cls, Converged) else cls()


@pytest.mark.parametrize("name", DRIVES)
def test_the_error_stays_within_the_tolerance(name):
    system = block()
    fine = motion(system, name, solver(sim.Sdirk2), sim.FixedStep(H / 32)).node_position
    fine = fine.isel(time=slice(None, None, 32)).values
    cases = {
        sim.ConvergedEuler: (3e-4,),
        sim.Sdirk2: (3e-4, 3e-5),
        sim.LinearlyImplicitTrapezoidal: (3e-4,),  # without an estimate: repeated in halves
    }
    for cls, tolerances in cases.items():
        errors, counts = [], []
        for tolerance in tolerances:
            run = motion(system, name, solver(cls), sim.ErrorControlledStep(tolerance, H))
            axis = run.node_position.dims.index("axis")
            errors.append(np.linalg.norm(run.node_position.values - fine, axis=axis).max())
            counts.append(int(run.steps.sum()))
            assert errors[-1] <= tolerance, (cls.__name__, tolerance)
        # steps are not needlessly short: the error is at least a tenth of the tolerance
        assert errors[0] > 0.02 * tolerances[0]
        assert sorted(counts) == counts


def test_the_tolerance_is_met_in_contact_with_a_wall():
    """Impact, sliding and release by jumps of the load, with both integrators that support contact."""
    system, tolerance = block(0.021), 2e-4
    time = np.array([0.0, 0.01, 0.012, 0.03, 0.032])
    load = np.array([0.0, 0.0, 0.6, 0.6, 0.0])
    activation = sim.Activation(time, np.stack([load, 0.3 * load], axis=1))

    def run(cls, steps):
        return sim.simulate(
            system,
            activation,
            duration=0.05,
            integrator=cls(tolerance=1e-6, residual_tolerance=1e-5),
            steps=steps,
            every=H,
            probes=(sim.Positions(), sim.Iterations(), sim.Contacts()),
        )[0]

    fine = run(sim.Sdirk2, sim.FixedStep(H / 8))
    counts = []
    for cls in (sim.ConvergedEuler, sim.Sdirk2):
        result = run(cls, sim.ErrorControlledStep(tolerance, H))
        gap = result.node_position.values - fine.node_position.values
        error = np.linalg.norm(gap, axis=result.node_position.dims.index("axis")).max()
        assert 0.02 * tolerance < error <= tolerance, cls.__name__
        assert result.contact_force.max() > 1e-2
        assert result.contact_force[..., -1] == 0.0
        counts.append(int(result.steps.sum()))
    assert counts[1] < counts[0] < 300


ESTIMATING = (sim.LinearlyImplicitEuler, sim.ConvergedEuler, sim.Sdirk2)


@pytest.mark.parametrize("cls", ESTIMATING)
def test_estimated_errors_fall_with_the_order_of_the_method_and_have_the_right_size(cls):
    """One step from a smooth motion: estimate against the error of the step itself."""
    law, damping = sim.NeoHooke(2500.0), sim.RestRayleigh(19.0, 0.03)
    system = fixed_block(grid((2, 2, 2)), sim.Constant(5e3), law, damping=damping)
    control = system.control(np.array([0.3, 0.1]))
    tight = {"tolerance": 1e-13, "residual_tolerance": 1e-11}
    moving = sim.simulate(
        system,
        sim.Activation(np.zeros(1), control.activation[None]),
        duration=0.02,
        integrator=sim.Sdirk2(**tight),
        steps=sim.FixedStep(2.5e-4),
    )[1]
    integrator = cls(**tight) if issubclass(cls, Converged) else cls()
    ratios, estimates = [], []
    for h in (1e-3, 5e-4):
        exact, work = moving, sim.Workspace(system)
        for _ in range(8):
            exact, _ = sim.Sdirk2(**tight).step(system, exact, control, h / 8, work)
        end, report = integrator.step(system, moving, control, h, sim.Workspace(system))
        estimates.append(np.linalg.norm(report.local_error, axis=1).max())
        ratios.append(estimates[-1] / np.linalg.norm(end.q - exact.q, axis=1).max())
    assert 0.5 < ratios[-1] < 2.0
    assert np.log2(estimates[0] / estimates[1]) == pytest.approx(cls.order + 1, abs=0.25)


def test_a_rejected_step_changes_nothing():
    """Attempts that fail after they did their work change neither the state nor the result."""
    sizes = []

    class Faltering(sim.ConvergedEuler):
        def step(self, system, state, control, h, work):
            end = super().step(system, state, control, h, work)  # changes the workspace in any case
            if h > 0.004 and state.t > 0.015:
                raise sim.NotConverged((1.0,), state.t + h, "made to fail")
            sizes.append(h)
            return end

    system, exact = block(), {"tolerance": 1e-12, "residual_tolerance": 1e-10}
    control = system.control(np.array([0.4, 0.1]))
    state, rejected = system.rest_state(), 0
    driven = Motion(Faltering(**exact), system, control, sim.Workspace(system))
    for i in range(1, 6):
        before = state.q.copy(), state.v.copy()
        new, report = sim.HalvingStep(0.01).advance(driven, state, i * 0.01)
        np.testing.assert_array_equal(state.q, before[0])
        np.testing.assert_array_equal(state.v, before[1])
        state, rejected = new, rejected + report.rejected
    assert rejected >= 3
    plain, work = system.rest_state(), sim.Workspace(system)
    for h in sizes:
        plain, _ = sim.ConvergedEuler(**exact).step(system, plain, control, h, work)
    np.testing.assert_allclose(state.q, plain.q, rtol=0, atol=1e-11)


@dataclass(frozen=True)
class Fed:
    """Damping D = -rate M, by which velocities grow as e^(rate t)."""

    rate: float
    beta: float = 0.0
    rest: None = None

    def compile(self, layout, stiffness):
        return replace(self, mass=layout.node_mass, pattern=layout.pattern)

    mass: object = None
    pattern: object = None

    def __call__(self, q, control, K=None):
        D = np.zeros(self.pattern.nnz)
        D[self.pattern.diagonal] = -self.rate * self.mass[self.pattern.free // 3]
        return D


@pytest.mark.parametrize(("rate", "refused"), [(60.0, False), (400.0, True)])
@pytest.mark.parametrize("control", ["error", "halving"])
def test_damping_that_feeds_the_motion_ends_it(rate, refused, control):
    """Velocities grow at a known rate; a motion that grows by less than e in 10 ms is simulated."""
    mesh = grid((1, 1, 1))
    system = sim.compile_scene(sim.Scene(mesh, (sim.Solid(),), damping=Fed(rate)))
    start = sim.State(0.0, mesh.X, np.full(mesh.X.shape, 1e-3))
    steps = sim.ErrorControlledStep(1e-7, H, horizon=10.0)
    if control == "halving":
        steps = sim.HalvingStep(H)

    def run():
        return sim.simulate(
            system,
            sim.Activation(np.zeros(1), np.zeros((1, 0))),
            duration=0.05,
            integrator=Fragile() if control == "halving" else sim.Sdirk2(),
            steps=steps,
            initial=start,
        )[1]

    if not refused:
        grown = float(run().v[0, 0]) / 1e-3
        assert grown == pytest.approx(np.exp(rate * 0.05), rel=0.02 if control == "error" else 0.4)
        return
    with pytest.raises(sim.UnstableDamping, match="damping_tangent = 'rest'") as caught:
        run()
    assert caught.value.rate == pytest.approx(rate, rel=1e-9)
    assert isinstance(caught.value, sim.NotConverged)  # weaker muscles avoid it


@dataclass(frozen=True)
class Fragile(sim.ConvergedEuler):
    """Steps above 0.5 ms fail."""

    def step(self, system, state, control, h, work):
        if h > 6e-4:
            raise sim.NotConverged((1.0,), state.t, "made to fail")
        return super().step(system, state, control, h, work)


def test_error_control_of_a_static_solver_is_refused():
    system = block()
    with pytest.raises(sim.SceneError, match="no order in time"):
        motion(system, "ramp", sim.Static(), sim.ErrorControlledStep())


def test_a_tolerance_beyond_the_smallest_step_is_reported():
    """The error differs from a failure of the mechanics, after which sigma_max would be lowered."""
    with pytest.raises(sim.ToleranceMissed, match="smallest step") as caught:
        motion(
            block(), "jump", sim.ConvergedEuler(), sim.ErrorControlledStep(1e-9, H, max_halvings=2)
        )
    assert not isinstance(caught.value, sim.NotConverged)
    assert caught.value.error > caught.value.allowed > 0.0


@pytest.mark.parametrize(
    ("failure", "expected"),
    [
        (sim.NotConverged((1.0,), 0.0, "made to fail"), sim.ToleranceMissed),
        (sim.InvertedElement(0, -0.1, 0.0), sim.InvertedElement),
    ],
)
def test_a_failure_that_only_the_accuracy_requires_is_a_missed_tolerance(failure, expected):
    """Weaker muscles would not repair steps that fail only when they are very short."""

    class NotShort(sim.ConvergedEuler):
        def step(self, system, state, control, h, work):
            if h < 0.3 * H:
                raise failure
            return super().step(system, state, control, h, work)

    with pytest.raises(expected) as caught:
        motion(block(), "jump", NotShort(), sim.ErrorControlledStep(1e-9, H))
    if expected is sim.ToleranceMissed:
        assert caught.value.error > caught.value.allowed > 0.0


def test_a_step_that_never_converges_is_not_a_missed_tolerance():
    class Failing(sim.ConvergedEuler):
        def step(self, system, state, control, h, work):
            raise sim.NotConverged((1.0,), state.t + h, "made to fail")

    with pytest.raises(sim.NotConverged):
        motion(block(), "jump", Failing(), sim.ErrorControlledStep(1e-9, H))


JUMPS = {
    "start": sim.Activation(np.zeros(1), np.array([[0.3, 0.3]])),
    "within": sim.Activation(np.array([0.05, 0.0501]), np.array([[0.0, 0.0], [0.3, 0.3]])),
}


def after_jump(system, name, integrator, steps):
    return sim.simulate(
        system,
        JUMPS[name],
        duration=0.1,
        every=H,
        probes=(sim.Positions(), sim.Iterations()),
        integrator=integrator,
        steps=steps,
    )[0]


@functools.cache
def resolved_jump(name):
    return after_jump(block(), name, solver(sim.Sdirk2), sim.FixedStep(H / 64))


@pytest.mark.parametrize("cls", [sim.ConvergedEuler, sim.Sdirk2, sim.Trapezoidal])
def test_steps_after_a_jump_of_the_load_are_bounded_below(cls):
    """Steps after a jump, at the start or within, are no smaller than the new motion needs."""
    system, tolerance = block(), 1e-4 if cls is sim.ConvergedEuler else 3e-5
    for name in JUMPS:
        exact = resolved_jump(name)
        motion = after_jump(system, name, solver(cls), sim.ErrorControlledStep(tolerance, H))
        gap = np.linalg.norm(motion.node_position.values - exact.node_position.values, axis=1)
        moved = np.linalg.norm((exact.node_position - exact.node_position[..., 0]).values, axis=1)
        assert moved.max() > 30 * tolerance, name
        assert gap.max() <= tolerance, (name, gap.max())
        assert motion.steps.max() < 100, name


def test_accumulated_errors_are_part_of_the_state():
    """A run in two parts has the same steps as an uninterrupted one."""
    system, control = block(), sim.ErrorControlledStep(3e-5, H)
    whole = motion(system, "burst", solver(sim.Sdirk2), control)
    state, steps = None, []
    for _ in range(2):
        part, state = sim.simulate(
            system,
            drive("burst"),
            duration=DURATION / 2,
            integrator=solver(sim.Sdirk2),
            steps=control,
            probes=(sim.Positions(), sim.Iterations()),
            initial=state,
        )
        steps += part.steps.values[1:].tolist()
    np.testing.assert_array_equal(whole.steps.values[1:], steps)
    np.testing.assert_allclose(state.q, whole.node_position.isel(time=-1).values, atol=1e-8)


@pytest.mark.parametrize("read", [False, True])
def test_errors_are_estimated_only_if_something_reads_them(read):
    """The motion and the test of its stability do not depend on it."""

    class Reports:
        """Reports of all steps."""

        def __init__(self):
            self.seen = []

        def variables(self):
            return ()

        def record(self, system, state, control, report):
            self.seen.append(report)
            return ()

    system, reports = block(), Reports()
    probes = (sim.Positions(), reports)
    probes += (sim.StepErrors(np.array([26]), ("corner",)),) if read else ()
    options = {"duration": DURATION, "integrator": sim.LinearlyImplicitEuler()}
    motion, _ = sim.simulate(system, drive("ramp"), probes=probes, **options)
    reports_seen = reports.seen[1:]
    assert {report.local_error is not None for report in reports_seen} == {read}
    assert {report.concave for report in reports_seen} == {False}
    if read:
        assert motion.step_error.isel(time=-1).any() and motion.step_error.notnull().all()
        other, _ = sim.simulate(system, drive("ramp"), probes=(sim.Positions(),), **options)
        np.testing.assert_array_equal(motion.node_position, other.node_position)


def test_everything_that_reads_errors_declares_it():
    """A part that does not would find no estimate."""
    parts = [getattr(sim, name) for name in sim.__all__ if isinstance(getattr(sim, name), type)]
    reading = {part for part in parts if "local_error" in _names(part)}
    assert {sim.StepErrors, sim.ErrorControlledStep} <= reading
    assert {part for part in reading if not getattr(part, "reads_errors", False)} == set()


def _names(part):
    """Names of attributes that the methods of a probe or step control read."""
    if not (hasattr(part, "record") or hasattr(part, "advance")):
        return set()
    methods = [m for m in vars(part).values() if inspect.isfunction(m)]
    return {name for method in methods for name in method.__code__.co_names}


def test_lengths_that_failed_from_a_state_are_not_tried_again():
    """A step of which every length fails is given up after one attempt per length."""
    tried = []

    class Failing(sim.ConvergedEuler):
        def step(self, system, state, control, h, work):
            tried.append(h)
            raise sim.NotConverged((1.0,), state.t, "made to fail")

    with pytest.raises(sim.NotConverged, match="made to fail"):
        motion(block(), "ramp", Failing(), sim.ErrorControlledStep(1e-4, H, max_halvings=6))
    assert len(tried) == 7
    np.testing.assert_allclose(tried, [H / 2**k for k in range(7)])
