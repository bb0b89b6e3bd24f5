"""Live session: sliders, streams that fail, the log, and what its pages hear."""

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
from emgface.pictures.encoding import QUANTUM
from emgface.schema.netcdf import read_netcdf, write_netcdf
from emgface.view.curves import Curves
from emgface.view.frames import FRAME_NUMBERS, frame_of
from emgface.view.live import STILL_SENTENCE, Semg
from emgface.view.moving import FullMoving
from tests.view.sessions import STEP, Asking, Page, Shifted, Waiting, session_of


def test_a_slider_is_followed_at_a_limited_rate(coarse, skin):
    session = session_of(coarse, skin)
    page = Page({"kind": "activation", "values": [1.0] + [0.0] * 19})
    session.talk(page)
    session.run(0.15)
    logged = session.log.dataset({})
    np.testing.assert_allclose(
        logged["activation"][0], np.minimum(0.1 * np.arange(1, 16), 1.0), atol=1e-12
    )
    np.testing.assert_allclose(logged["time"], STEP * np.arange(1, 16))
    rise = (
        logged["position"].sel(axis="z")
        - coarse["position"].values[coarse["marker_node"].values[0], 2]
    )
    np.testing.assert_allclose(rise[0], 1e-3 * logged["activation"].sum("muscle"), atol=1e-12)


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
    logged = session.log.dataset({})["activation"].max("muscle").values
    assert logged[0] > 0.5 and logged[1] == 0.0 and np.isfinite(logged).all()
    assert (logged[2:] > 0.1).all()  # one value that is no number does not stay in the filter
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
    size = 4 * (len(FRAME_NUMBERS) + 20) + 6 * (len(skin.node) + coarse.sizes["marker"])
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
    frame = frame_of(np.arange(len(FRAME_NUMBERS), dtype=float), activation, moved, centre)
    numbers = np.frombuffer(frame[: 4 * (len(FRAME_NUMBERS) + 20)], "<f4")
    np.testing.assert_allclose(numbers[len(FRAME_NUMBERS) :], activation, atol=1e-7)
    points = (
        QUANTUM * np.frombuffer(frame[4 * (len(FRAME_NUMBERS) + 20) :], "<i2").reshape(-1, 3)
        + centre
    )
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


def test_other_pages_hear_why_the_face_stands_still(coarse, skin):
    """A page that edits curves stops the live face of all pages; a page alone receives nothing."""
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
        assert texts == ([STILL_SENTENCE] if others else [])


@pytest.mark.parametrize("message", ["still", "curves"])
def test_the_face_moves_again_when_the_page_that_edits_is_closed(coarse, skin, message):
    """Or loaded again, which begins with the sliders, also while a motion is computed."""
    closed = threading.Event()

    def motion(curves, *, preview):
        closed.wait(10.0)
        return b"motion"

    session = session_of(coarse, skin, curves=motion)
    curves = {"kind": "curves", "knots": {"ZYG_L": [[0.0, 0.0]]}, "duration": 0.2}
    page = Asking(curves if message == "curves" else {"kind": "still"})
    talk = threading.Thread(target=session.talk, args=(page,), daemon=True)
    run = threading.Thread(target=session.run, args=(60.0,), daemon=True)
    talk.start()
    time.sleep(0.1)
    run.start()
    time.sleep(0.2)
    standing = len(session.log.rows)
    page.close()
    talk.join(10.0)
    closed.set()
    limit = time.monotonic() + 10.0
    while len(session.log.rows) <= standing + 5 and time.monotonic() < limit:
        time.sleep(0.02)
    session.ended = True
    run.join(10.0)
    assert len(session.log.rows) > standing + 5


def test_a_step_is_not_delayed_by_drawing(coarse, skin, monkeypatch):
    """Without a page, no frame is encoded."""
    monkeypatch.setattr("emgface.view.live.frame_of", lambda *given: pytest.fail("encoded"))
    session = session_of(coarse, skin)
    session.run(0.1)
    assert len(session.log.rows) == 10


def test_missed_time_is_left_out_and_reported(coarse, skin):
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


class Editing(Waiting):
    """Page that asks for a motion, and for another one when it may."""

    def __init__(self, *said):
        super().__init__()
        self.said, self.next = list(said), threading.Event()
        self.next.set()

    def receive(self):
        if not self.said:
            return super().receive()
        self.next.wait(20.0)
        self.next.clear()
        return json.dumps(self.said.pop(0))


@pytest.mark.parametrize("same", [True, False])
def test_the_motion_of_a_preview_is_computed_ahead_until_another_is_wanted(coarse, skin, same):
    """The request for the complete motion of the same curves does not end it, any other does."""
    asked, ends = [], []
    knots = {"ZYG_L": [[0.0, 0.0], [0.5, 0.5], [1.0, 0.0]]}
    other = {"ZYG_L": [[0.0, 0.0], [0.5, 0.6], [1.0, 0.0]]}
    first = {"kind": "curves", "knots": knots, "duration": 1.0, "interpolation": "linear"}
    second = first | {"knots": knots if same else other}
    page = Editing(first | {"preview": True}, second | {"preview": False})

    def motion(curves, *, preview=False):
        asked.append((curves, preview))
        return b"motion"

    def ahead(curves, unwanted):
        assert curves.same(Curves(knots, 1.0)) and not unwanted()
        page.next.set()
        limit = time.monotonic() + 20.0
        while page.said and time.monotonic() < limit:
            time.sleep(0.01)
        time.sleep(0.1)
        ends.append(unwanted())

    session = session_of(coarse, skin, curves=motion, ahead=ahead)
    threads = [
        threading.Thread(target=session.talk, args=(page,), daemon=True),
        threading.Thread(target=session.run, args=(60.0,), daemon=True),
    ]
    for one in threads:
        one.start()
    limit = time.monotonic() + 20.0
    while len(asked) < 2 and time.monotonic() < limit:
        time.sleep(0.02)
    session.ended = True
    page.close()
    for one in threads:
        one.join(10.0)
    assert [preview for _, preview in asked] == [True, False]
    assert ends == [not same]
