"""Keyboard: every control of every page has a name, is reached, shows that it is, and acts."""

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import xarray as xr

from emgface.muscles import MUSCLES
from emgface.pictures.body import skin_of
from emgface.pictures.page import face_page, motion_page
from emgface.pictures.surface import with_surface
from emgface.treatment.motions import ComparedMotions
from emgface.treatment.outcomes import movement_table, outcome_table
from emgface.treatment.pages import compare_page
from emgface.view.recording import recording_page
from tests.browser import needs_browser, until
from tests.data.made_recordings import emg, noise

CONTROLS = """
const all = [...document.querySelectorAll('a[href], button, input, select, textarea, [tabindex]')];
for (const e of all) delete e.dataset.walk;
const seen = all.filter((e) => !e.disabled && e.tabIndex >= 0 && e.getClientRects().length);
return seen.map((e, i) => { e.dataset.walk = i; return {
  walk: String(i), tag: e.tagName, type: e.type || '', shown: e.id || e.textContent.trim(),
  other: e.type === 'radio' && !e.checked, tab: e.role === 'tab' || e.type === 'file',
  only: e.readOnly || (e.type === 'radio' && e.checked) || e.options?.length < 2,
}; });
"""
FOCUSED = """
const e = document.activeElement, s = getComputedStyle(e);
return [e.dataset.walk ?? e.tagName, s.outlineStyle !== 'none' || s.boxShadow !== 'none'];
"""
STATE = """
const parts = {};
for (const e of document.querySelectorAll('body *')) {
  const name = e.dataset.walk ?? e.id;
  if (!name) continue;
  parts[`${name}:text`] = e.children.length ? e.children.length : e.textContent;
  for (const a of e.attributes) parts[`${name}:${a.name}`] = a.value;
  for (const k of ['value', 'checked', 'scrollLeft', 'scrollTop']) parts[`${name}:${k}`] = e[k];
  if (e.tagName === 'CANVAS' && !e.dataset.drawn) parts[`${name}:drawn`] = e.toDataURL();
}
return parts;
"""
LOOP = "const e = document.getElementById('loop'); if (e && !e.checked) e.click();"
LEFT, RIGHT, UP, DOWN, TAB = "\ue012", "\ue014", "\ue013", "\ue015", "\ue004"
PAGE, INSERT = "\ue00f", "\ue016"
KEYS = {"range": RIGHT + LEFT, "checkbox": " ", "radio": " ", "number": "3", "search": "z",
        "text": "n", "TEXTAREA": "n", "SELECT": DOWN + UP, "BUTTON": " ",
        "CANVAS": RIGHT + LEFT + "+" + PAGE + INSERT}  # fmt: skip
"""Keys that act on a control, each of which is tried until the page changes."""


def lifted(face: xr.Dataset) -> tuple[xr.Dataset, xr.Dataset]:
    """A face that rises by 4 mm within 0.1 s, and its activation."""
    drawn, instants = skin_of(face), np.linspace(0.0, 0.1, 6)
    lift = np.multiply.outer(0.04 * instants, [[0.0, 0.0, 1.0]])
    rest = face["position"].values
    lips = rest[face["marker_node"].values] + lift
    motion = xr.Dataset(
        {"position": (("time", "marker", "axis"), lips, {"units": "m"}),
         "surface_position": (("time", "surface_node", "axis"), rest[drawn.node] + lift)},
        {"time": ("time", instants, {"units": "s"}), "marker": face["marker"].values,
         "axis": ["x", "y", "z"]},
        {"output": 0.02, "sigma_max": 100e3, "origin": "simulated", "instruction": "D",
         "volunteer": "S01", "recorded_start": 0.0, "recorded_pace": 1.0, "face": "template"},
    )  # fmt: skip
    level = 0.5 * np.ones((len(MUSCLES), len(instants)))
    drive = xr.Dataset(
        {"activation": (("muscle", "time"), level)},
        {"muscle": list(MUSCLES), "time": ("time", instants, {"units": "s"})},
    )
    return with_surface(motion, face, drawn), drive


def of_motion(face: xr.Dataset) -> str:
    motion, drive = lifted(face)
    other = motion.assign(position=motion["position"] + 1e-3).assign_attrs(sigma_max=50e3)
    return motion_page(motion, drive, compared=other)


