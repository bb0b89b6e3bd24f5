"""From face model to motion: contents of the scene, initial state and excitation."""

import numpy as np
import pytest
import xarray as xr

from emgface.choices import configure
from emgface.errors import ActivationError, FaceError, UnitsError
from emgface.face.motion import require_rest, settle_face, simulate_face
from emgface.face.recipe import compose_scene, element_order
from emgface.face.simulation_parameters import SimulationParameters
from emgface.muscles import LIP_MARKERS, MUSCLES
from emgface.treatment.pressure import pressure_held
from sim import ControlError, InvertedElement, compile_scene
from sim.errors import NotConverged

PARAMETERS = SimulationParameters(sigma_max=50e3, sigma_max_policy={"minimum": 10e3})


def activation(level: float, *muscles: str, duration: float = 0.2) -> xr.DataArray:
    time = np.linspace(0.0, duration, 21)
    values = np.zeros((len(MUSCLES), time.size))
    for muscle in muscles:
        values[MUSCLES.index(muscle)] = level * np.sin(np.pi * time / duration) ** 2
    return xr.DataArray(
        values, coords={"muscle": list(MUSCLES), "time": time}, dims=("muscle", "time")
    )


@pytest.fixture(scope="module")
def settled(slab: xr.Dataset) -> xr.Dataset:
    return settle_face(slab, PARAMETERS)


def test_the_mass_of_a_scene_is_that_of_its_volume_and_fixed_nodes_are_fixed(slab) -> None:
    system = compile_scene(compose_scene(slab, PARAMETERS))
    assert system.node_mass.sum() == pytest.approx(1040.0 * 0.06 * 0.01 * 0.036, rel=1e-12)
    assert system.pattern.n == 3 * int((slab["fixed"] == 0).sum())
    assert system.muscles == MUSCLES


def test_element_order_puts_hexahedra_first_and_undoes_itself(slab) -> None:
    mixed = slab.copy(deep=True)
    mixed["connectivity"][[0, 3], 6:] = -1
    order = element_order(mixed)
    assert list(order.face_index[-2:]) == [0, 3]
    np.testing.assert_array_equal(order.face_index[order.scene_index], np.arange(120))


def test_the_settled_face_stays_where_it_is_and_hangs_down(slab, settled) -> None:
    still = simulate_face(slab, activation(0.0), PARAMETERS, settled=settled)
    assert float(np.abs(still["position"] - still["position"].isel(time=0)).max()) < 1e-6
    sag = settled["node_position"].values - slab["position"].values
    assert sag[:, 2].min() < -1e-5 and abs(sag[:, 2].min()) > abs(sag[:, 0]).max()
    np.testing.assert_array_equal(sag[slab["fixed"].values > 0], 0.0)


def test_without_gravity_the_geometry_is_the_rest_state(slab) -> None:
    weightless = PARAMETERS.model_copy(update={"gravity": False})
    settled = settle_face(slab, weightless)
    np.testing.assert_array_equal(settled["node_position"].values, slab["position"].values)


def test_an_upper_lip_levator_lifts_the_markers_of_its_side(slab, settled) -> None:
    motion = simulate_face(slab, activation(0.8, "LLSAN_L"), PARAMETERS, settled=settled)
    assert list(motion["marker"].values) == list(LIP_MARKERS)
    moved = (motion["position"] - motion["position"].isel(time=0)).sel(axis="z")
    left = float(moved.sel(marker="upper_paramedian_left").max())
    right = float(moved.sel(marker="upper_paramedian_right").max())
    assert left > 2e-4 and left > 2 * abs(right)
    assert motion.attrs["origin"] == "simulated" and motion.attrs["sigma_max"] == 50e3
    assert float(motion["smallest_J"].min()) > 0.0


