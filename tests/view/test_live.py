"""Live session: sliders, streams that fail, the log, and the page in a browser."""

import json
import os
import signal
import subprocess
import threading
import time

import numpy as np
import pytest

from emgface.children import child_environment, python_command
from emgface.errors import SignalError
from emgface.face.simulation_parameters import SimulationParameters
from emgface.muscles import CHANNELS, MUSCLES
from emgface.pictures.body import skin_of
from emgface.pictures.encoding import QUANTUM, middle_of
from emgface.schema.netcdf import read_netcdf, write_netcdf
from emgface.view.curves import Curves
from emgface.view.live import HEAD, STILL, LiveSession, Semg, Sliders, frame_of
from emgface.view.moving import FullMoving, Moved
from emgface.view.page import live_page
from emgface.view.server import LocalServer
from emgface.view.workspace import Workspace
from sim import InvertedElement
from tests.browser import needs_browser, started, until

STEP = 0.01


class Shifted:
    """A face that moves along z by the sum of the activations, 1 mm each."""

    real_time = True
    step = STEP

    def __init__(self, face, skin, note=""):
        self.muscles = tuple(map(str, face["muscle"].values))
        self._rest = face["position"].values
        self._skin, self._markers, self._note = skin.node, face["marker_node"].values, note

    def reset(self):
        """Nothing to forget."""

    def __call__(self, activation):
        q = self._rest + np.array([0.0, 0.0, 1e-3]) * np.sum(activation)
        return Moved(q[self._skin], q[self._markers], 1e-4, 0.5, True, np.nan, self._note)


@pytest.fixture(scope="module")
def skin(coarse):
    return skin_of(coarse)


def session_of(face, skin, drive=None, **further):
    moving = Shifted(face, skin)
    markers = list(map(str, face["marker"].values))
    centre = middle_of(face["position"].values[skin.node])
    return LiveSession(
        moving, drive or Sliders(moving.muscles, STEP), markers, centre=centre, **further
    )


class Page:
    """Connection of a page that says some messages and keeps what it receives."""

    def __init__(self, *said):
        self.said, self.received, self.open = list(said), [], True
        self._more = threading.Semaphore(0)

    def send(self, message):
        self.received.append(message)

    def receive(self):
        if not self.said:
            self.open = False
            return None
        message = self.said.pop(0)
        return message if isinstance(message, str) else json.dumps(message)


def test_a_slider_is_followed_at_a_limited_rate(coarse, skin):
    session = session_of(coarse, skin)
    page = Page({"kind": "activation", "values": [1.0] + [0.0] * 19})
    session.talk(page)
    session.run(0.15)
    found = session.log.dataset({})
    np.testing.assert_allclose(
        found["activation"][0], np.minimum(0.1 * np.arange(1, 16), 1.0), atol=1e-12
    )
    np.testing.assert_allclose(found["time"], STEP * np.arange(1, 16))
    rise = (
        found["position"].sel(axis="z")
        - coarse["position"].values[coarse["marker_node"].values[0], 2]
    )
    np.testing.assert_allclose(rise[0], 1e-3 * found["activation"].sum("muscle"), atol=1e-12)


def test_the_log_is_an_activation_that_can_be_simulated_again(coarse, skin, tmp_path):
    session = session_of(coarse, skin)
    session.run(0.05)
    data = session.log.dataset({"source": "sliders", "step": STEP})
    path = write_netcdf(data, tmp_path / "log.nc", "activation")
    again = read_netcdf(path, "activation")
    assert again.attrs["origin"] == "simulated"
    np.testing.assert_array_equal(again["activation"], data["activation"])


@pytest.mark.parametrize(
    ("message", "expected"),
    [
        ({"kind": "activation", "values": [1]}, "no 20 numbers"),
        ({"kind": "activation", "values": [float("nan")] * 20}, "no 20 numbers"),
        ({"kind": "activation", "values": [2.0] * 20}, "outside 0 to 1"),
        ({"kind": "activation", "values": ["a"] * 20}, "no 20 numbers"),
        ({"kind": "activation", "values": {"a": 1}}, "no 20 numbers"),
        ({"kind": "activation"}, "no 20 numbers"),
        ({"kind": "curves", "knots": {}, "duration": 1.0}, "curves require a reduced face"),
        ({"kind": "delete everything"}, "unknown kind"),
        ([1], "unknown kind"),
        (1, "unknown kind"),
        (None, "unknown kind"),
        ("no JSON", "not JSON"),
        ("[" * 100_000, "not JSON"),
    ],
)
def test_messages_that_a_page_must_not_send(coarse, skin, message, expected):
    """They are answered by a sentence, and nothing changes."""
    session = session_of(coarse, skin)
    page = Page(message)
    session.talk(page)
    (answer,) = [json.loads(one) for one in page.received if isinstance(one, str)]
    assert answer["kind"] == "refused" and expected in answer["why"]
    assert not session.drive.wanted.any()


