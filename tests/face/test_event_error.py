"""Error by contact: of the steps, assumed, or the distance from a repetition with other time steps."""

import numpy as np
import pytest
import xarray as xr

from emgface.choices import configure
from emgface.errors import ConfigurationError
from emgface.face.event_error import (
    ASSUMED,
    ASSUMED_SHARE,
    BY_ASSUMPTION,
    BY_REPETITION,
    BY_STEPS,
    CONTACT_FORCE,
    ERRORS,
    ESTIMATE_FACTOR,
    TOUCHING,
    ContactForce,
    contact_share,
    contact_statement,
    event_error,
    in_other_steps,
)
from emgface.face.integration import INTEGRATORS
from emgface.face.motion import simulate_face
from emgface.face.simulation_parameters import SimulationParameters
from emgface.face.stability import stability_warning
from sim import (
    ConstraintContact,
    FixedStep,
    LinearlyImplicitTrapezoidal,
    NodeSurface,
    NotConverged,
    Pairing,
    Positions,
    RestRayleigh,
    State,
    boundary_surface,
    resting,
    simulate,
)
from tests.bodies import grid
from tests.contact.scenes import contact_of, square, system_of


def motion_of(force, moved=0.0):
    """Two markers at four instants, the second moved along y at the third."""
    position = np.zeros((2, 3, 4))
    position[1, 1, 2] = moved
    return xr.Dataset(
        {"position": (("marker", "axis", "time"), position), CONTACT_FORCE: ("time", force)},
        coords={"time": 0.01 * np.arange(4.0)},
        attrs={"run_time_s": 2.0},
    )


def test_errors_of_the_steps_accumulate_and_do_not_fall():
    """The lasting ones decay, and the passing one of a step is added to their sum."""
    motion = motion_of([0.0, 0.2, 0.2, 0.0], moved=0.1)
    lasting, passing = (xr.zeros_like(motion["position"]) for _ in range(2))
    lasting[0, 0, 1], lasting[0, 0, 2], passing[0, 1, 2] = 3e-5, 3e-5, 4e-5
    motion = motion.assign(dict(zip(ERRORS, (lasting, passing), strict=True)))
    event, attributes = event_error(motion, None, 0.02)
    kept = 3e-5 * (1.0 + np.exp(-0.5))
    np.testing.assert_allclose(event / ESTIMATE_FACTOR, [0.0, 3e-5, *2 * [np.hypot(kept, 4e-5)]])
    assert attributes == {"event_error": float(event.max()), "event_error_measured": BY_STEPS}
    unknown = motion.assign({ERRORS[0]: lasting.where(lasting["time"] < 0.02)})
    assert event_error(unknown, None, 0.02)[1]["event_error_measured"] == BY_ASSUMPTION


def test_an_error_is_assumed_from_the_first_contact():
    for without in (motion_of([0.0] * 4), motion_of([0.0] * 4).drop_vars(CONTACT_FORCE)):
        event, attributes = event_error(without, None)
        assert not event.any() and attributes == {}
    far = motion_of([0.0, 0.2, 0.0, 0.0], moved=0.1)
    assumed, attributes = event_error(far, None)
    np.testing.assert_array_equal(assumed, [0.0, 0.0, ASSUMED, ASSUMED])
    assert attributes == {"event_error": ASSUMED, "event_error_measured": 0}
    near, attributes = event_error(motion_of([0.0, 0.2, 0.0, 0.0], moved=1e-3), None)
    np.testing.assert_allclose(near, [0.0, 0.0, 1e-3 * ASSUMED_SHARE, 1e-3 * ASSUMED_SHARE])
    assert attributes["event_error"] == pytest.approx(1e-3 * ASSUMED_SHARE)


def test_a_contact_between_two_outputs_counts():
    """A block falls on a floor, rebounds, and is far from it at every output."""
    mesh = grid((1, 1, 1))
    floor = square(-1e-3)
    block = NodeSurface(boundary_surface(mesh).triangles, "block")
    contact = contact_of(ConstraintContact, (Pairing(block, floor),))
    system = system_of(mesh, contact, damping=RestRayleigh(0.0, 1e-4))
    rest = system.rest_state()
    fast = State(0.0, rest.q, rest.v - [0.0, 0.0, 0.5])
    simulated, _ = simulate(
        system, resting(0), duration=0.06, every=0.03, initial=fast, steps=FixedStep(1e-3),
        integrator=LinearlyImplicitTrapezoidal(), probes=(ContactForce(), Positions()),
    )  # fmt: skip
    assert (simulated[CONTACT_FORCE] == 0.0).all() and (
        simulated["node_position"].sel(axis="z") > -1e-3
    ).all()
    assert float(simulated[TOUCHING].max()) >= 1.0
    far = (simulated["node_position"] * 0.0 + simulated["time"]).rename(node="marker")
    error, attributes = event_error(simulated[[CONTACT_FORCE, TOUCHING]].assign(position=far), None)
    assert float(error.max()) == ASSUMED and attributes["event_error_measured"] == 0