def test_mirrored_activation_gives_the_mirrored_motion(slab, settled) -> None:
    # One linear solution per step has no stopping error. Exactly at rest, rounding would determine
    # the tangent of a Blemker fibre; the test therefore uses the passive tangent under gravity.
    direct = PARAMETERS.model_copy(
        update={"solver": "linearly_implicit", "damping_tangent": "passive"}
    )
    left, right = (
        simulate_face(slab, activation(0.5, f"ZYG_{side}"), direct, settled=settled)["position"]
        for side in "LR"
    )
    mirror = [name.replace("left", "*").replace("right", "left").replace("*", "right")
              for name in LIP_MARKERS]  # fmt: skip
    flip = xr.DataArray([-1.0, 1.0, 1.0], coords={"axis": ["x", "y", "z"]}, dims="axis")
    mirrored = (right * flip).sel(marker=mirror)
    # The slab and its initial state are symmetric up to rounding and the remaining velocities.
    np.testing.assert_allclose(left.values, mirrored.transpose(*left.dims).values, atol=1e-7)
    assert float(abs(left - left.isel(time=0)).max()) > 1e-4


def test_the_two_solvers_agree_to_first_order_in_the_step(slab, settled) -> None:
    drive = activation(0.3, "DAO_L", "DAO_R")
    difference = []
    for step in (0.01, 0.005):
        paths = [
            simulate_face(
                slab, drive, PARAMETERS.model_copy(update={"solver": s, "step": step}),
                settled=settled,
            )["position"].sel(time=slice(0.0, 0.2 + 1e-9, round(0.01 / step))).values
            for s in ("converged", "linearly_implicit")
        ]  # fmt: skip
        difference.append(np.abs(paths[0] - paths[1]).max())
    assert difference[1] < 0.7 * difference[0]


@pytest.mark.parametrize("kind", ["pointwise", "element", "nodal"])
def test_a_large_bulk_modulus_keeps_the_volume_whatever_its_pressure_belongs_to(slab, kind) -> None:
    change = {"incompressibility": kind, "bulk_potential": "quadratic", "gravity": False}
    drive = activation(0.5, "OOP_L", "OOP_R")
    spread = []
    for kappa in (5e3, 500e3):
        parameters = PARAMETERS.model_copy(update=change | {"kappa": kappa})
        motion = simulate_face(slab, drive, parameters)
        spread.append(1.0 - float(motion["smallest_J"].min()))
    assert 0.0 < spread[1] < spread[0]


def test_normalised_timing_takes_one_step_per_sample(slab, settled) -> None:
    slow = activation(0.2, "MEN_L", duration=2.0)
    parameters = PARAMETERS.model_copy(update={"timing": "normalised"})
    motion = simulate_face(slab, slow, parameters, settled=settled)
    np.testing.assert_allclose(motion["time"].values, 0.01 * np.arange(21), atol=1e-12)
    recorded = simulate_face(slab, activation(0.2, "MEN_L"), PARAMETERS, settled=settled)
    np.testing.assert_allclose(motion["position"], recorded["position"], atol=1e-12)


@pytest.mark.parametrize(
    ("change", "error", "said"),
    [
        (lambda a: a.isel(muscle=slice(1, None)), ActivationError, "lacks ZYG_L"),
        (lambda a: a.assign_coords(muscle=["XYZ_L", *MUSCLES[1:]]), ActivationError, "lacks ZYG_L"),
        (lambda a: a.isel(time=[0]), ActivationError, "1 sample"),
        (lambda a: a.expand_dims(repetition=2), ActivationError, "dimensions repetition, muscle"),
        (lambda a: a.assign_coords(time=a["time"] / 1e3), ActivationError, "less than one output"),
        (
            lambda a: a.isel(muscle=[0, *range(len(MUSCLES))]),
            ActivationError,
            f"contains {MUSCLES[0]} more than once",
        ),
        (lambda a: a.isel(time=slice(None, None, -1)), ActivationError, "expected ascending"),
        (lambda a: a + 1.5, ControlError, "1.5"),
        (lambda a: a * np.nan, ControlError, "nan"),
        (lambda a: a.assign_attrs(units="%"), UnitsError, "is in '%', expected '1'"),
        (
            lambda a: a.assign_coords(time=(1e3 * a["time"]).assign_attrs(units="ms")),
            UnitsError,
            "is in 'ms', expected 's'",
        ),
        (
            lambda a: a.assign_coords(time=1e4 * a["time"].drop_attrs()),
            ActivationError,
            "states no unit",
        ),
    ],
)
@pytest.mark.parametrize("timing", ["recorded", "normalised"])
def test_an_unusable_activation_is_refused(
    slab, settled, change, error, said: str, timing: str
) -> None:
    given = change(activation(0.2, "MEN_L"))
    if timing == "normalised" and said == "less than one output":
        return  # there an output is a sample
    parameters = PARAMETERS.model_copy(update={"timing": timing})
    with pytest.raises(error, match=said):
        simulate_face(slab, given, parameters, settled=settled)


