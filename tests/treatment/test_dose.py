"""Tables of treatments over persons: cases, resumption, intervals, cube, and refusals with a reason."""

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import emgface as ef
from emgface.acoustics.matrix import lossless_formants
from emgface.choices import configure
from emgface.errors import DataError
from emgface.face.simulation_parameters import SimulationParameters
from emgface.run.store import Store
from emgface.treatment import dose, jobs
from emgface.treatment.dose_figure import dose_figure
from emgface.treatment.motions import compared_motions, gestures
from emgface.treatment.outcomes import (
    CLOSED_AREA,
    OUTCOMES,
    TRACT,
    TRACT_LIP_LENGTH,
    formant_of_lips,
)
from emgface.treatment.plan import Plan
from sim.errors import InvertedElement, NotConverged, SceneError

SETTING = dose.DoseSetting(movements=(), contact=False)


def invented(case, setting):
    """Width 50 + person, less 10 times the share, and 2 more in every draw."""
    width = 50.0 + case.person - 10.0 * case.share + 2.0 * (case.draw > 0) * (case.share > 0)
    values = dict.fromkeys((o.name for o in OUTCOMES), 0.0) | {"mouth width": width}
    return dose._row(values, "reached" if case.share < 0.4 else "refused: too wide")


@pytest.fixture
def table(monkeypatch, tmp_path):
    done: list[str] = []

    def counted(case, setting):
        done.append(case.name)
        return invented(case, setting)

    monkeypatch.setattr(dose, "computed", counted)
    every = dose.cases(2, 1, ["V", "W"], [0.1, 0.4], [0.5], ["all"])
    rows = dose.dose_table(every, SETTING, tmp_path)
    assert len(done) == len(every) == 2 * 2 * (1 + 4)
    again = dose.dose_table(every, SETTING, tmp_path)
    assert len(done) == len(every)  # all from the store
    pd.testing.assert_frame_equal(rows, again)
    return rows


def test_the_status_of_a_case_names_what_failed():
    for end, status in {
        "reached": ("ok", ""),
        "refused: step 1: too wide": ("failed:refused", "step 1: too wide"),
        "failed: closing: element 3 is inverted": ("failed:closing", "element 3 is inverted"),
        "failed: pressure held: the lips: at 5 %": ("failed:pressure held", "the lips: at 5 %"),
    }.items():
        assert dose._status({"end": end}) == status


def test_changes_are_from_the_same_person_and_draw(table):
    own = dose.changes_by_dose(table).query("outcome == 'mouth width'")
    np.testing.assert_allclose(own["change"], -10.0 * own["share"] + 2.0 * (own["draw"] > 0))
    rows = dose.intervals_by_dose(table).query("outcome == 'mouth width' and shape == 'V'")
    np.testing.assert_allclose(rows["median"], [-1.0, -4.0])
    np.testing.assert_allclose(rows["parameters high"], [1.0, -2.0])


def test_the_cube_has_every_axis_and_its_reasons(table):
    cube = dose.cube_of(table, SETTING)
    assert cube["after"].dims == (*dose.COMPARISONS, "outcome")
    one = cube.sel(person=2, draw=0, shape="W", share=0.4, place=0.5, rejoin="all")
    assert float(one["after"].sel(outcome="mouth width")) == pytest.approx(48.0)
    assert str(one["end"].values) == "refused: too wide"
    assert float(cube["before"].sel(person=2, draw=0, outcome="mouth width")) == 52.0


def test_the_figure_states_that_it_is_simulated_and_how(table):
    figure = dose_figure(table, SETTING)
    title = figure.get_suptitle()
    for words in ("simulated", "not validated", "2 generated persons", "coarse", "without contact",
                  "1 draw of", "100 kPa", "smallest to largest of the persons", "crosses"):  # fmt: skip
        assert words in title, words
    assert "95 %" not in title  # which two persons do not have
    assert "in contact" in dose_figure(table, dose.DoseSetting()).get_suptitle()
    drawn = [axis.get_title() for axis in figure.axes if axis.has_data()]
    assert "mouth width" in drawn
    axis = next(a for a in figure.axes if a.get_title() == "mouth width")
    crosses = [line for line in axis.get_lines() if line.get_marker() == "x"]
    values = [y for line in crosses for y in line.get_ydata()]
    np.testing.assert_allclose(sorted(values), [-2.0, -2.0, 1.0, 1.0])  # both shapes and shares