def test_the_error_is_twice_the_largest_distance_from_the_repetition_so_far():
    touching = motion_of([0.0, 0.2, 0.0, 0.0])
    other = motion_of([0.0] * 4, moved=-2e-4)["position"].transpose("time", "axis", "marker")
    repeated = xr.Dataset({"position": other}, attrs={"run_time_s": 3.0})
    event, attributes = event_error(touching, lambda: repeated)
    np.testing.assert_allclose(event, [0.0, 0.0, 4e-4, 4e-4], rtol=1e-12)
    assert attributes["event_error_measured"] == 1 and touching.attrs["run_time_s"] == 5.0


def test_a_repetition_that_fails_loses_no_motion_and_is_reported():
    def fails() -> xr.Dataset:
        raise NotConverged((), 0.02, "no")

    touching = motion_of([0.0, 0.2, 0.0, 0.0], moved=0.1)
    event, attributes = event_error(touching, fails)
    assert event.max() == ASSUMED and attributes["event_error_measured"] == 0
    moved = touching.assign_attrs(attributes)
    assert "failed (NotConverged" in stability_warning(moved)
    assert "assumed" in contact_share(moved) and "--check-contact" not in contact_share(moved)
    assert event_error(motion_of([0.0] * 4), fails)[1] == {}, "without contact it is not repeated"


@pytest.mark.parametrize("given", [{}, {"step": 0.02, "output": 0.01}, {"solver": "converged"}])
def test_the_repetition_takes_other_steps(given):
    parameters = configure(SimulationParameters, given)
    other = in_other_steps(parameters)
    assert other.step == 0.005
    if parameters.error_tolerance is None:
        assert other.error_tolerance is None
    else:
        assert other.error_tolerance is not None
        assert other.error_tolerance > 2.0 * parameters.error_tolerance
        tolerances = {"error_tolerance", "iteration_tolerance"}
        draft = configure(SimulationParameters, {"accuracy": "draft", "step": 0.005})
        assert other.model_dump(include=tolerances) == draft.model_dump(include=tolerances)
    assert SimulationParameters.model_validate(other.model_dump()) == other


def pursing(face, duration=0.02):
    time = np.array([0.0, duration])
    rows = [[0.0, 1.0] if str(m).startswith("OO") else [0.0, 0.0] for m in face["muscle"].values]
    coords = {"muscle": face["muscle"].values, "time": time}
    return xr.DataArray(np.array(rows), dims=("muscle", "time"), coords=coords)


def test_the_estimated_error_of_a_motion_with_contact_contains_its_events(coarse):
    drive, base = pursing(coarse), {"gravity": False, "sigma_max": 100e3, "accuracy": "draft"}

    def run(**values):
        return simulate_face(coarse, drive, configure(SimulationParameters, base | values))

    own = run()
    share = own.attrs["event_error"]
    assert 0.0 < share < ASSUMED_SHARE * own.attrs["motion"]
    assert own.attrs["event_error_measured"] == BY_STEPS
    assert share < own.attrs["numerical_error"] < 3.0 * ASSUMED
    assert f"{1e3 * share:.2g} mm is for contact" in contact_share(own)
    assert "--check-contact" in contact_share(own)

    checked = run(check_contact=True)
    np.testing.assert_array_equal(checked["position"], own["position"])
    assert checked.attrs["event_error_measured"] == BY_REPETITION
    assert 1e-8 < checked.attrs["event_error"] < ASSUMED
    assert checked.attrs["numerical_error"] > checked.attrs["event_error"]
    assert "twice the distance from the repetition" in contact_share(checked)
    assert CONTACT_FORCE not in checked


@pytest.mark.parametrize("solver", sorted(INTEGRATORS))
def test_methods_say_how_each_solver_finds_the_error_of_contact(coarse, solver):
    """Every solver that supports contact does what the methods of a manuscript say."""
    values = {
        "gravity": False,
        "sigma_max": 100e3,
        "solver": solver,
        "error_tolerance": None,
        "step": 5e-3,
    }
    try:
        parameters = configure(SimulationParameters, values)
    except ConfigurationError:
        assert solver == "trapezoidal"
        return
    statement = contact_statement(solver, repeated=False)
    motion = simulate_face(coarse, 0.3 * pursing(coarse), parameters)
    kind = motion.attrs["event_error_measured"]
    assert kind == (BY_STEPS if "within each step" in statement else BY_ASSUMPTION)
    assert "repeated" in contact_statement(solver, repeated=True)