class Source:
    """Frames of sEMG, some of which are errors or not numbers."""

    rate, channels = 2000.0, CHANNELS

    def __init__(self, *frames):
        self.frames, self.starts = list(frames), 0

    def start(self):
        self.starts += 1

    def now(self):
        return time.perf_counter()

    def frame(self, k):
        one = self.frames.pop(0)
        if isinstance(one, Exception):
            raise one
        return one, self.now(), 0


def test_a_stream_that_stalls_or_sends_no_numbers_is_survived(coarse, skin):
    burst = 1e-4 * np.random.default_rng(0).normal(size=(len(CHANNELS), 20))
    damaged = burst.copy()
    damaged[:, 3] = np.nan
    source = Source(burst, SignalError("the stream has sent no samples"), burst, damaged, burst)
    drive = Semg(source, MUSCLES, (np.zeros(20), np.full(20, 1e-5)), "stream")
    session = session_of(coarse, skin, drive)
    session.run(5 * STEP)
    found = session.log.dataset({})["activation"].max("muscle").values
    assert found[0] > 0.5 and found[1] == 0.0 and np.isfinite(found).all()
    assert (found[2:] > 0.1).all()  # one value that is no number does not stay in the filter
    notes = [text for _, text in session.log.notes]
    assert "no samples" in notes[0] and "not numbers" in notes[1] and len(notes) == 2
    assert source.starts == 3  # at first, when the session began, and after the stall


def test_pages_receive_the_newest_frame_after_they_have_drawn(coarse, skin):
    session = session_of(coarse, skin)
    page, wait = Page(), threading.Event()

    def receive():
        wait.wait()
        page.open = False

    page.receive = receive
    thread = threading.Thread(target=session.talk, args=(page,), daemon=True)
    thread.start()
    runner = threading.Thread(target=session.run, args=(30.0,), daemon=True)
    runner.start()
    limit = time.monotonic() + 20.0
    while not page.received and time.monotonic() < limit:
        time.sleep(0.02)
    steps = len(session.log.rows)
    while len(session.log.rows) < steps + 20 and time.monotonic() < limit:
        time.sleep(0.02)
    session.ended = True
    wait.set()
    for one in (thread, runner):
        one.join(5.0)
    assert len(page.received) == 1  # the page never said that it had drawn
    (frame,) = page.received
    size = 4 * (len(HEAD) + 20) + 6 * (len(skin.node) + coarse.sizes["marker"])
    assert len(frame) == size


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such signals")
@pytest.mark.parametrize("ending", ["SIGTERM", "SIGHUP"])
def test_a_program_that_is_ended_writes_its_log(tmp_path, ending):
    """As Ctrl-C does: a closed terminal loses nothing."""
    words = ["live", "--resolution", "coarse", "--no-open", "--log", str(tmp_path / "log.nc")]
    process = subprocess.Popen(
        python_command("-m", "emgface", *words), stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        text=True, env={**child_environment(), "PYTHONUNBUFFERED": "1"},
    )  # fmt: skip
    for line in process.stdout:
        if "writes the log" in line:
            break
    time.sleep(3.0)
    process.send_signal(getattr(signal, ending))
    said = process.communicate(timeout=120)[0]
    assert process.returncode == 0 and (tmp_path / "log.nc").exists(), said


def test_a_frame_contains_the_positions(coarse, skin):
    moving, centre = Shifted(coarse, skin), np.array([0.01, 0.02, 0.03])
    activation = np.linspace(0.0, 1.0, 20)
    moved = moving(activation)
    frame = frame_of(np.arange(len(HEAD), dtype=float), activation, moved, centre)
    numbers = np.frombuffer(frame[: 4 * (len(HEAD) + 20)], "<f4")
    np.testing.assert_allclose(numbers[len(HEAD) :], activation, atol=1e-7)
    points = QUANTUM * np.frombuffer(frame[4 * (len(HEAD) + 20) :], "<i2").reshape(-1, 3) + centre
    np.testing.assert_allclose(points[: len(skin.node)], moved.skin, atol=QUANTUM)
    np.testing.assert_allclose(points[len(skin.node) :], moved.markers, atol=QUANTUM)


