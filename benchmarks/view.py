"""Pages that answer, in a headless browser: dragged knot to motion and rho, live minute, long recording.

    python -m benchmarks view FACE.nc FACE.rom.nc RECORDING.nc [--part drag] [--out FOLDER]

``drag``: 200 knots of curves are dragged in a window of 420 x 380 pixels; times are from the event of
the pointer until the picture with the changed motion was passed on, with the parts that the program
reports. ``live``: a minute of random slider moves, 30 per second; a frame is late if its step ended more
than a step after it was due, and dropped if the page had not drawn the former one when it was due.
``recording``: pictures per second while a generated recording of 64 channels, 1 h, 2 kHz is scrolled and
enlarged (``--page`` uses a page of a former run), in a window of 1400 x 900 pixels. ``motion``: pictures
per second while the page of a stored motion (``--motion``, such as that of a head) is turned and plays.
``waypoint``: processor time of a state that is saved, and of the steps between two. The browser draws
with the processor through an emulated graphics unit, ``recording`` and ``motion`` also without one.
"""

import os
import re
import signal
import subprocess
import tempfile
import time
from itertools import product
from pathlib import Path
from typing import Annotated
from unittest.mock import patch

import numpy as np
import pandas as pd
import typer
import xarray as xr

from benchmarks.report import finish, say
from emgface.children import child_environment, python_command
from emgface.errors import ConfigurationError

PARTS = ("drag", "live", "recording", "motion", "waypoint")
WAYS = {False: "no graphics unit", True: "emulated graphics unit"}
SIZE = (420, 380)  #: window of the browser [pixels]
DRAGS = 200
TOGETHER = 5  #: drags in one call, which must end within the patience of the driver
LIVE = 60.0  #: [s]
WARM = 10.0  #: time after which the memory is first read [s]
SEED = 0
SCRIPTS = dict(
    part.split("\n", 1)
    for part in Path(__file__).with_suffix(".js").read_text(encoding="utf-8").split("\n// ")[1:]
)
"""Scripts that the page runs, by name."""


def browser(width, height, *, emulated=True):
    """Headless Chromium that draws with the processor, through an emulated graphics unit or without."""
    from selenium import webdriver
    from selenium.webdriver.chrome.service import Service

    from tests.browser import CHROMIUM, DRIVER, FLAGS

    if not (CHROMIUM and DRIVER):
        raise ConfigurationError("no Chromium with chromedriver was found, expected both")
    options = webdriver.ChromeOptions()
    options.binary_location = CHROMIUM
    left_out = ("window-size",) if emulated else ("window-size", "angle", "swiftshader")
    flags = [f for f in FLAGS if not any(word in f for word in left_out)]
    for flag in (
        *flags,
        f"--window-size={width},{height}",
        *(() if emulated else ("--disable-gpu",)),
    ):
        options.add_argument(flag)
    made = webdriver.Chrome(options=options, service=Service(DRIVER))
    made.set_script_timeout(900)
    # A window has a least width and a frame.
    metrics = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
    made.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
    return made


def until(driver, script):
    """Wait for a condition in the page."""
    while not driver.execute_script(script):
        time.sleep(0.05)