@pytest.mark.parametrize(
    "start", [np.timedelta64(0, "ns"), np.datetime64("2026-01-05T10:00", "ns")]
)
def test_times_of_durations_and_dates_are_seconds(slab, settled, start) -> None:
    given = activation(0.2, "MEN_L")
    ticks = np.round(1e9 * given["time"].values).astype("timedelta64[ns]")
    dated = given.assign_coords(time=start + ticks)
    motions = [simulate_face(slab, a, PARAMETERS, settled=settled) for a in (given, dated)]
    np.testing.assert_allclose(motions[1]["position"], motions[0]["position"], atol=1e-12)
    np.testing.assert_allclose(motions[1]["time"], motions[0]["time"])
    assert motions[1].attrs["recorded_start"] == 0.0


def test_an_inverted_element_is_named_by_its_id_in_the_face(slab) -> None:
    renamed = slab.assign(element_id=slab["element_id"] + 1000)
    brutal = PARAMETERS.model_copy(
        update={"solver": "linearly_implicit", "sigma_max": 50e6, "step": 0.05, "beta": 0.0}
        | {"error_tolerance": None}
    )
    with pytest.raises(InvertedElement) as caught:
        simulate_face(renamed, activation(1.0, *MUSCLES), brutal)  # from its own equilibrium
    assert 1001 <= caught.value.element <= 1120 and caught.value.det_F <= 0.0


def test_a_face_without_equilibrium_is_reported(slab) -> None:
    soft = PARAMETERS.model_copy(update={"C10": 1e-3, "C20": 0.0, "kappa": 1e-3, "P1": 0.0})
    with pytest.raises((NotConverged, InvertedElement)):
        settle_face(slab, soft)


def test_muscles_as_lines_stiffening_and_skin_are_parts_of_the_scene(slab) -> None:
    p = PARAMETERS.model_copy(update={"gravity": False})

    def terms(**changes) -> list[str]:
        scene = compose_scene(slab, SimulationParameters(**p.model_dump() | changes))
        return [type(term).__name__ for term in scene.terms]

    assert terms() == ["Solid"]
    assert terms(stiffening=10.0) == ["Solid", "Stiffening"]
    assert terms(muscle_form="lines") == ["Solid", "LineMuscles"]
    lines = SimulationParameters(**p.model_dump() | {"muscle_form": "lines"})
    system = compile_scene(compose_scene(slab, lines))
    assert system.muscles == MUSCLES
    X = slab["position"].values
    level = np.zeros(len(MUSCLES))
    level[MUSCLES.index("ZYG_L")] = 0.5
    f = system.force(X, system.control(level)).f
    assert np.abs(f).max() > 0.01 and np.abs(f.sum(axis=0)).max() < 1e-15
    stiff = compose_scene(slab, SimulationParameters(**p.model_dump() | {"skin": {"stiffness": 4}}))
    tissue, skin = stiff.terms[0].materials
    assert skin.law.C10 == 4 * tissue.law.C10 and skin.bulk == tissue.bulk
    outer = stiff.terms[0].region == 1
    np.testing.assert_array_equal(outer, slab["layer"].values[element_order(slab).face_index] == 2)


