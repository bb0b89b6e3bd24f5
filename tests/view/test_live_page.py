"""The page of a live face in a browser: sliders, curves, time and forces."""

import numpy as np
import pytest

from emgface.muscles import MUSCLES
from emgface.view.workspace import Workspace
from tests.browser import needs_browser, until
from tests.view.sessions import STAGE, press, soon

pytestmark = needs_browser


def test_sliders_of_the_page(served, opened):
    session, _, _ = served

    def levels():
        return np.round(session.drive.wanted, 3)

    index = session.face.muscles.index
    slide = ("const s = document.getElementById('slide-ZYG_L'); s.dispatchEvent(new PointerEvent("
             "'pointerdown')); s.value = 0.4; s.dispatchEvent(new Event('input'))")  # fmt: skip
    opened.execute_script(slide)
    soon(opened, lambda: levels()[index("ZYG_L")] == levels()[index("ZYG_R")] == 0.4)  # linked
    until(opened, f"return Number({STAGE}.reacted) > 0")  # drawn with another activation
    press(opened, "linked")
    opened.execute_script(slide.replace("0.4", "0.7"))
    soon(opened, lambda: levels()[index("ZYG_L")] == 0.7 and levels()[index("ZYG_R")] == 0.4)
    press(opened, "undo")
    soon(opened, lambda: levels()[index("ZYG_L")] == 0.4)
    opened.execute_script("document.querySelector('#presets button').click()")  # instruction A
    soon(opened, lambda: levels()[index("OOP_L")] == 0.3 and levels()[index("ZYG_L")] == 0.0)
    until(opened, "return document.getElementById('status').innerText.includes('ms')")
    press(opened, "rest")
    soon(opened, lambda: not levels().any())


def test_curves_and_time_of_the_page(served, opened, tmp_path):
    _, _, asked = served

    def last():
        return asked[-1][0].knots["ZYG_L"]

    press(opened, "tab-curves")
    until(opened, f"return Number({STAGE}.motion) >= 1")
    until(opened, "return document.getElementById('rho').innerText.includes('0.75')")
    assert "undefined" in opened.execute_script("return document.getElementById('rho').innerText")
    plot = opened.find_element("id", "curve")
    page_down, up, insert, delete = "\ue00f", "\ue013", "\ue016", "\ue017"
    for keys, expected in (
        ((page_down, page_down, up), lambda: abs(last()[1, 1] - 0.52) < 1e-9),
        ((insert,), lambda: len(last()) == 4),
        ((delete,), lambda: len(last()) == 3),
    ):
        plot.send_keys(*keys)
        soon(opened, expected)
    for control, expected in {
        "later": lambda: abs(last()[0, 0] - 0.02) < 1e-9,
        "earlier": lambda: abs(last()[0, 0]) < 1e-9,
        "longer": lambda: abs(last()[-1, 0] - 1.05) < 1e-9,
        "undo-curve": lambda: abs(last()[-1, 0] - 1.0) < 1e-9,
        "mirror": lambda: "ZYG_R" in asked[-1][0].knots,
        "exchange": lambda: "ZYG_R" in asked[-1][0].knots,
        "shorter": lambda: abs(last()[-1, 0] - 0.95) < 1e-9,
    }.items():
        press(opened, control)
        soon(opened, expected)
    opened.execute_script("document.getElementById('notes').value = 'late on the left'")
    press(opened, "keep")
    until(opened, f"return {STAGE}.kept === 'work'")
    again = Workspace.open(tmp_path / "work", {"face": tmp_path / "face.nc"}, MUSCLES)
    assert again.notes == "late on the left" and set(again.curves.knots) == set(asked[-1][0].knots)
    assert again.view["zoom"] == 1.0
    # A knot that is dragged: previews while it moves, a complete motion after it.
    before = len(asked)
    press(opened, "undo-curve")
    opened.execute_script(
        "const c = document.getElementById('curve'), b = c.getBoundingClientRect();"
        "c.setPointerCapture = () => {};"
        "const x = (t) => b.left + 34 + t * (c.clientWidth - 42);"
        "const y = (v) => b.top + 8 + (1 - v) * (c.clientHeight - 28);"
        "const at = (t, v, name) => c.dispatchEvent(new PointerEvent(name,"
        " {pointerId: 1, clientX: x(t), clientY: y(v)}));"
        "at(0.5, 0.52, 'pointerdown'); at(0.5, 0.9, 'pointermove'); at(0.5, 0.9, 'pointerup');"
    )
    soon(
        opened, lambda: abs(last()[1, 1] - 0.9) < 0.02 and not asked[-1][1] and len(asked) > before
    )
    # Time: a slider, and play.
    opened.execute_script(
        "const t = document.getElementById('time'); t.value = 5; t.dispatchEvent(new Event('input'))"
    )
    until(opened, f"return {STAGE}.at === '5'")
    assert opened.execute_script("return document.getElementById('clock').textContent") == "0.50 s"
    # The measured marker is drawn, and disappears with its box.
    assert not opened.execute_script(
        "return document.getElementById('measured').parentElement.hidden"
    )
    pictures = [opened.get_screenshot_as_base64()]
    for _ in range(2):
        shown = opened.execute_script(f"return {STAGE}.frames")
        press(opened, "measured")
        until(opened, f"return {STAGE}.frames !== '{shown}'")
        pictures.append(opened.get_screenshot_as_base64())
    assert pictures[0] == pictures[2] != pictures[1]
    press(opened, "play")
    until(opened, f"return {STAGE}.at !== '5'")
    answer = opened.execute_async_script(
        "const done = arguments[0];"
        "fetch('curves', {method: 'POST', body: 'x,y'}).then(r => r.json()).then(done)"
    )
    assert "expected time" in answer["why"]


