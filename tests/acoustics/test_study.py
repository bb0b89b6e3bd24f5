"""Formants of a study: from the lips of its motions to cube, table and figure."""

from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr

from analysis.cube import build_cube
from analysis.errors import FigureError
from analysis.figures import formant_plot
from analysis.formants import FORMANT_VARIABLES, INSTANTS, cube_with_formants, formant_table
from analysis.listing import trials
from analysis.trial import Trial
from emgface.anatomy.airway import sound
from emgface.anatomy.airway.area_function import ideal_vowel, with_lips
from emgface.anatomy.airway.parameters import TractParameters
from emgface.errors import StoreError
from emgface.run.journal import Entry
from emgface.run.store import Store
from emgface.schema.validation import validate
from emgface.study.formants import formants_of, trial_formants, with_stored_formants
from emgface.study.stage_code import MOTION
from emgface.study.table import PlannedTrial

PLACE = ("P1", "A", 1, "act_all")


@pytest.fixture(scope="module")
def closing():
    """Lips that close from 1.2 to 0.4 cm^2 and protrude by 5 mm, and open halfway again."""
    part = np.interp(np.linspace(0.0, 1.0, 21), [0.0, 0.5, 1.0], [0.0, 1.0, 0.5])
    values = {
        "mouth_area": ("time", 1.2e-4 - 0.8e-4 * part),
        "lip_protrusion": ("time", 0.005 * part),
    }
    return xr.Dataset(values, {"time": np.linspace(0.2, 1.2, 21)})


@pytest.fixture(scope="module")
def cube(closing):
    scores = {
        name: ("marker", [value])
        for name, value in (("rho", 0.8), ("amplitude_ratio", 1.0), ("rmse", 1e-3))
    }
    trial = Trial(
        *PLACE, scores=xr.Dataset(scores, {"marker": ["corner_left"]}), origin="simulated"
    )
    scored = build_cube([trial], strategies=["act_all", "act_3"], origin="simulated")
    tract = ideal_vowel("u")
    return cube_with_formants(
        scored, {PLACE: formants_of(closing, tract, 0.01)}, tract.attrs["assumptions"]
    )


def test_formants_of_a_trial_follow_its_lips(cube):
    validate(cube, "cube")
    one = cube.sel(volunteer="P1", instruction="A", repetition=1, strategy="act_all")
    area, forward = np.array([1.2e-4, 0.4e-4]), np.array([0.0, 0.005])
    still = with_lips(ideal_vowel("u"), area, forward, np.arange(2.0))
    rest, closed = sound.with_formants(still)["formant_frequency"].values
    F = one["formant_frequency"]
    assert F.sel(instant=0.0).values == pytest.approx(rest)
    assert F.sel(instant=0.5).values == pytest.approx(closed, rel=1e-3)
    assert F.sizes["instant"] == INSTANTS
    assert one["formant_change"].values[:2] == pytest.approx((closed - rest)[:2], rel=0.01)
    assert float(one["simulated_duration"]) == pytest.approx(1.0)
    assert np.isnan(cube["formant_change"].sel(strategy="act_3").values).all()


def test_the_cube_reads_the_formants_that_a_worker_stored(closing, cube, tmp_path):
    store = Store(tmp_path)
    motion = store.get_or_compute(MOTION, {"of": "a test"}, {}, lambda: closing)
    tract = TractParameters(vowel="u", lips=0.01)
    laboratory = SimpleNamespace(store=store, study=SimpleNamespace(tract=tract))
    entry = Entry(tmp_path, 0, "ok", 3e5, False, (("motion", motion.digest, 0, 0),))
    digest = trial_formants(laboratory, (PlannedTrial(PLACE[:3], PLACE[3], None), entry, None))
    bare = cube.drop_vars([*FORMANT_VARIABLES, "formant", "instant"])
    bare.attrs.pop("tract")
    completed = with_stored_formants(bare, laboratory, {PLACE: digest})
    xr.testing.assert_identical(completed, cube)
    (tmp_path / "formants" / f"{digest}.nc").unlink()
    with pytest.raises(StoreError, match="was changed or removed while the study ran"):
        with_stored_formants(bare, laboratory, {PLACE: digest})


def test_the_table_of_formants_states_what_moves(cube):
    table = formant_table(cube)
    assert table is not None and "tract that does not move" in table.note
    row = dict(zip([c.name for c in table.columns], table.rows[0], strict=True))
    assert row["trials"] == 1 and row["rho"] == pytest.approx(0.8)
    assert row["change of F2"] < row["change of F1"] < 0.0 < row["F1 at the start"]
    assert table.rows[1][2] == 0
    assert formant_table(cube.drop_vars("formant_change")) is None
    assert list(trials(cube)["strategy"]) == ["act_all", "act_3"]  # lists the trials of such a cube


def test_the_figure_of_formants(cube, tmp_path):
    figure = formant_plot(cube)
    lower = figure.axes[1].lines[0].get_ydata()
    assert lower == pytest.approx(cube["formant_frequency"].values[0, 0, 0, 0, 0])
    with pytest.raises(FigureError, match="tract"):
        formant_plot(cube.drop_vars("formant_frequency"))
