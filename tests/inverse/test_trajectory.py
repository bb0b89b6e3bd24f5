"""Trajectory form: derivatives against finite differences, recovery of a known course, refusals."""

import numpy as np
import pytest

import sim
from emgface.inverse.assumptions import prior
from sim.inverse import PointTarget, Splines, fit, linearise
from tests.bodies import crossed_muscles, grid
from tests.contact.scenes import square
from tests.inverse.test_response import block, stiffening

SPLINES = Splines(0.2, 0.05)


def pressed_block(touching=True):
    mesh = grid()
    solid = sim.Solid(muscles=crossed_muscles(mesh))
    sheet = sim.ConstraintContact((sim.Pairing(sim.boundary_surface(mesh), square()),))
    side = sim.Fixed(np.flatnonzero(mesh.X[:, 0] == 0.0))
    damping = sim.RestRayleigh(19.0, 0.055)
    terms = (solid, sheet) if touching else (solid,)
    return sim.compile_scene(sim.Scene(mesh, terms, (side,), damping))


def course(seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(0.1, 0.5, (SPLINES.n, 2))


def targets(system, nodes=(20, 26), size=1e-4) -> list[PointTarget]:
    nodes = np.array(nodes)
    return [PointTarget(nodes, np.zeros(1), system.mesh.X[None, nodes] + 1e-4, size)]


def test_derivatives_over_a_trial_are_those_of_finite_differences():
    system, c = block(), course()
    linearised = linearise(system, targets(system), SPLINES, c, h=0.02, decayed=0.0)
    move = np.random.default_rng(1).standard_normal(c.shape)
    ends = [
        linearise(system, targets(system), SPLINES, c + s * move, h=0.02, derivatives=False)
        for s in (1e-4, -1e-4)
    ]
    slope = (ends[1].residual - ends[0].residual) / 2e-4  # residuals are wanted minus reached
    assert np.abs(linearised.J @ move.ravel() - slope).max() <= 1e-6 * np.abs(slope).max()
    gradient = -np.einsum("ti,tip->p", linearised.residual, linearised.J) @ move.ravel()
    assert gradient == pytest.approx((ends[0].misfit - ends[1].misfit) / 2e-4, rel=1e-6)


def test_closed_contacts_hold_in_the_derivatives():
    """A block that its muscles press on a sheet, so that two to four rows close one after another.

    Steps close the gaps of these rows to rounding, as the derivatives do.
    """
    splines, c = Splines(0.1, 0.05), np.full((3, 2), 0.4)
    move = np.random.default_rng(1).standard_normal(c.shape)

    def off(system):
        """Largest difference of derivatives with and without rows over the largest derivative."""
        nodes = np.flatnonzero(system.mesh.X[:, 0] > 0.019)
        target = [PointTarget(nodes, np.zeros(1), system.mesh.X[None, nodes], 1e-4)]
        ends = [
            linearise(system, target, splines, c + s * move, derivatives=False)
            for s in (1e-5, -1e-5)
        ]
        slope = (ends[1].residual - ends[0].residual) / 2e-5
        for one in (system, pressed_block(False)):
            derivative = linearise(one, target, splines, c, decayed=0.0).J @ move.ravel()
            yield np.abs(derivative - slope).max() / np.abs(slope).max()

    closed, free = off(pressed_block())
    assert closed <= 1e-6 and free > 0.05


def test_a_known_course_is_recovered_and_the_objective_decreases():
    system, true = block(), course(3)
    motion = linearise(system, targets(system), SPLINES, true, derivatives=False)
    t = 0.01 * np.arange(1, 21)
    reached = targets(system)[0].wanted(0.0)[None] - motion.residual * 1e-4
    nodes = np.array([20, 26])
    target = PointTarget(nodes, t, reached.reshape(20, 2, 3), 1e-6)
    flat = prior(SPLINES, t, 1e3, 1e9, 1e3, np.zeros((20, 2)), np.zeros(2))
    fitted = fit(system, [target], SPLINES, 0.0 * true, flat, iterations=30, enough=1e-12)
    assert np.all(np.diff(fitted.objective) < 0.0) and not fitted.converged  # it decreases to 0
    a, b = (SPLINES.basis(t) @ c for c in (fitted.linearised.coefficients, true))
    assert np.abs(a - b).max() <= 1e-3


def test_a_fit_tells_whether_it_converged():
    system, t = block(), 0.01 * np.arange(1, 21)
    density = prior(SPLINES, t, 0.5, 0.3, 2.0, np.zeros((20, 2)), np.zeros(2))
    begin = np.zeros((SPLINES.n, 2))
    fitted = fit(system, targets(system), SPLINES, begin, density, iterations=20)
    assert fitted.converged and len(fitted.objective) < 20
    short = fit(system, targets(system), SPLINES, begin, density, iterations=1)
    assert not short.converged and len(short.objective) == 2


@pytest.mark.parametrize(
    "make", [lambda: block(damping=sim.Rayleigh(19.0, 0.055)), lambda: block(terms=(stiffening,))]
)
def test_what_has_no_derivatives_over_a_trial_is_refused_or_exact(make):
    system, c = make(), 0.5 * course()
    if system.damping_law is not None and system.damping_law.rest is None:
        with pytest.raises(sim.SceneError, match="damping that varies: leave these out"):
            linearise(system, targets(system), SPLINES, c, h=0.02)
        return
    linearised = linearise(system, targets(system), SPLINES, c, h=0.02, decayed=0.0)
    move = np.random.default_rng(1).standard_normal(c.shape)
    ends = [
        linearise(system, targets(system), SPLINES, c + s * move, h=0.02, derivatives=False)
        for s in (1e-4, -1e-4)
    ]
    slope = (ends[1].residual - ends[0].residual) / 2e-4
    assert np.abs(linearised.J @ move.ravel() - slope).max() <= 1e-6 * np.abs(slope).max()
