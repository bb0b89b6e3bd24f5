"""Pressure that closed lips hold: closed forms, its search, and lower bounds in every output."""

import io

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import emgface as ef
import sim
from emgface.api.given import simulation_of, study_of
from emgface.errors import FaceError
from emgface.face.template.build import volunteer_face
from emgface.treatment import dose, jobs, pressure
from emgface.treatment.cut_difference import with_cut_difference
from emgface.treatment.dose_figure import dose_figure
from emgface.treatment.motions import ComparedMotions
from emgface.treatment.outcomes import OUTCOMES, outcome_table, with_words
from emgface.treatment.pages import plain_sentences
from emgface.treatment.pressure import LoadSteps, PressureHeld, pressure_forces, pressure_held

DRAFT = simulation_of(study_of(None).simulation, "draft", {"sigma_max": 100e3})
NAME = "pressure held before the lips part"


def test_forces_of_a_pressure_are_those_of_its_closed_form():
    q = np.array([[0.0, 0, 0], [2, 0, 0], [2, 3, 0], [0, 3, 0], [2, 0, 4], [0, 0, 4]])
    faces = np.array([[0, 1, 2, 3], [0, 1, 4, 4]])  # a rectangle, and a triangle with a node twice
    np.testing.assert_allclose(pressure_forces(q, faces[:1], 5.0).sum(axis=0), [0, 0, -30.0])
    np.testing.assert_allclose(pressure_forces(q, faces[1:], 5.0).sum(axis=0), [0, 20.0, 0])


def test_closed_lips_hold_a_pressure_that_converges_with_its_step(coarse):
    pressures = [pressure_held(coarse, DRAFT, step=step) for step in (100.0, 200.0, 400.0, 800.0)]
    values = [one.pressure for one in pressures]
    assert all(one.closed and one.parted and one.force > 0.1 for one in pressures)
    assert 800.0 < values[0] < 12000.0
    for one in pressures[1:]:  # the interval in which the lips part contains the finest value
        assert 0.0 < one.step and abs(one.pressure - values[0]) <= one.step
    assert abs(values[2] - values[0]) < 0.02 * values[0]
    few = pressure_held(coarse, DRAFT, step=400.0, highest=800.0)
    assert (few.pressure, few.parted, few.at_least) == (800.0, False, True)
    assert "highest pressure" in few.reason
    # the contact force vanishes continuously with a change of the face: no threshold is passed
    step = {"kind": "wedge", "width": 4.0, "height": 11.0, "place": 0.44}
    narrow = pressure_held(ef.treat(coarse, {"step": [step]}), DRAFT, step=400.0)
    assert narrow.pressure == pytest.approx(values[2], rel=0.1)
    paralysed = ef.treat(coarse, {"step": [{"kind": "palsy", "side": "both"}]})
    open_lips = pressure_held(paralysed, DRAFT)
    assert (open_lips.pressure, open_lips.closed, open_lips.at_least) == (0.0, False, False)
    without = DRAFT.model_copy(
        update={"contact": DRAFT.contact.model_copy(update={"method": "none"})}
    )
    with pytest.raises(FaceError, match="without contact"):
        pressure_held(coarse, without)


class Invented:
    """Lips whose force is 8 minus the load, with equilibria up to `limit` by steps up to `largest`."""

    def __init__(self, limit: float = np.inf, largest: float = np.inf) -> None:
        self.state, self.limit, self.largest = 0.0, limit, largest
        self.tried: list[float] = []

    @property
    def force(self) -> float:
        return max(8.0 - self.state, 0.0)

    def to(self, load: float) -> None:
        self.tried.append(load)
        if load > self.limit or load - self.state > self.largest:
            raise sim.NotConverged((), 0.0, "no equilibrium")
        self.state = load


def test_a_load_rises_by_steps_that_double_and_brackets_where_the_lips_part():
    lips, steps = Invented(), LoadSteps(1.0, 4.0, 0.1)
    rise = pressure._risen(lips, lips.to, 20.0, steps, parting=True)
    assert lips.tried[:4] == [1.0, 3.0, 7.0, 11.0]
    assert rise.failure is None and 7.0 <= rise.reached < 8.0 <= rise.parted
    assert rise.parted - rise.reached <= steps.first
    assert lips.state == rise.reached  # from which a shorter step continues
    assert pressure._vanishing(((0.0, 8.0), *rise.course), rise.parted) == pytest.approx(8.0)


