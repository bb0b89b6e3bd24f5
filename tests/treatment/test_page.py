"""Page of a comparison in a browser: both faces, one time cursor, keyboard, and no network access."""

import html
import io
import json
import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from PIL import Image

import emgface as ef
from emgface.choices import configure
from emgface.face.simulation_parameters import SimulationParameters
from emgface.treatment.motions import compared_motions, gestures
from emgface.treatment.outcomes import OUTCOMES, movement_table, outcome_table, with_words
from emgface.treatment.pages import compare_page, plain_sentences, states_of
from emgface.treatment.plan import NOT_VALIDATED
from tests.browser import needs_browser, started, until

QUICK = configure(
    SimulationParameters,
    {"accuracy": "draft", "contact": {"method": "none"}, "sigma_max": 100e3},
)


@pytest.fixture(scope="module")
def made(coarse):
    step = {"kind": "wedge", "place": 0.42, "width": 12.0, "height": 11.0}
    treated = ef.treat(coarse, {"name": "<b>V</b>", "step": [step]})
    drives = gestures(coarse, ("A",))
    motions = compared_motions(coarse, treated, drives, QUICK, source="Gestures.")
    tables = outcome_table(coarse, treated, motions), movement_table(motions)
    return coarse, treated, motions, drives, tables


@pytest.fixture(scope="module")
def pages(made):
    coarse, treated, motions, drives, tables = made
    return [
        compare_page(coarse, treated, motions, drives, tables, plain=plain)
        for plain in (False, True)
    ]


def test_every_page_states_that_it_is_simulated_and_not_validated(pages):
    for page in pages:
        assert NOT_VALIDATED in page and "simulated" in page
        assert "<b>V</b>" not in page
        assert "http://" not in page.replace("http://www.w3.org", "")


def test_outcomes_are_those_of_the_faces(made):
    coarse, treated, motions, _, (outcomes, movements) = made
    row = outcomes.set_index("outcome").loc["length of the lower lip margin"]
    assert 1.0 < row["before"] - row["after"] < 12.0
    assert np.isnan(outcomes.set_index("outcome").loc["lip opening", "after"])
    assert 0.5 < movements.iloc[0]["rho"] <= 1.0
    own = compared_motions(coarse, coarse, gestures(coarse, ("A",)), QUICK, source="")
    same = movement_table(own).iloc[0]
    assert same["rho"] == pytest.approx(1.0) and same["amplitude ratio"] == pytest.approx(1.0)


def test_the_picture_shows_the_treated_face(made, tmp_path):
    from emgface.pictures.stills import write_figure

    _, treated, motions, _, _ = made
    path = write_figure(states_of(treated, motions, ("A",)), tmp_path / "states.png")
    pixels = np.asarray(Image.open(path).convert("RGB"), dtype=int)
    yellow = (pixels[..., 0] > 180) & (pixels[..., 1] > 110) & (pixels[..., 2] < 90)
    assert yellow.sum() > 50  # the suture


def test_the_plain_page_names_movements_by_their_words(pages):
    """The letter of an instruction, or the name of a task, is a term of the field."""
    for page, names in zip(pages, ({"A": "purse lips"}, {"purse lips": ""}), strict=True):
        data = re.search(r'(?s)id="motions">(.*?)</script>', page)
        assert data is not None
        shown = json.loads(data[1])
        assert shown["instructions"] == names
        assert {trial["instruction"] for trial in shown["trials"]} == set(names)


def test_the_plain_page_states_what_could_not_be_worked_out(made):
    """A movement without result, and a number of one face only, are named and not left out."""
    coarse, treated, motions, drives, (outcomes, movements) = made
    lost = replace(motions, failed={"closing": "no equilibrium"},
                   words=motions.words | {"closing": "press the lips together"})  # fmt: skip
    one = outcomes.copy()
    one.loc[one["outcome"] == "mouth width", "after"] = np.nan
    page = compare_page(coarse, treated, lost, drives, (one, movements), plain=True)
    assert "“press the lips together”: the model could not work out this movement." in page
    assert "before the operation; the model could not work it out after." in page
    assert page.count("the model could not work it out after") == 1
    noted = replace(motions, notes=("The pressure held after is a lower bound: because.",))
    assert "a lower bound: because." in compare_page(
        coarse, treated, noted, drives, (outcomes, movements)
    )


