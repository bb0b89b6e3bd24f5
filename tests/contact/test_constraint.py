"""Contact by constraints: detection of contacts, initial penetrations, and errors."""

import numpy as np
import pytest

import sim
from sim.contact.compiled import CONTACT_MEMORY, FORCE, StepGeometry
from tests.bodies import grid, rotation
from tests.contact.scenes import box, moved, square, system_of, two_bodies

IMPLICIT = (sim.LinearlyImplicitEuler, sim.ConvergedEuler, sim.Sdirk2)


@pytest.mark.parametrize("integrator", IMPLICIT)
def test_an_initial_penetration_remains_without_a_jump_and_never_increases(integrator):
    mesh = grid((1, 1, 1), (0.01, 0.01, 0.01))
    floor = box([-0.1, -0.1, -0.1], [0.1, 0.1, 0.002], "bone")
    contact = sim.ConstraintContact((sim.Pairing(sim.boundary_surface(mesh), floor),))
    resting = system_of(mesh, contact, sim.Gravity((0.0, 0.0, -9.81)))
    states = moved(resting, integrator(), 20)
    assert min(state.q[:, 2].min() for state in states) > -1e-5
    # lifted by 1 mm and dropped, it comes to rest at the depth that remained after lifting
    lifting = np.zeros_like(mesh.X)
    lifting[:, 2] = 0.15
    states = moved(resting, integrator(), 40, v=lifting)
    lowest = np.array([state.q[:, 2].min() for state in states])
    assert lowest.max() > 5e-4
    assert lowest[-1] >= lowest[: np.argmax(lowest) + 1].min() - 1e-5
    gap = sim.Contacts().record(resting, states[-1], resting.control(np.zeros(0)), None)[1]
    assert gap[0] > -1e-5


@pytest.mark.parametrize("integrator", IMPLICIT)
def test_surfaces_with_common_nodes_or_zero_gap_exert_no_force_at_rest(integrator):
    """Two halves of a block have common nodes at the cut; a third body touches the second."""
    mesh, first, last = two_bodies(
        grid((2, 1, 1), (0.02, 0.01, 0.01)), grid((1, 1, 1), (0.01, 0.01, 0.01)), [0.02, 0, 0]
    )
    whole = first.triangles
    x = mesh.X[whole, 0]
    left = sim.NodeSurface(whole[(x < 0.011).all(axis=1)], "left")
    right = sim.NodeSurface(whole[(x > 0.009).all(axis=1)], "right")
    contact = sim.ConstraintContact((sim.Pairing(left, right), sim.Pairing(right, last)))
    end = moved(system_of(mesh, contact), integrator(), 3)[-1]
    np.testing.assert_allclose(end.q, mesh.X, rtol=0, atol=1e-9)


@pytest.mark.parametrize("integrator", IMPLICIT)
def test_a_strip_folded_on_itself_does_not_pass_through_itself(integrator):
    """The arms of a U, one shorter and narrower, are pressed together: its tip rests on the other."""
    low = grid((5, 1, 1), (0.05, 0.01, 0.004))
    X = low.X.copy()
    # bend the strip into a U: two arms on a half circle
    s, out = X[:, 0] - 0.02, X[:, 2].copy()
    angle = np.clip(s / 0.008, -1.0, 1.0) * np.pi / 2
    radius = 0.0011 + out
    arm = np.maximum(np.abs(s) - 0.008, 0.0)
    X[:, 0], X[:, 2] = arm - radius * np.cos(angle), radius * np.sin(angle)
    X[s < -0.001, 1] = 0.005 + 0.6 * (X[s < -0.001, 1] - 0.005)
    mesh = sim.Mesh(X, low.blocks)
    contact = sim.ConstraintContact((sim.Pairing(sim.boundary_surface(mesh, "strip")),))
    ends = np.flatnonzero((np.abs(np.abs(s) - 0.02) < 1e-9) & (out > 0.0))
    load = sim.NodeLoad(ends, np.outer(-0.003 * np.sign(s[ends]), [0.0, 0.0, 1.0]))
    crown = sim.Fixed(np.flatnonzero(np.abs(s) < 1e-9))
    tip = (np.abs(s + 0.02) < 1e-9) & (out == 0.0)
    over = {}
    for terms in ((load,), (load, contact)):
        system = system_of(mesh, *terms, reductions=(crown,))
        end = moved(system, integrator(), 30)[-1]
        # the inner side of the longer arm is straight from 0.002 to 0.012 m and to its tip
        inner = np.flatnonzero((s > 0.0) & (out == 0.0))
        line = inner[np.argsort(end.q[inner, 0])]
        height = np.interp(end.q[tip, 0], end.q[line, 0], end.q[line, 2])
        over[len(terms)] = height - end.q[tip, 2]
    assert over[1].max() < -5e-4  # without contact the arms pass through each other
    _, gap, force = sim.Contacts().record(system, end, system.control(np.zeros(0)), None)
    assert -1e-5 < gap[0] < 1e-5 and force[0] > 1e-3
    assert over[2] == pytest.approx(np.zeros(2), abs=2e-5)


