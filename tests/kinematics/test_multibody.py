"""Fused steps of scenes of bodies alone: equal to the general path, and chosen by the scene."""

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

import sim
from sim.integrators import Workspace
from sim.joints import Bushing, Limit, PointOnCurve, PointOnPlane, Revolute, Spherical, Weld
from sim.scene import CompiledTerm
from tests.kinematics.scenes import INERTIA, mixed_system, swing

STEPPED = (sim.LinearlyImplicitEuler(), sim.LinearlyImplicitTrapezoidal())
POINTS = np.array(
    [[0.0, 0.0, 0.05], [0.01, 0.02, 0.0], [0.04, 0.0, 0.0], [0.05, 0.01, 0.02], [0.06, 0.0, 0.01]]
)


def scene(*joints, motion=swing, **more) -> sim.Scene:
    """Two bodies on lines to space, to each other and to a prescribed one."""
    bodies = (
        sim.Body("jaw", 0.2, 100.0 * INERTIA, (0.02, 0.01, 0.0), (0.3, 1e-5)),
        sim.Body("skull", centre=(0.03, 0.005, 0.005)),
        sim.Body("hyoid", 0.1, 50.0 * INERTIA, (0.05, 0.01, 0.01)),
    )
    members = (
        sim.Fixed(np.array([0])),
        sim.OnBody("jaw", np.array([1, 2])),
        sim.OnBody("hyoid", np.array([3])),
        sim.OnBody("skull", np.array([4])),
        sim.PrescribedBody("skull", motion),
    )
    fibres = [
        sim.LineFibre(k, np.array(path)) for k, path in enumerate(((0, 1, 3), (2, 4), (1, 3)))
    ]
    laws = sim.Peck(20.0, tendon_ratio=0.2), sim.ConstantForce(3.0), sim.Peck(5.0)
    relation = [sim.ForceVelocity(v_max) for v_max in (0.5, 2.0, 10.0)]
    lines = sim.LineMuscles(
        ("a", "b", "c"), fibres, laws, stiffness=300.0, damping=2.0, relation=relation
    )
    load = sim.NodeLoad(np.array([3]), np.array([[0.1, 0.0, -0.2]]))
    springs = sim.AxialSprings(
        (np.array([0, 3]), np.array([1, 4])), 200.0, 3.0, np.array([0.05, 0.06])
    )
    terms = (sim.Gravity(), lines, load, springs)
    return sim.Scene(
        sim.NO_TISSUE, terms, members, bodies=bodies, points=POINTS, joints=joints, **more
    )


JOINTS = (
    Spherical("ball", "skull", "jaw", (0.02, 0.0, 0.01)),
    PointOnCurve(
        "guide",
        2,
        "skull",
        POINTS[2],
        (0.0, 0.3, 1.0),
        (1.0, 0.0, 0.0),
        np.array([0.0, -0.7, 30.0, -300.0]),
        (0.0, 0.012),
    ),
    Weld("bond", "jaw", "hyoid", (0.04, 0.01, 0.0), compliance=1e-3, damping_time=0.01),
    Bushing(
        "band", "skull", "hyoid", (0.05, 0.0, 0.01), (0, 1, 1), (50.0, 20.0, 9.0, 0.1, 0.2, 0.3)
    ),
    PointOnPlane("bite", 3, None, POINTS[3] - [0.0, 0.0, 1e-4], (0.1, 0.0, 1.0), unilateral=True),
    Limit("stop", None, "hyoid", (0.05, 0.01, 0.01), (0.0, 1.0, 0.0), -0.02, 0.01),
)


def drive(t):
    return sim.Activation(
        np.array([0.0, 0.5 * t, t]), np.array([[0.1, 0.2, 0.3], [0.8, 0.0, 0.2]] * 2)[:3]
    )


def ended(system, integrator, general, n=60, h=1e-3):
    work = sim.Workspace(system)
    if general:
        work.bodies = None
    start = system.rest_state()
    reactions = () if system.rows is None else (sim.Reactions(system.rows.joints),)
    return sim.simulate(
        system,
        drive(n * h),
        duration=n * h,
        steps=sim.FixedStep(h),
        every=10 * h,
        integrator=integrator,
        initial=start,
        work=work,
        probes=(sim.Frames(("jaw", "skull", "hyoid")), sim.Iterations(), *reactions),
    )


