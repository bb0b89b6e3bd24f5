"""Contact with invalid or difficult initial states: a correct result, or a located error.

All iterations of contact are bounded, so that no case can hang.
"""

import numpy as np
import pytest

import sim
from tests.bodies import grid, rotation
from tests.contact.scenes import (
    CASES,
    box,
    contact_of,
    moved,
    square,
    system_of,
    two_bodies,
)

GRAVITY = sim.Gravity((0.0, 0.0, -9.81))
BLOCK = (0.02, 0.02, 0.01)


def refused(method, mesh, pairing, *terms, reductions=()):
    """System, or the error of a refused start, which must contain the pairing and a node."""
    try:
        return system_of(mesh, contact_of(method, (pairing,)), *terms, reductions=reductions), None
    except sim.ContactFailure as error:
        assert error.surface == pairing.name and error.node is not None
        for word in (f"{pairing.name!r} starts intersecting", "node", "expected", ": "):
            assert word in str(error)
        return None, error


@pytest.mark.parametrize(("method", "integrator"), CASES)
@pytest.mark.parametrize("depth", [0.0, 1e-9, 1e-4, 4e-3])
@pytest.mark.parametrize("shift", [0.005, 0.0037], ids=["node on node", "node on face"])
def test_an_overlapping_start_is_refused_or_does_not_deepen(method, integrator, depth, shift):
    """Without load the overlapping bodies stay at rest; under gravity depths do not increase."""
    mesh, a, b = two_bodies(
        grid((4, 4, 2), BLOCK), grid((2, 2, 2), (0.01, 0.01, 0.01)), [shift, shift, 0.01 - depth]
    )
    system, error = refused(method, mesh, sim.Pairing(a, b))
    if error is not None:
        return
    end = moved(system, integrator(), 3)[-1]
    np.testing.assert_allclose(end.q, mesh.X, rtol=0, atol=1e-9)
    floor = sim.Fixed(np.flatnonzero(mesh.X[:, 2] == 0.0))
    system, _ = refused(method, mesh, sim.Pairing(a, b), GRAVITY, reductions=(floor,))
    top = np.setdiff1d(np.flatnonzero(np.isclose(mesh.X[:, 2], 0.01)), b.nodes)
    bottom = np.setdiff1d(np.flatnonzero(np.isclose(mesh.X[:, 2], 0.01 - depth)), a.nodes)
    for state in moved(system, integrator(), 10):
        gap = sim.Contacts().record(system, state, system.control(np.zeros(0)), None)[1]
        assert not gap[0] < -1e-5
        # height of the middle of the lower side of the upper block above the lower block
        under = bottom[4]
        away = np.linalg.norm(state.q[top, :2] - state.q[under, :2], axis=1)
        apart = state.q[under, 2] - state.q[top[np.argmin(away)], 2]
        assert apart > -depth - (1e-5 if shift == 0.005 else 1e-4)


@pytest.mark.parametrize(("method", "integrator"), CASES)
@pytest.mark.parametrize("depth", [0.0, 1e-12, 1e-9, 1e-3])
def test_blocks_whose_sides_and_nodes_coincide_are_refused_or_rest_on_each_other(
    method, integrator, depth
):
    """They rest on each other for any rounding of the gap; with a larger overlap they stay at
    rest."""
    mesh, a, b = two_bodies(grid((2, 2, 2), BLOCK), grid((2, 2, 2), BLOCK), [0, 0, 0.01 - depth])
    system, error = refused(method, mesh, sim.Pairing(a, b))
    if error is not None:
        return
    end = moved(system, integrator(), 3)[-1]
    np.testing.assert_allclose(end.q, mesh.X, rtol=0, atol=1e-9)
    if depth < 1e-6:
        floor = sim.Fixed(np.flatnonzero(mesh.X[:, 2] == 0.0))
        system, _ = refused(method, mesh, sim.Pairing(a, b), GRAVITY, reductions=(floor,))
        top = a.nodes[np.isclose(mesh.X[a.nodes, 2], 0.01)]
        bottom = b.nodes[np.isclose(mesh.X[b.nodes, 2], 0.01)]
        for state in moved(system, integrator(), 10):
            assert (state.q[bottom, 2] - state.q[top, 2]).min() > -1e-5