def test_a_pair_beyond_reach_is_named(monkeypatch):
    mesh, lower, upper = two_bodies(grid((1, 1, 1)), grid((1, 1, 1)), [0.0, 0.0, 0.03])
    pairings = (sim.Pairing(lower, upper),)
    system = system_of(mesh, sim.ConstraintContact(pairings, reach=0.005))
    monkeypatch.setattr("sim.integrators.factor.MOST_APART", -1)  # rows in the matrix
    v = np.zeros_like(mesh.X)
    v[upper.nodes, 2] = -1.0
    with pytest.raises(sim.ContactFailure, match="reach of 0.005 m.*increase the reach") as raised:
        moved(system, sim.ConvergedEuler(), 3, v=v)
    assert raised.value.surface == "first on second"
    # rows of linearly implicit steps have no entries in the matrix
    q = moved(system, sim.LinearlyImplicitEuler(), 3, v=v)[-1].q
    assert q[upper.nodes, 2].min() > q[lower.nodes, 2].max() - 1e-3


@pytest.mark.parametrize(("points", "rests"), [(0, False), (3, True)])
def test_points_on_its_edges_support_a_bar_across_a_rail(points, rests):
    """Neither has a vertex near a face of the other: the bar is longer and the rail wider."""
    mesh = grid((1, 1, 1), (0.04, 0.01, 0.01))
    rail = box((0.008, -0.04, -0.011), (0.032, 0.05, -1e-3), "rail")
    pairing = sim.Pairing(sim.boundary_surface(mesh), rail)
    contact = sim.ConstraintContact((pairing,), edge_points=points)
    system = system_of(mesh, sim.Gravity((0.0, 0.0, -9.81)), contact)
    end = moved(system, sim.ConvergedEuler(), 40, 0.005)[-1]
    force, weight = end.memory[CONTACT_MEMORY][:, FORCE].sum(), 9.81 * system.node_mass.sum()
    left, right = (
        end.q[(mesh.X[:, 0] == x) & (mesh.X[:, 2] == 0.0)] for x in (0.0, mesh.X[:, 0].max())
    )
    lowest = min((left + share * (right - left))[:, 2].min() for share in (0.25, 0.5, 0.75))
    if rests:
        assert force == pytest.approx(weight, rel=2e-3)
        assert -1e-3 - 2e-6 <= lowest <= -1e-3 + 5e-5
    else:
        assert force == 0.0 and lowest < -0.05


