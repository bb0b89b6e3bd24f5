"""What a fresh process costs until its first result, and the memory that it needs.

Every measurement is a process of its own: it tells the end of each phase, and its parent takes the
time. Compiled kernels are on disk, since a first process that is not counted comes before.
"""

import importlib
import json
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
import xarray as xr

from emgface.errors import DataError

Progress = Callable[[str], None]

PHASES: Final = ("imports", "face", "equilibrium", "first output")
VOLUMES: Final = ("pointwise", "element", "nodal", "hard")
IMPORTED: Final = (
    "numpy, scipy.sparse, numba, xarray",
    "sim",
    "emgface.face.motion",
    "emgface.cli",
)
"""Whose import time is taken; each but the first by name."""
DURATION: Final = 0.1
"""Time simulated after the first output, for the memory [s]."""
LEVEL: Final = 0.2
"""Activation of all muscles at its end."""


def import_seconds(what: str) -> float:
    """Wall time of a fresh interpreter that imports modules and ends [s]."""
    start = time.perf_counter()
    subprocess.run([sys.executable, "-c", f"import {what}"], check=True, capture_output=True)
    return time.perf_counter() - start


def first_result(face: Path | None, volume: str) -> tuple[dict[str, float], float]:
    """Seconds of every phase of a fresh process until its first output, and its peak memory [B].

    Parameters
    ----------
    face : Path, optional
        Face model; the coarse template face if absent.
    volume : str
        Treatment of the volume.

    Raises
    ------
    DataError
        The process failed.
    """
    task = json.dumps({"face": None if face is None else str(face), "volume": volume})
    start = time.perf_counter()
    child = subprocess.Popen(
        [sys.executable, "-c", "from emgface.bench.start import work; work()", task],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONUNBUFFERED": "1"},
    )
    assert child.stdout is not None and child.stderr is not None
    seconds: dict[str, float] = {}
    peak = float("nan")
    for line in child.stdout:
        word, _, value = line.strip().partition("=")
        if word == "peak":
            peak = float(value)
        elif word in PHASES:
            now = time.perf_counter()
            seconds[word], start = now - start, now
    told = child.stderr.read()
    if child.wait() != 0 or set(seconds) != set(PHASES):
        last = (told.strip().splitlines() or ["it said nothing"])[-1]
        raise DataError(f"a fresh process failed: {last}; expected it to simulate the face")
    return seconds, peak


def work() -> None:
    """Simulate a face in this process, telling the end of every phase; the task is an argument."""
    task: dict[str, Any] = json.loads(sys.argv[-1])
    path, volume = task["face"], task["volume"]
    name = "emgface.face.template" if path is None else "emgface.face.file"
    source = importlib.import_module(name)  # a face from a file needs no template
    from emgface.face.motion import settle_face, simulate_face
    from emgface.face.simulation_parameters import SimulationParameters

    print(PHASES[0])
    face = source.template_face(resolution="coarse") if path is None else source.load_face(path)
    print(PHASES[1])
    parameters = SimulationParameters(
        sigma_max=100e3,
        incompressibility=volume,
        bulk_potential="logarithmic" if volume == "pointwise" else "quadratic",
    )
    settled = settle_face(face, parameters)
    print(PHASES[2])
    for end, duration in ((PHASES[3], parameters.step), ("", DURATION)):
        muscles = face["muscle"].values
        rise = np.outer(np.full(len(muscles), LEVEL), [0.0, duration / DURATION])
        coords = {"muscle": muscles, "time": [0.0, duration]}
        activation = xr.DataArray(rise, coords, ("muscle", "time"))
        simulate_face(face, activation, parameters, settled=settled)
        print(end)
    print(f"peak={peak_memory()}")


def peak_memory() -> float:
    """Largest resident memory of this process so far [B]; NaN where the system does not tell."""
    try:
        import resource
    except ImportError:  # Windows
        return float("nan")
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return float(peak if sys.platform == "darwin" else 1024 * peak)


def measure(
    face: Path | None = None,
    *,
    volumes: Sequence[str] = VOLUMES,
    repeats: int = 3,
    progress: Progress | None = None,
) -> xr.Dataset:
    """Time fresh processes.

    Parameters
    ----------
    face : Path, optional
        Face model; the coarse template face if absent.
    volumes : sequence of str
        Treatments of the volume.
    repeats : int
        Processes per case; times are medians, memory is the largest.
    progress : callable, optional
        Told what is being run.

    Returns
    -------
    Dataset
        ``seconds(volume, phase)`` [s] until the first output and ``peak(volume)`` [B] after 0.1 s of
        motion; ``import_time(module)`` [s].

    Raises
    ------
    DataError
        A process failed.
    """
    tell = progress or (lambda _: None)
    seconds: list[list[float]] = []
    peaks: list[float] = []
    for volume in volumes:
        tell(f"{volume}, first of all")
        first_result(face, volume)
        runs: list[tuple[dict[str, float], float]] = []
        for k in range(repeats):
            tell(f"{volume}, {k + 1} of {repeats}")
            runs.append(first_result(face, volume))
        seconds.append([statistics.median(run[phase] for run, _ in runs) for phase in PHASES])
        peaks.append(max(peak for _, peak in runs))
    imports: list[float] = []
    for what in IMPORTED:
        tell(f"import {what}")
        imports.append(statistics.median(import_seconds(what) for _ in range(repeats)))
    return xr.Dataset(
        {
            "seconds": (("volume", "phase"), np.array(seconds), {"units": "s"}),
            "peak": ("volume", np.array(peaks), {"units": "B"}),
            "import_time": ("module", np.array(imports), {"units": "s"}),
        },
        coords={"volume": list(volumes), "phase": list(PHASES), "module": list(IMPORTED)},
        attrs={
            "origin": "simulated",
            "face": "template face, coarse" if face is None else face.name,
            "repeats": repeats,
        },
    )


def table(found: xr.Dataset) -> pd.DataFrame:
    """One row per treatment of the volume, then one per imported module."""
    seconds = found["seconds"].transpose("volume", "phase").values
    rows = pd.DataFrame(seconds, columns=[f"{phase} s" for phase in found["phase"].values])
    rows["first result s"] = seconds.sum(axis=1)
    rows["peak MB"] = found["peak"].values / 1e6
    rows.insert(0, "process", [f"first output, {v}" for v in found["volume"].values])
    imports = pd.DataFrame(
        {
            "process": [f"import {m}" for m in found["module"].values],
            "first result s": found["import_time"].values,
        }
    )
    return pd.concat([rows, imports], ignore_index=True)
