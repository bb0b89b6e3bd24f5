"""Measurements of the package on small cases."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import sim
from benchmarks import scaling, start
from benchmarks.__main__ import measurements, run
from benchmarks.drives import gesture
from benchmarks.report import finish, markdown
from benchmarks.scaling import slope
from benchmarks.stability import limits, run_battery
from benchmarks.stability.bodies import SIZE, Block
from benchmarks.work_precision.errors import errors, other_person
from benchmarks.work_precision.measure import TIME, Measured, measure, worst
from benchmarks.work_precision.models import Model, finest
from benchmarks.work_precision.settings import Setting
from emgface.errors import ConfigurationError, DataError
from emgface.face.contact_parameters import NO_CONTACT
from emgface.face.simulation_parameters import SimulationParameters


@pytest.fixture(scope="module")
def measured(coarse) -> Measured:
    settings = [
        # Longer steps end at outputs at which the activation changes its slope.
        Setting("Euler", "10 ms", sim.ConvergedEuler(), sim.HalvingStep(0.01)),
        Setting("Euler", "5 ms", sim.ConvergedEuler(), sim.HalvingStep(0.005)),
        Setting("SDIRK2", "10 ms", sim.Sdirk2(), sim.HalvingStep(0.01)),
        Setting("stubborn", "10 ms", sim.ConvergedEuler(max_iterations=1), sim.FixedStep(0.01)),
        Setting("SDIRK2", "20 ms", sim.Sdirk2(), sim.HalvingStep(0.02), Model(0, "element")),
        Setting("control", "0.5 mm", sim.Sdirk2(), sim.ErrorControlledStep(5e-4, 0.02)),
    ]
    return measure(
        coarse,
        SimulationParameters(gravity=False, sigma_max=100e3, contact=NO_CONTACT),
        settings=settings,
        instructions=("D",),
        duration=0.04,
        repeats=1,
    )


def test_errors_fall_with_step_and_order_and_failures_are_named(measured):
    table = worst(measured.stepping)
    euler10, euler5, sdirk10, failed = table["error max mm"][:4]
    assert euler5 < 0.8 * euler10
    assert sdirk10 < 0.4 * euler10
    assert np.isnan(failed)
    assert table["status"][3] == "NotConverged" and not table["Pareto"][3]
    assert (table[TIME][:3] > 0.0).all()
    euler10, euler5, sdirk10 = table["change of rho"][:3]
    assert 0.0 < sdirk10 < euler5 < euler10 < 0.5
    assert table["Pareto"][table["model"] == "element"].all(), "Pareto sets are those of one model"


def test_error_control_reports_requested_and_achieved_errors(measured):
    controlled = measured.stepping.dropna(subset="requested mm")
    assert controlled["requested mm"].tolist() == [0.5]
    assert controlled["instruction"].tolist() == ["D"]
    assert 0.0 < controlled["error max mm"].item() <= 0.5


def test_models_are_compared_with_the_finest(measured):
    assert measured.finest == "element"
    table = measured.models.set_index("model")
    pointwise, element = table["error max mm"][["pointwise", "element"]]
    assert element == table["change of rho"]["element"] == 0.0
    assert 1e-3 < pointwise < 1.0
    assert table["error rms mm"]["pointwise"] < pointwise
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
    assert shifted["error rms mm"] == pytest.approx(np.sqrt(3.0), rel=1e-9)
    assert shifted["error max mm"] == pytest.approx(np.sqrt(3.0), rel=1e-9)
    assert shifted["change of rho"] == pytest.approx(
        0.0, abs=1e-9
    )  # rho does not depend on the position of a marker
    late = errors(motion(np.roll(wave, 1, axis=2)), motion(wave), other)
    # the phase difference of two waves decreases by one step per step
    assert late["change of rho"] == pytest.approx(
        np.cos(3 * 2 * np.pi / 41) - np.cos(4 * 2 * np.pi / 41), abs=0.02
    )


def test_the_substitute_of_a_measurement_is_another_motion():
    drive = other_person("D", ("ZYG_L", "RIS_L"), 0.4)
    own = gesture("D", ("ZYG_L", "RIS_L"), 0.4)
    np.testing.assert_array_equal(drive.values[:3], 0.0)
    np.testing.assert_allclose(drive.values[3:, 0], 1.3 * own.values[:-3, 0], atol=1e-15)
    np.testing.assert_allclose(drive.values[3:, 1], 0.7 * own.values[:-3, 1], atol=1e-15)


def test_pareto_marks_undominated_points():
    time, error = [1.0, 2.0, 2.0, 3.0, 0.5, 2.1], [4.0, 2.0, 3.0, 2.0, 0.1, 1.99]
    table = pd.DataFrame({TIME: time, "error max mm": error, "error rms mm": error})
    table = table.assign(
        model="pointwise", family="Euler", setting=list("abcdef"), instruction="A", status="ok",
        **dict.fromkeys(
            ("change of rho", "steps", "rejected", "iterations", "factorisations", "smallest J"), 1.0
        ),
    )  # fmt: skip
    table.loc[4, "status"] = "NotConverged"
    assert worst(table)["Pareto"].tolist() == [True, True, False, False, False, False]


def test_growth_of_a_power_law_is_found():
    elements = np.array([100.0, 1000.0, 5000.0])
    assert slope(elements, 3e-4 * elements**1.7) == pytest.approx(1.7, abs=1e-12)
    assert np.isnan(slope(elements, np.full(3, np.nan)))


def test_the_battery_has_no_wrong_answers_and_converged_solvers_survive():
    results = run_battery(rows=(4, 5, 10))
    outcome = results["outcome"].to_numpy(dtype=str)
    assert not np.char.startswith(outcome, "WRONG").any()
    converged = np.isin(
        results["integrator"].to_numpy(dtype=str), ["Euler", "trapezoidal", "SDIRK2"]
    )
    jumps = converged & (results["row"].values == 4)
    assert jumps.sum() == 12
    assert (outcome[jumps] == "ok").all()
    single = ~converged & (results["row"].values == 4)
    assert (outcome[single] == "refused: InvertedElement").any()  # as in the published scheme
    assert (results["smallest_J"].values[outcome == "ok"] > 0.0).all()
    table = limits(results).set_index("parameter")
    jump = table.loc["sigma_max [kPa], block"]
    assert jump["swept"] == "100 ... 1000"
    assert jump["SDIRK2"] == jump["static"] == "all"
    assert jump["linearly implicit Euler"] == "100 (InvertedElement)"
    assert jump["RK4"] == ""
    # An expected refusal is not a limit.
    assert table.loc["noise of the start [edges]", "Euler"] == "all"


def test_a_sliver_has_the_scaled_jacobian_of_its_name():
    for wanted in (0.1, 0.007, 1e-5):
        X = Block(corner=wanted).mesh().X.reshape(4, 4, 4, 3)
        corner = X[1, 1, 1]
        edges = np.stack([X[1, 1, 0], X[1, 0, 1], X[0, 1, 1]]) - corner
        unit = edges / np.linalg.norm(edges, axis=1)[:, None]
        assert abs(np.linalg.det(unit)) == pytest.approx(wanted, rel=1e-6)
        assert corner.sum() > 2.0 * SIZE / 3.0  # the node remains on its side


def test_a_measurement_is_printed_and_stored(coarse, tmp_path, capsys):
    table = scaling.measure([coarse], SimulationParameters(gravity=False), refine=False, repeats=1)
    assert table["elements"].tolist() == [coarse.sizes["element"]]
    assert (table.filter(like=" ms") > 0.0).all(axis=None)
    finish("scaling", table, tmp_path / "new")
    stored = pd.read_csv(tmp_path / "new" / "scaling.csv")
    pd.testing.assert_frame_equal(stored, table, check_dtype=False)
    assert capsys.readouterr().out == markdown(table) + "\n"


def test_the_command_lists_measurements_and_writes_files(tmp_path, capsys):
    with pytest.raises(SystemExit, match="0"):
        run([])
    said = capsys.readouterr().out
    assert {"stability", "work_precision", "locking", "tables"} <= set(measurements())
    assert all(name in said and title for name, title in measurements().items())
    with pytest.raises(SystemExit, match="2"):
        run(["stabilty"])
    assert "no measurement 'stabilty'" in capsys.readouterr().err
    with pytest.raises(SystemExit, match="0"):
        run(["stability", "--row", "10", "--out", str(tmp_path)])
    written = {"stability.csv", "stability-limits.csv"}
    assert {path.name for path in tmp_path.iterdir()} == written


@pytest.mark.slow
def test_a_new_process_reports_phases_and_memory():
    seconds, peak = start.first_result(None, "pointwise")
    assert list(seconds) == list(start.PHASES)
    assert min(seconds.values()) > 0.0
    # an interpreter with numba takes 0.1 GB, compiling 1.1 GB; a wrong unit differs by 1000
    assert 1e8 < peak < 1e10
    with pytest.raises(DataError, match="new process failed: .*nowhere"):
        start.first_result(Path("nowhere.nc"), "pointwise")
