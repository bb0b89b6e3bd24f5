"""Acoustics of tubes: published formants, error against run time, stability, another program.

    python -m benchmarks acoustics [--part NAME] [--out FOLDER]

Formants: published shapes (EMGFACE_SHARED) by three methods; largest differences of F1 to F4.
Cost: two-tube /a/ of 17 cm with all losses; largest error of F1 to F4 against the matrix method, and
processor seconds per second of sound. Stability: folds at 785 Pa, or as stated; sound pressure at 0.3
m; click: largest second difference of the sound over that of the voice before a still /a/. Other: the 13
published shapes (EMGFACE_SHARED); theirs / the same nine cells with the matrix method / this package.
"""

import json
import os
import time
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd

from benchmarks.acoustic_shapes import AH, TABLE, tubes
from benchmarks.report import finish
from emgface.acoustics import (
    LOSSLESS,
    NO_TURBULENCE,
    Flow,
    Folds,
    Medium,
    Turbulence,
    formants,
    kelly_lochbaum,
    lossless_formants,
    resonances,
    simulate_tube,
)
from emgface.acoustics.errors import AcousticsError

CLICK = Flow(np.array([0.0, 1e-6, 0.0]), 44_100.0)


SHARED = Path(os.environ.get("EMGFACE_SHARED", "../shared"))