def test_a_face_at_full_order_moves_and_returns_to_rest(coarse, skin):
    parameters = SimulationParameters(accuracy="draft", contact={"method": "none"}, sigma_max=50e3)
    moving = FullMoving(coarse, parameters, skin, STEP)
    rest = moving(np.zeros(20)).skin
    for _ in range(5):
        moved = moving(np.full(20, 0.2))
    assert np.abs(moved.skin - rest).max() > 1e-4 and 0.0 < moved.smallest_J < 1.5
    moving.reset()
    np.testing.assert_allclose(moving(np.zeros(20)).skin, rest, atol=1e-9)


def test_a_failed_step_is_reported_and_the_face_goes_on(coarse, skin, monkeypatch):
    import emgface.view.moving as module
    from sim import InvertedElement

    parameters = SimulationParameters(accuracy="draft", contact={"method": "none"}, sigma_max=50e3)
    moving = FullMoving(coarse, parameters, skin, STEP)
    real = module.sim.simulate

    def fails(*given, **named):
        raise InvertedElement(1, -0.1, 0.2)

    monkeypatch.setattr(module.sim, "simulate", fails)
    moved = moving(np.full(20, 0.5))
    assert not moved.trusted and "returned to rest" in moved.note
    monkeypatch.setattr(module.sim, "simulate", real)
    assert not moving(np.zeros(20)).note


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    yield from started(tmp_path_factory.mktemp("profile"))


@pytest.fixture
def served(coarse, skin, tmp_path):
    """A session with its page; curves shift the face by the mean of each curve."""
    from emgface.pictures.encoding import QUANTUM

    asked = []
    centre = middle_of(coarse["position"].values[skin.node])
    rest = coarse["position"].values

    def forces(level):
        """Twice the sum of all curves, for every muscle [N]."""
        return np.repeat(2.0 * level[:, None], len(MUSCLES), axis=1).tolist()

    def motion(curves, *, preview=False):
        import struct

        asked.append((curves, preview))
        if curves.duration > 50.0:
            raise InvertedElement(3, -0.1, 0.2)
        t = np.linspace(0.0, curves.duration, 11)
        level = sum(curves.at(name, t) for name in curves.knots)
        q = rest[None] + 1e-3 * np.multiply.outer(level, np.array([[0.0, 0.0, 1.0]]))
        head = {"kind": "motion", "preview": preview, "time": t.tolist(), "bound": 1e-4, "doubt": "",
                "clipped": 0, "forces": None if preview else forces(level),
                "rho": {"corner_left": 0.75, "corner_right": None},
                "simulated": 0.0, "total": 0.0}  # fmt: skip
        text = json.dumps(head).encode()
        body = b"".join(
            np.round((q[:, node] - centre) / QUANTUM).astype("<i2").tobytes()
            for node in (skin.node, coarse["marker_node"].values)
        )
        if not preview:  # measured: the first marker only, 2 mm above the simulated ones
            measured = np.full((len(t), coarse.sizes["marker"], 3), -32768)
            above = q[:, coarse["marker_node"].values[0]] + [0.0, 0.0, 2e-3]
            measured[:, 0] = np.round((above - centre) / QUANTUM)
            body += measured.astype("<i2").tobytes()
        return struct.pack("<I", len(text)) + text + body

    session = session_of(coarse, skin, curves=motion)
    given = Curves({"ZYG_L": [[0.0, 0.0], [0.5, 0.5], [1.0, 0.0]]}, 1.0)
    (tmp_path / "face.nc").write_bytes(b"face")
    kept = Workspace.of(tmp_path / "work", {"face": tmp_path / "face.nc"}, MUSCLES)
    text = live_page(coarse, skin, session.face, words="activations by sliders", sliders=True,
                     edits=True, curves=given, workspace=kept)  # fmt: skip
    from emgface.cli.live import _opened

    server = LocalServer(text, talk=session.talk, post={"curves": _opened, "workspace": kept.save})
    server.start()
    thread = threading.Thread(target=session.run, args=(60.0,), daemon=True)
    thread.start()
    yield session, server, asked
    session.ended = True
    server.stop()


STAGE = "document.getElementById('stage').dataset"


def press(browser, control):
    browser.execute_script(f"document.getElementById('{control}').click()")


def soon(browser, condition):
    limit = time.monotonic() + 20.0
    while not condition():
        assert time.monotonic() < limit, browser.get_log("browser")
        time.sleep(0.02)


