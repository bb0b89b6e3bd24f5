"""Names from files reorder and hide nothing in pages and terminals, and return to files unchanged."""

import ast
import io
import json
import re
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from emgface.characters import END_OF_ISOLATE, ISOLATE, isolated, visible
from emgface.cli import console
from emgface.pictures.body import skin_of
from emgface.pictures.page import Exact, as_json, environment, face_page, figure_page, motion_page
from emgface.recordings.labels import read_label_map
from emgface.report.results import Results
from emgface.report.write import render_report
from emgface.texts import read_toml
from emgface.view.page import live_page
from emgface.view.recording import RecordingPage, recording_page
from emgface.view.server import LocalServer
from tests.browser import needs_browser, until
from tests.data.made_recordings import emg, noise
from tests.study_run.test_report_contents import scores
from tests.view.sessions import Shifted
from tests.view.test_sentences import moved

ROOT = Path(__file__).parents[2]
CONTROLS = "\u202e\u202d\u2066\u200b\u200f\ufeff\x1b\x07\x00\x85\u2028\xad\udc80"
HOSTILE = f'V1{CONTROLS[:-1]}<b>"x"</b>'  # matplotlib draws no surrogates
HEBREW = "\u05d0\u05d1 \u05d2"
RAW = re.compile(f"[{CONTROLS}]")


@pytest.mark.parametrize("character", CONTROLS)
def test_a_character_without_shape_is_shown_as_its_code(character: str) -> None:
    shown = f"a[U+{ord(character):04X}]b"
    assert visible(f"a{character}b") == isolated(f"a{character}b") == shown
    page = environment().from_string("<p title='{{ name }}'>{{ name }}</p>")
    assert page.render(name=f"a{character}b") == f"<p title='{shown}'>{shown}</p>"
    assert json.loads(as_json({f"a{character}b": [f"a{character}b"]})) == {shown: [shown]}


@pytest.mark.parametrize(
    "text",
    [
        "ZYG_L",
        "ρ ≥ 0.5 µV\t1\n2",
        "Ångström – “x”",
        "\u0646\u0645\u06cc\u200c\u062e\u0648\u0627\u0647",
        "日本",
    ],
)
def test_other_texts_remain(text: str) -> None:
    assert visible(text) == text


def test_words_from_the_right_are_isolated() -> None:
    own = f"{ISOLATE}{HEBREW}{END_OF_ISOLATE}"
    assert isolated(f"{HEBREW} 1 A, {HEBREW} 2") == f"{own} 1 A, {own} 2"
    assert json.loads(as_json([Exact(HEBREW), HEBREW])) == [HEBREW, own]


def test_no_page_contains_a_hostile_name(coarse, tmp_path: Path) -> None:
    face = coarse.assign_attrs(name=HOSTILE, source=HOSTILE)
    motion = moved(face, np.linspace(3e-3, 1e-3, 11)).assign_attrs(face=HOSTILE, volunteer=HOSTILE)
    data = emg(noise()).to_dataset(name="emg").assign_attrs(origin="simulated", source=HOSTILE)
    data = data.assign_coords(channel=[f"{k}{HOSTILE}" for k in range(data.sizes["channel"])])
    (tmp_path / "cube.nc").write_bytes(b"")
    cube = scores(volunteers=2).assign_coords(
        volunteer=[f"{k}{HOSTILE}" for k in range(2)],
        instruction=[f"{k}{HOSTILE}" for k in range(2)],
    )
    pages = {
        "face": face_page(face),
        "motion": motion_page(motion),
        "live": live_page(face, skin_of(face), Shifted(face, skin_of(face)), words=HOSTILE,
                          sliders=True, edits=True),
        "recording": recording_page(data),
        "report": render_report(Results(tmp_path, cube)),
    }  # fmt: skip
    for name, text in pages.items():
        assert not RAW.search(text), name
        assert "<b>" not in text.replace("<figcaption><b>", ""), name
        assert "[U+202E]" in text, name
        text.encode()


