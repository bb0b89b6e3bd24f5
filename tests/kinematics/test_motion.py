"""Motion of bodies and attached tissue compared with closed forms and measured orders."""

import numpy as np
import pytest

import sim
from sim.integrators import INTEGRATORS
from sim.integrators.stage import Converged
from sim.joints import Spherical
from sim.kinematics import rotations
from tests.bodies import crossed_muscles, grid, solid_system
from tests.kinematics.scenes import INERTIA, mixed_system

MOMENTS = np.diag([1.0, 2.0, 3.0]) * 1e-4


def top(moments=MOMENTS) -> sim.System:
    return sim.compile_scene(
        sim.Scene(sim.NO_TISSUE, (), bodies=(sim.Body("top", 0.2, moments, (0.1, 0.2, 0.3)),))
    )


def loaded_top() -> sim.System:
    """The top with a constant force on a point away from its centre."""
    body, point = sim.Body("top", 0.2, MOMENTS, (0.1, 0.2, 0.3)), np.array([[0.12, 0.2, 0.3]])
    push = sim.NodeLoad(np.array([0]), np.array([[0.01, 0.03, -0.02]]))
    on = sim.OnBody("top", np.array([0]))
    return sim.compile_scene(sim.Scene(sim.NO_TISSUE, (push,), (on,), bodies=(body,), points=point))


def moving(system: sim.System, *twist: float) -> sim.State:
    """State at the rest positions with a twist of the first free body."""
    w = np.zeros(system.pattern.n)
    w[system.kinematics.first :][:6] = twist
    return system.kinematics.state(system.rest_state().pose, w, {})


def run(system, start, duration, steps, integrator, activation=None, parts=1):
    """Last state, with checkpoints between the parts of equal duration."""
    return sim.simulate(
        system,
        activation or sim.resting(len(system.muscles)),
        duration=duration,
        steps=sim.FixedStep(duration / steps),
        every=duration / parts,
        integrator=integrator,
        initial=start,
        probes=(),
        checkpoint=1,
    )[1]


def tight(cls):
    return cls(tolerance=1e-12, residual_tolerance=1e-10) if issubclass(cls, Converged) else cls()


def angular_momentum(state, moments=MOMENTS):
    Q = rotations.matrices(state.frames[:, 3:])[0]
    return Q @ moments @ Q.T @ state.twists[0, 3:]


def test_free_top_keeps_energy_and_angular_momentum():
    """One rotation with Runge-Kutta's method conserves both to its order."""
    system, duration = top(), 0.2 * np.pi
    start = moving(system, 0.1, 0.0, 0.0, 0.2, 10.0, 0.1)
    left = []
    for n in (50, 100):
        end = run(system, start, duration, n, sim.RungeKutta4())
        L0, L1 = angular_momentum(start), angular_momentum(end)
        left.append(np.abs(L1 - L0).max() / np.linalg.norm(L0))
        energies = [s.twists[0, 3:] @ L for s, L in ((start, L0), (end, L1))]
        assert abs(energies[1] / energies[0] - 1.0) < 1e-7
        np.testing.assert_allclose(end.frames[0, 0], 0.1 + 0.1 * duration, rtol=1e-12)
    assert left[1] < 1e-7 and left[0] / left[1] > 14.0


def test_free_top_keeps_energy_and_angular_momentum_over_many_turns():
    """600 steps of Runge-Kutta's method per turn; linearly implicit steps have a test of their own."""
    system, turns = top(), 10
    start = moving(system, 0.1, 0.0, 0.0, 0.2, 10.0, 0.1)
    end = run(system, start, turns * 0.2 * np.pi, turns * 600, sim.RungeKutta4())
    L0, L1 = angular_momentum(start), angular_momentum(end)
    assert np.abs(L1 - L0).max() < 1e-10 * np.linalg.norm(L0)
    energy = [s.twists[0, 3:] @ L for s, L in ((start, L0), (end, L1))]
    assert abs(energy[1] / energy[0] - 1.0) < 1e-10


def test_symmetric_top_precesses_as_in_closed_form():
    """In the body omega turns about the axis at (I3 - I1)/I1 omega3."""
    moments = np.diag([2.0, 2.0, 3.0]) * 1e-4
    system = top(moments)
    end = run(system, moving(system, 0, 0, 0, 1.0, 0.0, 8.0), 0.5, 200, sim.RungeKutta4())
    inside = rotations.matrices(end.frames[:, 3:])[0].T @ end.twists[0, 3:]
    angle = 0.5 * 8.0 * 0.5
    np.testing.assert_allclose(inside, [np.cos(angle), np.sin(angle), 8.0], atol=1e-9)


