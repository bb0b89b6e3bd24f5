"""Response of steps and equilibria to the activations, against finite differences."""

from dataclasses import replace

import numpy as np
import pytest

import sim
from sim.inverse import (
    ActiveForces,
    equilibrium_response,
    require_affine,
    step_response,
)
from sim.joints import PointOnPlane
from tests.bodies import crossed_muscles, dense, grid
from tests.contact.scenes import square
from tests.inverse.points import LinearTension, circle, constant_muscles, particle

EULER, TRAPEZOIDAL = sim.LinearlyImplicitEuler(), sim.LinearlyImplicitTrapezoidal()
A0 = np.array([0.2, 0.1])


def block(law=None, damping=None, terms=(), muscles=True, conditions=()) -> sim.System:
    mesh = grid()
    solid = sim.Solid(
        (sim.Material(sim.MooneyRivlin(), sim.QuadraticBulk(25e3)),),
        muscles=crossed_muscles(mesh, law) if muscles else None,
    )
    base = sim.Fixed(np.flatnonzero(mesh.X[:, 2] == 0.0))
    more = tuple(make(mesh, solid) for make in terms)
    damping = damping or sim.RestRayleigh(19.0, 0.055)
    scene = sim.Scene(mesh, (solid, *more), (base,), damping, conditions)
    return sim.compile_scene(scene)


def stiffening(mesh, solid):
    m = solid.muscles
    return sim.Stiffening(m.names, m.element, m.muscle, replace(solid, muscles=None))


def lines(mesh, solid):
    fibres = [sim.LineFibre(k, np.array([k, 26 - k])) for k in range(2)]
    return sim.LineMuscles(("first", "second"), fibres, sim.Peck(0.3))


def rated(mesh, solid):
    return replace(lines(mesh, solid), relation=sim.ForceVelocity())


def tendinous(mesh, solid):
    return replace(rated(mesh, solid), law=sim.Hill(0.3, tendon_strain=0.05))


def pulled(law):
    """Block moved by two lines of a law with forces of the order of the tissue's."""

    def made(mesh, solid):
        return replace(lines(mesh, solid), law=law)

    return lambda: block(muscles=False, terms=(made,))


CASES = {
    "Blemker": (block, EULER),
    "Blemker, trapezoidal": (block, TRAPEZOIDAL),
    "Generic": (lambda: block(sim.Generic(sigma_max=50e3)), EULER),
    "Constant": (lambda: block(sim.Constant(sigma_max=50e3)), EULER),
    "Peck lines": (lambda: block(muscles=False, terms=(lines,)), EULER),
    "constant lines": (pulled(sim.ConstantForce(0.3)), EULER),
    "Hill lines, rigid tendon": (pulled(sim.Hill(0.3, tendon_strain=0.0)), EULER),
    "Hill lines, elastic tendon": (pulled(sim.Hill(0.3, tendon_strain=0.05)), EULER),
    "Hill lines, force-velocity": (lambda: block(muscles=False, terms=(tendinous,)), EULER),
    "current Rayleigh": (lambda: block(damping=sim.Rayleigh(19.0, 0.055)), EULER),
    "force-velocity": (lambda: block(muscles=False, terms=(rated,)), TRAPEZOIDAL),
    "stiffening": (lambda: block(terms=(stiffening,)), EULER),
    "hard volumes": (lambda: block(conditions=(sim.HardElementVolume(),)), EULER),
}


def moving(system, integrator, work) -> sim.State:
    state = system.rest_state()
    for _ in range(3):
        state, _ = integrator.step(system, state, sim.Control(A0, state.t + 0.01), 0.01, work)
    return state


def differences(system, integrator, state, a, h=0.01, near=1e-4) -> np.ndarray:
    """Central differences of the end velocities of a step."""
    columns = []
    for i in range(len(a)):
        ends = []
        for way in (near, -near):
            b = a.copy()
            b[i] += way
            work = sim.Workspace(system, "superlu")
            end, _ = integrator.step(system, state, sim.Control(b, state.t + h), h, work)
            ends.append(system.kinematics.velocities(end))
        columns.append((ends[0] - ends[1]) / (2.0 * near))
    return np.array(columns).T