@pytest.mark.parametrize(("method", "integrator"), CASES)
@pytest.mark.parametrize("height", [0.0, 1e-9, 1e-4, 3e-3])
def test_a_shell_that_starts_in_the_tissue_exerts_no_force_at_rest(method, integrator, height):
    mesh = grid((2, 2, 2), BLOCK)
    for shell in (square(height), box([-0.1, -0.1, -0.1], [0.1, 0.1, height])):
        pairing = sim.Pairing(sim.boundary_surface(mesh, "block"), shell)
        system, error = refused(method, mesh, pairing)
        if error is None:
            end = moved(system, integrator(), 3)[-1]
            np.testing.assert_allclose(end.q, mesh.X, rtol=0, atol=1e-9)


@pytest.mark.parametrize(("method", "integrator"), CASES)
def test_a_block_rests_on_an_open_sheet_and_falls_past_its_free_edge(method, integrator):
    """An open sheet has a front, and supports only the part of the block above it."""
    mesh = grid((2, 2, 1), BLOCK)
    lowest = {}
    for shift in (0.0, 0.2):
        sheet = square(0.0)
        sheet = sim.RigidShell(sheet.vertices + [shift, 0, 0], sheet.triangles, "sheet")
        contact = contact_of(method, (sim.Pairing(sim.boundary_surface(mesh), sheet),))
        states = moved(system_of(mesh, contact, GRAVITY), integrator(), 12)
        lowest[shift] = states[-1].q[:, 2].min()
    assert lowest[0.0] > -1e-5
    assert lowest[0.2] < -0.05


@pytest.mark.parametrize(("method", "integrator"), CASES)
def test_a_block_that_hangs_over_the_free_edge_of_a_sheet_tips_over_it(method, integrator):
    """Its centre is beyond the edge: contact with a free edge, and with the faces behind it."""
    mesh = grid((4, 2, 1), (0.04, 0.02, 0.01))
    sheet = square(0.0)
    sheet = sim.RigidShell(sheet.vertices + [-0.085, 0, 0], sheet.triangles, "sheet")
    contact = contact_of(method, (sim.Pairing(sim.boundary_surface(mesh), sheet),))
    states = moved(system_of(mesh, contact, GRAVITY), integrator(), 8)
    far, near = mesh.X[:, 0] > 0.039, mesh.X[:, 0] < 0.001
    assert states[-1].q[far, 2].mean() < mesh.X[far, 2].mean() - 5e-3
    assert states[-1].q[near, 2].min() > -1e-4


def lips():
    """Two lips that open like a book and have two common nodes at their corner, at x = 0."""
    lower, upper = grid((6, 3, 1), (0.03, 0.018, 0.004)), grid((6, 1, 1), (0.027, 0.006, 0.004))
    n, m = len(lower.X), len(upper.X)
    X = np.vstack([lower.X, upper.X + [0, 0.006, 0.004]])
    X[n:, 2] += 0.1 * X[n:, 0]
    number = np.arange(n + m)
    for node in n + np.flatnonzero((upper.X[:, 0] == 0.0) & (upper.X[:, 2] == 0.0)):
        number[node] = np.argmin(((X[:n] - X[node]) ** 2).sum(axis=1))
    kept = np.unique(number)
    above = np.searchsorted(kept, number[n:])
    cells = np.vstack([lower.blocks[0].nodes, above[upper.blocks[0].nodes]])
    skins = [sim.boundary_surface(lip).triangles for lip in (lower, upper)]
    return (
        sim.mesh_from_arrays(X[kept], hex8=cells),
        sim.NodeSurface(skins[0], "lower lip"),
        sim.NodeSurface(above[skins[1]], "upper lip"),
    )


@pytest.mark.parametrize(("method", "integrator"), CASES)
@pytest.mark.parametrize("friction", [0.0, 0.2])
def test_lips_that_share_a_corner_have_no_contact_force_at_rest_and_close(
    method, integrator, friction
):
    """Also if the forces, and the bounds of friction, are as small as iteration errors."""
    mesh, lower, upper = lips()
    X = mesh.X
    pairing = sim.Pairing(lower, upper)
    assert len(pairing.shared) == 2
    corner = sim.Fixed(np.flatnonzero(X[:, 0] == 0.0))
    contact = contact_of(method, (pairing,), friction)
    end = moved(system_of(mesh, contact, reductions=(corner,)), integrator(), 3)[-1]
    np.testing.assert_allclose(end.q, X, rtol=0, atol=1e-9)
    tips = [s.nodes[X[s.nodes, 0] > X[s.nodes, 0].max() - 1e-6] for s in (lower, upper)]
    nodes = np.concatenate(tips)
    push = np.zeros((len(nodes), 3))
    push[:, 2] = np.repeat([1e-4, -1e-4], [len(tip) for tip in tips])
    system = system_of(mesh, contact, sim.NodeLoad(nodes, push), reductions=(corner,))
    end = moved(system, integrator(), 30)[-1]
    _, gap, force = sim.Contacts().record(system, end, system.control(np.zeros(0)), None)
    assert -1e-5 < gap[0] <= 1e-6 and force[0] > 2e-4
    # the tip of the upper lip above the middle of the lower one, a line between nodes
    middle = lower.nodes[np.isclose(X[lower.nodes, 1], 0.006) & (X[lower.nodes, 2] > 0.003)]
    x, _, z = end.q[tips[1][X[tips[1], 1] < 0.007].min()]
    height = z - np.interp(x, end.q[middle, 0], end.q[middle, 2])
    assert -1e-5 < height < 1e-5