def test_invalid_parameters_are_refused():
    mesh = grid((1, 1, 1))
    pairing = sim.Pairing(sim.boundary_surface(mesh), square())
    for options, text in (
        ({"friction": -0.1}, "friction = -0.1"),
        ({"friction": (0.1, 0.2)}, "friction has 2 values for 1 pairings"),
        ({"reach": np.inf}, "reach = inf"),
        ({"approach": 0.0}, "approach = 0.0"),
        ({"edge_points": -1}, "edge_points = -1"),
    ):
        with pytest.raises(sim.SceneError, match=text):
            sim.ConstraintContact((pairing,), **options)
    with pytest.raises(sim.SceneError, match="no pairings"):
        sim.ConstraintContact(())
    contact = sim.ConstraintContact((pairing,))
    with pytest.raises(sim.SceneError, match="two ConstraintContact"):
        system_of(mesh, contact, contact)
    with pytest.raises(sim.ContactFailure, match="refers to node 9"):
        bad = sim.NodeSurface(np.array([[0, 1, 9]]))
        system_of(mesh, sim.ConstraintContact((sim.Pairing(bad, square()),)))
    with pytest.raises(sim.SceneError, match="found no contact"):
        free = system_of(mesh)
        sim.Contacts().record(free, free.rest_state(), free.control(np.zeros(0)), None)
    for integrator in (sim.Trapezoidal, sim.SymplecticEuler, sim.RungeKutta4):
        with pytest.raises(sim.SceneError, match="does not support contact constraints"):
            moved(system_of(mesh, contact), integrator(), 1)


def test_a_restarted_simulation_equals_an_uninterrupted_one():
    mesh = grid((2, 2, 1), (0.02, 0.02, 0.01))
    pairing = sim.Pairing(sim.boundary_surface(mesh), square())
    contact = sim.ConstraintContact((pairing,), friction=0.4)
    system = system_of(mesh, contact, sim.Gravity((3.0, 0.0, -9.0)))
    whole = moved(system, sim.LinearlyImplicitEuler(), 12)
    again = moved(system, sim.LinearlyImplicitEuler(), 6, initial=whole[6])
    np.testing.assert_array_equal(again[-1].q, whole[-1].q)
    np.testing.assert_array_equal(again[-1].memory["contact"], whole[-1].memory["contact"])


def test_contact_is_frame_indifferent():
    """Block, sheet and gravity are rotated together."""
    R, mesh = rotation(5), grid((1, 1, 1), (0.01, 0.01, 0.01))
    ends = []
    for Q in (np.eye(3), R):
        body = sim.Mesh(mesh.X @ Q.T, mesh.blocks)
        flat = square()
        floor = sim.RigidShell(flat.vertices @ Q.T, flat.triangles)
        contact = sim.ConstraintContact((sim.Pairing(sim.boundary_surface(body), floor),), 0.3)
        g = Q @ np.array([2.0, 1.0, -9.0])
        system = system_of(body, contact, sim.Gravity(tuple(g)))
        ends.append(moved(system, sim.LinearlyImplicitEuler(), 10)[-1].q @ Q)
    np.testing.assert_allclose(ends[1], ends[0], rtol=0, atol=1e-7)


def test_a_slightly_penetrating_vertex_that_enters_deeper_is_found():
    """Inside by 5 micrometres, as after an earlier step, then 3 mm beyond the search range."""
    mesh = grid((1, 1, 1), (0.01, 0.01, 0.01))
    floor = box([-0.1, -0.1, -0.1], [0.1, 0.1, 0.0])
    contact = sim.ConstraintContact((sim.Pairing(sim.boundary_surface(mesh), floor),))
    compiled = system_of(mesh, contact).contact
    assert compiled is not None
    q0, q = mesh.X - [0.0, 0.0, 5e-6], mesh.X - [0.0, 0.0, 3e-3]
    none = np.zeros(len(compiled.node_of_vertex))
    rows = compiled.crossed(StepGeometry(q0, q, 0.0, 0.01), none)
    bottom = np.flatnonzero(mesh.X[:, 2] == 0.0)
    assert sorted(compiled.node_of_vertex[rows.contact_vertex]) == sorted(bottom)
    np.testing.assert_allclose(rows.gaps(q - q0), -3e-3, rtol=1e-9)
    np.testing.assert_allclose(rows.normal, np.tile([0.0, 0.0, 1.0], (len(bottom), 1)), atol=1e-12)
    # vertices with an allowed initial depth are not reported as entering
    assert not len(compiled.crossed(StepGeometry(q0, q, 0.0, 0.01), none + 5e-6))


