"""Accuracy specified by a preset or by an error; motions with every solver."""

import numpy as np
import pytest
import xarray as xr

from emgface.choices import configure
from emgface.errors import ConfigurationError
from emgface.face.accuracy import ACCURACY_PRESETS
from emgface.face.integration import INTEGRATORS, integrator_of
from emgface.face.motion import simulate_face
from emgface.face.sigma_max import lower_sigma_max
from emgface.face.simulation_parameters import SimulationParameters
from sim import Sdirk2

FREE = {"contact": {"method": "none"}}
"""Parameters without contact, for which every solver may be chosen."""


@pytest.fixture(scope="module")
def face(coarse: xr.Dataset) -> xr.Dataset:
    return coarse


def activation(face, duration=0.08):
    time = np.linspace(0.0, duration, 9)
    values = np.zeros((face.sizes["muscle"], 9))
    for side in "LR":
        values[list(face["muscle"].values).index(f"ZYG_{side}")] = 0.5 * time / duration
    coords = {"muscle": face["muscle"].values, "time": time}
    return xr.DataArray(values, dims=("muscle", "time"), coords=coords)


def test_a_preset_sets_parameters_that_are_not_given():
    chosen = configure(SimulationParameters, FREE | {"accuracy": "reference"})
    assert (chosen.solver, chosen.step) == ("sdirk2", ACCURACY_PRESETS["reference"]["step"])
    assert configure(SimulationParameters, {"accuracy": "draft", "step": 0.005}).step == 0.005
    again = SimulationParameters.model_validate(chosen.model_dump())
    assert again == chosen


def test_the_accuracy_of_given_parameters_is_changed():
    given = SimulationParameters(**FREE, solver="linearly_implicit", step=0.002, sigma_max=80e3)
    chosen = given.as_accurate("draft")
    assert (chosen.solver, chosen.step, chosen.sigma_max) == (
        "sdirk2",
        ACCURACY_PRESETS["draft"]["step"],
        80e3,
    )
    assert given.as_accurate("1 mm").error_tolerance == 1e-3


def test_accuracy_is_that_of_a_study_by_default():
    plain = SimulationParameters(**FREE)
    values = plain.model_dump()
    assert {name: values[name] for name in ACCURACY_PRESETS["study"]} == ACCURACY_PRESETS["study"]
    iterated = integrator_of(plain)
    assert isinstance(iterated, Sdirk2) and iterated.tolerance == 5e-6
    published = configure(SimulationParameters, {"accuracy": "published"})
    assert (published.solver, published.step) == ("linearly_implicit", 0.01)
    assert published.error_tolerance is None
    assert integrator_of(published) == INTEGRATORS["linearly_implicit"]


@pytest.mark.parametrize("method", ["none", "constraint"])
def test_contact_changes_neither_solver_nor_step(method):
    given = configure(SimulationParameters, {"contact": {"method": method}})
    assert (given.solver, given.step, given.error_tolerance) == ("sdirk2", 0.01, 1e-4)
    assert given.as_accurate("draft").solver == "sdirk2"
    assert SimulationParameters.model_validate(given.model_dump()) == given


def test_a_specified_solver_has_no_error_control_by_default():
    assert SimulationParameters(**FREE, solver="sdirk2", step=0.005).error_tolerance is None
    assert SimulationParameters(step=0.005).error_tolerance == 1e-4
    own = configure(SimulationParameters, {"accuracy": "study", "solver": "linearly_implicit"})
    assert own.error_tolerance is None
    again = SimulationParameters.model_validate(own.model_dump())
    assert again == own


def test_outputs_do_not_depend_on_the_accuracy(face):
    base = FREE | {"gravity": False, "sigma_max": 30e3}
    times = [
        simulate_face(
            face, activation(face, 0.07), configure(SimulationParameters, base | {"accuracy": name})
        )["time"].values
        for name in ("draft", "study", "reference", "published", "0.1 mm")
    ]
    for instants in times:
        np.testing.assert_allclose(instants, 0.01 * np.arange(8), atol=1e-15)


def test_steps_and_outputs_must_be_compatible():
    with pytest.raises(ConfigurationError, match="step = 0.004 s and output = 0.01 s"):
        configure(SimulationParameters, {"step": 0.004})


def test_a_requested_error_is_read_with_its_unit():
    assert configure(SimulationParameters, {"accuracy": "0.1 mm"}).error_tolerance == 1e-4
    assert configure(SimulationParameters, {"accuracy": "50 um"}).error_tolerance == 5e-5


@pytest.mark.parametrize("wrong", ["excellent", "0.1", "0 mm", "-1 mm", "1 s", "a mm"])
def test_other_accuracies_are_refused(wrong):
    with pytest.raises(ConfigurationError, match="accuracy"):
        configure(SimulationParameters, {"accuracy": wrong})


def test_error_control_of_a_linearly_implicit_scheme_is_refused():
    with pytest.raises(ConfigurationError, match="error control"):
        configure(SimulationParameters, {"solver": "linearly_implicit", "error_tolerance": 1e-4})


@pytest.mark.slow
def test_every_solver_gives_a_similar_motion_of_the_face(face):
    base = FREE | {"gravity": False, "sigma_max": 100e3}

    def corner(values):
        parameters = configure(SimulationParameters, base | values)
        run = simulate_face(face, activation(face), parameters)
        return run["position"].sel(marker="corner_left").isel(time=-1).values

    fine = corner({"accuracy": "reference"})
    moved = np.linalg.norm(fine - corner({"sigma_max": 30e3, "accuracy": "reference"}))
    for solver in INTEGRATORS:
        assert np.linalg.norm(corner({"solver": solver}) - fine) < 0.3 * moved, solver
    assert np.linalg.norm(corner({"accuracy": "0.01 mm"}) - fine) < 1e-5
    hard = corner({"solver": "sdirk2", "incompressibility": "hard"})
    assert 0.0 < np.linalg.norm(hard - fine) < moved


