"""The measurements of the package itself, on small cases."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

import sim
from emgface.bench import cost, scaling, start, work_precision
from emgface.bench.drives import gesture
from emgface.bench.scaling import slope
from emgface.bench.stability import limits, run_battery
from emgface.bench.stability.bodies import SIZE, Block
from emgface.bench.store import KINDS, store
from emgface.bench.work_precision import Model, Setting, pareto
from emgface.bench.work_precision.errors import errors, other_person
from emgface.bench.work_precision.models import finest
from emgface.bench.work_precision.table import requested_and_achieved
from emgface.cli import app
from emgface.errors import ConfigurationError, DataError
from emgface.face.simulation_parameters import SimulationParameters
from emgface.face.template import template_face


@pytest.fixture(scope="module")
def face():
    return template_face(resolution="coarse")


@pytest.fixture(scope="module")
def measured(face):
    settings = [
        # steps of at most an output, since longer ones end at outputs where the activation bends
        Setting("Euler", "10 ms", sim.ConvergedEuler(), sim.HalvingStep(0.01)),
        Setting("Euler", "5 ms", sim.ConvergedEuler(), sim.HalvingStep(0.005)),
        Setting("SDIRK2", "10 ms", sim.Sdirk2(), sim.HalvingStep(0.01)),
        Setting("stubborn", "10 ms", sim.ConvergedEuler(max_iterations=1), sim.FixedStep(0.01)),
        Setting("SDIRK2", "20 ms", sim.Sdirk2(), sim.HalvingStep(0.02), Model(0, "element")),
        Setting("control", "0.5 mm", sim.Sdirk2(), sim.ErrorControlledStep(5e-4, 0.02)),
    ]
    return work_precision.measure(
        face,
        SimulationParameters(gravity=False, sigma_max=100e3),
        settings=settings,
        instructions=("D",),
        duration=0.04,
        repeats=1,
    )


def test_errors_fall_with_step_and_order_and_failures_are_named(measured):
    euler10, euler5, sdirk10, failed = measured["error_max"].values[:4, 0]
    assert euler5 < 0.8 * euler10
    assert sdirk10 < 0.4 * euler10
    assert np.isnan(failed)
    assert measured["status"].values[3, 0] == "NotConverged"
    assert not measured["pareto"].values[3]
    assert (measured["run_time"].values[:3] > 0.0).all()
    euler10, euler5, sdirk10 = measured["change_rho"].values[:3, 0]
    assert 0.0 < sdirk10 < euler5 < euler10 < 0.5
    found = work_precision.pareto(measured)
    assert found[4], "another model is no rival"


def test_error_control_is_tabled_per_instruction(measured):
    table = requested_and_achieved(measured)
    assert table["requested mm"].tolist() == [0.5]
    assert 0.0 < table["achieved / requested"][0] <= 1.0
    assert table["instruction"].tolist() == ["D"]


def test_models_are_compared_with_the_finest(measured):
    assert measured.attrs["finest"] == "element"
    pointwise, element = measured["difference_max"].values[:, 0]
    assert element == measured["difference_rho"].values[1, 0] == 0.0
    assert 1e-6 < pointwise < 1e-3
    assert measured["difference_rms"].values[0, 0] < pointwise
    models = [Model(1, "pointwise"), Model(0, "nodal"), Model(1, "hard"), Model(1, "element")]
    assert finest(tuple(models)) == models[-1]
    assert [Model.named(m.name) for m in models] == models
    for wrong in ("nodl", "coarse:nodal", "refined"):
        with pytest.raises(ConfigurationError, match="model"):
            Model.named(wrong)


def test_errors_are_those_of_positions_and_of_scores():
    time, rng = np.linspace(0.0, 0.4, 41), np.random.default_rng(2)
    wave = np.sin(2 * np.pi * time / 0.4) * rng.normal(size=(2, 3, 1)) * 1e-3
    coords = {"marker": ["a", "b"], "axis": list("xyz"), "time": time}

    def motion(values):
        position = xr.DataArray(values, coords, ("marker", "axis", "time"), attrs={"units": "m"})
        return xr.Dataset({"position": position})

    other = motion(np.roll(wave, 4, axis=2))
    shifted = errors(motion(wave + 1e-3), motion(wave), other)
    assert shifted.rms == pytest.approx(np.sqrt(3.0) * 1e-3, rel=1e-9)
    assert shifted.largest == pytest.approx(np.sqrt(3.0) * 1e-3, rel=1e-9)
    assert shifted.rho == pytest.approx(0.0, abs=1e-9)  # rho does not see where a marker is
    late = errors(motion(np.roll(wave, 1, axis=2)), motion(wave), other)
    # of the angle between two waves: one step later is one step nearer to the other
    assert late.rho == pytest.approx(
        np.cos(3 * 2 * np.pi / 41) - np.cos(4 * 2 * np.pi / 41), abs=0.02
    )


def test_the_stand_in_for_a_measurement_is_another_motion():
    drive = other_person("D", ("ZYG_L", "RIS_L"), 0.4)
    own = gesture("D", ("ZYG_L", "RIS_L"), 0.4)
    np.testing.assert_array_equal(drive.values[:3], 0.0)
    np.testing.assert_allclose(drive.values[3:, 0], 1.3 * own.values[:-3, 0], atol=1e-15)
    np.testing.assert_allclose(drive.values[3:, 1], 0.7 * own.values[:-3, 1], atol=1e-15)


def test_pareto_marks_what_no_other_beats():
    found = xr.Dataset(
        {
            "run_time": (("setting", "instruction"), [[1.0], [2.0], [2.0], [3.0], [0.5], [2.1]]),
            "error_max": (("setting", "instruction"), [[4.0], [2.0], [3.0], [2.0], [0.1], [1.99]]),
            "status": (("setting", "instruction"), [["ok"]] * 4 + [["NotConverged"], ["ok"]]),
        },
        coords={"model_of": ("setting", ["pointwise"] * 6)},
    )
    np.testing.assert_array_equal(pareto(found), [True, True, False, False, False, False])


def test_growth_of_a_power_law_is_found():
    elements = np.array([100.0, 1000.0, 5000.0])
    assert slope(elements, 3e-4 * elements**1.7) == pytest.approx(1.7, abs=1e-12)
    assert np.isnan(slope(elements, np.full(3, np.nan)))


def test_the_battery_has_no_wrong_answers_and_converged_solvers_survive(face):
    found = run_battery(rows=(4, 5, 10))
    outcome = found["outcome"].values.astype(str)
    assert not np.char.startswith(outcome, "WRONG").any()
    converged = np.isin(found["integrator"].values.astype(str), ["Euler", "trapezoidal", "SDIRK2"])
    jumps = converged & (found["row"].values == 4)
    assert jumps.sum() == 12
    assert (outcome[jumps] == "ok").all()
    single = ~converged & (found["row"].values == 4)
    assert (outcome[single] == "refused: InvertedElement").any()  # as the published scheme did
    assert (found["smallest_J"].values[outcome == "ok"] > 0.0).all()
    table = limits(found).set_index("parameter")
    jump = table.loc["sigma_max [kPa], block"]
    assert jump["swept"] == "100 ... 1000"
    assert jump["SDIRK2"] == jump["static"] == "all"
    assert jump["linearly implicit Euler"] == "100 (InvertedElement)"
    assert jump["RK4"] == ""
    # a refusal that is the right answer is no limit
    assert table.loc["noise of the start [edges]", "Euler"] == "all"


def test_a_sliver_has_the_scaled_jacobian_that_its_name_says():
    for wanted in (0.1, 0.007, 1e-5):
        X = Block(corner=wanted).mesh().X.reshape(4, 4, 4, 3)
        corner = X[1, 1, 1]
        edges = np.stack([X[1, 1, 0], X[1, 0, 1], X[0, 1, 1]]) - corner
        unit = edges / np.linalg.norm(edges, axis=1)[:, None]
        assert abs(np.linalg.det(unit)) == pytest.approx(wanted, rel=1e-6)
        assert corner.sum() > 2.0 * SIZE / 3.0  # still on its own side


def started():
    return xr.Dataset(
        {
            "seconds": (("volume", "phase"), [[1.0, 0.5, 0.2, 0.1]], {"units": "s"}),
            "peak": ("volume", [4e8], {"units": "B"}),
            "import_time": ("module", [0.5], {"units": "s"}),
        },
        {"volume": ["pointwise"], "phase": list(start.PHASES), "module": ["sim"]},
        {"origin": "simulated"},
    )


def test_what_is_measured_is_stored_with_table_and_figure(measured, face, tmp_path):
    small = scaling.measure([face], SimulationParameters(gravity=False), refine=False, repeats=1)
    battery = run_battery(rows=(5,))
    parts = cost.measure(face, rounds=2, only=("tissue alone", "+ element volume"))
    made = dict(
        zip(
            ("work-precision", "stability", "cost", "scaling", "start"),
            (measured, battery, parts, small, started()),
            strict=True,
        )
    )
    assert set(made) == set(KINDS) - {"contact"}  # stored in its own test
    for kind, found in made.items():
        table, paths = store(kind, found, tmp_path)
        assert len(table) > 0
        assert all(path.stat().st_size > 0 for path in paths)
        again = xr.open_dataset(paths[0])
        assert again.attrs["origin"] == "simulated"
        assert set(again.data_vars) == set(found.data_vars)
        again.close()
        assert all("simulated" in p.read_text() for p in paths if p.suffix == ".svg")


def test_every_scene_of_the_cost_table_has_the_part_that_it_names(face):
    made = cost.scenes(face)
    counts = {name: len(scene.terms) for name, (scene, _) in made.items()}
    alone = counts["tissue alone"]
    assert counts["the same again"] == counts["+ muscles, active, stiffening 1 (off)"] == alone
    for name in ("+ gravity", "+ element volume", "+ nodal volume", "+ line muscles, active"):
        assert counts[name] == alone + 1, name
    assert made["+ hard volume"][0].constraints
    assert not any(scene.constraints for name, (scene, _) in made.items() if "hard" not in name)
    damped = [name for name, (scene, _) in made.items() if scene.damping is not None]
    assert damped == ["+ damping, current", "+ damping, at rest"]


def test_the_command_writes_its_files(tmp_path):
    result = CliRunner().invoke(app, ["bench", "stability", "--row", "10", "--out", str(tmp_path)])
    assert result.exit_code == 0, result.output
    assert {p.name for p in tmp_path.iterdir()} == {
        f"stability{ending}" for ending in (".nc", ".csv", ".svg", ".png")
    }


def test_a_fresh_process_tells_its_phases_and_its_memory():
    seconds, peak = start.first_result(None, "pointwise")
    assert list(seconds) == list(start.PHASES)
    assert min(seconds.values()) > 0.0
    assert 1e8 < peak < 1e9  # an interpreter with numba needs a tenth of a gigabyte
    with pytest.raises(DataError, match="fresh process failed: .*nowhere"):
        start.first_result(Path("nowhere.nc"), "pointwise")