@pytest.mark.parametrize(
    ("entered", "used"), [("0", 0.1), ("-1", 0.1), ("", 0.1), ("0.5", 0.5), ("1e9", 60.0)]
)
def test_the_duration_that_is_used_is_shown(served, opened, entered, used):
    _, _, asked = served
    press(opened, "tab-curves")
    until(opened, f"return Number({STAGE}.motion) >= 1")
    opened.execute_script(
        "const d = document.getElementById('duration'); d.value = arguments[0];"
        "d.dispatchEvent(new Event('change'))", entered,
    )  # fmt: skip
    soon(opened, lambda: asked[-1][0].duration == used)
    shown = opened.execute_script("return document.getElementById('duration').value")
    assert float(shown) == used


def test_the_controls_of_time_are_within_a_narrow_page(opened):
    press(opened, "tab-curves")
    until(opened, f"return Number({STAGE}.motion) >= 1")
    metrics = {"width": 420, "height": 380, "deviceScaleFactor": 1, "mobile": False}
    opened.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
    try:
        wide, beyond = opened.execute_script(
            "const bar = document.querySelector('.time'), end = bar.getBoundingClientRect().right;"
            "return [document.getElementById('time').getBoundingClientRect().width,"
            " [...bar.children].filter((c) => c.getBoundingClientRect().right > end).length]"
        )
    finally:
        opened.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
    assert wide > 60 and beyond == 0


def test_forces_are_those_of_the_changed_curves_or_none(served, opened):
    """Never those of the former curves: not during a drag, not after curves without a motion."""
    _, _, asked = served

    def status():
        return opened.execute_script("return document.getElementById('status').innerText")

    def force():
        return opened.execute_script(f"return {STAGE}.force")

    press(opened, "tab-curves")
    until(opened, f"return {STAGE}.force !== undefined && {STAGE}.way === 'complete'")
    opened.execute_script(
        "const m = document.getElementById('muscle'); m.value = 'ZYG_L';"
        "m.dispatchEvent(new Event('change')); const t = document.getElementById('time');"
        "t.value = 5; t.dispatchEvent(new Event('input'))"
    )
    until(opened, f"return {STAGE}.at === '5' && Number({STAGE}.force) === 1.0")
    assert "force of" in status() and "1.000 N, at most 1.000 N" in status()
    # A knot is dragged and held, then released.
    at = (
        "const c = document.getElementById('curve'), b = c.getBoundingClientRect();"
        "c.setPointerCapture = () => {};"
        "const at = (t, v, name) => c.dispatchEvent(new PointerEvent(name, {pointerId: 1,"
        " clientX: b.left + 34 + t * (c.clientWidth - 42),"
        " clientY: b.top + 8 + (1 - v) * (c.clientHeight - 28)}));"
    )
    before = opened.execute_script(f"return {STAGE}.motion")
    immediate = opened.execute_script(
        f"{at} at(0.5, 0.5, 'pointerdown'); at(0.5, 0.8, 'pointermove');"
        f"return [{STAGE}.force, document.getElementById('status').innerText]"
    )
    assert immediate[0] == "" and " N" not in immediate[1]
    until(opened, f"return {STAGE}.motion !== '{before}' && {STAGE}.way === 'preview'")
    assert force() == "" and "follows the complete motion" in status()
    opened.execute_script(f"{at} at(0.5, 0.8, 'pointerup');")
    until(opened, f"return {STAGE}.way === 'complete' && {STAGE}.force !== ''")
    level = float(asked[-1][0].at("ZYG_L", np.array([0.5]))[0])
    assert level > 0.7 and float(force()) == pytest.approx(2.0 * level)
    # Curves without a motion: neither a force nor a score of the former ones remains.
    opened.execute_script(
        "const d = document.getElementById('duration'); d.value = 55;"
        "d.dispatchEvent(new Event('change'))"
    )
    until(opened, f"return ({STAGE}.refused || '').includes('element 3')")
    assert force() == "" and status() == ""
    assert not opened.execute_script("return document.getElementById('rho').innerText")
    text = opened.execute_script("return document.getElementById('message').textContent")
    assert "the motion of the former curves" in text
    opened.execute_script(
        "const t = document.getElementById('time'); t.value = 3; t.dispatchEvent(new Event('input'))"
    )
    until(opened, f"return {STAGE}.at === '3'")
    assert force() == "" and status() == ""
    press(opened, "undo-curve")