def served(face, reduced, recording, log=None):
    """Process of ``emgface live`` and the address of its page."""
    words = [str(face), "--reduced", str(reduced), "--curves", str(recording), "--no-open"]
    words += [] if log is None else ["--log", str(log)]
    process = subprocess.Popen(
        python_command("-m", "emgface", "live", *words),
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        env={**child_environment(), "PYTHONUNBUFFERED": "1"},
        # A shell lets its background jobs ignore the signal that ends the program.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )  # fmt: skip
    text = ""
    for line in process.stdout:
        text += line
        if match := re.search(r"http://\S+/", text):
            return process, match[0]
    raise ConfigurationError(f"emgface live has ended: {text}")


def processor(pid):
    """Processor time [ms] of a process and of all that descend from it."""
    parents, ticks = {}, {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = stat.read_text().rpartition(")")[2].split()
        except OSError:  # it has ended meanwhile
            continue
        own = int(stat.parent.name)
        parents[own], ticks[own] = int(fields[1]), int(fields[11]) + int(fields[12])
    own, more = {pid}, {pid}
    while more := {child for child, parent in parents.items() if parent in more} - own:
        own |= more
    return 1e3 * sum(ticks.get(one, 0) for one in own) / os.sysconf("SC_CLK_TCK")


def page_time(driver):
    """Processor time [ms] of the main thread of a page; its domain is set by `watch_page`."""
    metrics = driver.execute_cdp_cmd("Performance.getMetrics", {})["metrics"]
    return 1e3 * next(one["value"] for one in metrics if one["name"] == "TaskDuration")


def watch_page(driver):
    """Count processor time, not elapsed time, of the main thread."""
    driver.execute_cdp_cmd("Performance.enable", {"timeDomain": "threadTicks"})


def memory(process):
    """Resident memory [MB] of a process and of those that it started."""
    pages = Path(f"/proc/{process.pid}/statm").read_text().split()[1]
    return int(pages) * 4096 / 1e6


def drags(driver, process, url):
    """Times [ms] of dragged knots."""
    watch_page(driver)
    driver.get(url)
    until(driver, "return document.getElementById('stage').dataset.connected === 'yes'")
    driver.execute_script("document.getElementById('tab-curves').click()")
    until(driver, "return document.getElementById('stage').dataset.shown === '1'")
    rng = np.random.default_rng(SEED)
    muscles = driver.execute_script(
        "return [...document.getElementById('muscle').options].map((o) => o.value)"
    )
    # Every curve becomes five knots of moderate activation, two of which are dragged several times.
    driver.execute_script(
        "const f = new File([arguments[0]], 'c.csv'); const d = new DataTransfer(); d.items.add(f);"
        "const l = document.getElementById('load'); l.files = d.files;"
        "l.dispatchEvent(new Event('change'))", knots(muscles),
    )  # fmt: skip
    until(driver, "return Number(document.getElementById('stage').dataset.shown) >= 2")
    steps = []
    for muscle in rng.permutation(muscles):
        for x in rng.choice([0.25, 0.5, 0.75], 2, replace=False):
            level = LEVEL
            for _ in range(DRAGS // (2 * len(muscles))):
                to = float(rng.uniform(0.02, 0.25))
                steps.append([str(muscle), float(x), level, to])
                level = to
    rows, browsers = [], driver.service.process.pid
    before = [processor(process.pid), processor(browsers), page_time(driver)]
    for first in range(0, len(steps), TOGETHER):
        rows += driver.execute_async_script(SCRIPTS["drag"], steps[first : first + TOGETHER])
        say(f"{len(rows)} of {len(steps)}")
    after = [processor(process.pid), processor(browsers), page_time(driver)]
    rows = np.array(rows)
    parts = ("drawn", "answered", "simulated", "scored", "in the program")
    names = [f"{way}: {part}" for way in ("preview", "complete") for part in parts]
    return pd.DataFrame(
        [
            {"part": "drag", "quantity": f"{name} [ms]", "median": np.median(rows[:, k]),
             "95 %": np.quantile(rows[:, k], 0.95), "number": len(rows)}
            for k, name in enumerate(names)
        ]
        + [
            {"part": "drag", "quantity": f"processor time of the {what} per drag, two motions [ms]",
             "median": (b - a) / len(rows), "95 %": np.nan, "number": len(rows)}
            for what, a, b in zip(("program", "browser", "page alone"), before, after, strict=True)
        ]
    )  # fmt: skip


LEVEL = 0.1  #: activation of all inner knots at first


def knots(muscles, duration=1.6):
    """Table of curves with five knots for each muscle."""
    times = np.linspace(0.0, duration, 5)
    value = [LEVEL if 0 < t < duration else 0.0 for t in times]
    rows = [
        f"{m},{t},{v},linear,{duration}" for m in muscles for t, v in zip(times, value, strict=True)
    ]
    return "\n".join(["muscle,time,value,interpolation,duration", *rows])


def minute(driver, process, url, log):
    """A minute of slider moves."""
    driver.get(url)
    until(driver, "return Number(document.getElementById('stage').dataset.frames) > 20")
    driver.execute_async_script(SCRIPTS["moves"], WARM)
    before = memory(process)
    frames, reacted = driver.execute_async_script(SCRIPTS["moves"], LIVE)
    grown = memory(process) - before
    process.send_signal(signal.SIGINT)
    process.wait(60)
    with xr.open_dataset(log) as data:
        late = data["late"].values[-round(LIVE * 100) :]
        latency = 1e3 * data["latency"].values[-round(LIVE * 100) :]
    due = round(30 * LIVE)
    rows = [
        ("steps late", late.sum(), np.nan, len(late)),
        ("latency of a step [ms]", np.median(latency), np.quantile(latency, 0.95), len(latency)),
        ("slider to picture [ms]", np.median(reacted), np.quantile(reacted, 0.95), len(reacted)),
        ("frames dropped", max(due - frames, 0), np.nan, due),
        ("growth of the memory [MB]", grown, np.nan, 1),
    ]
    names = ("quantity", "median", "95 %", "number")
    return pd.DataFrame([{"part": "live"} | dict(zip(names, row, strict=True)) for row in rows])


def long_page(path):
    """Page of 64 channels of noise in bursts, 1 h at 2 kHz."""
    from emgface.view.recording import RecordingPage

    rng, n = np.random.default_rng(SEED), 2000 * 3600
    emg = np.empty((64, n), dtype=np.float32)
    for k in range(64):
        burst = np.sin(np.arange(n) / 2000 * 0.05 * (k + 1)) > 0.9
        emg[k] = rng.standard_normal(n, dtype=np.float32) * 1e-5 * (1 + 5 * burst)
    names = [f"EMG {k + 1}" for k in range(64)]
    data = xr.Dataset(
        {"emg": (("channel", "time_emg"), emg, {"units": "V"})},
        {"channel": names, "time_emg": np.arange(n) / 2000},
        attrs={"origin": "simulated"},
    )
    path.write_text(RecordingPage(data, "one hour").html(), encoding="utf-8")


def scrolled(driver, page, way):
    """Pictures per second, and processor time of each, of a recording that is scrolled and enlarged."""
    driver.get(page.resolve().as_uri())
    watch_page(driver)
    until(driver, "return document.getElementById('traces').dataset.ready === 'yes'")
    rows, browsers, enlarged = [], driver.service.process.pid, 0
    for zoom, act in ((2, "scrolled"), (6, "scrolled"), (6, "enlarged and reduced")):
        for _ in range(zoom - enlarged):
            driver.execute_script("document.getElementById('in').click()")
        enlarged = zoom
        before = [page_time(driver), processor(browsers)]
        n, ms = driver.execute_async_script(SCRIPTS["scroll"], 5.0, act != "scrolled")
        own = [(page_time(driver) - before[0]) / n, (processor(browsers) - before[1]) / n]
        name = f"1/{2**zoom} of the hour {act}, {way}"
        for quantity, value in (("pictures per second", 1e3 * n / ms),
                                ("processor time of the page per picture [ms]", own[0]),
                                ("processor time of the browser per picture [ms]", own[1])):  # fmt: skip
            rows.append({"part": "recording", "quantity": f"{quantity}, {name}",
                         "median": value, "95 %": np.nan, "number": n})  # fmt: skip
    return pd.DataFrame(rows)


def played(driver, page, size):
    """Pictures per second of a page with a moving surface while it plays, and while it is turned."""
    driver.get(page.resolve().as_uri())
    watch_page(driver)
    until(driver, "return document.getElementById('stage').dataset.ready === 'yes'")
    rows, browsers = [], driver.service.process.pid
    for act, script in (("turned", SCRIPTS["turn"]), ("played", SCRIPTS["play"])):
        before = [page_time(driver), processor(browsers)]
        n, ms = driver.execute_async_script(script, 10.0)
        own = [(page_time(driver) - before[0]) / n, (processor(browsers) - before[1]) / n]
        for quantity, value in (("pictures per second", 1e3 * n / ms),
                                ("processor time of the page per picture [ms]", own[0]),
                                ("processor time of the browser per picture [ms]", own[1])):  # fmt: skip
            rows.append({"part": "motion", "quantity": f"{quantity}, {act}, {size}",
                         "median": value, "95 %": np.nan, "number": n})  # fmt: skip
    return pd.DataFrame(rows)


def saved(path):
    """Processor time [ms] of the states that a motion of 0.4 s saves, and of its steps."""
    import emgface as ef
    from emgface.face.waypoints import WayPoints

    face, spent, keep = ef.read(path), [], WayPoints.keep
    muscles = [str(m) for m in face["muscle"].values]
    levels = [[0.0, 0.3] if m.endswith("_L") else [0.0, 0.0] for m in muscles]
    drive = xr.Dataset(
        {"activation": (("muscle", "time"), levels, {"units": "1"})},
        {"muscle": muscles, "time": ("time", [0.0, 0.4], {"units": "s"})},
        {"origin": "simulated"},
    )
    stepped = []

    def timed(self, state):
        stepped.append(time.process_time())
        keep(self, state)
        spent.append(1e3 * (time.process_time() - stepped[-1]))

    rows = []
    for accuracy in ("draft", "study"):
        with tempfile.TemporaryDirectory() as folder, patch.object(WayPoints, "keep", timed):
            ef.simulate(drive, face, accuracy=accuracy, waypoints=(folder, 0.02), progress=False)
        # Between two saved states: the steps, without the saving of the first.
        steps = 1e3 * np.diff(stepped) - spent[:-1]
        share = 100.0 * np.median(spent) / (np.median(steps) / 0.02 * 0.1)
        for quantity, values in (("a saved state [ms]", spent), ("steps of 20 ms [ms]", steps),
                                 ("states every 0.1 s, share of the steps [%]", share)):  # fmt: skip
            rows.append({"part": "waypoint", "quantity": f"{accuracy}: {quantity}",
                         "median": np.median(values), "95 %": np.quantile(values, 0.95),
                         "number": np.size(values)})  # fmt: skip
        stepped.clear(), spent.clear()
    return pd.DataFrame(rows)


def main(
    face: Path,
    reduced: Path,
    recording: Path,
    part: Annotated[str, typer.Option(help=f"{', '.join(PARTS)} or all.")] = "all",
    page: Annotated[Path | None, typer.Option(help="Page of the long recording.")] = None,
    motion: Annotated[Path | None, typer.Option(help="Page of a stored motion.")] = None,
    out: Path | None = None,
) -> None:
    """Measure and print."""
    tables = []
    with tempfile.TemporaryDirectory() as folder:
        for name in PARTS if part == "all" else (part,):
            say(name)
            if name == "waypoint":
                tables.append(saved(face))
                continue
            if name == "motion":
                if motion is not None:
                    for emulated, size in product((False, True), (SIZE, (1000, 800))):
                        driver = browser(*size, emulated=emulated)
                        try:
                            way = WAYS[emulated]
                            tables.append(played(driver, motion, f"{size[0]} x {size[1]}, {way}"))
                        finally:
                            driver.quit()
                    row = {"part": name, "quantity": "size of the page [MB]", "number": 1}
                    tables.append(pd.DataFrame([row | {"median": motion.stat().st_size / 1e6}]))
                continue
            if name == "recording":
                if page is None:
                    page = Path(folder) / "long.html"
                    long_page(page)
                for emulated in (False, True):
                    driver = browser(1400, 900, emulated=emulated)
                    try:
                        tables.append(scrolled(driver, page, WAYS[emulated]))
                    finally:
                        driver.quit()
                size = {"part": "recording", "quantity": "size of the page [MB]", "number": 1}
                tables.append(pd.DataFrame([size | {"median": page.stat().st_size / 1e6}]))
                continue
            driver = browser(*SIZE)
            process = None
            try:
                log = Path(folder) / "log.nc"
                process, url = served(face, reduced, recording, log if name == "live" else None)
                if name == "drag":
                    tables.append(drags(driver, process, url))
                else:
                    tables.append(minute(driver, process, url, log))
            finally:
                driver.quit()
                if process is not None and process.poll() is None:
                    process.terminate()
    finish("view", pd.concat(tables), out)
