"""Pages of every kind state each sentence once, cut no text, and state how far the lips are apart."""

import re
from collections import Counter
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from analysis.axes import combine_cubes
from analysis.statistics.simulated import simulated_scores
from benchmarks.fit_inputs import person_of
from emgface.anatomy.head.build import build_head
from emgface.anatomy.head.picture import head_page
from emgface.anatomy.head.run import raised, read_motion, simulate_head, write_motion
from emgface.anatomy.jaw.picture import jaw_page
from emgface.anatomy.jaw.run import simulate_jaw
from emgface.anatomy.jaw.template import template_jaw
from emgface.anatomy.tongue.template import template_tongue
from emgface.face.lip_shape import lip_opening
from emgface.face.template import template_face
from emgface.fit.person import fit_face
from emgface.fit.report import fitted_face_page, render_fit
from emgface.pictures.body import skin_of
from emgface.pictures.lips import lips_at_rest, lips_of_motion
from emgface.pictures.page import face_page, motion_page
from emgface.pictures.show import page
from emgface.pictures.surface import with_surface
from emgface.report.results import Results
from emgface.report.write import render_report
from emgface.view.page import live_page
from emgface.view.recording import recording_page
from tests.browser import needs_browser, until
from tests.data.made_recordings import emg, noise
from tests.study_run.test_report_contents import scores
from tests.study_run.test_report_sentences import studied
from tests.tongue.small import small_tongue_motion
from tests.view.laid_out import faults_of
from tests.view.sessions import Shifted
from tests.view.test_keyboard import of_treatment

LONG = "n" * 3000  #: a name without a place to break
WORDS = 4  #: number of words from which a text with a full stop is a sentence


BREAK = "\0"


class _Text(HTMLParser):
    """Text of each element that is seen, without scripts and styles."""

    def __init__(self) -> None:
        super().__init__()
        self.parts: list[str] = []
        self._hidden = 0

    def handle_starttag(self, tag, attrs):
        self._hidden += tag in ("script", "style")
        if tag in ("p", "div", "section", "figcaption", "li", "td", "h1", "h2", "h3", "dt", "dd"):
            self.parts.append(BREAK)

    def handle_endtag(self, tag):
        self._hidden -= tag in ("script", "style")

    def handle_data(self, data):
        if not self._hidden:
            self.parts.append(data)


def repeated(text: str) -> list[str]:
    """Sentences that a text in HTML, or the text of a page, contains more than once."""
    reader = _Text()
    reader.feed(text)
    blocks = (" ".join(block.split()) for block in "".join(reader.parts).split(BREAK))
    sentences = [one for block in blocks for one in re.split(r"(?<=[.!?]) (?=[A-Z])", block)]
    counts = Counter(
        s for s in sentences if len(s.split()) >= WORDS and s.endswith((".", "!", "?"))
    )
    return [sentence for sentence, count in counts.items() if count > 1]


def moved(face: xr.Dataset, lips: np.ndarray) -> xr.Dataset:
    """Motion of a face that rises, with a given opening of the lips [m]."""
    skin, time = skin_of(face), np.linspace(0.0, 0.2, len(lips))
    rest = face["position"].values
    lift = np.outer(0.04 * time, [0.0, 0.0, 1.0])[:, None]
    markers = (rest[face["marker_node"].values] + lift).transpose(1, 2, 0)
    trajectory = xr.Dataset(
        {
            "position": (("marker", "axis", "time"), markers, {"units": "m"}),
            "surface_position": (("time", "surface_node", "axis"), rest[skin.node] + lift),
            "lip_opening": ("time", lips, {"units": "m"}),
        },
        coords={"time": ("time", time, {"units": "s"}), "marker": face["marker"].values,
                "axis": ["x", "y", "z"]},
        attrs={"output": 0.02, "sigma_max": 100e3, "origin": "simulated",
               "recorded_start": 0.0, "recorded_pace": 1.0, "face": "template"},
    )  # fmt: skip
    return with_surface(trajectory, face, skin)


