"""Report in a browser: drawing, motion by the slider, and no network access."""

import base64
import io
import json
import re
import shutil
import time
import zlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from PIL import Image
from scipy.ndimage import binary_erosion

from emgface.pictures.body import body_of, skin_of
from emgface.pictures.encoding import QUANTUM
from emgface.pictures.render import VIEWS, Window, project, render
from emgface.report.write import write_page
from tests.browser import PATIENCE, needs_browser, started, until
from tests.study_run.conftest import leave_out_figures

pytestmark = [
    needs_browser,
    pytest.mark.filterwarnings("ignore::emgface.errors.FeatureWarning"),
]


@pytest.fixture(scope="module")
def page(shown: Path, tmp_path_factory) -> Path:
    """Report without figures, which no test of this file looks at."""
    folder = tmp_path_factory.mktemp("page")
    shutil.copytree(shown, folder / "study")
    with pytest.MonkeyPatch.context() as patch:
        leave_out_figures(patch)
        return write_page(folder / "study", folder / "report.html").path


@pytest.fixture(scope="module")
def browser(tmp_path_factory) -> Iterator:
    yield from started(tmp_path_factory.mktemp("profile"))


def opened(browser, page: Path, *, query: str = "") -> None:
    """Open the page, wait until the face is drawn, and clear the log."""
    browser.get_log("browser")
    browser.get_log("performance")
    browser.get(page.as_uri() + query)
    until(browser, "return document.getElementById('stage').dataset.ready === 'yes'")


def drawn(browser) -> np.ndarray:
    """Pixels of the face on the screen, once two pictures in a row agree."""
    # The page may still move under the face: what stands above it is laid out later.
    limit = time.monotonic() + PATIENCE
    before = None
    while True:
        now = photographed(browser)
        if before is not None and before.shape == now.shape and changed(before, now) == 0:
            return now
        assert time.monotonic() < limit, "the picture of the face does not come to rest"
        before = now


def photographed(browser) -> np.ndarray:
    """Pixels of the face after two frames of the page."""
    browser.execute_script(
        "document.getElementById('stage').scrollIntoView({block: 'center', behavior: 'instant'})"
    )
    script = "return new Promise(f => requestAnimationFrame(() => requestAnimationFrame(f)))"
    browser.execute_script(script)
    picture = browser.find_element("id", "stage").screenshot_as_png
    return np.asarray(Image.open(io.BytesIO(picture)).convert("RGB")).astype(int)


def slide(browser, fraction: float) -> int:
    """Move the slider by events; return the frame."""
    frame = browser.execute_script(
        "const t = document.getElementById('time'); t.value = Math.round(arguments[0] * t.max);"
        "t.dispatchEvent(new Event('input', {bubbles: true})); return Number(t.value)",
        fraction,
    )
    until(browser, f"return document.getElementById('stage').dataset.frame === '{frame}'")
    return frame


def changed(first: np.ndarray, second: np.ndarray) -> float:
    """Fraction of pixels whose difference exceeds that of anti-aliasing."""
    return float((abs(first - second).max(axis=2) > 24).mean())


@pytest.mark.parametrize("query", ["", "?plain"], ids=["webgl", "canvas"])
def test_slider_moves_the_face(browser, page: Path, query: str) -> None:
    opened(browser, page, query=query)
    way = browser.execute_script("return document.getElementById('stage').dataset.drawn")
    assert way in (("canvas",) if query else ("webgl", "canvas"))
    browser.execute_script(
        "for (const id of ['simulated', 'measured']) document.getElementById(id).click()"
    )
    slide(browser, 0.0)
    rest, again = drawn(browser), drawn(browser)
    assert changed(rest, again) == 0
    skin = (rest[..., 0] > rest[..., 2] + 25).mean()
    assert 0.1 < skin < 0.9, "no face is seen"
    assert slide(browser, 0.6) > 0
    moved = drawn(browser)
    assert changed(rest, moved) > 0.002
    assert browser.execute_script("return document.getElementById('clock').textContent") != "0.00 s"
    browser.execute_script("document.getElementById('simulated').click()")
    marked = drawn(browser)
    blue = (marked[..., 2] > marked[..., 0] + 60) & ~(moved[..., 2] > moved[..., 0] + 60)
    assert blue.sum() > 50, "no simulated markers are seen"