def nearest(values: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Entries of `values` nearest to those wanted."""
    return values[np.abs(values[:, None] - wanted).argmin(axis=0)]


def formant_table() -> pd.DataFrame:
    """Formants of the published shapes by three methods, and their largest differences."""
    given = tubes(SHARED)
    rows: list[dict[str, object]] = []
    for name, (lossless, lossy) in TABLE.items():
        areas, L = given[name]
        matrix = lossless_formants(areas, L)[:4]
        sound = simulate_tube(areas, L, CLICK, duration=0.3, medium=LOSSLESS)
        time = nearest(resonances(sound.mouth, sound.rate, skip=0.02, order=24)[0], matrix)
        click = np.zeros(20_000)
        click[1] = 1e-6
        flow, rate = kelly_lochbaum(np.repeat(areas, 2), L, click)
        scattered = nearest(resonances(flow, rate, skip=0.005, order=24)[0], matrix)
        with_losses, width = formants(areas, L)
        sound = simulate_tube(areas, L, CLICK, duration=0.3)
        frequency, bandwidth = resonances(sound.mouth, sound.rate, order=32)
        sharp = width[:4] < 300.0
        # the nearest pole: a weak one may have nearly the frequency of a formant
        poles = frequency + 0.5j * bandwidth, with_losses[:4][sharp] + 0.5j * width[:4][sharp]
        here = np.abs(poles[0][:, None] - poles[1]).argmin(axis=0)
        rows.append(
            {"shape": name, "F1 to F4 Hz": " ".join(f"{f:.1f}" for f in matrix),
             "matrix, Hz": np.abs(matrix - lossless).max(),
             "time, %": 100.0 * np.abs(time / matrix - 1.0).max(),
             "Kelly-Lochbaum, %": 100.0 * np.abs(scattered / matrix - 1.0).max(),
             "matrix with losses, %": 100.0 * np.abs(with_losses[:4] / lossy - 1.0).max(),
             "time with losses, %":
                 100.0 * np.abs(frequency[here] / with_losses[:4][sharp] - 1.0).max(),
             "bandwidth, %": 100.0 * np.abs(bandwidth[here] / width[:4][sharp] - 1.0).max()}
        )  # fmt: skip
    return pd.DataFrame(rows).round(4)


def cost() -> pd.DataFrame:
    """Error and processor time by sections and steps, with folds, noise and moving lips."""
    exact = formants(*AH)[0][:4]
    still: dict[str, object] = {"areas": AH[0], "length": AH[1]}
    rows: list[dict[str, object]] = []
    cells = (16, 24, 32, 48, 60, 90, 120)
    for sections, steps in (*((n, None) for n in cells), (60, 6), (60, 12)):
        how: dict[str, object] = {**still, "sections": sections, "substeps": steps}
        sound = simulate_tube(source=CLICK, duration=0.3, **how)  # pyright: ignore
        error = nearest(resonances(sound.mouth, sound.rate)[0], exact) / exact - 1.0
        row: dict[str, object] = {"case": "pulse", "sections": sections, "steps per s": sound.rate}
        row["error %"] = 100.0 * float(np.abs(error).max())
        rows.append({**row, **_speed({**how, "source": CLICK})})
    voice: dict[str, object] = {"source": Folds(), "turbulence": Turbulence()}
    for name, how in (("folds and noise", still), ("folds, noise, moving lips", _closing(20e-3))):
        row = {"case": name, "sections": 60, "steps per s": 132_300.0, "error %": np.nan}
        rows.append({**row, **_speed({**how, **voice})})
    areas, click = np.repeat(AH[0], 4), np.zeros(40_000)
    click[1] = 1e-6
    flow, rate = kelly_lochbaum(areas, AH[1], click)
    start = time.process_time()
    kelly_lochbaum(areas, AH[1], click)
    spent = (time.process_time() - start) * rate / len(click)
    exact = lossless_formants(*AH)[:4]
    error = nearest(resonances(flow, rate, skip=0.005, order=24)[0], exact) / exact - 1.0
    row = {"case": "pulse, Kelly-Lochbaum, lossless", "sections": 64, "steps per s": rate}
    row |= {"error %": 100.0 * float(np.abs(error).max()), "s per s": spent}
    return pd.DataFrame([*rows, {**row, "times real time": 1 / spent}])


def _speed(how: dict[str, object]) -> dict[str, float]:
    """Processor time per second of sound, the least of twelve runs of 0.5 s."""
    spent: list[float] = []
    for _ in range(13):  # the first one compiles or loads the kernel
        start = time.process_time()
        simulate_tube(**{**how, "duration": 0.5})  # pyright: ignore
        spent.append(2.0 * (time.process_time() - start))
    return {"s per s": min(spent[1:]), "times real time": 1.0 / min(spent[1:])}


def _closing(width: float) -> dict[str, object]:
    areas = np.tile(AH[0], (6, 1))
    areas[2:4, -2:] = 0.0
    times = np.array([0.0, 0.1, 0.1 + width, 0.2, 0.2 + width, 0.35])
    return {"areas": areas, "length": AH[1], "times": times, "duration": 0.35}


def stability() -> pd.DataFrame:
    """Extreme time steps, constrictions and area changes: outcome and largest pressures."""
    still: dict[str, object] = {"areas": AH[0], "length": AH[1], "duration": 0.3}
    step = np.full(16, 8e-4)
    step[8:10] = 1e-8
    stretch: dict[str, object] = {
        "areas": np.full((2, 16), 3e-4),
        "length": [0.16, 0.19],
        "times": [0.1, 0.15],
    }
    cases: dict[str, dict[str, object]] = {
        **{f"time step, Courant number {n:g}": still | {"n": n} for n in (0.2, 0.5, 0.999, 1.05)},
        **{f"lips close within {1e3 * w:g} ms": _closing(w) for w in (20e-3, 2e-3, 2e-4)},
        "area 8 cm2 to 1e-4 cm2 and back": still | {"areas": step},
        "all areas to 0 and back every 0.2 s, lung 0 to 3000 Pa, 10 s": _pulsing(),
        "length 16 to 19 cm within 50 ms": stretch | {"duration": 0.3},
        "lung pressure 3000 Pa, 10 s": still | {"lung": 3000.0, "duration": 10.0},
    }
    rows: list[dict[str, object]] = []
    for name, case in cases.items():
        rows.append({"case": name} | _outcome(dict(case)))
    for name, narrowest in (("0.3 mm2", -6.5), ("closed", -8.5)):
        case = f"1000 random tubes, {name} to 32 cm2, moving, 0-3000 Pa"
        rows.append({"case": case} | _random(1000, narrowest))
    return pd.DataFrame(rows)


@cache
def _smooth(lung: float) -> float:
    """Largest second difference [Pa] of the voice before a still /a/ with noise."""
    sound = simulate_tube(*AH, Folds(lung=lung), duration=0.25, turbulence=Turbulence())
    return float(np.abs(np.diff(sound.radiated(44_100.0), 2)).max())


def click_ratio(p: np.ndarray, lung: float) -> float:
    """Largest second difference of the sound over that of the voice before a still /a/.

    The voice has the lung pressure of the sound, or 785 Pa where that is higher.
    """
    levels = [785.0, 1200.0, 2000.0, 3000.0]
    smooth = np.interp(lung, levels, [_smooth(level) for level in levels])
    return float(np.abs(np.diff(p, 2)).max() / smooth)


def _pulsing() -> dict[str, object]:
    times = np.linspace(0.0, 10.0, 201)
    open_ = 0.5 + 0.5 * np.cos(2.0 * np.pi * times / 0.2)
    areas = np.where(open_ < 1e-9, 0.0, open_)[:, None] * AH[0]
    lung = np.interp(np.linspace(0.0, 10.0, 10_001), [0.0, 5.0, 10.0], [0.0, 3000.0, 0.0])
    return {"areas": areas, "length": AH[1], "times": times, "duration": 10.0, "lung": lung}


def _outcome(case: dict[str, object]) -> dict[str, object]:
    rate = 44_100.0
    lung = np.asarray(case.pop("lung", 785.0), np.float64)
    finer = "n" in case
    if finer:
        rate = 350.0 * 60 / (0.17 * float(str(case.pop("n"))))
        case |= {"rate": rate, "substeps": 1}
    try:
        sound = simulate_tube(source=Folds(lung=lung), turbulence=Turbulence(), **case)  # pyright: ignore
    except AcousticsError as error:
        return {
            "outcome": f"refused: {type(error).__name__}",
            "sound Pa": np.nan,
            "glottis Pa": np.nan,
            "click": np.nan,
        }
    p = sound.radiated(rate)
    quarter = len(p) // 4
    grows = lung.ndim == 0 and (
        np.abs(p[-quarter:]).max() > 1.3 * np.abs(p[quarter : 2 * quarter]).max()
    )
    good = np.isfinite(p).all() and not grows
    return {
        "outcome": "ok" if good else "GROWS",
        "sound Pa": float(np.abs(p).max()),
        "glottis Pa": float(np.abs(sound.pressure).max()),
        "click": np.nan if finer else click_ratio(p, float(lung.max())),
    }


def _random(count: int, narrowest: float) -> dict[str, object]:
    rng = np.random.default_rng(0)
    largest = np.zeros((count, 3))
    for k in range(count):
        areas = 10.0 ** rng.uniform(narrowest, -2.5, (2, rng.integers(3, 40)))
        sound = simulate_tube(
            areas, rng.uniform(0.1, 0.2, 2),
            Folds(lung=(lung := rng.uniform(0.0, 3000.0)), tension=rng.uniform(0.5, 2.0)),
            times=[0.0, 0.05], duration=0.06, sections=int(rng.integers(10, 60)), seed=k,
            turbulence=Turbulence(),
        )  # fmt: skip
        p = sound.radiated(44_100.0)
        largest[k] = np.abs(p).max(), np.abs(sound.pressure).max(), click_ratio(p, lung)
    good = np.isfinite(largest).all()
    return {
        "outcome": "ok" if good else "NaN", "sound Pa": largest[:, 0].max(),
        "glottis Pa": largest[:, 1].max(), "click": largest[:, 2].max(),
    }  # fmt: skip


def ladder(s: np.ndarray, areas: np.ndarray, length: float) -> np.ndarray:
    """Transfer function of a tube on the staggered grid of the other program, continuous in time.

    Velocities on the even, pressures on the odd of N points; the lips load the last pressure point, one
    point before the end. Its friction is 8 times that of the theory (README of the comparison).
    """
    medium = Medium(friction=8.0)
    cell = 2.0 * length / (len(areas) - 1)
    mass, resistance = medium.load(areas[-1])
    p, u = s * mass, 1.0 + s * mass / resistance
    lips = u
    for k in range(len(areas) - 2, 0, -2):
        u = u + medium.line(s, areas[k])[1] * cell * p
        if k > 1:
            p = p + medium.line(s, areas[k - 1])[0] * cell * u
    return np.asarray(lips / u)


def other() -> pd.DataFrame:
    """Formants [Hz] of the other program and of this package, in its grid and in a fine one."""
    folder = SHARED / "artisynth_reference" / "acoustics"
    rows: list[dict[str, object]] = []
    for path in sorted(folder.glob("shape_*.json"), key=lambda p: int(p.stem.split("_")[1])):
        given = json.loads(path.read_text(encoding="utf-8"))
        areas, L = np.array(given["areas_cm2_glottis_to_lips"]) * 1e-4, float(given["length_m"])
        stored = np.load(path.with_suffix(".npz"))
        theirs = np.array(given["formants_hz_bandwidth_hz_peak_db"]["wall1"])[:4, 0]
        f = np.arange(80.0, 4500.0, 1.0)
        H = np.abs(ladder(2j * np.pi * f, stored["area_on_grid_m2"], L))
        peaks = f[1:-1][(H[1:-1] > H[:-2]) & (H[1:-1] > H[2:])]
        fine, width = formants(areas, L)
        row: dict[str, object] = {"shape": given["label"]}
        for k, value in enumerate(theirs[:3]):
            near = nearest(peaks, np.array([value]))[0]
            row |= {f"F{k + 1}": f"{value:.0f} / {near:.0f} / {fine[k]:.0f}"}
        source = Folds(lung=500.0, rest_area=-5e-7, zeta1=0.2)
        sound = simulate_tube(areas, L, source, duration=0.4, turbulence=NO_TURBULENCE)
        opening = sound.glottal_area[int(0.2 * sound.rate) :]
        above = opening > 0.5 * opening.max()
        period = np.diff(np.flatnonzero(above[1:] & ~above[:-1]))
        pitch = sound.rate / np.median(period) if len(period) > 2 else float("nan")
        row["B1"] = (
            f"{given['formants_hz_bandwidth_hz_peak_db']['wall1'][0][1]:.0f} / {width[0]:.0f}"
        )
        row["f0"] = f"{given['two_mass_f0_hz']:.0f} / {pitch:.0f}"
        rows.append(row)
    return pd.DataFrame(rows)


PARTS = {"formants": formant_table, "cost": cost, "stability": stability, "other": other}


def main(part: list[str] = list(PARTS), out: Path | None = None) -> None:  # noqa: B006
    """Print and store a table for every part."""
    for name in part:
        finish(f"acoustics-{name}", PARTS[name](), out)
