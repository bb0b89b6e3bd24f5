"""Hard volumes of tissue on moving bodies, with joints and contact."""

from dataclasses import replace

import numpy as np
import pytest

import sim
from sim.contact.rows import NO_ROWS
from sim.contact.surfaces import body_surfaces
from sim.integrators.linear_rows import LinearRows
from sim.integrators.step_solver import LinearStep, StepEstimates
from sim.joints import Spherical, Weld
from sim.state import Line
from sim.system import damping_matrix, implicit_matrix
from tests.bodies import grid, solid_system
from tests.kinematics.scenes import dense, mixed_system, random_pose, swing
from tests.kinematics.test_motion import run

HARD = (sim.HardElementVolume(),)
BOX = (0.02, 0.01, 0.01)


def test_derivatives_by_the_velocities_of_bodies_and_supports():
    """G w is the rate of c along a motion, and the drift that of a prescribed body."""
    system = mixed_system(constraints=HARD)
    conditions, kinematics = system.constraints, system.kinematics
    pose, _ = random_pose(system)
    G, eps = conditions.matrix(conditions.evaluate(pose)[1]), 1e-6
    w = np.random.default_rng(3).normal(size=system.pattern.n)
    ends = [
        conditions.evaluate(kinematics.advance(pose, s * eps * w, pose.t + s * eps))[0]
        for s in (1.0, -1.0)
    ]
    rate = (ends[0] - ends[1]) / (2.0 * eps)
    drift = conditions.drift(pose, pose.t)
    assert np.abs(drift).max() > 0.01 * np.abs(G @ w).max()
    np.testing.assert_allclose(G @ w + drift, rate, atol=1e-7 * np.abs(rate).max())


def rows_and_saddle(hard=()):
    """Velocities and forces of tissue, bodies, and a rigid and a compliant joint, and those of the dense
    solution of [A -h G' C'; G 0 0; C 0 0]."""
    ball = Spherical("ball", "jaw", None, (0.0, 0.0, 0.0))
    bond = Weld("bond", "skull", "jaw", (0.01, 0.0, 0.0), compliance=1e-3, damping_time=0.02)
    system = mixed_system(prescribed=False, joints=(ball, bond), constraints=hard)
    pose, _ = random_pose(system, size=0.3)
    control, h, rows = system.control(np.full(len(system.muscles), 0.2)), 2e-3, system.rows
    here, K = system.tangent(pose.q, control)
    D = damping_matrix(system, pose, np.zeros_like(pose.q), control, K)
    A = implicit_matrix(system, pose, here, K, D, h, h * h)
    rhs = np.random.default_rng(0).normal(size=system.pattern.n) * 1e-6
    state = system.kinematics.state(pose, np.zeros(system.pattern.n), {})
    silent = np.zeros(len(system.muscles))
    missed = StepEstimates(Line(silent, silent, 0.0, h), D, here, estimated=False, control=None)
    state, equation = replace(state, t=pose.t - h), LinearStep(A, rhs, 1.0, missed)
    step = LinearRows(system, state, equation, h, 1e-12, sim.Workspace(system))
    _, w, f = step.under(NO_ROWS)
    now, m, n = rows.evaluate(pose), len(rows.names), system.pattern.n
    G = np.zeros((m, n))
    G[:, rows.columns] = now.G
    C = np.zeros((0, n))
    if hard:
        C = system.constraints.matrix(system.constraints.evaluate(pose)[1]).toarray()
        C /= np.abs(C).mean()
    k = len(C)
    time = np.where(rows.rigid, np.inf, h + rows.damping_time)
    none = np.zeros((k, m))
    saddle = np.block(
        [
            [dense(system, A.values), -h * G.T, C.T],
            [G, np.diag(rows.compliance / time), none.T],
            [C, none, np.zeros((k, k))],
        ]
    )
    wanted = np.concatenate([rhs, -now.drift - now.c / time, np.zeros(k)])
    expected = np.linalg.solve(saddle, wanted)
    return (w, expected[:n]), (f, expected[n : n + m])