@pytest.mark.parametrize("integrator", STEPPED)
@pytest.mark.parametrize("joints", [JOINTS, ()])
def test_fused_steps_equal_the_general_path(integrator, joints):
    """Joints, limits that are reached, lines with dampers and a prescribed body that turns."""
    system = sim.compile_scene(scene(*joints))
    (fused, a), (general, b) = (ended(system, integrator, g) for g in (False, True))
    assert np.abs(a.q - system.mesh.X).max() > 1e-3
    for name in ("q", "v", "frames", "twists"):
        there = getattr(b, name)
        np.testing.assert_allclose(getattr(a, name), there, atol=1e-11 * np.abs(there).max())
    np.testing.assert_allclose(fused.body_position, general.body_position, atol=1e-12)
    control = sim.activation.Driven(system, drive(0.06))(0.03)
    bodies = sim.Workspace(system).bodies
    rest, f = system.rest_state(), []
    for state in (rest, b):
        force = system.force(state.q, control).f
        f.append(system.kinematics.generalised_force(force, state.pose))
    frames = np.stack([rest.frames, b.frames])
    (d,), (change,) = bodies.changes(frames, control.activation[None])
    np.testing.assert_allclose(d, system.kinematics.between(rest.pose, b.pose), atol=1e-15)
    np.testing.assert_allclose(change, f[0] - f[1], atol=1e-12 * np.abs(f).max())
    np.testing.assert_array_equal(fused.steps, general.steps)
    if joints:
        for name in ("joint_force", "joint_moment"):
            there = general[name].values[..., 1:]
            allowed = 1e-7 * np.abs(there).max()
            np.testing.assert_allclose(fused[name].values[..., 1:], there, atol=allowed)
        # the inequalities were active
        loose = ended(sim.compile_scene(scene(*JOINTS[:4])), integrator, False)[1]
        assert np.abs(loose.q - a.q).max() > 1e-5


def test_steps_continue_bit_for_bit_from_a_checkpoint_and_single_steps_are_the_same():
    system = sim.compile_scene(scene(*JOINTS))
    whole = ended(system, STEPPED[0], False)[1]
    work, state = sim.Workspace(system), system.rest_state()
    control = sim.activation.Driven(system, drive(0.06))
    for k in range(60):
        state, _ = STEPPED[0].step(system, state, control, (k + 1) * 1e-3 - state.t, work)
    np.testing.assert_allclose(state.q, whole.q, atol=1e-12)

    def run(duration, initial=None, checkpoint=None):
        return sim.simulate(
            system,
            drive(0.06),
            duration=duration,
            steps=sim.FixedStep(1e-3),
            every=0.01,
            integrator=STEPPED[0],
            initial=initial,
            checkpoint=checkpoint,
        )[1]

    whole, end = run(0.06, checkpoint=3), run(0.03, run(0.03))
    np.testing.assert_array_equal(end.frames, whole.frames)
    np.testing.assert_array_equal(end.twists, whole.twists)


class OneByOne:
    """A probe without the evaluation of several outputs at once."""

    def __init__(self, probe):
        self.variables, self.record = probe.variables, probe.record


def test_probes_evaluate_several_outputs_as_one_by_one():
    """Seven steps to an output, so that calls of 1000 steps end between outputs."""
    system, h = sim.compile_scene(scene(*JOINTS)), 2.5e-4
    probes = (
        sim.Frames(("jaw", "skull", "hyoid")),
        sim.Markers(np.array([1, 3]), ("a", "b")),
        sim.Reactions(system.rows.joints),
        sim.Iterations(),
    )
    seen, motions = [], []
    for chosen in (probes, tuple(map(OneByOne, probes))):
        motions.append(
            sim.simulate(
                system,
                drive(0.3),
                duration=1050 * h,
                steps=sim.FixedStep(h),
                every=7 * h,
                integrator=STEPPED[0],
                probes=chosen,
                progress=lambda done, total: seen.append((done, total)),
            )[0]
        )
    xr.testing.assert_identical(motions[0].drop_attrs(), motions[1].drop_attrs())
    np.testing.assert_array_equal(motions[0].steps[1:], 7)
    assert seen == [(k + 1, 150) for k in range(150)] * 2


def test_fused_steps_are_chosen_by_the_scene():
    """Rayleigh damping, or a point attached to other points, requires the general path."""
    assert sim.compile_scene(scene()).multibody is not None
    assert sim.compile_scene(scene(damping=sim.RestRayleigh())).multibody is None
    system = mixed_system()
    assert system.multibody is None
    assert sim.Workspace(system).bodies is None


class Unknown(sim.Gravity):
    """A term whose compiled form has no table for the fused step."""

    def compile(self, layout):
        """Without `add_to`."""
        made = super().compile(layout)

        class Compiled(CompiledTerm):
            add = staticmethod(made.add)

        return Compiled()