def test_the_page_draws_as_pictures_do(browser, page: Path, slab: xr.Dataset) -> None:
    """The canvas compared with the picture of the same surface, pixel by pixel."""
    skin = skin_of(slab)
    opened(browser, page)
    browser.execute_script(
        "for (const id of ['simulated', 'measured']) document.getElementById(id).click()"
    )
    motions = json.loads(re.search(r'id="motions">(.*?)</script>', page.read_text())[1])
    raw = zlib.decompress(base64.b64decode(motions["trials"][0]["skin"]))
    low, high = np.frombuffer(raw, np.uint8).reshape(2, -1)[:, : 3 * len(skin.node)].astype(int)
    rest = QUANTUM * (low | high << 8).astype(np.uint16).view(np.int16).reshape(-1, 3)
    for name, view in VIEWS.items():
        browser.execute_script(f"document.querySelector('[data-view={name}]').click()")
        slide(browser, 0.0)
        shown = drawn(browser)
        height, width = shown.shape[:2]
        spans = [np.ptp(project(rest, one)[:, :2], axis=0) for one in VIEWS.values()]
        half = max(0.53 * max(up, right * height / width) for right, up in spans)
        flat = project(rest, view)[:, :2]
        u, v = (flat.min(axis=0) + flat.max(axis=0)) / 2
        across = half * width / height
        window = Window(u - across, v - half, u + across, v + half)
        picture = render(body_of(slab, skin), rest, view, window, width)[:height].astype(int)
        inside = binary_erosion(picture[..., 3] == 255, iterations=3)  # outlines are smoothed
        inside[:60] = False  # buttons cover the canvas
        difference = abs(picture[..., :3] - shown[: len(picture)])[inside]
        assert inside.mean() > 0.04 and np.percentile(difference, 98) <= 8, name


def test_the_page_has_no_errors_and_no_requests(browser, page: Path) -> None:
    opened(browser, page)
    slide(browser, 0.5)
    severe = [one for one in browser.get_log("browser") if one["level"] in ("SEVERE", "WARNING")]
    # A software renderer warns that reading pixels, which only tests do, is slow.
    assert [one for one in severe if "ReadPixels" not in one["message"]] == []
    events = [json.loads(one["message"])["message"] for one in browser.get_log("performance")]
    asked = {
        event["params"]["request"]["url"].split(":")[0]
        for event in events
        if event["method"] == "Network.requestWillBeSent"
    }
    assert asked - {"chrome"} <= {"file", "data", "blob"}
    refused = browser.execute_async_script(
        "const done = arguments[0];"
        "document.addEventListener('securitypolicyviolation', e => done(e.violatedDirective));"
        "fetch('https://localhost:9/').catch(() => setTimeout(() => done('error'), 2000));"
    )
    assert refused == "connect-src"


def test_strategy_switch_keyboard_and_play(browser, page: Path) -> None:
    opened(browser, page)
    stage = "document.getElementById('stage')"
    assert browser.execute_script(f"return {stage}.dataset.trial") == "S01 B 1 act_all"
    slide(browser, 0.5)
    before = drawn(browser)
    frame = browser.execute_script(f"return {stage}.dataset.frame")
    browser.execute_script("document.querySelector('input[value=act_rel]').click()")
    until(browser, f"return {stage}.dataset.trial === 'S01 B 1 act_rel'")
    assert browser.execute_script(f"return {stage}.dataset.frame") == frame
    assert "act_rel" in browser.execute_script(f"return {stage}.getAttribute('aria-label')")
    from selenium.webdriver.common.keys import Keys

    front = drawn(browser)
    assert changed(before, front) >= 0
    browser.find_element("id", "stage").send_keys(Keys.ARROW_LEFT * 4)
    assert changed(front, drawn(browser)) > 0.01
    browser.execute_script("document.querySelector('[data-view=front]').click()")
    assert changed(front, drawn(browser)) < 0.001
    slide(browser, 0.0)
    browser.execute_script("document.getElementById('play').click()")
    until(browser, f"return Number({stage}.dataset.frame) > 2")
    browser.execute_script("document.getElementById('play').click()")


def test_phone_width_needs_no_sideways_scrolling(browser, page: Path) -> None:
    size = {"width": 390, "height": 844, "deviceScaleFactor": 1, "mobile": True}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    try:
        opened(browser, page)
        wide, stage = browser.execute_script(
            "return [document.documentElement.scrollWidth,"
            "document.getElementById('stage').getBoundingClientRect().width]"
        )
        assert wide <= 390 and stage > 300
    finally:
        browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
