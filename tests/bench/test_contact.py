"""Measurement of contact on the coarse template: closing of the lips, and oscillation at rest."""

import numpy as np
import pytest
import xarray as xr

import sim
from benchmarks.closing import closed_by
from benchmarks.contact import CLOSING, METHODS, contact_table, drive, measure
from benchmarks.lip_probe import to_and_fro
from emgface.face.accuracy import accuracy_settings
from emgface.face.simulation_parameters import SimulationParameters

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def closed(coarse: xr.Dataset) -> xr.Dataset:
    parameters = SimulationParameters(
        gravity=False, sigma_max=100e3, **(accuracy_settings("draft") | {"solver": "converged"})
    )
    return measure(coarse, cases=(CLOSING,), hold=0.1, parameters=parameters)


def test_lips_close_and_do_not_pass_each_other(closed: xr.Dataset) -> None:
    """Without contact the lips pass each other by millimetres; with contact they do not penetrate."""
    assert METHODS[0] == "none" and len(METHODS) > 1
    assert (closed["status"] == "ok").all()
    assert closed["opening_rest"].values == pytest.approx(2.85e-3, abs=1e-5)
    bare = closed.sel(contact="none", case=CLOSING)
    assert bare["depth_lips"] > 2e-3 and bare["depth_teeth"] > 1e-3
    limit = 1e-5
    for name in METHODS[1:]:
        run = closed.sel(contact=name, case=CLOSING)
        assert run["gap_end"] < 2e-4, name
        assert run["depth_lips"] <= limit, name
        assert run["depth_teeth"] <= limit, name
        assert run["gap"] >= -limit, name
    assert bare["gap"].isnull()


def test_lips_at_rest_do_not_oscillate(coarse: xr.Dataset) -> None:
    """No node oscillates by 0.1 mm within 0.25 s, after motions of the lips of millimetres."""
    parameters = SimulationParameters(
        gravity=False, sigma_max=100e3, **(accuracy_settings("study") | {"solver": "converged"})
    )
    measured = measure(
        coarse, cases=(CLOSING,), methods=("constraint",), hold=0.5, parameters=parameters
    )
    assert measured["chatter"] < 1e-4 and measured["ripple"] < 1e-5


def test_measurements_are_tabulated(closed: xr.Dataset) -> None:
    table = contact_table(closed)
    assert list(table["contact"]) == list(METHODS)
    assert table["step over that without"][0] == 1.0
    assert table["opening at rest mm"][0] == pytest.approx(2.85, abs=0.01)


def test_a_failed_run_is_reported(coarse: xr.Dataset, monkeypatch: pytest.MonkeyPatch) -> None:
    """A failed step ends the run; its row contains the failure and the results before it."""
    made, real = [], sim.simulate

    def simulate(*args, **options):
        made.append(options)
        if len(made) > 1:
            raise sim.InvertedElement(3, -0.1, 0.05)
        return real(*args, **options)

    monkeypatch.setattr(sim, "simulate", simulate)
    parameters = SimulationParameters(gravity=False, sigma_max=100e3)
    measured = measure(
        coarse, methods=("none",), cases=(CLOSING,), hold=0.05, parameters=parameters
    )
    assert len(made) == 2
    assert str(measured["status"].values[0, 0]).startswith("InvertedElement: ")
    assert np.isfinite(measured["opening"].values[0, 0]).sum() == 6
    assert np.isnan(measured["speed"].values[0, 0])


def test_only_reversals_count_as_oscillation() -> None:
    time = np.linspace(0.0, 1.0, 401)
    creeping, trembling = np.zeros((401, 2, 3)), np.zeros((401, 2, 3))
    creeping[:, 0, 2] = 1e-3 * time**2
    trembling[:, 1, 0] = 1e-3 * time + 2e-5 * np.sign(np.sin(20 * np.pi * time + 0.1))
    assert to_and_fro(creeping) == 0.0
    assert to_and_fro(1e-6 * np.cos(20 * np.pi * time)[:, None, None]) == pytest.approx(2e-5)
    # ten jumps down by 40 micrometres, each reduced by the slow motion between them
    assert to_and_fro(trembling) == pytest.approx(10 * (4e-5 - 2.5e-6))


def test_cases() -> None:
    assert drive(CLOSING) == {"OOP_L": 1.0, "OOP_R": 1.0, "OOM_L": 1.0, "OOM_R": 1.0}
    assert drive("protrusion") == {"OOP_L": 1.0, "OOP_R": 1.0}
    assert drive("B") == {"LLSAN_L": 0.5, "LLSAN_R": 0.5}


def test_lips_closed_by_strong_muscles_stay_whole_and_outside_each_other(
    coarse: xr.Dataset,
) -> None:
    """Both parts of the orbicularis oris, fully active, at three times the usual stress."""
    row = closed_by(coarse, "OOP+OOM", 300.0, 1.0, 0.1, "rest", "pointwise")
    assert row["status"] == "ok"
    assert row["smallest det F"] > 0.05
    assert row["lips in lips um"] < 20.0


def test_a_closing_that_negative_damping_feeds_is_given_up_early(coarse: xr.Dataset) -> None:
    """With the damping of the published simulator the motion grows before the lips have closed."""
    row = closed_by(coarse, "OOP+OOM", 100.0, 1.0, 0.1, "current", "pointwise")
    assert str(row["status"]).startswith("UnstableDamping: the damping of the current tangent")