def test_a_term_that_prevents_fused_steps_is_named():
    whole = scene()
    system = sim.compile_scene(replace(whole, terms=(*whole.terms, Unknown())))
    assert system.multibody is None
    assert "Unknown[0] has no table" in system.not_fused
    assert "Unknown[0]" in system.facts()["steps not fused"]
    with pytest.warns(sim.SlowStepsWarning, match=r"100 times as long: Unknown\[0\]"):
        sim.simulate(
            system, drive(0.002), duration=0.002, integrator=STEPPED[0], steps=sim.FixedStep(1e-3)
        )
    assert sim.compile_scene(whole).not_fused == "" == mixed_system().not_fused


def test_an_indefinite_step_equals_that_of_the_general_path():
    """The matrix of a step is indefinite if the step is too long for a spring of negative stiffness."""
    points = np.array([[0.0, 0.0, 0.1], [0.0, 0.0, 0.0]])
    law = sim.Peck(500.0, passive_fraction=0.0)
    lines = sim.LineMuscles(("m",), (sim.LineFibre(0, np.array([0, 1])),), law)
    body = sim.Body("bob", 0.1, INERTIA, (0.0, 0.0, 0.0))
    members = sim.Fixed(np.array([0])), sim.OnBody("bob", np.array([1]))
    system = sim.compile_scene(
        sim.Scene(sim.NO_TISSUE, (lines,), members, bodies=(body,), points=points)
    )
    state = system.rest_state()
    away = system.kinematics.advance(state.pose, np.array([0, 0, -0.02, 0, 0, 0.0]), 0.0)
    state = system.kinematics.state(away, np.zeros(6), {})
    control, ends = system.control(np.ones(1)), list[sim.State]()
    for fused in (True, False):
        work = sim.Workspace(system)
        assert work.bodies.advance(state, control, (0.1,), 1.0).done == 1
        if not fused:
            work.bodies = None
        end, report = STEPPED[0].step(system, state, control, 0.1, work)
        assert report.indefinite == 1
        ends.append(end)
    np.testing.assert_allclose(ends[0].frames, ends[1].frames, atol=1e-11)
    np.testing.assert_allclose(ends[0].twists, ends[1].twists, atol=1e-10)


def drift_of_a_chain():
    """Violations of two joints at 101 outputs of 100 s in steps of 1 ms, and the largest motion [m]."""
    bodies = tuple(
        sim.Body(n, 0.2, 10.0 * INERTIA, (0.0, y, 0.0)) for n, y in (("a", 0.1), ("b", 0.3))
    )
    joints = (
        Revolute("top", None, "a", (0.0, 0.0, 0.0), (1.0, 0.2, 0.0)),
        Spherical("middle", "a", "b", (0.0, 0.2, 0.0)),
    )
    system = sim.compile_scene(
        sim.Scene(sim.NO_TISSUE, (sim.Gravity(),), bodies=bodies, joints=joints)
    )
    worst = []

    class Drift:
        def variables(self):
            return ()

        def record(self, system, state, control, report):
            worst.append(np.abs(system.rows.evaluate(state.pose).c).max())
            return ()

    end = sim.simulate(
        system,
        sim.resting(0),
        duration=100.0,
        steps=sim.FixedStep(1e-3),
        every=1.0,
        integrator=sim.LinearlyImplicitTrapezoidal(),
        probes=(Drift(),),
    )[1]
    return worst, float(np.abs(end.frames[:, :3] - system.rest_state().frames[:, :3]).max())


def test_joints_of_a_chain_do_not_drift_over_a_hundred_seconds():
    """1e-9 m is allowed."""
    worst, moved = drift_of_a_chain()
    assert len(worst) == 101
    assert max(worst) < 1e-9
    assert moved > 0.05


@pytest.mark.parametrize("integrator", STEPPED)
def test_a_free_compound_with_a_joint_conserves_its_momentum(integrator):
    bodies = tuple(
        sim.Body(n, 0.2, 10.0 * INERTIA, (0.0, y, 0.0)) for n, y in (("a", 0.1), ("b", 0.3))
    )
    ball = Spherical("ball", "a", "b", (0.0, 0.2, 0.0))
    system = sim.compile_scene(sim.Scene(sim.NO_TISSUE, (), bodies=bodies, joints=(ball,)))
    w = np.array([0.3, 0.0, 0.1, 4.0, 2.0, -1.0, -0.2, 0.1, 0.0, -3.0, 1.0, 2.0])
    state, work = system.kinematics.state(system.rest_state().pose, w, {}), sim.Workspace(system)
    control = system.control(np.zeros(0))
    before = system.node_mass @ state.v
    for _ in range(200):
        state, _ = integrator.step(system, state, control, 1e-3, work)
    np.testing.assert_allclose(
        system.node_mass @ state.v, before, atol=1e-10 * np.abs(before).max()
    )
    assert np.abs(system.rows.evaluate(state.pose).c).max() < 1e-12


