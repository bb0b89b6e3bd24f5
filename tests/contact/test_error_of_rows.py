"""Estimated error of a step by the normals and closest points that its stages take from their start."""

import numpy as np
import pytest
import xarray as xr

import sim
from tests.bodies import grid
from tests.contact.scenes import moved, square, system_of, two_bodies
from tests.contact.test_bodies_in_contact import FLOOR, cuboid, scene

EVERY = 0.04 / 64  # s
METHODS = {
    "sdirk2": sim.Sdirk2(tolerance=1e-11, residual_tolerance=1e-9),
    "converged": sim.ConvergedEuler(tolerance=1e-11, residual_tolerance=1e-9),
}


def sliding(renewals=0, friction=0.0, *, in_matrix=False) -> sim.System:
    """A cube on a soft block whose upper side tilts under it."""
    low, high = grid((1, 1, 1), (0.03, 0.03, 0.02)), grid((1, 1, 1), (0.008, 0.008, 0.008))
    mesh, *surfaces = two_bodies(low, high, [0.003, 0.0185, 0.02])
    pairing = (sim.Pairing(*surfaces),)
    contact = sim.ConstraintContact(pairing, friction, tolerance=1e-6, renewals=renewals)
    fixed = sim.Fixed(np.flatnonzero(mesh.X[:, 2] < 1e-9))
    whole = system_of(mesh, contact, sim.Gravity((12.0, 2.0, -30.0)), reductions=(fixed,))
    return whole.with_rows.system if in_matrix else whole


def stepped(system, method, state, h, *, estimates=True):
    work = sim.Workspace(system)
    with work.estimating(estimates):
        return method.step(system, state, system.control(np.zeros(0)), h, work)


@pytest.mark.parametrize("friction, in_matrix", [(0.0, False), (0.2, False), (0.0, True)])
@pytest.mark.parametrize("name", METHODS)
def test_the_error_is_the_distance_from_the_step_with_rows_of_the_end(name, friction, in_matrix):
    """In size and direction, to a third.

    Renewed steps estimate the same distance, to a half, which their own error is far below.
    """
    method = METHODS[name]
    own, once, renewed = (sliding(n, friction, in_matrix=in_matrix) for n in (0, 1, 20))
    start, sizes = moved(own, method, 32, EVERY)[-1], []
    assert np.abs(start.q - own.mesh.X).max() > 1e-3
    for h in (2e-3, 1e-3):
        (one, report), (two, _) = (stepped(s, method, start, h) for s in (own, renewed))
        true = one.q - two.q
        assert np.linalg.norm(report.contact_error.sum(axis=0) - true) < np.linalg.norm(true) / 3.0
        sizes.append(np.linalg.norm(report.contact_error.sum(axis=0)))
        for system in (once, renewed):
            new, after = stepped(system, method, start, h)
            assert np.linalg.norm(after.contact_error.sum(axis=0) - true) < np.linalg.norm(true) / 2
            assert np.linalg.norm(new.q - two.q) < 0.1 * np.linalg.norm(true)
    assert 3.0 < sizes[0] / sizes[1] < 5.0, "of second order in one step"


@pytest.mark.parametrize("name", METHODS)
def test_flat_surfaces_have_no_error_and_surfaces_apart_no_estimate(name):
    mesh, method = grid((1, 1, 1), (0.01, 0.01, 0.01)), METHODS[name]
    pairing = sim.Pairing(sim.boundary_surface(mesh), square())
    pull = sim.Gravity((3.0, 0.0, -9.81))
    system = system_of(mesh, sim.ConstraintContact((pairing,), tolerance=1e-6), pull)
    state = moved(system, method, 10, 1e-3)[-1]
    assert state.q[:, 0].max() - mesh.X[:, 0].max() > 1e-4, "it slides"
    new, report = stepped(system, method, state, 1e-3)
    assert np.abs(new.q - state.q).max() > 1e-5
    assert np.abs(report.contact_error).max() < 1e-11
    up = system.rest_state()
    up = sim.State(0.0, up.q + [0.0, 0.0, 1e-2], up.v)
    assert stepped(system, method, up, 1e-3)[1].contact_error is None


def test_bodies_whose_rows_are_renewed_have_an_estimate():
    system = scene([cuboid("block", (0.02, 0.02, 0.01))], [("block", FLOOR)], (3.0, 0.0, -9.81))
    method = METHODS["sdirk2"]
    state = moved(system, method, 5, 1e-3)[-1]
    assert np.abs(stepped(system, method, state, 1e-3)[1].contact_error).max() < 1e-9


@pytest.mark.parametrize("name", METHODS)
def test_the_estimate_does_not_change_the_motion(name):
    """It is made only if something reads it."""
    system, method = sliding(), METHODS[name]
    start = moved(system, method, 32, EVERY)[-1]
    (one, report), (two, without) = (
        stepped(system, method, start, 1e-3, estimates=on) for on in (True, False)
    )
    np.testing.assert_array_equal(one.q, two.q)
    np.testing.assert_array_equal(one.v, two.v)
    np.testing.assert_array_equal(report.local_error, without.local_error)
    assert report.contact_error.any() and without.contact_error is None


@pytest.mark.parametrize("name, known", [("sdirk2", True), ("linearly_implicit", False)])
def test_recorded_errors_of_contact_are_missing_where_the_method_has_none(name, known):
    """Errors of several steps between two outputs are added."""
    system = sliding()
    method = METHODS.get(name, sim.LinearlyImplicitEuler())
    simulated, _ = sim.simulate(
        system, sim.resting(0), duration=0.02, every=0.01, integrator=method,
        steps=sim.FixedStep(1e-3), probes=(sim.StepErrors(np.array([8]), ("corner",)),),
    )  # fmt: skip
    error = abs(simulated["contact_error"]) + abs(simulated["contact_passing_error"])
    assert isinstance(error, xr.DataArray) and not error.isel(time=0).any()
    assert bool(error.isel(time=slice(1, None)).notnull().all()) == known
    assert not known or float(error.max()) > 1e-9
