"""Barrier contact: derivatives, limit of a step, and errors."""

import sys

import numpy as np
import pytest

import sim
from tests.bodies import dense, grid, rotation
from tests.contact.scenes import edge_edge, entered_by, point_triangle

pytest.importorskip("ipctk")

SOFT = sim.Solid((sim.Material(sim.NeoHooke(2e3), sim.QuadraticBulk(2e4)),))
REST = np.zeros(0)


def sheet(n=1, half=0.05, z=0.0, name="sheet", motion=None):
    """Open square of triangles, seen from above, with no edge parallel to those of a block."""
    side = np.linspace(-half, half, n + 1)
    x, y = np.meshgrid(side, side, indexing="ij")
    corner = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    a, b, c, d = corner, corner + n + 1, corner + n + 2, corner + 1
    triangles = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    x, y = 0.8 * x - 0.6 * y + 0.003, 0.6 * x + 0.8 * y + 0.001
    vertices = np.stack([x.ravel(), y.ravel(), np.full(x.size, z)], axis=1)
    return sim.RigidShell(vertices, triangles, name, motion)


def raised(mesh, height):
    return sim.Mesh(mesh.X + [0.0, 0.0, height], mesh.blocks)


def body_over(shell, height=0.0, n=(2, 2, 2), **barrier):
    """System of a block at a height over a shell, and its compiled barrier."""
    mesh = raised(grid(n), height)
    pairing = sim.Pairing(sim.boundary_surface(mesh, "block"), shell)
    contact = sim.BarrierContact((pairing,), **barrier)
    system = sim.compile_scene(sim.Scene(mesh, (SOFT, contact)))
    return system, system.terms[-1]


def alone(term, system, q, tangent=False):
    """Energy, force and stiffness of one term."""
    f, K = np.zeros_like(q), np.zeros(system.pattern.nnz)
    control = system.control(REST)
    found = term.add(q, control, f, K if tangent else None)
    return found.energy, f, K


def two_blocks(gap, shift=0.003, below=(3, 3, 1), above=(2, 2, 1)):
    """One mesh of a block over another, and their surfaces."""
    lower, upper = grid(below, (0.02, 0.02, 0.01)), grid(above, (0.02, 0.02, 0.01))
    X = np.vstack([lower.X, upper.X + [shift, 0.4 * shift, 0.01 + gap]])
    cells = [lower.blocks[0].nodes, upper.blocks[0].nodes + len(lower.X)]
    mesh = sim.mesh_from_arrays(X, hex8=np.vstack(cells))
    triangles = sim.boundary_surface(mesh).triangles
    first = (triangles < len(lower.X)).all(axis=1)
    return (
        mesh,
        sim.NodeSurface(triangles[first], "lower"),
        sim.NodeSurface(triangles[~first], "upper"),
    )


def squeezed(**barrier):
    """Two blocks with an uneven gap below the distance."""
    mesh, a, b = two_blocks(2e-4)
    contact = sim.BarrierContact((sim.Pairing(a, b),), **barrier)
    system = sim.compile_scene(sim.Scene(mesh, (SOFT, contact)))
    rng = np.random.default_rng(3)
    q = mesh.X + rng.normal(size=mesh.X.shape) * 1e-5
    q[b.nodes, 2] -= 1.4e-4
    return system, system.terms[-1], q


def test_force_is_the_derivative_of_the_energy():
    system, term, q = squeezed(stiffness=1e4)
    _, f, _ = alone(term, system, q)
    for seed in range(5):
        d = np.random.default_rng(seed).normal(size=q.shape)
        d, h = d / np.abs(d).max(), 1e-9
        slope = (alone(term, system, q + h * d)[0] - alone(term, system, q - h * d)[0]) / (2 * h)
        assert -(f * d).sum() == pytest.approx(slope, rel=1e-4)
    np.testing.assert_allclose(f.sum(axis=0), 0.0, atol=1e-12 * np.abs(f).max() * len(f))


def test_tangent_of_plane_contact_is_the_derivative_of_the_force():
    """For constant normals, the stiffness omits no term."""
    system, term = body_over(sheet(), 1e-4, stiffness=1e4)
    q = system.scene.mesh.X - [0.0, 0.0, 6e-5]
    _, f, K = alone(term, system, q, tangent=True)
    A, h = dense(system, K), 1e-9
    d = np.zeros_like(q)
    d[:, 2] = np.random.default_rng(0).uniform(0.5, 1.0, len(q))
    change = (alone(term, system, q + h * d)[1] - alone(term, system, q - h * d)[1]) / (2 * h)
    np.testing.assert_allclose(A @ d.ravel(), -change.ravel(), atol=1e-3 * np.abs(change).max())