def flat_triangle():
    """Mesh of a tetrahedron, and a surface with a triangle whose corners lie on one line."""
    corners = np.vstack([np.zeros(3), np.eye(3), [0.5, 0.5, 0.0]]) * 0.01
    tets = [[0, 1, 4, 3], [0, 4, 2, 3]]
    return sim.mesh_from_arrays(corners, tet4=tets), sim.NodeSurface(np.array([[1, 4, 2]]), "lip")


@pytest.mark.parametrize("method", [sim.ConstraintContact])
def test_surfaces_that_do_not_fit_the_mesh_are_refused_with_their_place(method):
    """Invalid triangles are refused independently of the method."""
    mesh, flat = flat_triangle()
    whole = sim.boundary_surface(mesh, "skin")
    bad = {
        "triangle 0 of surface 'lip' has no area": flat,
        "refers to node 7, expected 0..4 of the mesh": sim.NodeSurface(
            np.array([[0, 1, 7]]), "lip"
        ),
        "inside out": sim.NodeSurface(whole.triangles[:, ::-1], "lip"),
    }
    for text, surface in bad.items():
        with pytest.raises(sim.ContactFailure, match=text) as raised:
            system_of(mesh, contact_of(method, (sim.Pairing(surface, square(-0.01)),)))
        assert raised.value.surface == "lip"
    part = sim.NodeSurface(whole.triangles[:2], "part")
    with pytest.raises(
        sim.ContactFailure, match="belongs to both surfaces of pairing 'skin on part'"
    ):
        system_of(mesh, contact_of(method, (sim.Pairing(whole, part),)))


def rising(speed, height):
    """Plate that rises at a speed [m/s] below a block."""

    def motion(t):
        return np.eye(3), np.array([0.0, 0.0, speed * t])

    return box([-0.1, -0.1, height - 0.01], [0.1, 0.1, height], "plate", motion)


@pytest.mark.parametrize(("method", "integrator"), CASES)
@pytest.mark.parametrize("speed", [1.0, 100.0])
def test_a_shell_that_moves_far_in_one_step_is_followed_or_refused(method, integrator, speed):
    """Move it by a cell or a hundred blocks: the given state is unchanged, smaller steps succeed."""
    mesh = grid((2, 2, 2), BLOCK)
    pairing = sim.Pairing(sim.boundary_surface(mesh, "block"), rising(speed, -1e-3))
    system = system_of(mesh, contact_of(method, (pairing,)))
    start = system.rest_state()
    try:
        end = moved(system, integrator(), 1, initial=start)[-1]
    except (sim.NotConverged, sim.InvertedElement) as error:
        np.testing.assert_array_equal(start.q, mesh.X)
        assert "try" in str(error)
    else:
        assert end.q[:, 2].min() > -1e-3 + 0.01 * speed - 1e-5
    if speed == 1.0:
        _, end = sim.simulate(
            system,
            sim.resting(0),
            duration=0.01,
            integrator=integrator(),
            steps=sim.HalvingStep(0.01),
            probes=(),
        )
        assert end.q[:, 2].min() > 9e-3 - 1e-5


@pytest.mark.parametrize(("method", "integrator"), [*CASES, (sim.ConstraintContact, sim.Static)])
@pytest.mark.parametrize("part", ["q", "v"])
def test_a_position_or_velocity_that_is_not_a_number_is_refused(method, integrator, part):
    mesh = grid((2, 2, 2), BLOCK)
    pairing = sim.Pairing(sim.boundary_surface(mesh, "block"), square(-1e-3))
    system = system_of(mesh, contact_of(method, (pairing,), friction=0.3))
    values = {"q": mesh.X.copy(), "v": np.zeros_like(mesh.X)}
    values[part][3, 1] = np.nan
    state = sim.State(0.0, **values)
    if part == "v" and integrator is sim.Static:
        return  # it has no velocities
    with pytest.raises(sim.SimulationError):
        moved(system, integrator(), 1, initial=state)
    with pytest.raises(sim.SceneError, match="node 3 .* not finite"):
        sim.simulate(system, sim.resting(0), duration=0.01, integrator=integrator(), initial=state)


