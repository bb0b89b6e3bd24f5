"""Live face: activations from sliders or sEMG, one step at a time, sent to pages in the browser."""

import json
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from emgface.errors import DataError, SignalError
from emgface.reduced.live import CausalFeature, span_of, weights_of
from emgface.reduced.stream import SignalSource
from emgface.view.curves import Curves, curves_from
from emgface.view.frames import Log, frame_of
from emgface.view.moving import Moved, Moving
from emgface.view.server import Connection

Floats = NDArray[np.float64]

LARGEST_SLIDER_RATE: Final = 10.0
"""Largest change of an activation that follows a slider, per second of simulated time [1/s]."""
LIVE_FRAME_RATE: Final = 30.0  #: largest number of frames sent to a page per second
AGAIN: Final = 1.0  #: time after which a source that has stopped is asked again [s]
#: time without a request after which the motion of a preview is computed [s]
PREVIEW_DELAY: Final = 0.1
WAITING: Final = 0.25  #: time between looks at a page that has not drawn its frame yet [s]
LEFT_OUT: Final = 0.25
"""Delay after which sliders leave out the missed time instead of making up for it [s]."""
STILL_SENTENCE: Final = (
    "A page edits curves: the face stands still until a page returns to the sliders."
)
MOST_NOTES: Final = 10_000  #: largest number of notes in the log


class Drive(Protocol):
    """Origin of the activations of a live face."""

    name: str

    def start(self) -> None:
        """Begin with the next step."""
        ...

    def step(self, k: int) -> tuple[Floats, float, int, str]:
        """Activation (n_muscles,) of step k, its time of arrival [s], lost samples, and a note."""
        ...

    def now(self) -> float:
        """Time on the clock of the arrivals [s]."""
        ...

    def follow(self, began: float) -> None:
        """Continue after a pause, as if the first step had begun at an instant of `now`."""
        ...


class Sliders:
    """Activations that pages set; each follows its slider by `LARGEST_SLIDER_RATE` per second."""

    name = "sliders"

    def __init__(self, muscles: Sequence[str], step: float, *, real_time: bool = True) -> None:
        self.wanted = np.zeros(len(muscles))
        self._muscles, self._step, self._real_time = tuple(muscles), step, real_time
        self._current, self._begun = np.zeros(len(muscles)), 0.0

    def set(self, values: Any) -> None:
        """Set all sliders; DataError if the values are not one number in 0-1 for each muscle."""
        self.wanted = slider_levels(values, len(self._muscles))

    def start(self) -> None:
        """Begin now."""
        self._begun = self.now()

    def now(self) -> float:
        """Time of this computer [s]."""
        return time.perf_counter()

    def follow(self, began: float) -> None:
        """Continue after a pause."""
        self._begun = began

    def step(self, k: int) -> tuple[Floats, float, int, str]:
        """Activation at the end of step k, when its time has come."""
        due = self._begun + (k + 1) * self._step
        if self._real_time and (early := due - self.now()) > 0.0:
            time.sleep(early)
        most = LARGEST_SLIDER_RATE * self._step
        self._current = self._current + np.clip(self.wanted - self._current, -most, most)
        return self._current.copy(), due if self._real_time else self.now(), 0, ""


class Semg:
    """Activations from streamed sEMG: causal feature, divided by its range, limited to 0-1.

    A stream that stops is asked again every second, with the muscles at rest meanwhile.
    """

    def __init__(
        self,
        source: SignalSource,
        muscles: Sequence[str],
        between: tuple[Floats, Floats],
        name: str,
    ) -> None:
        self.name, self._source = name, source
        self._low, self._span = between[0], span_of(between)
        self._weights = weights_of(source.channels, muscles)
        self._rest = np.zeros(len(muscles))
        self.start()

    def start(self) -> None:
        """Forget what arrived before."""
        self._feature = CausalFeature(self._source.rate, self._weights)
        self._frame, self._silent_until = 0, 0.0
        self._source.start()

    def now(self) -> float:
        """Time on the clock of the source [s]."""
        return self._source.now()

    def follow(self, began: float) -> None:
        """Continue after a pause, without what arrived during it."""
        self.start()

    def step(self, k: int) -> tuple[Floats, float, int, str]:
        """Activation after the next frame of the source."""
        try:
            samples, arrived, lost = self._source.frame(self._frame)
            self._frame += 1
        except SignalError as error:
            note = f"{error} The muscles are at rest until samples arrive again."
            try:
                self.start()
            except Exception as failed:  # the transport library raises its own types
                note = f"{note} ({type(failed).__name__})"
                time.sleep(AGAIN)
            return self._rest.copy(), self.now(), 0, note
        note = ""
        if not np.isfinite(samples).all():
            note = "The source sent values that are not numbers; the last value replaces them."
        value = np.clip((self._feature(samples) - self._low) / self._span, 0.0, 1.0)
        return value, arrived, lost, note