def test_a_step_without_equilibrium_is_divided_and_the_last_one_is_stated():
    lips = Invented(largest=0.3)
    rise = pressure._risen(lips, lips.to, 4.0, LoadSteps(1.0, 4.0, 0.1), parting=False)
    assert (rise.reached, rise.failure) == (4.0, None)
    lost = Invented(limit=5.0)
    rise = pressure._risen(lost, lost.to, 20.0, LoadSteps(1.0, 4.0, 0.1), parting=True)
    assert isinstance(rise.failure, sim.NotConverged) and np.isinf(rise.parted)
    assert 5.0 - 0.4 < rise.reached <= 5.0 and lost.state == rise.reached


class Sliding(Invented):
    """Lips that slide to an equilibrium with more force by a step longer than 1.5."""

    slid = False

    @property
    def force(self):
        return 9.0 if self.slid else super().force

    def to(self, load):
        longer = load - self.state > 1.5 and self.state > 0.0
        super().to(load)
        self.slid = longer

    def __setattr__(self, name, value):
        if name == "state":
            object.__setattr__(self, "slid", False)
        object.__setattr__(self, name, value)


class Rising(Invented):
    """Lips that a pressure presses on each other."""

    @property
    def force(self):
        return 1.0 + self.state


def test_a_step_to_another_equilibrium_is_divided_until_the_force_falls():
    """Lips that slide across each other press more again, and would only give a lower bound."""
    lips = Sliding()
    rise = pressure._risen(lips, lips.to, 20.0, LoadSteps(1.0, 4.0, 0.1), parting=True)
    assert [aim for aim, _ in rise.course][:2] == [1.0, 2.0] and 3.0 in lips.tried
    assert all(b < a for (_, a), (_, b) in zip(rise.course, rise.course[1:], strict=False))
    assert 7.0 <= rise.reached < 8.0 <= rise.parted
    rising = Rising()  # also by steps whose sums are rounded, a finite number of times
    rise = pressure._risen(rising, rising.to, 20.0, LoadSteps(0.7, 2.8, 0.1), parting=True)
    assert rise.reached == 20.0 and len(rising.tried) < 100


class Slipping(Invented):
    """Lips whose equilibrium ends at a pressure, above which they press more, by steps of any length."""

    @property
    def force(self):
        return 9.0 if self.state > 5.0 else super().force


def test_a_rise_of_the_force_that_no_division_removes_ends_the_search_before_it():
    lips, steps = Slipping(), LoadSteps(1.0, 4.0, 0.1)
    rise = pressure._risen(lips, lips.to, 20.0, steps, parting=True)
    assert 5.0 - 0.4 < rise.reached <= 5.0 and np.isinf(rise.parted)
    assert "slide across each other, and their force rises from 3." in str(rise.failure)
    assert lips.state == rise.reached and len(lips.tried) < 30
    assert all(b < a for (_, a), (_, b) in zip(rise.course, rise.course[1:], strict=False))


def test_soft_lips_close_and_hold_a_pressure_by_shorter_steps():
    """An untreated person whose tissue is soft, without an equilibrium at the first fifth at once."""
    face = volunteer_face(2026, 2, resolution="coarse")[0]
    p = dose.DoseSetting().parameters()
    softness = dose.DRAWN_RANGES["stiffness"][0]
    soft = ef.treat(face, {"step": [{"kind": "change", "stiffness": softness}]})
    result = pressure_held(soft, p, step=800.0)
    assert result.closed and result.parted and 800.0 < result.pressure < 12000.0


def closing(**attrs):
    return xr.Dataset({"mouth_area": ("time", [1e-4, 0.0])}, attrs=attrs)


def bounded(monkeypatch, face, pressure):
    """Attributes of a motion of closing with a pressure."""
    monkeypatch.setattr(jobs, "pressure_held", lambda *given, **named: pressure)
    return jobs.pressure_attributes(face, DRAFT, face)


