"""An interrupted inversion continues from its last iteration; states of other inputs are ignored."""

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

import sim
from emgface.inverse.assumptions import Assumptions
from emgface.inverse.kept import Kept
from emgface.inverse.parameters import InverseParameters
from emgface.inverse.problem import Problem
from emgface.inverse.refine import model_error
from emgface.inverse.run import fitted
from sim.inverse import Linearised, PointTarget, Splines, linearise
from tests.inverse.test_response import block

H, NODES = 0.02, np.array([20, 26])
PARAMETERS = InverseParameters(iterations=12, assumed=Assumptions(spacing=0.05))


@pytest.fixture(scope="module")
def problem() -> Problem:
    """Two nodes of a block that moved by a known course, with noise."""
    system = block()
    splines = Splines(0.2, 0.05)
    rest = system.mesh.X[NODES]
    still = PointTarget(NODES, np.zeros(1), rest[None], 1e-3)
    true = np.random.default_rng(0).uniform(0.1, 0.5, (splines.n, 2))
    x = linearise(system, [still], splines, true, h=H, derivatives=False).residual.reshape(-1, 2, 3)
    x = rest - 1e-3 * np.concatenate([np.zeros((1, 2, 3)), x])
    x = x + 1e-5 * np.random.default_rng(1).standard_normal(x.shape)
    target = PointTarget(NODES, H * np.arange(11), x, 1e-3)
    work = sim.Workspace(system)
    return Problem(
        system, system.rest_state(), work, target, 0.0, H, xr.Dataset(), 1.0, 1e-5, "face"
    )


class Stop(Exception):
    """An interruption."""


def run(problem, kept, until=99, draws=0):
    """Result of a fit and the iterations that it reported; it is interrupted after `until`."""
    done = []

    def progress(k, n):
        done.append(k)
        if k >= until:
            raise Stop

    density = PARAMETERS.assumed.density(np.zeros((10, 2)), np.zeros(2), H)
    return fitted(problem, PARAMETERS, density, kept=kept, progress=progress, draws=draws), done


def test_an_interrupted_fit_goes_on_with_the_same_result(problem, tmp_path):
    whole, _ = run(problem, None)
    kept = Kept.for_result(tmp_path / "activation.nc")
    for until in (2, 4):  # before and after the error of the model is estimated
        with pytest.raises(Stop):
            run(problem, kept, until)
    resumed, done = run(problem, kept)
    assert done[0] >= 4
    assert np.abs(resumed.activation - whole.activation).max() <= 1e-10
    assert resumed.model_error == pytest.approx(whole.model_error, rel=1e-9)
    kept.remove()
    assert list(tmp_path.iterdir()) == []


def test_states_of_other_inputs_and_damaged_files_are_ignored(problem, tmp_path):
    kept = Kept.for_result(tmp_path / "activation.nc")
    with pytest.raises(Stop):
        run(problem, kept, 1)
    _, done = run(replace(problem, inputs="another face"), kept, draws=0)
    assert done[0] == 0
    kept.path.write_bytes(kept.path.read_bytes()[:100])
    _, done = run(problem, kept)
    assert done[0] == 0


def test_the_error_of_the_face_is_the_misfit_beyond_the_noise(problem):
    target = PointTarget(NODES, H * np.arange(11), problem.target.position, 1e-3)
    rest = problem.state.q[NODES]
    moved = np.sqrt(np.mean((target.position - rest) ** 2))
    residual = np.random.default_rng(2).choice([-1.0, 1.0], (10, 6)) * 5e-4 / target.size
    residual[3, 2] = np.nan  # a lost marker
    one = Linearised(np.zeros((5, 2)), residual, np.zeros((10, 6, 0)), problem.state)
    assert model_error(one, target, rest, 3e-4) == pytest.approx(4e-4 / moved)
    assert model_error(one, target, rest, 6e-4) == 0.0


def test_unequal_strengths_widen_the_intervals_of_active_muscles(problem):
    widths = []
    for strength in (0.0, 0.5):
        p = replace(PARAMETERS, assumed=Assumptions(0.05, 0.01, strength))
        density = p.assumed.density(np.zeros((10, 2)), np.zeros(2), H)
        estimate = fitted(problem, p, density, draws=256)
        assert estimate.model_error == 0.01
        assert np.all(
            (estimate.low <= estimate.activation) & (estimate.activation <= estimate.high)
        )
        widths.append((estimate.high - estimate.low).max())
    a = estimate.activation.max()
    assert widths[1] > widths[0] and widths[1] > 0.8 * 2.0 * 1.645 * 0.5 * a