def test_tangent_is_positive_semidefinite():
    system, term, q = squeezed()
    K = dense(system, alone(term, system, q, tangent=True)[2])
    values = np.linalg.eigvalsh(K)
    assert values[0] > -1e-9 * values[-1] and values[-1] > 0.0


def test_pressure_has_the_stated_size():
    """On a plane sheet the force is area times stiffness times the stated multiple."""
    for fine in (1, 8, 20):
        system, term = body_over(sheet(fine), 1e-4, n=(4, 4, 1), stiffness=1e4)
        for gap, times in ((0.9, 0.2), (0.5, 4.0), (0.05, 40.0)):
            q = system.scene.mesh.X - [0.0, 0.0, (1.0 - gap) * 1e-4]
            _, f, _ = alone(term, system, q)
            assert 0.9 < f[:, 2].sum() / (times * 1e4 * 4e-4) < 3.1


def brute_gaps(x, y, triangles):
    """Distances of two tetrahedra, of all pairs of vertices and faces and of edges."""
    edges = np.array([[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]])
    found = [point_triangle(p, y[t])[0] for p in x for t in triangles]
    found += [point_triangle(p, x[t])[0] for p in y for t in triangles]
    found += [edge_edge(x[e], y[g])[0] for e in edges for g in edges]
    return np.array(found)


TETRAHEDRON = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])


def test_a_step_is_limited_before_the_first_contact_found_by_brute_force():
    """1000 random displacements of two tetrahedra towards and past each other."""
    rng = np.random.default_rng(5)
    corners = np.vstack([np.zeros(3), np.eye(3)]) * 0.01
    X = np.vstack([corners, corners + 0.1])
    mesh = sim.mesh_from_arrays(X, tet4=[[0, 1, 2, 3], [4, 5, 6, 7]])
    a, b = sim.NodeSurface(TETRAHEDRON, "a"), sim.NodeSurface(TETRAHEDRON + 4, "b")
    contact = sim.BarrierContact((sim.Pairing(a, b),))
    system = sim.compile_scene(sim.Scene(mesh, (SOFT, contact)))
    control, stopped, left = system.control(REST), 0, []
    for _ in range(1000):
        q0 = X.copy()
        q0[:4] = corners @ rotation(rng.integers(1 << 30)).T
        way = rng.normal(size=3)
        q0[4:] = corners @ rotation(rng.integers(1 << 30)).T + 0.025 * way / np.linalg.norm(way)
        q1 = q0 + rng.normal(size=X.shape) * 0.004
        q1[4:] -= rng.uniform(0.0, 0.06) * way / np.linalg.norm(way)
        share = system.largest_step(q0, q1, control)
        end = q0 + share * (q1 - q0)
        for i, j in ((slice(0, 4), slice(4, 8)), (slice(4, 8), slice(0, 4))):
            entered = entered_by(q0[i], end[i], q0[j].copy(), end[j].copy(), TETRAHEDRON)
            assert len(entered.point) == 0
        after = brute_gaps(end[:4], end[4:], TETRAHEDRON)
        assert after.min() > 0.0
        if share < 1.0:  # The step was limited.
            stopped += 1
            before = brute_gaps(q0[:4], q0[4:], TETRAHEDRON)
            left.append((after / before).min())
    assert 300 < stopped < 900
    assert max(left) < 0.5 and min(left) > 0.05


@pytest.mark.parametrize("side", [1.0, -1.0], ids=["onto the front", "onto the back"])
def test_a_body_thrown_through_a_thin_sheet_in_one_step_is_stopped(side):
    system, term = body_over(sheet(3, half=0.04), 0.003 if side > 0 else -0.027)
    state = system.rest_state()
    v = np.zeros_like(state.q)
    v[:, 2] = -10.0 * side  # 10 cm in a step, five times the body
    state = sim.State(0.0, state.q, v)
    for _ in range(3):
        state, report = sim.ConvergedEuler().step(
            system, state, system.control(REST), 0.01, sim.Workspace(system)
        )
        assert (side * state.q[:, 2]).min() > 0.0


def test_repeatedly_limited_steps_never_close_the_gap():
    """A tenth of the gap remains after each step, down to a nanometre, the limit of double precision."""
    system, _ = body_over(sheet(), 3e-4)
    q, control = system.scene.mesh.X.copy(), system.control(REST)
    for _ in range(14):
        move = np.zeros_like(q)
        move[:, 2] = -1e-3
        q = q + system.largest_step(q, q + move, control) * move
    assert q[:, 2].min() == pytest.approx(1e-9, rel=1e-3)