def test_a_spread_is_that_of_its_number_of_values(table):
    assert dose.spread_of(19)[:2] == (0.0, 1.0) and dose.spread_of(20)[:2] == (0.05, 0.95)
    rows = dose.intervals_by_dose(table).query("outcome == 'mouth width' and shape == 'V'")
    np.testing.assert_allclose(rows["persons high"], [-1.0, -4.0])
    many = pd.concat([table.assign(person=k, **{"mouth width": table["mouth width"]
                      - k * table["share"]}) for k in range(1, 21)])  # fmt: skip
    one = dose.intervals_by_dose(
        many[many["draw"] == 0].drop_duplicates(["person", "shape", "share"])
    )
    share = one.query("outcome == 'mouth width' and shape == 'V' and share == 0.1").iloc[0]
    assert share["persons low"] == pytest.approx(-1.0 - 0.1 * np.quantile(np.arange(1, 21), 0.95))


def test_an_interval_of_several_plans_is_refused(table, tmp_path):
    outcomes = pd.DataFrame({"outcome": ["mouth width"], "before": [1.0]})
    with pytest.raises(DataError, match="several plans"):
        dose.with_intervals(outcomes, table)
    one = table[(table["share"] != 0.4) & (table["shape"] == "V")]
    estimates = dose.with_intervals(outcomes, one)
    assert estimates.loc[0, "change, persons low"] == pytest.approx(-1.0)
    path = tmp_path / "other.csv"
    path.write_text("a,b\n1,2\n", encoding="utf-8")
    with pytest.raises(DataError, match="no column 'person'"):
        dose.read_cases(path, [])


def test_an_interval_of_another_plan_than_that_of_the_face_is_refused(monkeypatch, tmp_path):
    """Its changes would stand next to those of the face, without a sign that they are not its own."""
    values = dict.fromkeys((o.name for o in OUTCOMES), 1.0)
    monkeypatch.setattr(dose, "computed", lambda case, setting: dose._row(values, "reached"))
    step = {"kind": "wedge", "width": 9.0}
    plan, other = (
        configure(Plan, {"name": name, "step": [step | given]})
        for name, given in (("one", {}), ("two", {"height": 8.0}))
    )
    setting = dose.DoseSetting(movements=("A",))
    path = tmp_path / "doses.csv"
    table = dose.dose_table(dose.cases_of_plan(1, 0, plan), setting, tmp_path / "cases")
    path.write_text("# simulated\n" + table.to_csv(index=False), encoding="utf-8")
    renamed = plan.model_copy(update={"name": "another name"})
    assert len(dose.read_cases(path, [{"plan": renamed.model_dump(mode="json")}])) == 2
    with pytest.raises(DataError, match="other plans than that of the treated face"):
        dose.read_cases(path, [{"plan": other.model_dump(mode="json")}])
    shapes = dose.dose_table(
        dose.cases(1, 0, ["V"], [0.2], [0.5], ["all"]), setting, tmp_path / "shapes"
    )
    path.write_text(shapes.to_csv(index=False), encoding="utf-8")
    with pytest.raises(DataError, match="found none"):
        dose.read_cases(path, [{"plan": plan.model_dump(mode="json")}])
    surface = configure(Plan, {"step": [{"kind": "tumour", "surface": "tumour.stl"}]})
    with pytest.raises(DataError, match="belongs to one person"):
        dose.cases_of_plan(1, 0, surface)


def test_a_case_is_treated_and_an_impossible_one_is_refused_with_its_reason():
    whole, cut, far = (
        dose.computed(dose.Case(1, 0, "V", share), SETTING) for share in (0.0, 0.2, 0.8)
    )
    width = [float(x["value"].sel(outcome="mouth width")) for x in (whole, cut)]
    margin = [float(x["value"].sel(outcome="length of the lower lip margin")) for x in (whole, cut)]
    assert width[1] < width[0] and 0.7 < margin[1] / margin[0] < 0.95
    height = [float(x["value"].sel(outcome="lower vermilion height")) for x in (whole, cut)]
    assert height[1] < height[0]
    assert cut.attrs["end"] == "reached" and far.attrs["end"].startswith("refused: step 1")
    assert far["value"].isnull().all()


def test_draws_differ_and_the_default_has_none():
    assert dose.drawn_persons(0, 1) == {}
    seed = SETTING.seed
    one, two = dose.drawn_persons(1, seed), dose.drawn_persons(2, seed)
    assert one != two and dose.drawn_persons(1, seed) == one
    for name, (low, high) in dose.DRAWN_RANGES.items():
        assert low <= one[name] <= high
    plan = dose.plan_of(dose.Case(1, 1, "V", 0.2), SETTING, 50e-3)
    change, wedge = plan.step
    assert change.stiffness == one["stiffness"] and wedge.width == pytest.approx(10.0)
    assert wedge.scar.stiffness == one["scar_stiffness"]
    incision = configure(Plan, {"step": [{"kind": "incision", "scar": False}]})
    own = dose.plan_of(dose.cases_of_plan(1, 1, incision)[-1], SETTING, 50e-3)
    assert own.step[1].scar is None and own.step[1].retraction == one["retraction"]