def fitted_page() -> str:
    """Page of a face that was fitted to the landmarks of a simulated person."""
    fit = fit_face(template_face(resolution="coarse"), person_of(5).landmarks, simulated=True)
    return render_fit(fitted_face_page(fit))


def moved_head(folder: Path) -> str:
    """Page of a moving head of jaw and tongue."""
    head = build_head(["jaw", "tongue"], preset="man", tongue_resolution=150, contacts=[])
    motion = simulate_head(head, raised({"bi_GGP": 0.1}), duration=0.02)
    return head_page(*read_motion(write_motion(motion, head, folder / "motion.nc")))


def reports(folder: Path) -> dict[str, str]:
    """Reports of studies with few and many persons, one strategy, and two levels of a choice."""
    (folder / "cube.nc").write_bytes(b"")  # its digest is stated
    two = combine_cubes(
        {(100e3,): studied(3, 0.5), (300e3,): studied(4, -0.5)}, {"stress": [100e3, 300e3]}
    )
    two["stress"].attrs["units"] = "Pa"
    cubes = {
        "study, choices": two,
        "study, two persons": scores().isel(volunteer=[0, 1]),
        "study, one person": scores(volunteers=1, instructions=1),
        "study, one strategy": studied(3, 0.0).isel(strategy=[0]),
        "study, long names": scores(volunteers=2).assign_coords(
            volunteer=[f"{k}{LONG}" for k in range(2)], instruction=[f"{k}{LONG}" for k in range(2)]
        ),
    }
    return {name: render_report(Results(folder, cube)) for name, cube in cubes.items()}


@pytest.fixture(scope="module")
def pages(coarse: xr.Dataset, tmp_path_factory) -> dict[str, str]:
    """A page of each kind."""
    face = coarse
    data = emg(noise()).to_dataset(name="emg").assign_attrs(origin="simulated", source="a test")
    long = data.assign_coords(channel=[f"{k}{LONG}" for k in range(data.sizes["channel"])])
    moving = Shifted(face, skin_of(face))
    motion = moved(face, np.linspace(3e-3, 1e-3, 11))
    live = {
        f"live, sliders {sliders}, edits {edits}": live_page(
            face, skin_of(face), moving, words="sliders", sliders=sliders, edits=edits
        )
        for sliders in (True, False)
        for edits in (True, False)
    }
    return (
        live
        | reports(tmp_path_factory.mktemp("study"))
        | {
            "recording": recording_page(data),
            "face": face_page(face),
            "motion": motion_page(motion),
            "two motions": motion_page(motion, compared=motion),
            "jaw": page(template_jaw().assign_attrs(schema="jaw_model")),
            "tongue": page(
                template_tongue(resolution="coarse").assign_attrs(schema="tongue_model")
            ),
            "tongue motion": page(small_tongue_motion()),
            "cube": page(simulated_scores(3)),
            "jaw motion": jaw_page(
                simulate_jaw(template_jaw(), raised({"bi_open": 0.2}), duration=0.02)
            ),
            "head motion": moved_head(tmp_path_factory.mktemp("head")),
            "treatment": of_treatment(face),
            "long names": motion_page(motion.assign_attrs(volunteer=LONG, face=LONG)),
            "recording with long names": recording_page(long),
            "fit": fitted_page(),
        }
    )


def test_the_search_finds_a_repeated_sentence() -> None:
    text = "<p>The face is simulated. It moves up.</p><p>Other words. The face is simulated.</p>"
    assert repeated(text) == ["The face is simulated."]
    assert repeated("<p>The face\nis simulated. The face is simulated.</p>") == [
        "The face is simulated."
    ]
    assert repeated("<p>The face is simulated.</p><script>The face is simulated.</script>") == []


def test_no_page_states_a_sentence_twice(pages: dict[str, str]) -> None:
    repeats = {name: repeated(text) for name, text in pages.items()}
    assert not {name: twice for name, twice in repeats.items() if twice}