@pytest.mark.parametrize("integrator", [sim.ConvergedEuler, sim.Sdirk2])
def test_vertices_in_contact_have_the_normal_velocity_of_the_face(integrator):
    """A plate touches a hanging block, presses, stops and retreats; n . v equals its velocity."""
    mesh = grid((2, 2, 1), (0.02, 0.02, 0.01))
    corners = np.array([0.0, 0.02, 0.04, 0.06]), 1e-3 * np.array([-0.5, 1.0, 1.0, 0.5])

    def motion(t):
        return np.eye(3), np.array([0.0, 0.0, np.interp(t, *corners)])

    pairing = sim.Pairing(sim.boundary_surface(mesh), square(motion=motion))
    hung = sim.Fixed(np.flatnonzero(mesh.X[:, 2] > 0.009))
    system = system_of(mesh, sim.ConstraintContact((pairing,)), reductions=(hung,))
    states = moved(system, integrator(), 15, h=0.004)
    lower = np.flatnonzero(mesh.X[:, 2] == 0.0)
    for k, speed in ((5, 0.075), (9, 0.0), (14, -0.025)):
        assert (states[k].q[lower, 2] >= motion(states[k].t)[1][2] - 5e-6).all()
        np.testing.assert_allclose(states[k].v[lower, 2], speed, atol=2e-3)


@pytest.mark.parametrize("integrator", IMPLICIT)
@pytest.mark.parametrize(("speed", "h"), [(0.1, 2.5e-3), (0.5, 2.5e-3)])
def test_soft_tissue_lands_without_rebound(integrator, speed, h):
    """A step of several stages may not begin a stage inside the floor, from which it would rebound."""
    mesh = grid((2, 2, 2))
    floor = box([-0.1, -0.1, -0.105], [0.15, 0.15, -0.003])
    touching = sim.ConstraintContact((sim.Pairing(sim.boundary_surface(mesh), floor),))
    solid = sim.Solid((sim.Material(sim.NeoHooke(1e3)),))
    damping = sim.RestRayleigh(19.0, 0.03)
    system = system_of(mesh, sim.Gravity(), touching, damping=damping, solid=solid)
    falls = np.zeros_like(mesh.X) - [0.0, 0.0, speed]
    states = moved(system, integrator(), round((0.003 / speed + 0.012) / h), h, falls)
    lowest = np.array([state.q[:, 2].min() for state in states]) + 0.003
    landed = int(np.argmax(lowest < 1e-5))
    assert 0 < landed < len(states) - 3
    assert np.abs(lowest[landed:]).max() < 1e-5


def test_normals_at_the_end_of_a_stage_keep_the_second_order_of_sliding_tissue():
    """A cube slides by 10 mm on a soft block whose upper side tilts under it."""
    low, high = grid((1, 1, 1), (0.03, 0.03, 0.02)), grid((1, 1, 1), (0.008, 0.008, 0.008))
    mesh, *surfaces = two_bodies(low, high, [0.003, 0.0185, 0.02])
    fixed = sim.Fixed(np.flatnonzero(mesh.X[:, 2] < 1e-9))
    method, order = sim.Sdirk2(tolerance=1e-10, residual_tolerance=1e-8), []
    for renewals in (0, 1):
        pairing = sim.Pairing(*surfaces)
        contact = sim.ConstraintContact((pairing,), tolerance=1e-6, renewals=renewals)
        pull = sim.Gravity((12.0, 2.0, -30.0))
        system = system_of(mesh, contact, pull, reductions=(fixed,))
        ends = [moved(system, method, n, 0.04 / n)[-1].q for n in (8, 16, 64)]
        one, two = (np.abs(q - ends[-1]).max() for q in ends[:-1])
        assert np.abs(ends[-1] - mesh.X).max() > 5e-3
        order.append(np.log2(one / two))
    assert order[0] < 1.5
    assert order[1] > 1.9
