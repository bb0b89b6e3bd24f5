"""Make the pictures of the tour: python docs/tour/make.py --work FOLDER [--width 900] [--dark].

The commands of the tour are executed in the folder unless their files exist; a browser then opens
their pages. The face is generated, and recording and motion are simulated.
"""

import argparse
import io
import re
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from PIL import Image

from benchmarks.view import browser, until
from emgface.children import child_environment, python_command

HERE = Path(__file__).parent
COMMANDS = (
    ("volunteers", "emgface volunteers --n 1 --repetitions 1 --resolution coarse --out volunteers"),
    ("face.nc", "emgface build face --resolution coarse --out face.nc"),
    ("recording.html", "emgface show volunteers/recordings/S01_D_1.nc --out recording.html"),
    ("activation.nc", "emgface activate volunteers/recordings/S01_D_1.nc --out activation.nc"),
    (
        "motion.nc",
        "emgface simulate activation.nc --face face.nc --accuracy draft --surface --out motion.nc",
    ),
    (
        "trial.html",
        "emgface show motion.nc --activation activation.nc"
        " --recording volunteers/recordings/S01_D_1.nc --out trial.html",
    ),
    ("face.html", "emgface show face.nc --out face.html"),
    ("face.rom.nc", "emgface reduce face.nc --out face.rom.nc --no-contact"),
)
LIVE = (
    "emgface live face.nc --reduced face.rom.nc --curves volunteers/recordings/S01_D_1.nc --no-open"
)

KEY = "document.getElementById('{0}').dispatchEvent(new KeyboardEvent('keydown', {{key: '{1}'}}));"
CLICK = "document.getElementById('{0}').click();"
SHOTS: dict[str, tuple[str, str, str, str]] = {
    "recording": (
        "recording.html",
        "traces",
        "".join(
            KEY.format("traces", key)
            for key in ("ArrowDown", "ArrowDown", "b", "+", "+", "ArrowRight")
        )
        + CLICK.format("span-one"),
        "return document.getElementById('spans').children.length === 1",
    ),
    "trial": (
        "trial.html",
        "stage",
        "const t = document.getElementById('time'); t.value = Math.round(0.45 * t.max);"
        "t.dispatchEvent(new Event('input'));",
        "return Number(document.getElementById('stage').dataset.frame) > 0",
    ),
    "pick": (
        "face.html",
        "stage",
        "const c = document.getElementById('stage'), b = c.getBoundingClientRect();"
        "const at = {pointerId: 1, bubbles: true, clientX: b.left + 0.56 * b.width,"
        " clientY: b.top + 0.42 * b.height};"
        "for (const name of ['pointerdown', 'pointerup']) c.dispatchEvent(new PointerEvent(name, at));"
        "c.dispatchEvent(new MouseEvent('click', at)); window.scrollTo(0, 170);",
        "return document.getElementById('stage').dataset.ready === 'yes'",
    ),
    "live": (
        LIVE,
        "stage",
        "document.querySelectorAll('#presets button')[3].click();",
        "return Number(document.getElementById('stage').dataset.time) > 3",
    ),
    "curves": (
        LIVE,
        "stage",
        CLICK.format("tab-curves")
        + "const m = document.getElementById('muscle'); m.value = 'ZYG_L';"
        "m.dispatchEvent(new Event('change'));",
        "const s = document.getElementById('stage'), t = document.getElementById('time');"
        "if (!(s.dataset.motion > 0) || document.getElementById('rho-title').hidden) return false;"
        "if (s.dataset.at !== '0') return true;"
        "t.value = Math.round(0.4 * t.max); t.dispatchEvent(new Event('input')); return false",
    ),
}
"""By the name of the picture: page or command that serves it, canvas, actions, and what they lead to."""


def make_files(folder: Path) -> None:
    """Execute the commands whose files do not exist."""
    for name, command in COMMANDS:
        if not (folder / name).exists():
            words = python_command("-m", *command.split())
            subprocess.run(words, cwd=folder, env=child_environment(), check=True)


@contextmanager
def address(page: str, folder: Path) -> Iterator[str]:
    """Address of a page, which a command serves or a file contains."""
    if not page.startswith("emgface "):
        yield (folder / page).resolve().as_uri()
        return
    process = subprocess.Popen(
        python_command("-m", *page.split()), cwd=folder, text=True,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        env={**child_environment(), "PYTHONUNBUFFERED": "1"},
    )  # fmt: skip
    try:
        assert process.stdout is not None
        matches = (re.search(r"http://\S+/", line) for line in process.stdout)
        yield next(one[0] for one in matches if one)
    finally:
        process.terminate()


def shot(driver: Any, name: str, folder: Path) -> bytes:
    """Picture of a page after its actions, as PNG."""
    page, canvas, act, reached = SHOTS[name]
    with address(page, folder) as url:
        # Edges are smooth although the processor draws.
        driver.get(f"{url}?smooth")
        until(driver, f"return document.getElementById('{canvas}').dataset.ready === 'yes'")
        if page == LIVE:
            until(driver, "return document.getElementById('stage').dataset.connected === 'yes'")
        driver.execute_script(act)
        until(driver, reached)
        driver.execute_async_script(
            "const done = arguments[0]; requestAnimationFrame(() => requestAnimationFrame(done))"
        )
        return driver.get_screenshot_as_png()


def main() -> None:
    """Make all pictures, or those that are named."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--work", type=Path, required=True)
    parser.add_argument("--out", type=Path, default=HERE)
    parser.add_argument("--width", type=int, default=1400)
    parser.add_argument("--dark", action="store_true")
    parser.add_argument("--only", nargs="*", default=list(SHOTS))
    given = parser.parse_args()
    given.work.mkdir(parents=True, exist_ok=True)
    make_files(given.work)
    driver = browser(given.width, 900)
    if given.dark:
        features = [{"name": "prefers-color-scheme", "value": "dark"}]
        driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": features})
    try:
        for name in given.only:
            with Image.open(io.BytesIO(shot(driver, name, given.work))) as picture:
                # 128 colours keep text and skin, at a third of the size.
                small = picture.convert("RGB").quantize(128)
                small.save(given.out / f"{name}.png", optimize=True)
            print(f"Wrote {name}.png.")
    finally:
        driver.quit()


if __name__ == "__main__":
    main()