def test_friction_is_the_derivative_of_its_potential_and_opposes_the_slip():
    system, term, q = squeezed(friction=0.4, stick_speed=1e-3)
    upper = system.scene.terms[-1].pairings[0].b.nodes
    step = term.starting(sim.State(0.0, q, np.zeros_like(q)), 0.01)
    slip = np.zeros_like(q)
    for size, mobilised in ((2e-6, False), (1e-4, True)):
        slip[upper, 0] = size
        x = q + slip
        without, f0, _ = alone(term, system, x)
        energy, f, K = alone(step, system, x, tangent=True)
        assert energy > without
        h = 1e-10
        d = np.random.default_rng(1).normal(size=q.shape)
        slope = (alone(step, system, x + h * d)[0] - alone(step, system, x - h * d)[0]) / (2 * h)
        assert -(f * d).sum() == pytest.approx(slope, rel=1e-3)
        assert np.linalg.eigvalsh(dense(system, K))[0] > -1e-6 * np.abs(K).max()
        drag = -(f - f0)[upper, 0].sum()
        normal = alone(term, system, q)[1][upper, 2].sum()
        if mobilised:
            assert drag == pytest.approx(0.4 * normal, rel=0.02)
        else:
            assert 0.0 < drag < 0.2 * normal


def test_a_moving_shell_advects_and_compresses_the_tissue():
    """Two plates compress a block by 30 % in large steps; the block stays between them."""
    mesh = grid((3, 3, 3))
    lid = sheet(1, z=0.0201, name="lid", motion=lambda t: (np.eye(3), [0.0, 0.0, -0.06 * t]))
    lid = sim.RigidShell(lid.vertices, lid.triangles[:, ::-1], "lid", lid.motion)
    surface = sim.boundary_surface(mesh, "block")
    contact = sim.BarrierContact(
        (sim.Pairing(surface, lid), sim.Pairing(surface, sheet(z=-1e-4, name="floor")))
    )
    scene = sim.Scene(mesh, (SOFT, contact), damping=sim.RestRayleigh(0.0, 0.01))
    system = sim.compile_scene(scene)
    record, end = sim.simulate(
        system,
        sim.resting(0),
        duration=0.1,
        steps=sim.HalvingStep(0.02),
        probes=(sim.Positions(), sim.Iterations()),
    )
    assert end.q[:, 2].max() < 0.0201 - 0.006 and end.q[:, 2].min() > -1e-4
    assert record.rejected.sum() == 0
    # lateral expansion
    assert end.q[:, 0].max() > 0.0205 and end.q[:, 0].min() < -0.0005


@pytest.mark.parametrize("integrator", [sim.Static, sim.Sdirk2, sim.Trapezoidal])
def test_every_iterative_integrator_ends_in_the_same_equilibrium(integrator):
    """A block that hangs from its upper side is pressed from below."""
    mesh = grid((2, 2, 2))
    rising = sheet(2, z=-1e-4, motion=lambda t: (np.eye(3), [0.0, 0.0, min(0.02 * t, 2e-3)]))
    scene = sim.Scene(
        mesh,
        (SOFT, sim.BarrierContact((sim.Pairing(sim.boundary_surface(mesh), rising),))),
        (sim.Fixed(np.flatnonzero(mesh.X[:, 2] > 0.0199)),),
        damping=sim.RestRayleigh(0.0, 0.05),
    )
    ends = [
        sim.simulate(
            sim.compile_scene(scene),
            sim.resting(0),
            duration=0.5,
            integrator=method(),
            steps=sim.HalvingStep(0.025),
            probes=(),
        )[1]
        for method in (sim.ConvergedEuler, integrator)
    ]
    assert ends[0].q[:, 2].min() > 1.85e-3
    np.testing.assert_allclose(ends[1].q, ends[0].q, atol=5e-6)


def test_stiffness_beyond_reach_is_replaced_by_an_upper_bound_on_the_diagonal():
    """An upper block displaced by 15 mm; the scene with all couplings has the exact stiffness."""
    matrices = []
    for reach in (0.05, 1e-4):
        mesh, a, b = two_blocks(2e-4, below=(6, 6, 1), above=(6, 5, 1))
        contact = sim.BarrierContact((sim.Pairing(a, b),), reach=reach, friction=0.3)
        system = sim.compile_scene(sim.Scene(mesh, (SOFT, contact)))
        q = mesh.X.copy()
        q[b.nodes] += [0.015, 0.002, -1.4e-4]
        step = system.terms[-1].starting(sim.State(0.0, q, 0.0 * q), 0.01)
        q[b.nodes, 0] += 2e-6
        energy, f, K = alone(step, system, q, tangent=True)
        matrices.append((energy, f, dense(system, K)))
    (energy, f, full), (same, g, bound) = matrices
    assert energy == same and energy > 0.0
    np.testing.assert_array_equal(f, g)
    assert np.abs(bound - full).max() > 0.01 * np.abs(full).max()
    values = np.linalg.eigvalsh(bound - full)
    assert values[0] > -1e-9 * values[-1]


