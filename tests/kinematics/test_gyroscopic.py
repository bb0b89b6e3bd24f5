"""Free rotation of bodies: energy never grows, the angular momentum is kept, by every integrator."""

from functools import cache

import numpy as np
import pytest

import sim
from sim.errors import NotConverged
from sim.integrators import INTEGRATORS
from sim.integrators.stage import Converged
from sim.joints import Revolute, Spherical
from tests.bodies import grid
from tests.kinematics.test_motion import angular_momentum, moving, run, tight, top

#: tensors of inertia [kg m2] and angular velocities [rad/s]; the jaw of the published tables
TOPS = {
    "oblate": (np.diag([0.1, 0.1, 0.3]), (2.0, 0.0, 4.0)),
    "prolate": (np.diag([0.3, 0.3, 0.1]), (1.0, 0.0, 8.0)),
    "asymmetric": (np.diag([1.0, 2.0, 3.0]) * 1e-4, (0.2, 6.0, 0.1)),
    "jaw": (
        np.array([[147.4, 0.0, 0.0], [0.0, 246.1, -45.0], [0.0, -45.0, 297.4]]) * 1e-6,
        (1.0, 5.0, 2.0),
    ),
}
MOVING = tuple(cls for cls in INTEGRATORS if cls is not sim.Static)
LINEAR = (sim.LinearlyImplicitEuler, sim.LinearlyImplicitTrapezoidal)


def kept(start, end, inertia):
    """Energy relative to that at the start, and the relative change of the angular momentum."""
    L0, L1 = (angular_momentum(s, inertia) for s in (start, end))
    E0, E1 = (s.twists[0, 3:] @ L for s, L in ((start, L0), (end, L1)))
    return E1 / E0, np.linalg.norm(L1 - L0) / np.linalg.norm(L0)


@pytest.mark.parametrize("cls", MOVING)
@pytest.mark.parametrize("name", TOPS)
def test_energy_of_a_free_body_does_not_grow(name, cls):
    """Steps of 5 ms: with explicit gyroscopic moments energy grew within 2 s by 4 % up to 4e7."""
    inertia, omega = TOPS[name]
    system = top(inertia)
    start = moving(system, 0.0, 0.0, 0.0, *omega)
    steps = 40 if issubclass(cls, Converged) else 400
    end = run(system, start, 5e-3 * steps, steps, tight(cls))
    energy, left = kept(start, end, inertia)
    assert energy < 1.0 + (1e-3 if cls is sim.SymplecticEuler else 1e-5)
    assert energy > 0.8
    assert left < (1e-6 if cls is sim.RungeKutta4 else 1e-8)


@pytest.mark.parametrize("cls", LINEAR)
@pytest.mark.parametrize("name", TOPS)
def test_linearly_implicit_steps_keep_the_momentum_over_a_thousand_turns(name, cls):
    """Implicit Euler ends in the state of least energy, the trapezoidal rule keeps the energy."""
    inertia, omega = TOPS[name]
    system = top(inertia)
    start = moving(system, 0.0, 0.0, 0.0, *omega)
    duration = 1000 * 2.0 * np.pi / np.linalg.norm(omega)
    end = run(system, start, duration, int(duration / 5e-3), cls())  # in one kernel
    energy, left = kept(start, end, inertia)
    assert left < 1e-10
    if cls is sim.LinearlyImplicitTrapezoidal:
        assert abs(energy - 1.0) < 1e-3
        return
    L = angular_momentum(start, inertia)
    least = L @ L / np.linalg.eigvalsh(inertia)[-1]
    least /= start.twists[0, 3:] @ L
    assert least * (1.0 - 1e-9) <= energy <= 1.0


@cache
def rotated():
    """Asymmetric top, its first state, and its state after 1 s by 2000 steps of fourth order."""
    inertia, omega = TOPS["asymmetric"]
    system = top(inertia)
    start = moving(system, 0.0, 0.0, 0.0, *omega)
    return system, start, run(system, start, 1.0, 2000, sim.RungeKutta4())