def order_with_rotation_and_attachments(cls, shorter=1):
    """Self-convergence of a spinning body with attached tissue and a prescribed body."""
    if cls.stability == "conditional":
        system, n, duration = loaded_top(), (20, 40, 80), 0.2
        start = moving(system, 0.1, 0.0, 0.0, 1.0, 10.0, 0.5)
    else:
        system, n, duration = mixed_system(), (5, 10, 20), 0.01
        start = moving(system, 0.1, 0.05, -0.1, 3.0, 20.0, -10.0)
    levels = np.array([[0.1, 0.2], [0.3, 0.1]])[:, : len(system.muscles)]
    drive = sim.Activation(np.array([0.0, 1.0]), levels)
    ends = [run(system, start, duration, shorter * k, tight(cls), drive) for k in n]
    pairs = zip(ends, ends[1:], strict=False)
    change = [np.linalg.norm(system.kinematics.between(b.pose, a.pose)) for a, b in pairs]
    return float(np.log2(change[0] / change[1]))


@pytest.mark.parametrize("cls", INTEGRATORS)
def test_every_integrator_keeps_its_order_with_rotation_and_attachments(cls):
    assert abs(order_with_rotation_and_attachments(cls) - cls.order) < 0.15


def attached_and_led():
    """Points at the start, of tissue that loads a body, and of that on a body with the same motion."""
    mesh, h = grid((2, 1, 1), (0.02, 0.01, 0.01)), 0.005
    left = np.flatnonzero(mesh.X[:, 0] == 0.0)
    jaw = sim.Body("jaw", 0.004, INERTIA, (-0.004, 0.004, 0.007))
    frames = []

    def path(t):
        frame = frames[min(round(t / h), len(frames) - 1)]
        return frame[:3], frame[3:]

    def made(*more):
        return solid_system(mesh, reductions=(sim.OnBody("jaw", left), *more), bodies=(jaw,))

    free = made()
    state = moving(free, 0.1, 0.0, 0.05, 1.0, 20.0, 0.0)
    frames.append(state.frames[0])
    start = state
    for _ in range(8):
        state = run(free, state, h, 1, tight(sim.ConvergedEuler))
        frames.append(state.frames[0])
    led = made(sim.PrescribedBody("jaw", path))
    start = sim.State(0.0, start.q, start.v, {}, start.frames, start.twists)
    end = run(led, start, 8 * h, 8, tight(sim.ConvergedEuler))
    return start.q, state.q, end.q


def test_tissue_on_a_body_equals_tissue_on_the_prescribed_motion():
    start, free, led = attached_and_led()
    assert np.abs(free - start).max() > 4e-3
    np.testing.assert_allclose(led, free, atol=1e-10)


def momentum_of_a_free_compound(cls):
    """Sum of m v over tissue and two joined bodies without external forces, before and after."""
    mesh = grid((2, 1, 1), (0.02, 0.01, 0.01))
    left = np.flatnonzero(mesh.X[:, 0] == 0.0)
    system = solid_system(
        mesh,
        muscles=crossed_muscles(mesh),
        reductions=(sim.OnBody("jaw", left),),
        bodies=tuple(
            sim.Body(name, 0.004, INERTIA, (x, 0.004, 0.007))
            for name, x in (("jaw", -0.004), ("skull", -0.02))
        ),
        joints=(Spherical("ball", "jaw", "skull", (-0.012, 0.004, 0.007)),),
    )
    start = moving(system, 0.3, 0.1, -0.2, 3.0, 10.0, -5.0)
    pose, w, _ = system.rows.projected(start.pose, system.kinematics.velocities(start))
    start = system.kinematics.state(pose, w, {})
    drive = sim.Activation(np.array([0.0, 0.05]), np.array([[0.0, 0.0], [0.5, 0.2]]))
    end = run(system, start, 0.05, 10, tight(cls), drive)
    return tuple(system.node_mass @ s.v for s in (start, end))


@pytest.mark.parametrize("cls", [sim.ConvergedEuler, sim.Trapezoidal, sim.Sdirk2])
def test_momentum_of_a_free_compound_is_conserved(cls):
    before, after = momentum_of_a_free_compound(cls)
    assert np.abs(after - before).max() < 1e-10 * np.abs(before).max()


