"""Simulate pairs of a Trigno text export and landmarks of a video, in the documented layouts.

    python -m studies.pairs.simulated FOLDER [--unrelated]

With --unrelated, the EMG of every trial belongs to another motion (negative control).
"""

import argparse
import shutil
from pathlib import Path

import numpy as np
import xarray as xr
from scipy.signal import butter, sosfiltfilt

import emgface as ef
from studies.pairs.__main__ import MECHANICS
from studies.pairs.landmarks import CORNERS

RATE, FRAMES = 2000.0, 50.0  #: of EMG and video [1/s]
DURATION = 2.5
MUSCLES = ("ZYG_L", "ZYG_R", "RIS_L", "RIS_R")
PIXELS = 4.0e3  #: per metre
EYES = 0.09  #: distance of the outer corners of the eyes [m]
BAND = (50.0, 180.0)  #: of the spectrum of facial EMG [Hz]


def course(rng: np.random.Generator, time: np.ndarray) -> np.ndarray:
    """Two bursts whose onsets, lengths and levels differ in every trial."""
    value = np.zeros(time.size)
    for centre in rng.uniform([0.4, 1.3], [1.0, 2.1]):
        width, level = rng.uniform(0.1, 0.35), rng.uniform(0.4, 1.0)
        value += level * np.exp(-0.5 * ((time - centre) / width) ** 2)
    return np.clip(value, 0.0, 1.0)


def make_folder(
    folder: Path,
    *,
    related: bool,
    volunteers: int = 5,
    repetitions: int = 2,
    videos: Path | None = None,
) -> Path:
    """Write a folder; without `related`, the EMG of a trial is that of another course.

    The landmarks are those of the folder `videos` that this function wrote, if it is given.
    """
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "README.md").write_text("Simulated recordings of no person.\n")
    (folder / "mapping.toml").write_text(
        'names = "{volunteer}_{instruction}_{repetition}_emg.csv"\n\n'
        '[channels]\n"Avanti sensor 1: EMG 1" = "ZYG_L"\n'
    )
    face = ef.face(resolution="coarse")
    for v in range(1, volunteers + 1):
        for r in range(1, repetitions + 1):
            rng = np.random.default_rng([7, v, r])
            stem = folder / f"V{v}_D_{r}"
            time = np.arange(0.0, DURATION, 0.02)
            moved = course(rng, time)
            heard = moved if related else course(np.random.default_rng([8, v, r]), time)
            _emg(stem.with_name(f"{stem.name}_emg.csv"), rng, time, heard)
            landmarks = stem.with_name(f"{stem.name}_landmarks.csv")
            if videos is None:
                _video(landmarks, rng, face, time, moved)
            else:
                shutil.copy(videos / landmarks.name, landmarks)
    return folder


def _emg(path: Path, rng: np.random.Generator, time: np.ndarray, level: np.ndarray) -> None:
    at = np.arange(0.0, DURATION, 1.0 / RATE)
    noise = rng.standard_normal((2, at.size))
    sos = butter(2, BAND, "bandpass", fs=RATE, output="sos")
    source = sosfiltfilt(sos, noise[0])
    volts = 150e-6 * np.interp(at, time, level) * source / source.std() + 1.5e-6 * noise[1]
    lines = ["X[s],Avanti sensor 1: EMG 1 [Volts]"]
    lines += [f"{t:.6f},{u:.9e}" for t, u in zip(at, volts, strict=True)]
    path.write_text("\n".join(lines) + "\n")


def _video(
    path: Path, rng: np.random.Generator, face: xr.Dataset, time: np.ndarray, level: np.ndarray
) -> None:
    """Project the corners of a moving face; the head turns in the image, moves and comes closer."""
    muscles = [str(m) for m in face["muscle"].values]
    values = np.zeros((len(muscles), time.size))
    for muscle in MUSCLES:
        values[muscles.index(muscle)] = level
    activation = xr.DataArray(
        values, coords={"muscle": muscles, "time": time}, dims=("muscle", "time")
    )
    motion = ef.simulate(activation, face, progress=False, **MECHANICS)
    frames = np.arange(0.0, DURATION - 0.1, 1.0 / FRAMES)
    rest = rng.uniform(-0.05, 0.05, (68, 2))
    rest[36], rest[45] = (-EYES / 2, 0.06), (EYES / 2, 0.06)
    points = np.repeat(rest[None], frames.size, axis=0)
    for side, name in (("L", "corner_left"), ("R", "corner_right")):
        own = motion["position"].sel(marker=name, axis=["x", "z"]).interp(time=frames)
        points[:, CORNERS[side]] = own.transpose("time", "axis").values * [-1.0, 1.0]
    z = (points[..., 0] + 1j * points[..., 1]) * PIXELS
    turn = np.exp(0.1j * np.sin(2.0 * frames)) * (1.0 + 0.05 * np.sin(frames))
    z = turn[:, None] * z + (40.0 * np.sin(1.3 * frames) + 320.0 + 240.0j)[:, None]
    z += 0.2 * (rng.standard_normal(z.shape) + 1j * rng.standard_normal(z.shape))
    head = ["frame", "timestamp", "confidence", "success"]
    head += [f"{axis}_{k}" for axis in "xy" for k in range(68)]
    lines = [", ".join(head)]
    for k, (t, row) in enumerate(zip(frames, z, strict=True)):
        lost = k % 37 == 20
        cells = [str(k + 1), f"{t:.3f}", "0.2" if lost else "0.98", "0" if lost else "1"]
        cells += [f"{v:.2f}" for v in (*row.real, *(-row.imag))]
        lines.append(", ".join(cells))
    path.write_text("\n".join(lines) + "\n")


def main() -> None:
    """Write the folder of the command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--unrelated", action="store_true")
    given = parser.parse_args()
    print(f"wrote {make_folder(given.folder, related=not given.unrelated)}")


if __name__ == "__main__":
    main()
