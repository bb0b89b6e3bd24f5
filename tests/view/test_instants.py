"""Instants: the frame that is scrubbed to has the vertices of the motion, as the one that is played."""

import zlib

import numpy as np
import pytest
import xarray as xr

from emgface.pictures.body import skin_of
from emgface.pictures.encoding import middle_of, whole
from emgface.pictures.page import motion_page
from emgface.pictures.show import page
from emgface.pictures.surface import drawn_surface, with_surface
from tests.browser import needs_browser, until
from tests.tongue.small import small_tongue_motion
from tests.view.sessions import press

STAGE = "document.getElementById('stage')"
SCRUB = (
    "const t = document.getElementById('time'); t.value = arguments[0];"
    "t.dispatchEvent(new Event('input'));"
)
WATCH = """
const [name, count, done] = arguments, seen = {}, stage = document.getElementById('stage');
document.getElementById('speed').value = '0.25';
document.getElementById('speed').dispatchEvent(new Event('change'));
const look = () => {
  (seen[stage.dataset[name]] ??= []).push(stage.checksum());
  if (Object.keys(seen).length < count) requestAnimationFrame(look); else done(seen);
};
document.getElementById('play').click();
requestAnimationFrame(look);
"""


def turned(face: xr.Dataset) -> xr.Dataset:
    """A face that rises and turns within 0.4 s, each of whose frames is another one."""
    own, time = skin_of(face), np.linspace(0.0, 0.4, 21)
    rest = face["position"].values
    angle = 0.3 * time
    turn = np.zeros((len(time), 3, 3))
    turn[:, 0, 0] = turn[:, 1, 1] = np.cos(angle)
    turn[:, 0, 1], turn[:, 1, 0] = -np.sin(angle), np.sin(angle)
    turn[:, 2, 2] = 1.0 + 0.05 * time
    q = np.einsum("tij,nj->tni", turn, rest)
    motion = xr.Dataset(
        {"position": (("time", "marker", "axis"), q[:, face["marker_node"].values], {"units": "m"}),
         "surface_position": (("time", "surface_node", "axis"), q[:, own.node])},
        {"time": ("time", time, {"units": "s"}), "marker": face["marker"].values,
         "axis": ["x", "y", "z"]},
        {"output": 0.02, "sigma_max": 100e3, "origin": "simulated", "face": "template",
         "recorded_start": 0.0, "recorded_pace": 1.0},
    )  # fmt: skip
    return with_surface(motion, face, own)


def sums(frames: np.ndarray) -> list[int]:
    """CRC-32 of frames (t, n, 3) [m] in the quanta of a page."""
    given = whole(frames, middle_of(frames[0])).astype("<i2")
    return [zlib.crc32(one.tobytes()) for one in given]


def drawn(browser) -> int:
    """Checksum of what is drawn, after the pictures that wait."""
    return browser.execute_async_script(
        "const done = arguments[0]; requestAnimationFrame(() => requestAnimationFrame(() =>"
        f" done({STAGE}.checksum())))"
    )


@needs_browser
def test_a_scrubbed_frame_is_that_of_the_motion_and_that_of_playing(coarse, browser, tmp_path):
    motion = turned(coarse)
    expected = sums(drawn_surface(motion)[2])
    assert len(set(expected)) == len(expected)
    path = tmp_path / "page.html"
    path.write_text(motion_page(motion), encoding="utf-8")
    browser.get(path.as_uri())
    until(browser, f"return {STAGE}.dataset.ready === 'yes'")
    order = np.random.default_rng(0).permutation(len(expected)).tolist()
    for k in order:
        browser.execute_script(SCRUB, k)
        until(browser, f"return {STAGE}.dataset.frame === '{k}'")
        assert drawn(browser) == expected[k], k
    browser.execute_script(SCRUB, 0)
    until(browser, f"return {STAGE}.dataset.frame === '0'")
    played = browser.execute_async_script(WATCH, "frame", 8)
    assert {int(k): set(v) for k, v in played.items()} == {
        int(k): {expected[int(k)]} for k in played
    }
    # The end is reached by playing as well.
    browser.execute_script(
        "document.getElementById('loop').checked = false;"
        "document.getElementById('speed').value = '1';"
        "document.getElementById('speed').dispatchEvent(new Event('change'))"
    )
    last = len(expected) - 1
    until(browser, f"return {STAGE}.dataset.frame === '{last}'")
    until(browser, "return document.getElementById('play').textContent === 'Play'")
    assert drawn(browser) == expected[last]


