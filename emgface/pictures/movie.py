"""Movies of a simulated motion: GIF by pillow, MP4 by ffmpeg if it is installed."""

import shutil
import subprocess
from collections.abc import Callable, Iterator
from contextlib import suppress
from importlib import import_module
from itertools import chain
from pathlib import Path
from tempfile import TemporaryFile
from typing import Final

import numpy as np
import xarray as xr
from PIL import Image, ImageDraw, ImageFont

from emgface.errors import DataError
from emgface.files import replace_file
from emgface.pictures.page import trial_name
from emgface.pictures.render import VIEWS, render, window_of
from emgface.pictures.surface import drawn_surface

MOVIE_SUFFIXES: Final = (".gif", ".mp4")
MOVIE_VIEWS: Final = ("front", "oblique")  #: views in a movie, side by side
PANEL: Final = 360  #: width of each [pixels]


def write_movie(
    motion: xr.Dataset, path: str | Path, *, progress: Callable[[int, int], None] | None = None
) -> Path:
    """Write a movie (``*.gif`` or ``*.mp4``) of a trajectory with surface, at the simulated speed.

    ``progress(done, total)`` is called after every frame. Every frame is labelled as simulated,
    with trial and time. Raises DataError if the format is unknown, the trajectory has no surface,
    ffmpeg is not found (MP4) or fails, or the file cannot be written.
    """
    path = Path(path)
    program = check_movie(path)
    pictures, times = frames(motion, progress), motion["frame_time"].values
    # The unit of time in GIF is a hundredth of a second.
    step = float(np.median(np.diff(times))) if len(times) > 1 else 1.0
    if program:
        replace_file(path, lambda target: _write_mp4(pictures, target, program, 1.0 / step))
    else:
        replace_file(path, lambda target: _write_gif(pictures, target, step))
    return path


def check_movie(path: Path) -> str:
    """Return the program required by a movie, empty for a GIF, for a check before a simulation.

    Raises DataError if the format is unknown, or the program is not found.
    """
    if path.suffix.lower() not in MOVIE_SUFFIXES:
        raise DataError(f"{path.name} is not a movie, expected a name that ends in .gif or .mp4")
    return ffmpeg() if path.suffix.lower() == ".mp4" else ""


def frames(
    motion: xr.Dataset, progress: Callable[[int, int], None] | None = None
) -> Iterator[Image.Image]:
    """Draw the frames of a movie, one by one."""
    body, _, surface = drawn_surface(motion)
    rest, times = surface[0], motion["frame_time"].values
    windows = [window_of(rest, VIEWS[side], 0.04) for side in MOVIE_VIEWS]
    sizes = [round(PANEL * (w.top - w.bottom) / (w.right - w.left)) for w in windows]
    height = max(sizes) + 28
    height += height % 2  # MP4 has half the resolution in colour
    font = ImageFont.load_default(14)
    label = f"simulated motion: {trial_name(motion)}"
    for k, (position, time) in enumerate(zip(surface, times, strict=True), start=1):
        picture = Image.new("RGB", (PANEL * len(MOVIE_VIEWS), height), "white")
        for column, (side, window) in enumerate(zip(MOVIE_VIEWS, windows, strict=True)):
            drawn = Image.fromarray(render(body, position, VIEWS[side], window, PANEL), "RGBA")
            picture.paste(drawn, (column * PANEL, (height - 28 - drawn.height) // 2), drawn)
        pen = ImageDraw.Draw(picture)
        pen.text((8, height - 22), f"{label}, {time:.2f} s", fill="#333333", font=font)
        if progress:
            progress(k, len(times))
        yield picture


def ffmpeg() -> str:
    """Path of the program ffmpeg, of the system or of imageio-ffmpeg; DataError without one."""
    installed = shutil.which("ffmpeg")
    if installed:
        return installed
    try:
        return str(import_module("imageio_ffmpeg").get_ffmpeg_exe())
    except (ImportError, RuntimeError):
        raise DataError(
            "no program ffmpeg was found, which writes MP4: install it (apt install ffmpeg, or pip "
            "install imageio-ffmpeg), or write a .gif"
        ) from None


def _write_gif(pictures: Iterator[Image.Image], path: Path, step: float) -> None:
    first = next(pictures)
    # One palette for all frames avoids flicker.
    palette = first.quantize(255, method=Image.Quantize.MEDIANCUT)
    rest = [one.quantize(palette=palette, dither=Image.Dither.NONE) for one in pictures]
    first.quantize(palette=palette, dither=Image.Dither.NONE).save(
        path,
        format="GIF",
        save_all=True,
        append_images=rest,
        duration=10 * max(2, round(100.0 * step)),
        loop=0,
        comment=b"simulated by emgface",
    )


def _write_mp4(pictures: Iterator[Image.Image], path: Path, program: str, rate: float) -> None:
    first = next(pictures)
    command = [
        program, "-y", "-loglevel", "error", "-f", "rawvideo", "-pix_fmt", "rgb24",
        "-s", f"{first.width}x{first.height}", "-r", f"{rate:.6g}", "-i", "-", "-an",
        "-pix_fmt", "yuv420p", "-metadata", "comment=simulated by emgface", "-f", "mp4", str(path),
    ]  # fmt: skip
    # Messages go to a file: a pipe that nobody reads would stop a program that writes many.
    with TemporaryFile() as messages:
        with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=messages) as running:
            assert running.stdin is not None  # opened as a pipe
            with suppress(BrokenPipeError):  # the exit code tells why
                for picture in chain([first], pictures):
                    running.stdin.write(picture.tobytes())
                running.stdin.close()
            code = running.wait()
        messages.seek(0)
        said = messages.read().decode(errors="replace").strip().splitlines()
    if code != 0:
        raise DataError(
            f"{program} could not write the movie ({said[-1] if said else 'without a message'}): "
            "update it, or write a .gif"
        )