def test_a_lower_bound_is_one_in_table_page_and_interval(coarse, monkeypatch):
    exact = PressureHeld(9000.0, 400.0, 1.0, closed=True, parted=True)
    least = PressureHeld(10600.0, 0.0, 1.0, closed=True, parted=False, reason="still closed")
    for before, after, bound, change in (
        (exact, exact, "", 0.0), (exact, least, "after", 1600.0), (least, exact, "before", -1600.0),
        (least, least, "both", np.nan),
    ):  # fmt: skip
        pair = [{"closing": closing(**bounded(monkeypatch, coarse, p))} for p in (before, after)]
        motions = ComparedMotions(*pair, {"closing": ""}, "", {})
        table = outcome_table(coarse, coarse, motions)
        row = table.set_index("outcome").loc[NAME]
        assert row["bound"] == bound and row["after"] == after.pressure
        np.testing.assert_equal(row["change"], change)
        assert (table["bound"] != "").sum() == (bound != "")
        shown = with_words(table).set_index("outcome").loc[NAME]
        assert str(shown["after"]).startswith("at least") == (bound in ("after", "both"))
        words = {"after": "at least 1600.00", "before": "at most -1600.00"}.get(bound, change)
        np.testing.assert_equal(shown["change"], words)
        sentence = next(s for s in plain_sentences(table, table.iloc[:0, :4]) if "pressure" in s)
        assert ("is at least 10600 pascals" in sentence) == (bound in ("after", "both"))
        assert ("before: at least 10600" in sentence) == (bound in ("before", "both"))
        both = with_cut_difference(table, table).set_index("outcome").loc[NAME]
        ends = both["change, lowest of both cuts"], both["change, highest of both cuts"]
        assert np.isnan(ends[0]) == (bound in ("before", "both"))
        assert np.isnan(ends[1]) == (bound in ("after", "both"))


def test_a_lower_bound_is_one_in_the_table_cube_and_figure_of_doses(monkeypatch, tmp_path):
    def invented(case, setting):
        values = dict.fromkeys((o.name for o in OUTCOMES), 0.0) | {NAME: 5000.0 + 1e4 * case.share}
        least = case.share > 0.3 or (case.person == 2 and case.share == 0.0)
        return dose._row(values, "reached", [NAME] if least else [])

    monkeypatch.setattr(dose, "computed", invented)
    every = dose.cases(2, 0, ["V"], [0.2, 0.4], [0.5], ["all"])
    setting = dose.DoseSetting(movements=("closing",))
    table = dose.dose_table(every, setting, tmp_path)
    read = pd.read_csv(io.StringIO(table.to_csv(index=False)))  # as the command writes it
    for one in (table, read):
        changes = dose.changes_by_dose(one).query(f"outcome == '{NAME}'")
        bounds = dict(zip(zip(changes["person"], changes["share"], strict=True), changes["bound"],
                          strict=True))  # fmt: skip
        assert bounds == {(1, 0.2): "", (1, 0.4): "after", (2, 0.2): "before", (2, 0.4): "both"}
        unknown = changes.set_index(["person", "share"]).loc[(2, 0.4), "change"]
        assert np.isnan(float(unknown))
        counted = dose.intervals_by_dose(one).query(f"outcome == '{NAME}'")
        assert list(counted["bounds"]) == [1, 2]  # by share
        cube = dose.cube_of(one, setting).sel(outcome=NAME, draw=0, drop=True).squeeze()
        np.testing.assert_array_equal(cube["before_at_least"], [0, 1])
        np.testing.assert_array_equal(cube["after_at_least"], [[0, 1], [0, 1]])
        assert not dose.cube_of(one, setting)["after_at_least"].sel(outcome="mouth width").any()
    titles = [axis.get_title() for axis in dose_figure(table, setting).axes]
    assert f"{NAME}\n(3 changes are bounds)" in titles
    earlier = table.drop(columns=dose.BOUNDS)  # a table without this column has no bounds
    assert (dose.changes_by_dose(earlier)["bound"] == "").all()