def of_recording(_: xr.Dataset) -> str:
    data = emg(noise()).to_dataset(name="emg").assign_attrs(origin="simulated")
    return recording_page(data)


def of_treatment(face: xr.Dataset) -> str:
    motion, drive = lifted(face)
    motions = ComparedMotions({"D": motion}, {"D": motion}, {"D": "smile"}, "Lifted.", {})
    tables = outcome_table(face, face, motions), movement_table(motions)
    return compare_page(face, face, motions, {"D": drive["activation"]}, tables)


PAGES: dict[str, Callable[[xr.Dataset], str]] = {
    "recording": of_recording, "face": face_page, "motion": of_motion, "treatment": of_treatment,
}  # fmt: skip


@needs_browser
@pytest.mark.parametrize("kind", PAGES)
def test_pages_in_files_need_no_pointer(coarse, browser, tmp_path, kind):
    path = tmp_path / "page.html"
    path.write_text(PAGES[kind](coarse), encoding="utf-8")
    browser.get(path.as_uri())
    walked(browser, at_least=12)


@needs_browser
def test_the_live_page_needs_no_pointer(served, browser):  # noqa: F811
    _, server, _ = served
    browser.get(server.url)
    until(browser, "return document.getElementById('stage').dataset.connected === 'yes'")
    walked(browser, at_least=30)
    browser.find_element("id", "tab-curves").send_keys(" ")
    until(browser, "return !document.getElementById('curves').hidden")
    walked(browser, at_least=20)


def walked(browser: Any, at_least: int) -> None:
    """Reach each control by the tab key, and use it by its keys."""
    from selenium.webdriver.common.action_chains import ActionChains

    until(browser, "return [...document.querySelectorAll('canvas')]"
                   ".some((c) => c.dataset.ready === 'yes')")  # fmt: skip
    controls = browser.execute_script(CONTROLS)
    assert len(controls) >= at_least
    visible = {}
    browser.execute_script("document.activeElement.blur(); scrollTo(0, 0)")
    for _ in range(len(controls) + 5):
        ActionChains(browser).send_keys(TAB).perform()
        key, ring = browser.execute_script(FOCUSED)
        if key in visible:
            break
        visible[key] = ring
    for one in reversed(controls):  # what there is to undo comes after its button
        element = browser.find_element("css selector", f"[data-walk='{one['walk']}']")
        assert one["other"] or visible.get(one["walk"]), f"not reached or not marked: {one}"
        assert element.accessible_name, one
        keys = KEYS.get(one["type"]) or KEYS.get(one["tag"])
        if one["only"] or one["tab"] or one["tag"] in ("A", "DIV"):
            continue  # one choice, a dialogue of the browser, or a place that only scrolls
        assert keys, one
        browser.execute_script("arguments[0].focus()", element)
        chosen = ("aria-pressed", "aria-selected")
        if one["shown"] != "play" and "true" in map(element.get_attribute, chosen):
            continue  # the view or tab that is drawn
        if one["shown"] == "play":
            browser.execute_script(LOOP)  # so that it does not end by itself
        assert acts(browser, keys), f"no effect of {keys!r}: {one}"
        if element.text == "Pause":
            element.send_keys(keys)
            until(browser, "return document.getElementById('play').textContent === 'Play'")
    assert not [e for e in browser.get_log("browser") if e["level"] == "SEVERE"
                and "favicon" not in e["message"]]  # fmt: skip


def acts(browser: Any, keys: str) -> bool:
    """Return True if a key changes the page within two seconds, apart from what changes by itself."""
    from selenium.webdriver.common.action_chains import ActionChains

    earlier = browser.execute_script(STATE)
    time.sleep(0.3)
    before = browser.execute_script(STATE)
    still = {k for k in before if before[k] == earlier.get(k)}
    for key in keys:
        ActionChains(browser).send_keys(key).perform()
        limit = time.monotonic() + 2.0
        while time.monotonic() < limit:
            now = browser.execute_script(STATE)
            if any(now.get(k) != before[k] for k in still) or now.keys() - before.keys():
                return True
            time.sleep(0.05)
    return False