@pytest.mark.parametrize("name", CASES)
def test_the_response_is_the_derivative_of_the_step(name):
    make, integrator = CASES[name]
    system = make()
    work = sim.Workspace(system)
    state = moving(system, integrator, work)
    response = step_response(system, integrator, state, A0, 0.01, work, ActiveForces(system))
    exact = differences(system, integrator, state, A0)
    assert np.abs(response.H - exact).max() <= 1e-6 * np.abs(exact).max()
    end, _ = integrator.step(system, state, sim.Control(A0, state.t + 0.01), 0.01, work)
    w = system.kinematics.velocities(end)
    assert np.abs(response.w - w).max() <= 1e-9 * np.abs(w).max()


def test_hard_volumes_follow_prescribed_nodes():
    mesh = grid()
    bottom, top = (np.flatnonzero(mesh.X[:, 2] == z) for z in (0.0, 0.02))

    def path(t):
        return mesh.X[top] + np.array([0.02 * t, 0.0, -0.03 * t])

    solid = sim.Solid(
        (sim.Material(sim.MooneyRivlin(), sim.QuadraticBulk(25e3)),), muscles=crossed_muscles(mesh)
    )
    members = sim.Fixed(bottom), sim.PrescribedNodes(top, path)
    damping, volumes = sim.RestRayleigh(19.0, 0.055), (sim.HardElementVolume(),)
    system = sim.compile_scene(sim.Scene(mesh, (solid,), members, damping, volumes))
    work, state = sim.Workspace(system), system.rest_state()
    response = step_response(system, EULER, state, A0, 0.01, work, ActiveForces(system))
    end, _ = EULER.step(system, state, sim.Control(A0, state.t + 0.01), 0.01, work)
    w = system.kinematics.velocities(end)
    assert np.abs(response.w - w).max() <= 1e-9 * np.abs(w).max()


def test_muscles_that_are_slack_at_rest_respond_where_they_are_stretched():
    tension = LinearTension(("left", "right"), 1.0, 0.0, 0.0101, 0.02, 0.0)
    system, last = particle(np.array([[-0.01, 0.0, 0.0], [0.01, 0.0, 0.0]]), tension)
    rest, work, active = system.rest_state(), sim.Workspace(system), ActiveForces(system)
    pose = system.kinematics.advance(rest.pose, np.array([2e-3, 0.0, 0.0, 0.0, 0.0, 0.0]), 0.0)
    state = system.kinematics.state(pose, np.zeros(6), {})
    response = step_response(system, EULER, state, A0, 0.01, work, active)
    exact = differences(system, EULER, state, A0)
    assert response.H[0, 0] < 0.0 == response.H[0, 1] and last == 2
    assert np.abs(response.H - exact).max() <= 1e-6 * np.abs(exact).max()


def test_the_affine_form_is_refused_where_moduli_depend_on_the_activation():
    system = block(terms=(stiffening,))
    with pytest.raises(sim.SceneError, match="Stiffening depend on the activation"):
        require_affine(system)
    tendons = pulled(sim.Hill(0.3, tendon_strain=0.05))()
    with pytest.raises(sim.SceneError, match="not affine in the activation, as those of fibres in"):
        require_affine(tendons)
    require_affine(block())
    require_affine(pulled(sim.Hill(0.3, tendon_strain=0.0))())


def test_the_affine_form_is_the_step_with_its_matrix_held():
    """Its error is first order in the change of the activation, that of the exact form second."""
    system = block()
    work, forces = sim.Workspace(system), ActiveForces(system)
    state = moving(system, EULER, work)
    affine, exact = (
        step_response(system, EULER, state, A0, 0.01, work, forces, form)
        for form in ("affine", "exact")
    )
    errors = {"affine": [], "exact": []}
    for way in (0.02, 0.01):
        a = A0 + way
        end, _ = EULER.step(system, state, sim.Control(a, state.t + 0.01), 0.01, work)
        w = system.kinematics.velocities(end)
        errors["affine"].append(np.abs(affine.velocity(a) - w).max())
        errors["exact"].append(np.abs(exact.velocity(a) - w).max())
    assert 1.8 < errors["affine"][0] / errors["affine"][1] < 2.3
    assert 3.6 < errors["exact"][0] / errors["exact"][1] < 4.6