@pytest.mark.parametrize("damping", [0.0, 1.6])
def test_body_on_a_line_muscle_swings_as_on_a_damped_spring(damping):
    """A line from a point in space to one on a body: m x'' + d x' + k x = 0 along it."""
    stiffness, mass, t = 20.0, 0.2, 0.1
    points = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0]])
    body = sim.Body("bob", mass, INERTIA, (0.15, 0.0, 0.0))
    fibre = sim.LineFibre(0, np.array([0, 1]))
    line = sim.LineMuscles(("line",), (fibre,), stiffness=stiffness, damping=damping)
    members = sim.Fixed(np.array([0])), sim.OnBody("bob", np.array([1]))
    system = sim.compile_scene(
        sim.Scene(sim.NO_TISSUE, (line,), members, bodies=(body,), points=points)
    )
    end = run(system, moving(system, 0.1, 0, 0, 0, 0, 0), t, 20, sim.RungeKutta4())
    decay = 0.5 * damping / mass
    omega = np.sqrt(stiffness / mass - decay**2)
    expected = 0.1 / omega * np.exp(-decay * t) * np.sin(omega * t)
    assert end.q[1, 0] - 0.1 == pytest.approx(expected, rel=1e-6)


def test_states_with_bodies_continue_from_a_file_bit_for_bit(tmp_path):
    system = mixed_system()
    start = moving(system, 0.1, 0.05, -0.1, 3.0, 20.0, -10.0)
    whole = run(system, start, 0.02, 4, sim.ConvergedEuler(), parts=2)
    sim.save_state(run(system, start, 0.01, 2, sim.ConvergedEuler()), tmp_path / "s.nc")
    again = run(system, sim.read_state(tmp_path / "s.nc"), 0.01, 2, sim.ConvergedEuler())
    for name in ("q", "v", "frames", "twists"):
        np.testing.assert_array_equal(getattr(again, name), getattr(whole, name))
    with pytest.raises(sim.SceneError, match="in the initial state is not finite"):
        run(system, moving(system, 0, 0, 0, np.nan, 0, 0), 0.01, 1, sim.ConvergedEuler())


def test_outputs_between_steps_follow_the_rotation():
    """The cubic of rotation vectors: a quarter of the step of a spinning body."""
    system, omega = top(np.eye(3) * 1e-4), np.array([1.0, 10.0, 0.5])
    data, _ = sim.simulate(
        system,
        sim.resting(0),
        duration=0.04,
        steps=sim.FixedStep(0.04),
        every=0.01,
        integrator=sim.RungeKutta4(),
        initial=moving(system, 0.0, 0.0, 0.0, *omega),
        probes=(sim.Frames(("top",)), sim.Energies()),
    )
    turned = rotations.logarithm(data.body_quaternion.values[0].T)
    np.testing.assert_allclose(turned, data.time.values[:, None] * omega, atol=1e-12)
    np.testing.assert_allclose(data.kinetic_energy, 0.5e-4 * omega @ omega, rtol=1e-9)


def test_body_of_a_closed_surface():
    """A box away from the origin; its inertia is m (b^2 + c^2)/12."""
    size = np.array([0.02, 0.03, 0.05])
    surface = sim.boundary_surface(grid((1, 2, 3), size))
    X = grid((1, 2, 3), size).X + [0.5, -0.2, 0.1]
    body = sim.body_of_surface("jaw", X, surface.triangles, 2000.0)
    mass = 2000.0 * size.prod()
    squares = size**2
    assert body.mass == pytest.approx(mass, rel=1e-12)
    np.testing.assert_allclose(body.centre, 0.5 * size + [0.5, -0.2, 0.1], rtol=1e-12)
    expected = mass / 12.0 * (squares.sum() - squares)
    np.testing.assert_allclose(body.inertia, np.diag(expected), atol=1e-9 * expected.max())
    with pytest.raises(sim.MeshError, match=r"not closed: 3 edges .*\("):
        sim.body_of_surface("jaw", X, surface.triangles[1:], 2000.0)
    with pytest.raises(sim.MeshError, match="reverse the order of the vertices"):
        sim.body_of_surface("jaw", X, surface.triangles[:, ::-1], 2000.0)
    with pytest.raises(sim.SceneError, match="symmetric positive definite"):
        sim.Body("jaw", 1.0)
    with pytest.raises(sim.SceneError, match="finite numbers"):
        sim.Body("jaw", -1.0, INERTIA)


def test_prescribed_motions_must_be_finite():
    system = solid_system(
        grid((1, 1, 1)),
        reductions=(sim.PrescribedNodes(np.array([0]), lambda t: np.array([[np.nan, 0, 0]])),),
    )
    with pytest.raises(sim.SceneError, match="PrescribedNodes is not finite"):
        system.rest_state()