def slider_levels(values: Any, count: int) -> Floats:
    """Activations (count,) of a message; DataError if they are not numbers in 0-1."""
    try:
        levels = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        levels = np.empty(0)
    if levels.shape != (count,) or not np.isfinite(levels).all():
        raise DataError(f"the message contains no {count} numbers, one for each muscle")
    if levels.min(initial=0.0) < 0.0 or levels.max(initial=0.0) > 1.0:
        raise DataError("an activation of the message is outside 0 to 1")
    return levels


class LiveSession:
    """Moves a face by a drive and sends it to any number of pages.

    Steps are taken in the thread that calls `run`; each page has a thread that receives and one that
    sends the newest frame after the page has drawn the former.
    """

    def __init__(
        self,
        face: Moving,
        drive: Drive,
        markers: Sequence[str],
        *,
        centre: Floats,
        curves: Callable[..., bytes] | None = None,
        ahead: Callable[[Curves, Callable[[], bool]], None] | None = None,
        further: Callable[[Floats, Floats], None] | None = None,
    ) -> None:
        self.face, self.drive = face, drive
        self.log = Log(face.muscles, tuple(markers))
        self._centre, self._curves, self._further = centre, curves, further
        self._new, self._number = threading.Condition(), 0
        self._newest: tuple[Floats, Floats, Moved] | None = None
        self._asked: list[tuple[Connection, Curves, bool]] = []
        # While nothing else is asked for, the complete motion of a preview is computed.
        self._ahead: Callable[[Curves, Callable[[], bool]], None] = ahead or (lambda *_: None)
        self._shown: Curves | None = None
        self._still = self._reset = self.ended = False
        self._editor: Connection | None = None  # the page for which the face stands still
        self._pages = self.dropped = 0

    def talk(self, connection: Connection) -> None:
        """Converse with one page until it closes."""
        ready = threading.Event()
        with self._new:
            self._pages += 1
        sender = threading.Thread(target=self._send, args=(connection, ready), daemon=True)
        sender.start()
        while (message := connection.receive()) is not None:
            try:
                self._hear(connection, message, ready)
            except DataError as error:
                connection.send(json.dumps({"kind": "refused", "why": str(error)}))
        with self._new:
            self._pages -= 1
            self._asked = [one for one in self._asked if one[0] is not connection]
            if self._editor is connection:  # it was closed or loaded again
                self._editor, self._still = None, False
            self._new.notify_all()
        ready.set()

    def _hear(self, connection: Connection, message: str | bytes, ready: threading.Event) -> None:
        try:
            parsed = json.loads(message) if isinstance(message, str) else None
        except (ValueError, RecursionError) as error:
            raise DataError("the message is not JSON") from error
        said: dict[str, Any] = parsed if isinstance(parsed, dict) else {}
        kind = said.get("kind")
        if kind == "drawn":
            ready.set()
        elif kind == "activation":
            if not isinstance(self.drive, Sliders):
                raise DataError(f"the activations come from {self.drive.name}, not from sliders")
            self.drive.set(said.get("values"))
            self._still = False
        elif kind == "curves":
            if self._curves is None:
                raise DataError("curves require a reduced face: start with --reduced FILE")
            curves = curves_from(said, self.face.muscles)
            self._editor = connection
            with self._new:
                self._asked = [one for one in self._asked if one[0] is not connection]
                self._asked.append((connection, curves, said.get("preview") is True))
                self._new.notify_all()
        elif kind == "rest":
            self._reset = True
        elif kind in ("still", "go"):
            self._still = kind == "still"
            self._editor = connection if self._still else None
            if self._still and self._pages > 1:
                self.note(self.log.last, STILL_SENTENCE)
        else:
            raise DataError("the message is of an unknown kind")

    def _send(self, connection: Connection, ready: threading.Event) -> None:
        """Send the newest frame whenever the page has drawn the former one, and all notes.

        Only frames that are sent are encoded, in this thread: drawing does not delay the steps.
        """
        sent, last, noted = 0, 0.0, len(self.log.notes)
        ready.set()
        while connection.open and not self.ended:
            if not ready.wait(WAITING) or not connection.open:
                continue
            with self._new:
                if self._number <= sent:
                    self._new.wait(WAITING)
                new = self._number > sent
            notes = self.log.notes[noted:]
            noted += len(notes)
            for _, note in notes:
                connection.send(json.dumps({"kind": "note", "text": note}))
            if not new:
                continue
            if (early := last + 1.0 / LIVE_FRAME_RATE - time.perf_counter()) > 0.0:
                time.sleep(early)
            with self._new:
                newest, number = self._newest, self._number
            assert newest is not None  # its number is above 0
            self.dropped += max(number - sent - 1, 0) if sent else 0
            ready.clear()
            last, sent = time.perf_counter(), number
            connection.send(frame_of(*newest, self._centre))

    def run(self, seconds: float | None = None) -> None:
        """Take steps until the time is over, or for ever."""
        self.face(np.zeros(len(self.face.muscles)))  # loads the kernels before the clock starts
        self.face.reset()
        self.drive.start()
        k, began = 0, self.drive.now()
        try:
            while not self.ended and (seconds is None or k * self.face.step < seconds - 1e-9):
                if self._asked:
                    self._answer()
                    self._still, began = self._editor is not None, self._continue(k)
                    continue
                if self._still and self._shown is not None:
                    shown, self._shown = self._shown, None
                    # Drawing the preview must not wait for the processor.
                    with self._new:
                        moved_on = self._new.wait_for(lambda: bool(self._asked), PREVIEW_DELAY)
                    if not moved_on:
                        self._ahead(shown, lambda shown=shown: self._other_than(shown))
                    continue
                if self._still:
                    with self._new:
                        self._new.wait_for(lambda: bool(self._asked) or not self._still, WAITING)
                    began = self._continue(k)
                    continue
                if self._reset:
                    self._reset = False
                    self.face.reset()
                activation, arrived, lost, note = self.drive.step(k)
                begun = self.drive.now()
                moved = self.face(activation)
                done = self.drive.now()
                k += 1
                pace = k * self.face.step / max(done - began, 1e-9)
                self._publish(moved, activation, k, (done - arrived, done - begun, lost, pace))
                for text in filter(None, (note, moved.note)):
                    self.note(k * self.face.step, text)
                behind = done - arrived
                if self.face.real_time and behind > LEFT_OUT and isinstance(self.drive, Sliders):
                    began = self._continue(k)
                    text = f"The computer was busy: {behind:.2f} s were left out."
                    self.note(k * self.face.step, text)
        finally:
            self.ended = True
            with self._new:
                self._new.notify_all()

    def _continue(self, k: int) -> float:
        """Let step k be due now, and return the start that this corresponds to."""
        began = self.drive.now() - k * self.face.step
        self.drive.follow(began)
        return began

    def _answer(self) -> None:
        """Compute and send the motions of the curves that pages have asked for."""
        with self._new:
            asked, self._asked = self._asked, []
        _, shown, preview = asked[-1]
        self._shown = shown if preview else None
        for connection, curves, preview in asked:
            assert self._curves is not None
            try:
                connection.send(self._curves(curves, preview=preview))
            except Exception as error:
                from emgface.errors import EmgfaceError
                from sim import SimulationError

                if not isinstance(error, EmgfaceError | SimulationError):
                    raise
                connection.send(json.dumps({"kind": "refused", "why": str(error)}))

    def _other_than(self, curves: Curves) -> bool:
        """Return True if the page asks for anything but the complete motion of curves."""
        with self._new:
            asked = list(self._asked)
        other = any(preview or not one.same(curves) for _, one, preview in asked)
        return other or self.ended or not self._still

    def _publish(
        self, moved: Moved, activation: Floats, k: int, times: tuple[float, float, int, float]
    ) -> None:
        latency, computing, lost, pace = times
        late = float(self.face.real_time and latency > self.face.step)
        doubts = moved.bound, moved.distance, float(moved.trusted), moved.smallest_J
        row = np.array([k * self.face.step, latency, computing, *doubts, float(lost), late, pace])
        self.log.add(row, activation, moved.markers)
        if self._further:
            self._further(activation, moved.markers)
        with self._new:
            self._newest, self._number = (row, activation, moved), self._number + 1
            self._new.notify_all()

    def note(self, at: float, text: str) -> None:
        """Report a sentence to the pages and the log, once until another one follows."""
        notes = self.log.notes
        if (notes and notes[-1][1] == text) or len(notes) >= MOST_NOTES:
            return
        notes.append((round(at, 4), text))
