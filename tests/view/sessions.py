"""A face that is shifted, its live session, and pages that talk to it."""

import json
import threading
import time

import numpy as np

from emgface.pictures.encoding import middle_of
from emgface.view.live import LiveSession, Sliders
from emgface.view.moving import Moved

STEP = 0.01
STAGE = "document.getElementById('stage').dataset"


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


class Waiting(Page):
    """Page that stays open until it is closed."""

    def receive(self):
        self._more.acquire()
        self.open = False

    def close(self):
        self._more.release()


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


def press(browser, control):
    browser.execute_script(f"document.getElementById('{control}').click()")


def soon(browser, condition):
    limit = time.monotonic() + 20.0
    while not condition():
        assert time.monotonic() < limit, browser.get_log("browser")
        time.sleep(0.02)