def test_a_face_with_tense_skin_settles_in_tension(slab) -> None:
    """The slab, held only at its inner rim, is bent by its skin; 'displaced' stretches it."""
    for method, more in (
        ("stretch", {"skin": {"stiffness": 4.0, "kappa": 250e3}}),
        ("displaced", {}),
    ):
        changes = {"gravity": False, "prestress": {"method": method}, **more}
        p = SimulationParameters(**PARAMETERS.model_dump() | changes)
        settled = settle_face(slab, p)
        moved = settled["node_position"].values - slab["position"].values
        np.testing.assert_array_equal(moved[slab["fixed"].values > 0], 0.0)
        assert 1e-4 < np.abs(moved).max() < 0.02
        assert settled.attrs["largest_speed"] < 1e-5


def test_missing_requirements_of_prestress_are_reported() -> None:
    nodal = {"incompressibility": "nodal", "bulk_potential": "quadratic"}
    with pytest.raises(ValueError, match=r"skin.kappa cannot be combined with .* = 'hard'"):
        SimulationParameters(**nodal | {"incompressibility": "hard"}, skin={"kappa": 1e5})
    with pytest.raises(ValueError, match=r"'stretch' cannot be combined with .* = 'nodal'"):
        SimulationParameters(**nodal, prestress={"method": "stretch"})


OTHER = {
    "sigma_max": {"sigma_max": 60e3},
    "gravity": {"gravity": False},
    "contact": {"contact": {"method": "constraint", "friction": 0.3}},
    "C10": {"C10": 2000.0},
    "density": {"density": 1000.0},
    "skin": {"skin": {"stiffness": 2.0}},
    "prestress": {"prestress": {"method": "displaced"}},
    "support": {"support": 1e4},
}


@pytest.mark.parametrize("name", OTHER)
@pytest.mark.parametrize("use", [simulate_face, pressure_held])
def test_an_equilibrium_of_other_parameters_is_refused(slab, settled, name: str, use) -> None:
    other = configure(SimulationParameters, PARAMETERS.model_dump(mode="json") | OTHER[name])
    given = (activation(0.2, "MEN_L"),) if use is simulate_face else ()
    with pytest.raises(FaceError, match=f"the equilibrium was computed with .*{name}"):
        use(slab, *given, other, settled=settled)


def test_an_equilibrium_serves_for_other_steps_and_damping_and_without_statement(
    slab, settled, tmp_path
) -> None:
    for change in (
        {"step": 0.005, "solver": "linearly_implicit", "output": 0.02},
        {"alpha": 1.0, "beta": 0.01, "stiffening": 2.0, "linear_solver": "superlu"},
    ):
        require_rest(settled, slab, PARAMETERS.model_copy(update=change))
    earlier = settled.drop_attrs(deep=False)
    require_rest(earlier, slab, PARAMETERS.model_copy(update={"sigma_max": 1e3}))
    settled.to_netcdf(tmp_path / "rest.nc", engine="netcdf4")
    with xr.open_dataset(tmp_path / "rest.nc", engine="netcdf4") as read:
        require_rest(read, slab, PARAMETERS)
        with pytest.raises(FaceError, match="sigma_max = 50000.0, found sigma_max = 60000.0"):
            require_rest(read, slab, PARAMETERS.model_copy(update={"sigma_max": 60e3}))


def test_without_a_load_the_mesh_is_the_equilibrium_for_any_parameters(slab) -> None:
    weightless = PARAMETERS.model_copy(update={"gravity": False})
    settled = settle_face(slab, weightless)
    require_rest(settled, slab, weightless.model_copy(update={"sigma_max": 1e3}))
    with pytest.raises(FaceError, match="gravity = False.*gravity = True"):
        require_rest(settled, slab, PARAMETERS)