@pytest.mark.parametrize(("cls", "order"), [*zip(LINEAR, (1, 2), strict=True)])
def test_order_of_a_free_rotation(cls, order):
    system, start, exact = rotated()
    ends = [run(system, start, 1.0, n, cls()) for n in (400, 800)]
    left = [np.abs(e.twists - exact.twists).max() for e in ends]
    left_frames = [np.abs(e.frames - exact.frames).max() for e in ends]
    assert abs(np.log2(left[0] / left[1]) - order) < 0.15
    assert abs(np.log2(left_frames[0] / left_frames[1]) - order) < 0.15


@pytest.mark.parametrize("cls", LINEAR)
def test_fused_and_general_steps_rotate_alike(cls):
    inertia, omega = TOPS["oblate"]
    system = top(inertia)
    ends = []
    for fused in (True, False):
        state, work = moving(system, 0.0, 0.0, 0.0, *omega), sim.Workspace(system)
        if not fused:
            work.bodies = None
        for _ in range(50):
            state, _ = cls().step(system, state, system.control(np.zeros(0)), 5e-3, work)
        ends.append(state)
    np.testing.assert_allclose(ends[0].frames, ends[1].frames, rtol=0.0, atol=1e-13)
    np.testing.assert_allclose(ends[0].twists, ends[1].twists, rtol=0.0, atol=1e-12)


def hinged(joint):
    """A body about an axis that is no principal axis, at its centre of mass."""
    inertia = TOPS["jaw"][0]
    body = sim.Body("b", 0.2, inertia)
    joints = (joint("hinge", None, "b", (0.0, 0.0, 0.0), (0.0, 0.0, 1.0)),)
    scene = sim.Scene(sim.NO_TISSUE, (), bodies=(body,), joints=joints)
    return sim.compile_scene(scene), inertia


@pytest.mark.parametrize("cls", LINEAR)
@pytest.mark.parametrize("fused", [True, False])
def test_energy_on_a_hinge_off_the_principal_axes(cls, fused):
    """The rotation is uniform, although the moments of the hinge turn."""
    system, inertia = hinged(Revolute)
    state, work = moving(system, 0.0, 0.0, 0.0, 0.0, 0.0, 5.0), sim.Workspace(system)
    if not fused:
        work.bodies = None
    start = state
    for _ in range(200):
        state, _ = cls().step(system, state, system.control(np.zeros(0)), 0.01, work)
    assert abs(kept(start, state, inertia)[0] - 1.0) < 1e-9


@pytest.mark.parametrize("cls", (*LINEAR, sim.SymplecticEuler))
def test_energy_on_a_spherical_joint_does_not_grow(cls):
    system, inertia = hinged(Spherical)
    start = moving(system, 0.0, 0.0, 0.0, *TOPS["jaw"][1])
    energy, left = kept(start, run(system, start, 10.0, 2000, cls()), inertia)
    assert energy < 1.0 + 1e-3
    assert left < 1e-6


@pytest.mark.parametrize("cls", LINEAR)
def test_energy_of_a_body_that_carries_tissue_does_not_grow(cls):
    """The inertia is that of attached nodes alone, up to a thousandth."""
    mesh = grid((2, 1, 1), (0.4, 0.2, 0.1))
    body = sim.Body("b", 0.01, 1e-5 * np.eye(3), (0.2, 0.1, 0.05))
    solid = sim.Solid((sim.Material(sim.MooneyRivlin()),))
    attached = sim.OnBody("b", np.arange(mesh.n_nodes))
    system = sim.compile_scene(sim.Scene(mesh, (solid,), (attached,), bodies=(body,)))
    start = moving(system, 0.0, 0.0, 0.0, 2.0, 0.3, 4.0)

    def energy(state):
        w = system.kinematics.velocities(state)
        return w @ system.kinematics.apply_mass(w, state.pose)

    assert energy(run(system, start, 4.0, 800, cls())) <= energy(start)


@pytest.mark.parametrize("cls", (*LINEAR, sim.SymplecticEuler))
def test_a_turn_too_large_for_a_step_is_refused(cls):
    inertia, _ = TOPS["asymmetric"]
    system = top(inertia)
    start = moving(system, 0.0, 0.0, 0.0, 300.0, 200.0, -100.0)
    with pytest.raises(NotConverged, match="body 0 turns by .* rad, too much for one step"):
        run(system, start, 0.5, 5, cls())