def test_figures_of_pages_are_written_with_codes() -> None:
    from analysis.figures.style import blank

    figure = blank(3.0, 2.0)
    figure.suptitle(f"{HOSTILE} {HEBREW} 1")
    with pytest.warns(UserWarning, match="missing from font"):
        text = figure_page(figure)
    assert not RAW.search(text) and "[U+202E]" in text
    assert f"{ISOLATE}{HEBREW}{END_OF_ISOLATE} 1" in text


def test_no_other_place_makes_templates() -> None:
    """Texts enter pages through `environment` and `as_json`."""
    made = [
        path.relative_to(ROOT).as_posix()
        for path in (ROOT / "emgface").rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Call)
        and getattr(node.func, "id", "") in ("Environment", "Template")
    ]
    assert made == ["emgface/pictures/page.py"]


def test_a_name_moves_no_cursor(monkeypatch: pytest.MonkeyPatch) -> None:
    messages, results = io.StringIO(), io.StringIO()
    monkeypatch.setattr(console, "err", Console(file=messages, width=200))
    monkeypatch.setattr(console, "out", Console(file=results, force_terminal=True, width=200))
    hostile = "V1\x1b[2J\u202e\rx"
    console.say(hostile)
    console.warn(hostile, UserWarning)
    console.fail(ValueError(hostile))
    console.tell(hostile)
    console.show_table(console.Rows((hostile, "b"), ((hostile, hostile),)), hostile)
    for written in (messages.getvalue(), results.getvalue()):
        assert "\x1b[2J" not in written and "\u202e" not in written
        assert "V1[U+001B][2J[U+202E][U+000D]x" in written
    piped = io.StringIO()
    monkeypatch.setattr(console, "out", Console(file=piped))
    console.tell("label\u202e")  # data, such as a sidecar
    assert piped.getvalue() == "label\u202e\n"


@needs_browser
def test_a_mapping_contains_the_labels_of_the_file(browser, tmp_path: Path) -> None:
    data = emg(noise(4)).to_dataset(name="emg").assign_attrs(origin="simulated")
    data = data.assign_coords(channel=["EMG\u202e1", HEBREW, "ZYG_L", "<b>"])
    target = tmp_path / "mapping.toml"
    page = RecordingPage(data, HEBREW, mapping=target)
    server = LocalServer(
        page.html(served=True), get={"span": page.span}, post={"mapping": page.save}
    )
    server.start()
    try:
        browser.get(server.url)
        stage = "document.getElementById('traces').dataset"
        until(browser, f"return {stage}.ready === 'yes'")
        browser.execute_script(
            "const key = (k) => document.getElementById('traces').dispatchEvent(new KeyboardEvent("
            "'keydown', { key: k, bubbles: true })); key('b'); key('ArrowDown'); key('b');"
            "const name = document.getElementById('name'); name.value = 'ZYG_R';"
            "name.dispatchEvent(new Event('change')); document.getElementById('save').click();"
        )
        until(browser, f"return {stage}.saved === 'mapping.toml'")
    finally:
        server.stop()
    wrote = read_toml(target)
    assert wrote["unusable"]["channels"] == ["EMG\u202e1", HEBREW]
    assert wrote["channels"] == {
        "EMG\u202e1": "EMG\u202e1", HEBREW: "ZYG_R", "ZYG_L": "ZYG_L", "<b>": "<b>",
    }  # fmt: skip
    assert read_label_map(target).channels == wrote["channels"]


@needs_browser
def test_a_browser_keeps_words_after_a_name_behind_it(browser, coarse, tmp_path: Path) -> None:
    for name in (f"{HEBREW}", "a\u202eb", f"1{HOSTILE}"):
        motion = moved(coarse, np.linspace(3e-3, 1e-3, 11))
        text = motion_page(motion.assign_attrs(volunteer=name, instruction="D", repetition=1))
        path = tmp_path / "page.html"
        path.write_text(text, encoding="utf-8")
        browser.get(path.as_uri())
        places = browser.execute_script(
            "const node = document.querySelector('h1').firstChild, r = document.createRange();"
            "const at = (k) => { r.setStart(node, k); r.setEnd(node, k + 1);"
            " return r.getBoundingClientRect().left; };"
            "const text = node.data, k = text.lastIndexOf(' D 1');"
            "return [at(0), at(k - 1), at(k + 1), at(k + 3)];"
        )
        assert max(places[:2]) < places[2] < places[3], name