def test_the_plain_page_calls_only_a_cut_an_operation(made):
    coarse, _, motions, drives, tables = made
    weak = ef.treat(coarse, {"name": "weak", "step": [{"kind": "palsy", "degree": 0.5}]})
    same = replace(motions, treated=motions.intact)
    page = compare_page(coarse, weak, same, drives, tables, plain=True)
    assert "How the lips may move after a treatment" in page and "operation" not in page


def test_the_page_states_the_plan_and_its_numbers_with_their_units(made, pages):
    """Of every step its parameters and report; legends of a cut only where something is cut."""
    coarse, _, motions, drives, tables = made
    body = re.sub(r"(?s)<(script|style).*?</\1>", " ", pages[0])
    text = " ".join(html.unescape(re.sub("<[^>]+>", " ", body)).split())
    for part in ("Step 1 of “<b>V</b>”: wedge lip lower place 0.42", "width 12\xa0mm", "height 11\xa0mm",
                 "scar radius 3\xa0mm", " mm² ", "closing force 0."):  # fmt: skip
        assert part in text or " ".join(part.split()) in text, part
    assert re.search(r"removed volume \d+ mm³", text) and not re.search(
        r"mm[23]|[0-9]e[+][0-9]", text
    )
    assert all("dark red" in page.lower() for page in pages)
    weak = ef.treat(coarse, {"name": "weak", "step": [{"kind": "palsy", "degree": 0.5}]})
    same = replace(motions, treated=motions.intact)
    for plain in (False, True):
        assert (
            "dark red" not in compare_page(coarse, weak, same, drives, tables, plain=plain).lower()
        )


def test_no_number_of_the_plain_page_is_below_zero():
    none = pd.DataFrame(columns=["movement", "words", "instruction", "amplitude ratio"])
    for outcome in OUTCOMES:
        if outcome.plain and outcome.unit in ("mm", "mm2", "Pa"):
            row = {"outcome": outcome.name, "unit": outcome.unit, "before": -2.0, "after": 3.0}
            (sentence,) = plain_sentences(pd.DataFrame([row | {"bound": ""}]), none)
            assert "-" not in sentence and "more than before" in sentence
            assert ("-2" not in sentence) and ("5.0" in sentence or outcome.unit == "Pa")