@pytest.mark.parametrize(("method", "integrator"), CASES)
def test_a_contact_without_a_free_vertex_exerts_no_force(method, integrator):
    """A fixed block overlapped by a plate, next to a falling one."""
    mesh, a, b = two_bodies(grid((1, 1, 1), BLOCK), grid((1, 1, 1), BLOCK), [0.1, 0, 0])
    for height in (-1e-3, 0.0, 2e-3):
        pairing = sim.Pairing(a, square(height))
        contact = contact_of(method, (pairing,), friction=0.5)
        system = system_of(mesh, contact, GRAVITY, reductions=(sim.Fixed(a.nodes),), damping=None)
        end = moved(system, integrator(), 5)[-1]
        np.testing.assert_array_equal(end.q[a.nodes], mesh.X[a.nodes])
        assert end.v[b.nodes, 2] == pytest.approx(np.full(8, -9.81 * 0.05), rel=1e-3)


@pytest.mark.parametrize(("method", "integrator"), CASES)
def test_a_plate_that_moves_into_fixed_tissue_is_refused_or_has_no_effect(method, integrator):
    mesh, a, _ = two_bodies(grid((1, 1, 1), BLOCK), grid((1, 1, 1), BLOCK), [0.1, 0, 0])
    contact = contact_of(method, (sim.Pairing(a, rising(0.3, -1e-3)),))
    system = system_of(mesh, contact, reductions=(sim.Fixed(a.nodes),))
    try:
        end = moved(system, integrator(), 3)[-1]
    except sim.NotConverged as error:
        assert "'first on plate' a shell moves through the tissue" in str(error)
    else:
        np.testing.assert_allclose(end.q, mesh.X, rtol=0, atol=1e-12)


@pytest.mark.parametrize("method", [sim.ConstraintContact])
def test_a_self_intersecting_surface_is_refused_or_has_no_effect_at_rest(method):
    """A strip bent into a ring whose ends pass through each other."""
    strip = grid((12, 1, 1), (0.06, 0.01, 0.004))
    X = strip.X.copy()
    angle, radius = X[:, 0] / 0.06 * 2.2 * np.pi, 0.01 + X[:, 2]
    X[:, 0], X[:, 2] = -radius * np.cos(angle), radius * np.sin(angle)
    mesh = sim.Mesh(X @ rotation(4), strip.blocks)
    pairing = sim.Pairing(sim.boundary_surface(mesh, "strip"))
    system, error = refused(method, mesh, pairing)
    if error is None:
        end = moved(system, sim.ConvergedEuler(), 3)[-1]
        np.testing.assert_allclose(end.q, mesh.X, rtol=0, atol=1e-9)


@pytest.mark.parametrize("friction", [0.0, 0.3])
@pytest.mark.parametrize("integrator", [sim.LinearlyImplicitEuler, sim.LinearlyImplicitTrapezoidal])
def test_a_step_that_cannot_succeed_is_given_up_within_ten_ordinary_ones(integrator, friction):
    """A lid is pushed through a sheet and the floor below it; work in forces and solutions."""
    mesh, work = grid((3, 3, 1), (0.02, 0.02, 1e-3)), []
    for speed in (0.015, 0.5):

        def falling(t, speed=speed):
            return np.eye(3), np.array([0.0, 0.0, -speed * t])

        floor = box([-0.1, -0.1, -0.01], [0.1, 0.1, -1e-4])
        lid = box([-0.1, -0.1, 1.1e-3], [0.1, 0.1, 0.01], "lid", falling)
        sheet = sim.boundary_surface(mesh, "sheet")
        pairings = tuple(sim.Pairing(sheet, shell) for shell in (floor, lid))
        system = system_of(mesh, sim.ConstraintContact(pairings, friction=friction))
        state, memory = system.rest_state(), sim.Workspace(system)
        step, control = integrator().step, system.control(np.zeros(0))
        try:
            for _ in range(3):
                state, _ = step(system, state, control, 0.01, memory)
        except (sim.NotConverged, sim.InvertedElement):
            assert speed == 0.5 and state.t == 0.0
        work.append(sum(memory.calls.values()))
    assert work[1] < 10.0 * work[0] / 3.0
