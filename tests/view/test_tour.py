"""The tour of the documentation: its commands, its pictures, and the cheap part of their script."""

import io
import re
import sys
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import pytest
from PIL import Image

from emgface.pictures.page import face_page
from emgface.view.recording import recording_page
from tests.browser import needs_browser
from tests.data.made_recordings import emg, noise

DOCS = Path(__file__).parents[2] / "docs"
TEXT = (DOCS / "tour.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def tour():
    spec = spec_from_file_location("tour", DOCS / "tour" / "make.py")
    assert spec and spec.loader
    made = module_from_spec(spec)
    sys.modules["tour"] = made
    spec.loader.exec_module(made)
    return made


def test_the_commands_of_the_tour_are_those_of_its_pictures(tour):
    words = " ".join(TEXT.split())
    for name, command in tour.COMMANDS:
        # The tour opens some pages without a file.
        assert command in words or command.replace(f" --out {name}", "") in words, command
    assert tour.LIVE.replace(" --no-open", "") in words


def test_every_picture_is_shown_small_and_made_by_the_script(tour):
    shown = re.findall(r"!\[(.*?)\]\(tour/(\w+)\.png\)", TEXT)
    assert sorted(name for _, name in shown) == sorted(tour.SHOTS)
    for caption, name in shown:
        path = DOCS / "tour" / f"{name}.png"
        assert len(caption) > 40 and path.stat().st_size < 200_000
        with Image.open(path) as picture:
            assert picture.size == (1400, 900)


@needs_browser
def test_pictures_of_pages_that_need_no_simulation(tour, browser, coarse, tmp_path):
    """The actions of the script reach what they are for."""
    data = emg(noise()).to_dataset(name="emg").assign_attrs(origin="simulated")
    (tmp_path / "recording.html").write_text(recording_page(data), encoding="utf-8")
    (tmp_path / "face.html").write_text(face_page(coarse), encoding="utf-8")
    for name in ("recording", "pick"):
        content = tour.shot(browser, name, tmp_path)
        with Image.open(io.BytesIO(content)) as picture:
            assert len(picture.convert("RGB").resize((100, 80)).getcolors(10_000)) > 50
    assert browser.execute_script("return document.getElementById('stage').dataset.fine") == "true"
    written = browser.execute_script(
        "return [...document.querySelectorAll('#pick textarea, #pick pre, #pick output')]"
        ".map((one) => one.value || one.textContent).join('')"
    )
    assert "node = " in written