@needs_browser
@pytest.mark.parametrize("query", ["", "?plain"])
def test_both_faces_move_under_one_cursor_and_turn_by_keys(
    pages, tmp_path, tmp_path_factory, query
):
    from selenium.common.exceptions import TimeoutException
    from selenium.webdriver.common.keys import Keys

    path = tmp_path / "page.html"
    path.write_text(pages[0], encoding="utf-8")
    stage = "document.getElementById('stage')"

    def halves(browser):
        for attempt in range(6):  # software rendering on a loaded machine may exceed ten seconds
            try:
                png = browser.find_element("id", "stage").screenshot_as_png
                break
            except TimeoutException:
                if attempt == 5:
                    raise
        pixels = np.asarray(Image.open(io.BytesIO(png)).convert("RGB"), dtype=int)
        return pixels[:, : pixels.shape[1] // 2], pixels[:, pixels.shape[1] // 2 :]

    def settled(browser):
        before = halves(browser)
        for _ in range(100):
            now = halves(browser)
            if all(np.array_equal(a, b) for a, b in zip(before, now, strict=True)):
                return now
            before = now
        raise AssertionError("the picture does not come to rest")

    def changed(one, two):
        return [
            float((np.abs(a - b).max(axis=2) > 20).mean()) for a, b in zip(one, two, strict=True)
        ]

    for browser in started(tmp_path_factory.mktemp("profile")):
        browser.get(path.as_uri() + query)
        until(browser, f"return {stage}.dataset.ready === 'yes'")
        rest = settled(browser)
        slider = browser.find_element("id", "time")
        slider.send_keys(Keys.END)
        until(browser, f"return Number({stage}.dataset.frame) > 5")
        assert min(changed(rest, settled(browser))) > 0.003
        slider.send_keys(Keys.HOME)
        until(browser, f"return Number({stage}.dataset.frame) === 0")
        assert max(changed(rest, settled(browser))) < 0.001
        browser.find_element("id", "stage").send_keys(Keys.ARROW_LEFT * 4)
        assert min(changed(rest, settled(browser))) > 0.01
        severe = [e for e in browser.get_log("browser") if e["level"] == "SEVERE"]
        assert not severe, severe


@needs_browser
def test_on_a_telephone_nothing_is_covered_and_the_plain_page_has_no_terms(
    pages, tmp_path, tmp_path_factory
):
    """The words before | after stand beneath the buttons; the plain page names no muscle."""
    boxes = """return ['.tag', ...[1, 2, 3, 4].map(k => `.views :nth-child(${k})`)].map(name => {
        const b = document.querySelector(name).getBoundingClientRect()
        return [b.left, b.top, b.right, b.bottom]})"""
    for browser in started(tmp_path_factory.mktemp("profile")):
        browser.set_window_size(420, 900)
        for page, plain in zip(pages, (False, True), strict=True):
            path = tmp_path / f"{plain}.html"
            path.write_text(page, encoding="utf-8")
            browser.get(path.as_uri())
            until(browser, "return document.getElementById('stage').dataset.ready === 'yes'")
            tag, *buttons = browser.execute_script(boxes)
            for left, top, right, bottom in buttons:
                assert right > left and bottom > top
                assert tag[2] <= left or right <= tag[0] or tag[3] <= top or bottom <= tag[1]
            cut_off = """return [...document.querySelectorAll('.scroll')].filter(one =>
                one.scrollWidth > one.clientWidth + 1).map(one => one.getAttribute('aria-label'))"""
            assert browser.execute_script(cut_off) == []
            shown = "return document.getElementById('tracks').clientHeight > 0"
            assert browser.execute_script(shown) != plain  # its words are terms of the field
            text = browser.execute_script("return document.body.innerText")
            assert NOT_VALIDATED in text
            text += browser.execute_script(
                "return document.getElementById('stage').getAttribute('aria-label')"
            )
            terms = ("sigma_max", "orbicularis", "Activation at this instant", "corner left",
                     "Markers and colour")  # fmt: skip
            for term in terms:
                assert (term in text) != plain, term


def test_small_gaps_are_closed_lips_on_the_plain_page():
    """A gap counts as closed below 1 mm2, and no sentence states that it became smaller."""
    gap = next(o.name for o in OUTCOMES if "gap that is left" in o.plain)
    none = pd.DataFrame(columns=["movement", "words", "instruction", "amplitude ratio"])

    def sentence_of(name, unit, before, after):
        row = {"outcome": name, "unit": unit, "before": before, "after": after, "bound": ""}
        (sentence,) = plain_sentences(pd.DataFrame([row]), none)
        return sentence

    assert "counts as closed" in sentence_of(gap, "mm2", 0.96, 0.02)
    more = sentence_of(gap, "mm2", 0.02, 3.0)
    assert "is 3.0 square millimetres, more than before (0.0); less than one counts as" in more
    less = sentence_of("mouth width", "mm", 50.0, 40.0)
    assert less.endswith("the width of the mouth is 40.0 millimetres, less than before (50.0).")
    assert "5400 pascals, more than before (4700)." in sentence_of(
        "pressure held before the lips part", "Pa", 4707.4, 5469.7
    )


def test_the_plain_page_says_one_thing_about_every_movement():
    """A movement with outcomes in words has no share of its own, which may contradict them."""
    plain = {o.movement for o in OUTCOMES if o.plain and o.movement}
    rows = [
        {"outcome": o.name, "unit": o.unit, "before": 3.0, "after": 2.0, "bound": ""}
        for o in OUTCOMES
    ]
    moved = pd.DataFrame(
        [(name, f"words of {name}", 1.09, 0.9) for name in (*plain, "B")],
        columns=["movement", "words", "amplitude ratio", "rho"],
    )
    sentences = plain_sentences(pd.DataFrame(rows), moved)
    assert [one for one in sentences if "words of" in one] == [
        "“words of B”: the movement is 109 % of that before."
    ]
    assert len(sentences) == 1 + sum(bool(o.plain) for o in OUTCOMES)
    lost = plain_sentences(pd.DataFrame(rows).assign(after=np.nan, before=np.nan), moved)
    assert len(lost) == len(moved)


def test_answers_are_words_for_readers():
    """A question has yes or no, and neither a unit nor a change, in every table for readers."""
    rows = [
        {
            "outcome": o.name,
            "unit": o.unit,
            "before": 1.0,
            "after": 0.0,
            "change": -1.0,
            "bound": "",
        }
        for o in OUTCOMES
    ]
    shown = with_words(pd.DataFrame(rows)).set_index("outcome")
    for outcome in OUTCOMES:
        row = shown.loc[outcome.name]
        assert outcome.answer == ((row["before"], row["after"]) == ("yes", "no"))
        assert outcome.answer == (row["unit"] == "") == bool(pd.isna(row["change"]))
        assert not (outcome.answer and outcome.plain)