@pytest.fixture
def opened(served, browser):
    """The browser with the page of a session, whose console and requests are judged at the end."""
    _, server, _ = served
    browser.get_log("browser")
    browser.get_log("performance")
    browser.get(server.url)
    until(browser, f"return {STAGE}.ready === 'yes' && {STAGE}.connected === 'yes'")
    yield browser
    assert not [e for e in browser.get_log("browser") if e["level"] == "SEVERE"
                and "favicon" not in e["message"]]  # fmt: skip
    own = server.url.split("/")[2]
    for entry in browser.get_log("performance"):
        message = json.loads(entry["message"])["message"]
        if message["method"] == "Network.requestWillBeSent":
            url = message["params"]["request"]["url"]
            assert url.startswith(("data:", "blob:", f"http://{own}/", "chrome:")), url


@needs_browser
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


@needs_browser
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
    again = Workspace.of(tmp_path / "work", {"face": tmp_path / "face.nc"}, MUSCLES)
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
    found = opened.execute_async_script(
        "const done = arguments[0];"
        "fetch('curves', {method: 'POST', body: 'x,y'}).then(r => r.json()).then(done)"
    )
    assert "expected time" in found["why"]


@needs_browser
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
    told = opened.execute_script("return document.getElementById('told').textContent")
    assert "the motion of the former curves" in told
    opened.execute_script(
        "const t = document.getElementById('time'); t.value = 3; t.dispatchEvent(new Event('input'))"
    )
    until(opened, f"return {STAGE}.at === '3'")
    assert force() == "" and status() == ""
    press(opened, "undo-curve")


class Waiting(Page):
    """Page that stays open until it is closed."""

    def receive(self):
        self._more.acquire()
        self.open = False

    def close(self):
        self._more.release()


def test_every_page_hears_the_notes(coarse, skin):
    """Two pages at once; each hears a note once, and is sent frames."""
    session = session_of(coarse, skin)
    session.face._note = "A step failed."
    pages = [Waiting(), Waiting()]
    threads = [threading.Thread(target=session.talk, args=(page,), daemon=True) for page in pages]
    for one in threads:
        one.start()
    session.run(0.5)
    for page, thread in zip(pages, threads, strict=True):
        page.close()
        thread.join(10.0)
        texts = [json.loads(m)["text"] for m in page.received if isinstance(m, str)]
        assert texts == ["A step failed."]
        assert any(isinstance(m, bytes) for m in page.received)


class Asking(Waiting):
    """Page that asks for something, and then stays open."""

    def __init__(self, message):
        super().__init__()
        self._message = message

    def receive(self):
        if message := self._message:
            self._message = None
            return json.dumps(message)
        return super().receive()


def test_other_pages_hear_why_the_face_stands_still(coarse, skin):
    """A page that edits curves stops the live face of all pages; a page alone is told nothing."""
    for others in (1, 0):
        session = session_of(coarse, skin)
        pages = [Waiting() for _ in range(others)] + [Asking({"kind": "still"})]
        threads = []
        for page in pages:
            threads.append(threading.Thread(target=session.talk, args=(page,), daemon=True))
            threads[-1].start()
            time.sleep(0.1)
        worker = threading.Thread(target=session.run, args=(60.0,), daemon=True)
        worker.start()
        limit = time.monotonic() + 20.0
        while others and not any(isinstance(m, str) for m in pages[0].received):
            assert time.monotonic() < limit
            time.sleep(0.02)
        session.ended = True
        for page, thread in zip(pages, threads, strict=True):
            page.close()
            thread.join(10.0)
        worker.join(10.0)
        texts = [json.loads(m)["text"] for m in pages[0].received if isinstance(m, str)]
        assert texts == ([STILL] if others else [])


def test_a_step_is_not_delayed_by_drawing(coarse, skin, monkeypatch):
    """Without a page, no frame is encoded."""
    monkeypatch.setattr("emgface.view.live.frame_of", lambda *given: pytest.fail("encoded"))
    session = session_of(coarse, skin)
    session.run(0.1)
    assert len(session.log.rows) == 10


def test_missed_time_is_left_out_and_told(coarse, skin):
    """A step that takes long is followed by steps at their time, not by a series of late ones."""
    session = session_of(coarse, skin)
    whole, calls = session.face, []

    class Slow(Shifted):
        def __call__(self, activation):
            calls.append(time.perf_counter())
            if len(calls) == 6:  # the first loads the kernels
                time.sleep(1.0)
            return whole(activation)

    session.face = Slow(coarse, skin)
    session.run(0.3)
    assert len(session.log.rows) == 30
    assert [text[:21] for _, text in session.log.notes][:1] == ["The computer was busy"]
    # Making up for it would need no time; the 24 steps that are left take their own.
    assert calls[-1] - calls[6] > 0.2