def test_the_estimated_error_of_a_motion_is_near_the_true_one(face):
    def run(values):
        base = FREE | {"gravity": False, "sigma_max": 100e3}
        drive = activation(face, 0.16)
        return simulate_face(face, drive, configure(SimulationParameters, base | values))

    fine = run({"solver": "sdirk2", "step": 0.00125})
    for solver, low, high in (
        ("converged", 0.8, 3.0),
        ("linearly_implicit", 0.8, 3.0),
        ("sdirk2", 0.8, 6.0),
    ):
        coarse = run({"solver": solver, "step": 0.02})
        there = fine["position"].sel(time=coarse["time"], method="nearest")
        gap = (coarse["position"] - there.assign_coords(time=coarse["time"])) ** 2
        true = float(np.sqrt(gap.sum("axis")).max())
        assert low < coarse.attrs["numerical_error"] / true < high, solver
    none = run({"solver": "linearly_implicit_trapezoidal", "step": 0.02})
    assert "numerical_error" not in none.attrs
    assert none["numerical_error"].isnull().any()


def drive_of(face, time, values, group):
    """One course of activation for all muscles whose names begin with the group."""
    rows = [values if str(m).startswith(group) else 0.0 * values for m in face["muscle"].values]
    coords = {"muscle": face["muscle"].values, "time": time}
    return xr.DataArray(np.array(rows), dims=("muscle", "time"), coords=coords)


def distance(run, fine):
    """Largest distance of a marker at the instants of a run [m]."""
    there = fine["position"].sel(time=run["time"], method="nearest")
    gap = run["position"] - there.assign_coords(time=run["time"])
    return float(np.sqrt((gap**2).sum("axis")).max())


FINE = {"solver": "sdirk2", "step": 1e-3, "iteration_tolerance": 1e-6}


def test_muscles_that_are_active_from_the_start_keep_their_strength(face):
    """A jump of the load at the first instant does not lower sigma_max."""
    time = np.linspace(0.0, 0.06, 7)
    drive = drive_of(face, time, np.full(7, 0.3), "")
    base = FREE | {"gravity": False, "sigma_max": "published"}

    def run(values):
        return simulate_face(face, drive, configure(SimulationParameters, base | values))

    parameters = configure(SimulationParameters, base | {"accuracy": "0.1 mm"})
    lowered = lower_sigma_max(lambda p: simulate_face(face, drive, p), parameters)
    assert (lowered.attrs["attempts"], lowered.attrs["sigma_max"]) == (1, 300e3)
    assert lowered.attrs["motion"] > 5e-3
    assert distance(lowered, run(FINE)) < 1e-4
    assert float(lowered["steps"].sum()) < 60


@pytest.mark.parametrize("at", [0.023, 0.025])
def test_a_burst_between_two_steps_moves_the_face(face, at):
    """One sample of 5 ms, which is not at the instants of the steps."""
    time = np.array([0.0, at - 0.005, at, at + 0.005, 0.05])
    drive = drive_of(face, time, np.array([0.0, 0.0, 1.0, 0.0, 0.0]), "OOP")

    def run(values):
        base = FREE | {"gravity": False, "sigma_max": 100e3}
        return simulate_face(face, drive, configure(SimulationParameters, base | values))

    fine = run(FINE)
    motion = fine.attrs["motion"]
    assert motion > 1e-3
    for accuracy in ("study", "0.1 mm"):
        result = run({"accuracy": accuracy})
        assert distance(result, fine) < 1e-4
        assert 0.0 < result.attrs["numerical_error"] < 2e-4
    published = run({"accuracy": "published"})
    assert published.attrs["motion"] == pytest.approx(motion, rel=0.35)
    assert published.attrs["numerical_error"] > 0.5 * distance(published, fine)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["jump", "burst"])
def test_contact_lowers_neither_accuracy_nor_strength(face, name):
    """All muscles from the start, or one burst of 5 ms, with contact of lips and teeth."""
    parameters = configure(SimulationParameters, {"sigma_max": "published"})
    group, values = {"jump": ("", [0.3] * 7), "burst": ("OOP", [0.0, 0, 1, 0, 0, 0, 0])}[name]
    drive = drive_of(face, 0.005 * np.arange(7.0), np.array(values), group)

    def run(parameters):
        return simulate_face(face, drive, parameters)

    lowered = lower_sigma_max(run, parameters)
    assert (lowered.attrs["attempts"], lowered.attrs["sigma_max"]) == (1, 300e3)
    assert lowered.attrs["motion"] > 4e-3
    fine = run(parameters.as_accurate("0.02 mm"))
    assert distance(lowered, fine) < 1.2e-4
    of_contact = lowered.attrs.get("event_error", 0.0)
    assert lowered.attrs["numerical_error"] - of_contact < 1.2e-4
    # both sides alike, although the length of the step varies a thousandfold
    position = lowered["position"].transpose("time", "marker", "axis").values
    rest = position[0] * [-1.0, 1.0, 1.0]
    mirror = np.linalg.norm(rest[:, None] - position[0], axis=2).argmin(axis=1)
    np.testing.assert_allclose(rest, position[0][mirror], rtol=0, atol=1e-9)
    image = position[:, mirror] * [-1.0, 1.0, 1.0]
    np.testing.assert_allclose(image, position, rtol=0, atol=1e-8)
