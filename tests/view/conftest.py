"""Sessions with a page, open in a browser."""

import json
import threading

import numpy as np
import pytest

from emgface.muscles import MUSCLES
from emgface.pictures.body import skin_of
from emgface.pictures.encoding import QUANTUM, middle_of
from emgface.view.curves import Curves
from emgface.view.page import live_page
from emgface.view.server import LocalServer
from emgface.view.workspace import Workspace
from sim import InvertedElement
from tests.browser import started, until
from tests.view.sessions import STAGE, session_of


@pytest.fixture(scope="module")
def skin(coarse):
    return skin_of(coarse)


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    yield from started(tmp_path_factory.mktemp("profile"))


@pytest.fixture
def served(coarse, skin, tmp_path):
    """A session with its page; curves shift the face by the mean of each curve."""
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
    kept = Workspace.open(tmp_path / "work", {"face": tmp_path / "face.nc"}, MUSCLES)
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