def test_joints_are_held_in_the_response():
    """A particle on a line responds only along it."""
    system, last = particle(circle(0.01), constant_muscles(circle(0.01)))
    joint = PointOnPlane("plane", last, None, (0.0, 0.0, 0.0), (1.0, 0.0, 1.0))
    jointed = sim.compile_scene(replace(system.scene, joints=(joint,)))
    a, work = np.full(16, 0.1), sim.Workspace(jointed)
    response = step_response(
        jointed, EULER, jointed.rest_state(), a, 0.01, work, ActiveForces(jointed)
    )
    exact = differences(jointed, EULER, jointed.rest_state(), a)
    assert np.abs(response.H - exact).max() <= 1e-6 * np.abs(exact).max()
    assert np.abs(response.H[0] + response.H[2]).max() <= 1e-9 * np.abs(response.H).max()


def pressed(friction=0.0):
    """Block that muscles press on a sheet, its state and its response."""
    mesh = grid()
    solid = sim.Solid(muscles=crossed_muscles(mesh))
    pairing = sim.Pairing(sim.boundary_surface(mesh), square())
    sheet = sim.ConstraintContact((pairing,), friction)
    terms = (solid, sheet, sim.Gravity((0.0, 0.0, -9.8)))
    side = sim.Fixed(np.flatnonzero(mesh.X[:, 0] == 0.0))
    scene = sim.Scene(mesh, terms, (side,), sim.RestRayleigh(19.0, 0.055))
    system = sim.compile_scene(scene)
    work = sim.Workspace(system)
    state = moving(system, EULER, work)
    return (
        system, state, step_response(system, EULER, state, A0, 0.01, work, ActiveForces(system))
    )  # fmt: skip


def closed_nodes(system, state, response) -> np.ndarray:
    """Nodes of the lower face whose height does not respond."""
    X = system.mesh.X
    low = (X[:, 2] == 0.0) & (X[:, 0] > 0.0)
    heights = (system.kinematics.matrix(state.pose) @ response.H).reshape(-1, 3, 2)[:, 2]
    return np.flatnonzero(low & (np.abs(heights).max(axis=1) < 1e-9 * np.abs(response.H).max()))


def held_differences(system, state, response, closed) -> np.ndarray:
    """Differences of the whole equation of a step, with the rows of nodes as rigid conditions."""
    work = sim.Workspace(system)
    N = system.kinematics.matrix(state.pose).toarray()[3 * closed + 2]
    exact = []
    for i in range(2):
        ends = []
        for way in (1e-4, -1e-4):
            a = A0.copy()
            a[i] += way
            line = sim.Line(a, 0.0 * a, state.t, 0.01)
            step = EULER.equation(system, state, line, work)
            A = np.block([[dense(system, step.A.values), N.T], [N, np.zeros((len(N), len(N)))]])
            ends.append(np.linalg.solve(A, np.concatenate([step.rhs, N @ response.w]))[: -len(N)])
        exact.append((ends[0] - ends[1]) / 2e-4)
    return np.array(exact).T


def test_closed_contacts_are_held_in_the_response():
    """Muscles press a block on a sheet; they do not move it through."""
    system, state, pressure = pressed()
    closed = closed_nodes(system, state, pressure)
    assert len(closed) == pressure.rows > 0
    exact = held_differences(system, state, pressure, closed)
    assert np.abs(pressure.H - exact).max() <= 1e-6 * np.abs(exact).max()


def test_contact_with_friction_has_no_response():
    """Its rows also hold along the surface; without them derivatives were wrong by a quarter."""
    with pytest.raises(sim.SceneError, match="inverse tracking does not support friction"):
        pressed(0.05)


def test_the_equilibrium_response_is_its_derivative():
    system = block()
    static = sim.Static(tolerance=1e-12, residual_tolerance=1e-10)
    work = sim.Workspace(system)
    state, _ = static.step(system, system.rest_state(), sim.Control(A0), 1.0, work)
    J = equilibrium_response(system, state, sim.Control(A0), work, ActiveForces(system))
    for i in range(2):
        ends = []
        for way in (1e-4, -1e-4):
            a = A0.copy()
            a[i] += way
            ends.append(static.step(system, state, sim.Control(a), 1.0, work)[0].q)
        exact = (ends[0] - ends[1]).reshape(-1)[system.free] / 2e-4
        assert np.abs(J[:, i] - exact).max() <= 1e-5 * np.abs(exact).max()