@needs_browser
def test_no_open_page_shows_a_sentence_twice(browser, pages, tmp_path) -> None:
    """Texts that the scripts of the pages write are included."""
    for name, text in pages.items():
        path = tmp_path / "page.html"
        path.write_text(text, encoding="utf-8")
        browser.get(path.as_uri())
        if 'id="stage"' in text:  # before its script has run, a page shows less
            until(browser, "return document.getElementById('stage').dataset.ready === 'yes'")
        shown = browser.execute_script(
            "return document.body.innerText.replaceAll('&', ' ').replaceAll('<', ' ')"
        ).replace("\n", "</p><p>")
        assert len(shown) > 20 or "<svg" in text, name
        assert repeated(f"<p>{shown}") == [], name


@needs_browser
def test_no_open_page_cuts_a_text_or_hides_it(browser, pages, tmp_path) -> None:
    """In two widths, with light and dark colours."""
    faults_by_page = {}
    for name, text in pages.items():
        path = tmp_path / "page.html"
        path.write_text(text, encoding="utf-8")
        browser.get(path.as_uri())
        if 'id="stage"' in text:
            until(browser, "return document.getElementById('stage').dataset.ready === 'yes'")
        browser.execute_script("document.querySelectorAll('details').forEach((d) => d.open = true)")
        if faults := faults_of(browser):
            faults_by_page[name] = faults
    assert not faults_by_page


@needs_browser
def test_the_search_finds_faults_of_a_layout(browser, tmp_path) -> None:
    path = tmp_path / "page.html"
    path.write_text(
        "<body style='background: white'><h1 style='overflow: hidden; width: 50px'>A_long_title</h1>"
        "<p style='color: #eee'>pale</p><table style='width: 1500px'><tr><td>wide</td></tr></table>"
        "<p>good</p><label style='display: inline-block; width: 9px; overflow-wrap: anywhere'>Track"
        "</label><svg width='50' height='20'><text x='30' y='10'>leaves it</text></svg></body>",
        encoding="utf-8",
    )
    browser.get(path.as_uri())
    faults = " ".join(faults_of(browser)["900, light"])
    for said in (
        "the page is 15",
        'breaks "Track"',
        '"A_long_title" is cut',
        '"pale" has a contrast of 1.2',
        "a text of a figure leaves it",
    ):
        assert said in faults, faults
    assert '"good"' not in faults


def test_a_page_states_how_far_the_lips_are_apart(coarse: xr.Dataset) -> None:
    opening = 1e3 * lip_opening(coarse, coarse["position"].values)
    assert opening > 0.5, "the lips of the template are apart without loads"
    words = f"the margins of the lips are {opening:.1f} mm apart"
    live = live_page(coarse, skin_of(coarse), Shifted(coarse, skin_of(coarse)), words="sliders",
                     sliders=True, edits=False)  # fmt: skip
    assert words in face_page(coarse) and words in live
    closed = coarse.copy(deep=True)
    top, bottom = closed["lip_opening_node"].values
    closed["position"][top] = closed["position"][bottom].values
    assert "0.0 mm apart" in lips_at_rest(closed)
    assert lips_at_rest(coarse.drop_vars("lip_opening_node")) == ""


def test_the_closest_lips_of_a_motion_are_stated(coarse: xr.Dataset) -> None:
    apart = lips_of_motion(moved(coarse, np.array([2.85e-3, 0.21e-3, np.nan])))
    assert "2.9 mm apart in the midline at the start, and 0.2 mm where they are closest" in apart
    assert "(at 0.10 s)" in apart
    passed = lips_of_motion(moved(coarse, np.array([2.85e-3, 1e-3, -0.4e-3])))
    assert "at 0.20 s one lip is in front of the other by 0.4 mm" in passed
    touching = lips_of_motion(moved(coarse, np.array([2.85e-3, -0.02e-3, 1e-3])))
    assert "and 0.0 mm where they are closest (at 0.10 s)" in touching
    assert lips_of_motion(moved(coarse, np.full(3, np.nan))) == ""
    assert "2.9 mm apart" in motion_page(moved(coarse, np.array([2.85e-3, 1e-3, 1e-3])))