def test_open_lips_have_the_formant_of_their_tube_and_closed_ones_none():
    """Within 10 % of the tube without losses, whose walls do not yield; rounding lowers it."""
    for share in (1.0, 0.3):
        cells = np.append(np.full(round(TRACT[0] / TRACT_LIP_LENGTH), TRACT[1]), share * TRACT[1])
        ideal = lossless_formants(cells, len(cells) * TRACT_LIP_LENGTH)[0]
        assert formant_of_lips(share * TRACT[1]) == pytest.approx(ideal, rel=0.1)
    assert formant_of_lips(0.2 * TRACT[1]) < 0.9 * formant_of_lips(TRACT[1])
    assert np.isnan(formant_of_lips(0.5 * CLOSED_AREA))


def test_an_interrupted_comparison_continues(coarse, tmp_path, monkeypatch):
    p = configure(
        SimulationParameters, {"accuracy": "draft", "contact": {"method": "none"}, "sigma_max": 5e4}
    )
    weak = ef.treat(coarse, {"step": [{"kind": "palsy", "degree": 0.5}]})
    drives = gestures(coarse, ("A",))
    store = Store(tmp_path)
    first = compared_motions(coarse, weak, drives, p, source="", store=store)

    def fails(*given, **named):
        raise AssertionError("a stored motion is not simulated again")

    monkeypatch.setattr(jobs, "simulate_face", fails)
    again = compared_motions(coarse, weak, drives, p, source="", store=store)
    xr.testing.assert_equal(first.treated["A"], again.treated["A"])
    with pytest.raises(AssertionError):  # another face is computed
        compared_motions(coarse, coarse, drives, p.model_copy(update={"sigma_max": 6e4}), source="",
                 store=store)  # fmt: skip


def test_both_faces_move_in_processes_as_one_after_the_other(coarse, tmp_path):
    """The same bits by two processes, also where a movement requires a smaller sigma_max."""
    p = configure(
        SimulationParameters,
        {"accuracy": "draft", "contact": {"method": "none"}, "sigma_max": 5e4,
         "check_contact": False},
    )  # fmt: skip
    weak = ef.treat(coarse, {"step": [{"kind": "palsy", "degree": 0.5}]})
    drives = gestures(coarse, ("A", "closing"))
    messages: list[tuple[int, int]] = []
    one, two = (
        compared_motions(coarse, weak, drives, p, source="", store=Store(tmp_path / str(n)),
                         workers=n, progress=lambda *at: messages.append(at))
        for n in (1, 2)
    )  # fmt: skip
    assert messages[-1] == (4, 4) and not one.failed and not two.failed
    for name in drives:
        for a, b in ((one.intact, two.intact), (one.treated, two.treated)):
            for variable in ("position", "surface_position", "mouth_area"):
                np.testing.assert_array_equal(a[name][variable], b[name][variable])
    with pytest.raises(KeyboardInterrupt):
        compared_motions(coarse, weak, drives, p, source="", stopping=lambda: True)


def test_a_movement_that_fails_is_repeated_with_weaker_muscles_of_both_faces(coarse, monkeypatch):
    tried: list[tuple[str, float]] = []

    class Invented(jobs.Faces):
        def _computed(self, job: jobs.Job) -> xr.Dataset:
            tried.append((job.name, job.parameters.sigma_max))
            if job.name == "A" and job.which == 0 and job.parameters.sigma_max > 90e3:
                raise InvertedElement(3, -1.0, 0.1)
            if job.name == "D":
                raise SceneError("no such muscle")
            if job.name == "F":
                raise NotConverged((), 0.1, "never")
            return xr.Dataset(attrs={"sigma_max": job.parameters.sigma_max})

    monkeypatch.setattr("emgface.treatment.motions.Faces", Invented)
    p = configure(
        SimulationParameters,
        {"contact": {"method": "none"}, "sigma_max": 100e3,
         "sigma_max_policy": {"factor": 0.9, "minimum": 85e3}},
    )  # fmt: skip
    drives = gestures(coarse, ("A", "B", "D", "F"))
    rows = compared_motions(coarse, coarse, drives, p, source="")
    stress = [rows.intact[n].attrs["sigma_max"] for n in ("A", "B")]
    assert stress == [90e3, 100e3] and rows.treated["A"].attrs["sigma_max"] == 90e3
    assert list(rows.failed) == ["D", "F"] and "no such muscle" in rows.failed["D"]
    assert tried.count(("F", 90e3)) == 1 and ("D", 90e3) not in tried