@pytest.mark.parametrize("hard", [(), HARD], ids=["joints", "joints and volumes"])
def test_joints_volumes_and_tissue_equal_the_full_saddle_system(hard):
    for computed, expected in rows_and_saddle(hard):
        np.testing.assert_allclose(computed, expected, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("cls", [sim.LinearlyImplicitEuler, sim.LinearlyImplicitTrapezoidal])
def test_volumes_are_kept_on_a_jointed_body_and_one_that_swings(cls):
    """Tissue between both, with active muscles, under gravity; the joint stays closed."""
    ball = Spherical("ball", "jaw", None, (0.0, 0.0, 0.0))
    system = mixed_system(joints=(ball,), constraints=HARD)
    levels = np.array([[0.0, 0.0], [0.3, 0.1]])
    drive = sim.Activation(np.array([0.0, 0.02]), levels)
    start = system.rest_state()
    end = run(system, start, 0.02, 10, cls(), drive)
    assert np.abs(end.q - start.q).max() > 1e-3
    changed = np.abs(system.constraints.evaluate(end.pose)[0])
    assert changed.max() < 1e-5 * system.scene.mesh.volumes().min()
    assert np.abs(system.rows.evaluate(end.pose).c).max() < 1e-8


def test_tissue_with_hard_volumes_on_a_body_equals_that_on_prescribed_nodes():
    mesh = grid((2, 1, 1), BOX)
    right = np.flatnonzero(mesh.X[:, 0] == BOX[0])
    skull = sim.Body("skull", centre=(0.03, 0.005, 0.005))
    body = solid_system(
        mesh,
        reductions=(sim.OnBody("skull", right), sim.PrescribedBody("skull", swing)),
        bodies=(skull,),
        constraints=HARD,
    )

    def path(t):
        c, q = swing(t)
        return (
            sim.kinematics.rotations.matrices(np.array([q]))[0] @ (mesh.X[right] - skull.centre).T
            + np.array(c)[:, None]
        )

    nodes = solid_system(
        mesh,
        reductions=(sim.PrescribedNodes(right, lambda t: path(t).T),),
        constraints=HARD,
    )
    ends = [
        run(s, s.rest_state(), 0.02, 10, sim.LinearlyImplicitEuler()).q[: mesh.n_nodes]
        for s in (body, nodes)
    ]
    assert np.abs(ends[0] - mesh.X).max() > 1e-3
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-10)


def test_an_incompressible_block_lands_on_a_body_and_keeps_its_volume():
    """Contact, bodies and volumes in one step, with conserved momentum."""
    mesh = grid((2, 2, 1), (0.02, 0.02, 0.01))
    n, tissue = mesh.n_nodes, sim.boundary_surface(mesh, "tissue")
    plate = grid((1, 1, 1), (0.03, 0.03, 0.01))
    shell = sim.boundary_surface(plate, "plate").triangles
    X = plate.X + [-0.005, -0.005, -0.0105]
    points, on, surfaces = body_surfaces({"plate": (X, shell)}, n)
    body = sim.body_of_surface("plate", X, shell, 1000.0)
    contact = sim.ConstraintContact((sim.Pairing(tissue, surfaces["plate"]),))
    system = sim.compile_scene(
        sim.Scene(
            mesh,
            (sim.Solid(), contact),
            on,
            bodies=(body,),
            points=points,
            constraints=HARD,
        )
    )
    w = np.zeros(system.pattern.n)
    w[: 3 * n].reshape(-1, 3)[:] = [0.1, 0.0, -0.5]
    start = system.kinematics.state(system.rest_state().pose, w, {})
    end = run(system, start, 0.006, 12, sim.LinearlyImplicitEuler())
    before, after = (system.node_mass @ s.v for s in (start, end))
    np.testing.assert_allclose(after, before, atol=1e-10 * np.abs(before).max())
    assert end.twists[0, 2] < -0.05
    changed = np.abs(system.constraints.evaluate(end.pose)[0])
    assert changed.max() < 1e-3 * mesh.volumes().min()
    _, gap, _ = sim.Contacts().record(system, end, system.control(np.zeros(0)), None)
    assert not gap[0] < -5e-6  # NaN where they are apart again


@pytest.mark.parametrize("cls", [sim.ConvergedEuler, sim.Sdirk2, sim.Static])
def test_converged_steps_refuse_hard_volumes_on_bodies(cls):
    system = mixed_system(constraints=HARD)
    with pytest.raises(sim.SceneError, match="hard volumes together with bodies"):
        run(system, system.rest_state(), 0.01, 1, cls())