def test_sdirk2_keeps_its_order_with_rotation():
    """Bodies that turn at 20 rad/s on lines; stiff tissue on them hides the order at such steps."""
    system = sim.compile_scene(scene())
    w = np.array([0.1, 0.05, -0.1, 3.0, 20.0, -10.0, 0.0, 0.1, 0.0, 5.0, -10.0, 3.0])
    start = system.kinematics.state(system.rest_state().pose, w, {})
    levels = np.array([[0.1, 0.2, 0.3], [0.3, 0.1, 0.2]])
    ends = [
        sim.simulate(
            system,
            sim.Activation(np.array([0.0, 1.0]), levels),
            duration=0.01,
            steps=sim.FixedStep(0.01 / n),
            every=0.01,
            integrator=sim.Sdirk2(tolerance=1e-12, residual_tolerance=1e-10),
            initial=start,
            probes=(),
        )[1]
        for n in (3, 6, 12)
    ]
    change = [
        np.linalg.norm(system.kinematics.between(b.pose, a.pose))
        for a, b in zip(ends, ends[1:], strict=False)
    ]
    assert abs(np.log2(change[0] / change[1]) - 2.0) < 0.02


def test_activations_of_many_steps_are_the_ends_of_their_chords():
    """Corners between, at and within steps, before the first and after the last sample."""
    system = sim.compile_scene(scene())
    values = np.random.default_rng(0).uniform(size=(6, 3))
    samples = np.array([0.01, 0.02, 0.0255, 0.03, 0.0312, 0.05])
    control = sim.activation.Driven(system, sim.Activation(samples, values))
    times = np.arange(0.0, 0.08, 0.005).tolist()
    expected = [control.chord(t, 0.005).at(1.0).activation for t in times[:-1]]
    np.testing.assert_allclose(control.at_ends(times), expected, atol=1e-12)


def test_stops_that_are_reached_together_share_the_force():
    """A square on four stops, of which three would do: each carries a quarter of the weight."""
    corners = np.array([[x, y, 0.0] for x in (-0.1, 0.1) for y in (-0.1, 0.1)])
    stops = [
        PointOnPlane(f"stop {k}", k, None, c, (0.0, 0.0, 1.0), True) for k, c in enumerate(corners)
    ]
    body = sim.Body("plate", 0.4, np.diag([1.0, 1.0, 2.0]) * 1e-3, (0.0, 0.0, 0.02))
    system = sim.compile_scene(
        sim.Scene(
            sim.NO_TISSUE,
            (sim.Gravity((0.0, 0.0, -10.0)),),
            (sim.OnBody("plate", np.arange(4)),),
            bodies=(body,),
            points=corners,
            joints=tuple(stops),
        )
    )
    work, control = sim.Workspace(system), sim.activation.Driven(system, sim.resting(0))
    ends = (1e-3 * np.arange(1, 201)).tolist()
    passed = work.bodies.advance(system.rest_state(), control, ends, 1.0)
    assert passed.done == 200
    state = passed.state(200)
    np.testing.assert_allclose(state.memory["joints"], 1.0, rtol=1e-6)
    assert np.abs(state.q[:4, 2]).max() < 1e-9


def test_jump_is_the_change_of_the_velocity_of_a_point_times_the_step():
    """A body that falls gains g h in every step; one that is hit at an arm r turns, too."""
    h, mass, r, push = 2e-3, 0.1, 0.04, 3.0
    body = sim.Body("stone", mass, 1e-5 * np.eye(3))
    points = np.array([[0.0, 0.0, 0.0], [r, 0.0, 0.0]])
    for load, expected in (
        ([0.0, 0.0, -9.8 * mass], 9.8 * h * h),
        ([0.0, 0.0, push], h * h * (push / mass + r * push * r / 1e-5)),
    ):
        node = int(expected != 9.8 * h * h)
        terms = (sim.NodeLoad(np.array([node]), np.array([load])),)
        stone = sim.Scene(
            sim.NO_TISSUE,
            terms,
            (sim.OnBody("stone", np.array([0, 1])),),
            bodies=(body,),
            points=points,
        )
        system = sim.compile_scene(stone)
        method, work = sim.LinearlyImplicitEuler(), Workspace(system)
        still = system.control(np.zeros(0))
        _, report = method.step(system, system.rest_state(), still, h, work)
        assert report.jump == pytest.approx(expected, rel=0.02)