def test_tissue_that_starts_inside_a_shell_stays_at_rest():
    """A block that overlaps a tilted floor by up to 1.5 mm stays at rest under its weight."""
    floor = sheet(20, half=0.03)
    tilted = floor.vertices + [0.0, 0.0, 1.0] * (1e-3 + 0.03 * floor.vertices[:, :1])
    floor = sim.RigidShell(tilted, floor.triangles, "floor")
    mesh = grid((4, 4, 2), (0.02, 0.02, 0.01))
    contact = sim.BarrierContact((sim.Pairing(sim.boundary_surface(mesh, "block"), floor),))
    scene = sim.Scene(
        mesh,
        (SOFT, sim.Gravity((0.0, 0.0, -9.8)), contact),
        damping=sim.RestRayleigh(1.0, 0.01),
    )
    system = sim.compile_scene(scene)
    energy, f, _ = alone(system.terms[-1], system, mesh.X)
    assert energy == 0.0 and not f.any()
    _, end = sim.simulate(system, sim.resting(0), duration=0.2, probes=())
    # The offset extends over triangles of the shell, so that the block sinks slightly.
    assert -2.5e-4 < (end.q - mesh.X)[:, 2].min()


def test_surfaces_that_share_nodes_exert_no_force_at_rest():
    """Two lips of one mesh that meet in a corner at a right angle."""
    mesh = grid((2, 2, 1), (0.02, 0.02, 0.01))
    whole = sim.boundary_surface(mesh).triangles
    x = mesh.X[whole]
    floor = sim.NodeSurface(whole[(x[..., 2] == 0.0).all(axis=1)], "lower lip")
    wall = sim.NodeSurface(whole[(x[..., 0] == 0.0).all(axis=1)], "upper lip")
    assert len(sim.Pairing(floor, wall).shared) > 0
    contact = sim.BarrierContact((sim.Pairing(floor, wall),))
    system = sim.compile_scene(sim.Scene(mesh, (SOFT, contact)))
    energy, f, _ = alone(system.terms[-1], system, mesh.X)
    assert energy == 0.0 and not f.any()


def test_errors_of_overlapping_starts_state_the_place():
    for gap, word in ((-5e-4, "cross"), (0.0, "touch|cross")):
        mesh, a, b = two_blocks(gap)
        scene = sim.Scene(mesh, (SOFT, sim.BarrierContact((sim.Pairing(a, b),))))
        with pytest.raises(
            sim.ContactFailure, match=f"'lower on upper'.*({word}) at rest"
        ) as found:
            sim.compile_scene(scene)
        assert found.value.node is not None and found.value.surface == "lower on upper"
    with pytest.raises(sim.ContactFailure, match="shell 'sheet' would have to be offset") as found:
        body_over(sheet(), -0.01)
    assert found.value.node is not None


BAD = {"distance": 0.0, "stiffness": -1.0, "reach": np.nan, "stick_speed": np.inf, "friction": -0.1}


@pytest.mark.parametrize("name", BAD)
def test_numbers_out_of_range_are_refused(name):
    mesh = grid((1, 1, 1))
    pairing = sim.Pairing(sim.boundary_surface(mesh), sheet())
    with pytest.raises(sim.SceneError, match=f"{name} = "):
        sim.BarrierContact((pairing,), **{name: BAD[name]})
    with pytest.raises(sim.SceneError, match="no pairings"):
        sim.BarrierContact(())


@pytest.mark.parametrize(
    "integrator",
    [
        sim.LinearlyImplicitEuler,
        sim.LinearlyImplicitTrapezoidal,
        sim.SymplecticEuler,
        sim.RungeKutta4,
    ],
)
def test_integrators_without_iteration_refuse_a_barrier(integrator):
    system, _ = body_over(sheet(), 1e-3)
    with pytest.raises(sim.SceneError, match="use an iterative integrator"):
        sim.simulate(system, sim.resting(0), duration=0.01, integrator=integrator())


def test_a_missing_package_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "ipctk", None)
    with pytest.raises(sim.SceneError, match="pip install ipctk"):
        body_over(sheet(), 1e-3)
