"""The measurements of the package itself, on small cases."""

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

import sim
from emgface.bench import cost, scaling, work_precision
from emgface.bench.scaling import slope
from emgface.bench.stability import run_battery
from emgface.bench.store import KINDS, store
from emgface.bench.work_precision import Setting, pareto
from emgface.cli import app
from emgface.face.simulation_parameters import SimulationParameters
from emgface.face.template import template_face


@pytest.fixture(scope="module")
def face():
    return template_face(resolution="coarse")


@pytest.fixture(scope="module")
def measured(face):
    settings = [
        Setting("Euler", "20 ms", sim.ConvergedEuler(), sim.HalvingStep(0.02)),
        Setting("Euler", "10 ms", sim.ConvergedEuler(), sim.HalvingStep(0.01)),
        Setting("SDIRK2", "20 ms", sim.Sdirk2(), sim.HalvingStep(0.02)),
        Setting("stubborn", "10 ms", sim.ConvergedEuler(max_iterations=1), sim.FixedStep(0.01)),
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
    euler20, euler10, sdirk20, failed = measured["error_max"].values[:, 0]
    assert euler10 < 0.8 * euler20
    assert sdirk20 < 0.4 * euler20
    assert np.isnan(failed)
    assert measured["status"].values[3, 0] == "NotConverged"
    assert not measured["pareto"].values[3]
    assert (measured["run_time"].values[:3] > 0.0).all()


def test_pareto_marks_what_no_other_beats():
    found = xr.Dataset(
        {
            "run_time": (("setting", "instruction"), [[1.0], [2.0], [2.0], [3.0], [0.5]]),
            "error_max": (("setting", "instruction"), [[4.0], [2.0], [3.0], [2.0], [0.1]]),
            "status": (("setting", "instruction"), [["ok"]] * 4 + [["NotConverged"]]),
        },
        coords={"volume": ("setting", ["pointwise"] * 5)},
    )
    np.testing.assert_array_equal(pareto(found), [True, True, False, False, False])


def test_growth_of_a_power_law_is_found():
    elements = np.array([100.0, 1000.0, 5000.0])
    assert slope(elements, 3e-4 * elements**1.7) == pytest.approx(1.7, abs=1e-12)
    assert np.isnan(slope(elements, np.full(3, np.nan)))


def test_the_battery_has_no_wrong_answers_and_converged_solvers_survive(face):
    found = run_battery(rows=(4, 5, 8, 10))
    outcome = found["outcome"].values.astype(str)
    assert not np.char.startswith(outcome, "WRONG").any()
    converged = np.isin(found["integrator"].values.astype(str), ["Euler", "trapezoidal", "SDIRK2"])
    jumps = converged & (found["row"].values == 4)
    assert jumps.sum() == 12
    assert (outcome[jumps] == "ok").all()
    single = ~converged & (found["row"].values == 4)
    assert (outcome[single] == "refused: InvertedElement").any()  # as the published scheme did
    assert (found["smallest_J"].values[outcome == "ok"] > 0.0).all()


def test_what_is_measured_is_stored_with_table_and_figure(measured, face, tmp_path):
    small = scaling.measure([face], SimulationParameters(gravity=False), refine=False, repeats=1)
    battery = run_battery(rows=(5, 10))
    parts = cost.measure(face, rounds=2, only=("tissue alone", "+ element volume"))
    made = dict(
        zip(
            ("work-precision", "stability", "cost", "scaling"),
            (measured, battery, parts, small),
            strict=True,
        )
    )
    assert set(made) == set(KINDS)
    for kind, found in made.items():
        table, paths = store(kind, found, tmp_path)
        assert len(table) > 0
        assert all(path.stat().st_size > 0 for path in paths)
        again = xr.open_dataset(paths[0])
        assert again.attrs["origin"] == "simulated"
        assert set(again.data_vars) == set(found.data_vars)
        again.close()
        assert "simulated" in paths[2].read_text()


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