@needs_browser
def test_a_scrubbed_frame_of_edited_curves_is_that_of_playing(coarse, skin, served, opened):  # noqa: F811
    """The curve of one muscle lifts the face: the frames are those of the curve."""
    press(opened, "tab-curves")
    until(opened, f"return Number({STAGE}.dataset.motion) >= 1")
    curves = served[2][-1][0]
    level = sum(curves.at(name, np.linspace(0.0, curves.duration, 11)) for name in curves.knots)
    lift = 1e-3 * np.multiply.outer(level, np.array([[0.0, 0.0, 1.0]]))
    expected = sums(coarse["position"].values[skin.node] + lift)
    frames = []
    for k in range(11):
        opened.execute_script(SCRUB, k)
        until(opened, f"return {STAGE}.dataset.at === '{k}'")
        frames.append(drawn(opened))
    assert frames == expected
    opened.execute_script(SCRUB, 0)
    until(opened, f"return {STAGE}.dataset.at === '0'")
    played = opened.execute_async_script(WATCH, "at", 6)
    assert {int(k): set(v) for k, v in played.items()} == {
        int(k): {expected[int(k)]} for k in played
    }


@needs_browser
def test_forces_of_a_motion_are_tracked_under_the_cursor(coarse, browser, tmp_path):
    """A compared motion without the same forces has none; a muscle without a force is not offered."""
    motion = turned(coarse)
    count = motion.sizes["time"]
    force = np.zeros((3, count))
    force[0], force[1], force[2] = np.linspace(0.0, 4.0, count), 0.5, np.nan
    given = motion.assign(
        muscle_force=(("muscle", "time"), force, {"units": "N"}),
        contact_force=("time", np.linspace(2.0, 0.0, count), {"units": "N"}),
    ).assign_coords(muscle=["ZYG_L", "<b>RIS</b>", "OOP_R"])
    path = tmp_path / "page.html"
    path.write_text(motion_page(given, compared=motion), encoding="utf-8")
    browser.get(path.as_uri())
    until(browser, f"return {STAGE}.dataset.ready === 'yes'")
    offered = browser.execute_script(
        "return [...document.getElementById('track').options].map((o) => o.textContent)"
    )
    assert [o for o in offered if "force of" in o] == [
        "force of zygomaticus major, left", "force of <b>RIS</b>",
        "force of contact of the lips and teeth",
    ]  # fmt: skip
    choose = (
        "const t = document.getElementById('track'); t.value = arguments[0];"
        "t.dispatchEvent(new Event('change'))"
    )
    reading = "return document.getElementById('reading').textContent"
    for frame in (5, 2):
        browser.execute_script(SCRUB, frame)
        for name, expected in (("force ZYG_L", force[0, 2 * frame]), ("force <b>RIS</b>", 0.5),
                               ("force ", 2.0 - 0.1 * 2 * frame)):  # fmt: skip
            browser.execute_script(choose, name)
            drawn(browser)
            assert float(browser.execute_script(reading).split()[0]) == pytest.approx(
                expected, abs=5e-3
            )
    browser.execute_script(
        "const c = document.getElementById('compare'); c.value = '1';"
        "c.dispatchEvent(new Event('change'))"
    )
    until(browser, f"{reading}.includes('compared not available')")
    browser.execute_script(choose, str(coarse["marker"].values[0]))
    until(browser, f"{reading}.includes(' mm')")


@needs_browser
def test_instants_of_a_moving_tongue(browser, tmp_path):
    """Pages of other models are drawn by the same script."""
    path = tmp_path / "page.html"
    path.write_text(page(small_tongue_motion()), encoding="utf-8")
    browser.get(path.as_uri())
    until(browser, f"return {STAGE}.dataset.ready === 'yes'")
    count = int(browser.execute_script("return document.getElementById('time').max")) + 1
    frames = []
    for k in [*range(count), *reversed(range(count))]:
        browser.execute_script(SCRUB, k)
        until(browser, f"return {STAGE}.dataset.frame === '{k}'")
        frames.append(drawn(browser))
    assert frames == frames[::-1] and len(set(frames)) == count > 1
