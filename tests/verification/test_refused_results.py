"""Iterations that do not end with a checked result raise an error that step controls catch."""

import ast
from pathlib import Path

import numpy as np
import pytest

import sim
from sim.constraints import projection
from sim.contact.cone import Blocks, forces
from sim.dense import inverse, least, solved
from sim.integrators.newton import Trial, line_search
from sim.linear.equations import Equations
from sim.steps.contract import FAILURES
from tests.bodies import grid, solid_system

SINGULAR = np.array([[1.0, 1.0], [1.0, 1.0]])


def along(phi, slope, rounding=1e-12, derivative=None):
    """Line search on a function of the length, with det F > 0 everywhere."""

    def trial(length):
        there = None if derivative is None else derivative(length)
        return Trial(length, 1.0, phi(length) - phi(0.0), there)

    return line_search(trial, slope, rounding)


def test_a_direction_of_ascent_has_no_length():
    """At a length of 2e-9 its change is below the rounding, which is no decrease."""
    assert along(lambda x: x + x * x, 1.0, 1e-8, lambda x: 1.0 + 2.0 * x) is None
    assert along(lambda x: x, 1.0, 1e-8) is None


def test_a_change_by_rounding_is_accepted_only_where_the_slope_has_fallen():
    # a function that is said to fall, and rises
    assert along(lambda x: x, -1.0, 1e-8, lambda x: 1.0) is None
    assert along(lambda x: x, -1.0, 1e-8) is None
    # a minimum whose value is known to rounding
    assert along(lambda x: 1e-9 * x, -1e-7, 1e-8, lambda x: -1e-7 * (1.0 - x)) == (1.0, 1.0)
    assert along(lambda x: 1e-9 * x, -1e-9, 1e-8) == (1.0, 1.0)


def test_a_descent_has_the_longest_length_with_sufficient_decrease():
    assert along(lambda x: 2.0 * x * x - x, -1.0, 0.0, lambda x: 4.0 * x - 1.0) == (0.25, 0.25)


@pytest.mark.parametrize("solve", [solved, lambda A, b, what: inverse(A, what) @ b])
def test_singular_dense_matrices_are_failures_of_a_step(solve):
    with pytest.raises(sim.SingularSystem, match="of two equal rows cannot be solved") as caught:
        solve(SINGULAR, np.ones(2), "a matrix of two equal rows")
    assert isinstance(caught.value, FAILURES)


def test_least_squares_of_no_numbers_are_a_failure_of_a_step():
    with pytest.raises(sim.SingularSystem, match="expected independent equations"):
        least(np.full((2, 2), np.nan), np.ones(2), "a matrix without numbers")


def test_equations_that_repeat_each_other_are_a_failure_of_a_step():
    none = np.empty(0)
    blocks = Blocks(np.arange(2), none.astype(np.int64), none)
    with pytest.raises(sim.SingularSystem, match="equations of joints"):
        forces(SINGULAR, np.ones(2), blocks, np.zeros(2), 1e-12)
    equations = Equations(np.arange(2), SINGULAR, np.zeros(2))
    with pytest.raises(sim.SingularSystem, match="equations of joints"):
        equations.solved(np.ones(2), np.eye(2))


DENSE = {"solve", "inv", "eigvals", "lstsq", "svd", "eigh", "eigvalsh", "pinv"}


@pytest.mark.parametrize(
    "path",
    sorted(
        p
        for folder in ("integrators", "joints", "contact", "linear", "kinematics", "constraints")
        for p in Path(sim.__file__).parent.joinpath(folder).glob("*.py")
    ),
    ids=lambda p: f"{p.parent.name}/{p.name}",
)
def test_steps_solve_dense_systems_only_where_failures_are_reported(path):
    """NumPy's LinAlgError ends a simulation, because no step control catches it."""
    tree = ast.parse(path.read_text())
    guarded = {
        inner
        for node in ast.walk(tree)
        if isinstance(node, ast.With | ast.Try)
        for inner in ast.walk(node)
    }
    calls = [
        node.lineno
        for node in ast.walk(tree)
        if isinstance(node, ast.Attribute)
        and node.attr in DENSE
        and ast.unparse(node.value) == "np.linalg"
        and node not in guarded
    ]
    assert calls == [], "use sim.dense, or sim.dense.reported"


def coupled_block(beta):
    mesh = grid()
    return sim.Scene(
        mesh,
        (sim.Solid((sim.Material(sim.MooneyRivlin(), sim.QuadraticBulk(25e3)),)),),
        (sim.Fixed(np.flatnonzero(mesh.X[:, 2] == 0.0)),),
        sim.RestRayleigh(0.0, beta),
    )


def test_stiffness_damping_that_differs_between_coupled_nodes_is_refused():
    beta = np.full(27, 0.05)
    system = sim.compile_scene(coupled_block(beta))
    D = system.damping(system.mesh.X, system.control(np.empty(0)))
    same = sim.compile_scene(coupled_block(0.05))
    np.testing.assert_array_equal(D, same.damping(same.mesh.X, same.control(np.empty(0))))
    beta[26] = 0.01
    with pytest.raises(sim.SceneError, match=r"element 7 is between 0.01 and 0.05 s"):
        sim.compile_scene(coupled_block(beta))


def hard_block(motion):
    mesh = grid()
    bottom, top = (np.flatnonzero(mesh.X[:, 2] == z) for z in (0.0, 0.02))
    return solid_system(
        mesh,
        reductions=(sim.Fixed(bottom), sim.PrescribedNodes(top, lambda t: mesh.X[top] + motion(t))),
        constraints=(sim.HardElementVolume(),),
    )


def test_a_truncated_projection_of_positions_is_refused(monkeypatch):
    system = hard_block(lambda t: np.array([0.05 * t, 0.0, 0.0]))
    integrator, work = sim.LinearlyImplicitEuler(), sim.Workspace(system)
    start, control = system.rest_state(), sim.Control(np.empty(0), 0.01)
    end, _ = integrator.step(system, start, control, 0.01, work)
    c, _ = system.constraints.evaluate(end.pose)
    assert np.abs(c).max() < 1e-3 * 8e-6 / 8  # of the volume of an element
    monkeypatch.setattr(projection, "SOLUTIONS", 1)
    with pytest.raises(sim.SingularSystem, match="were not projected"):
        integrator.step(system, start, control, 0.01, work)


def test_memories_of_terms_do_not_depend_on_the_order_of_terms():
    mesh = grid()
    morsels = [
        sim.Crushable(node, mesh.X[node] - [0.0, 0.0, 0.005], np.array([0.0, 0.0, 1.0]))
        for node in (17, 26)
    ]
    solid = sim.Solid((sim.Material(sim.MooneyRivlin(), sim.QuadraticBulk(25e3)),))
    base = (sim.Fixed(np.flatnonzero(mesh.X[:, 2] == 0.0)),)
    names = []
    for terms in ((solid, *morsels, sim.Gravity()), (sim.Gravity(), *morsels[::-1], solid)):
        system = sim.compile_scene(sim.Scene(mesh, terms, base))
        state = system.rest_state()
        during = system.during(state, 0.01)
        names.append({name: values.tolist() for name, values in during.remember(state.q).items()})
    assert names[0] == names[1]
    assert set(names[0]) == {"Crushable at 17[0]", "Crushable at 26[0]"}


def test_the_map_of_free_nodes_is_made_once():
    system = sim.compile_scene(coupled_block(0.0))
    pose = system.rest_state().pose
    assert system.kinematics.matrix(pose) is system.kinematics.matrix(pose)
