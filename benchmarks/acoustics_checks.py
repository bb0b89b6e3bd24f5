"""Checks of the acoustics against closed forms and the published shapes, as tables."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.optimize import brentq, fsolve
from scipy.signal import welch

from benchmarks.acoustic_shapes import AH, BENT, EE, STRAIGHT, TABLE, pipe, published_airway, tubes
from emgface.acoustics import (
    LOSSLESS,
    Flow,
    Folds,
    Medium,
    Turbulence,
    formants,
    kelly_lochbaum,
    lossless_formants,
    resonances,
    rosenberg,
    simulate_tube,
)

CLICK = Flow(np.array([0.0, 1e-6, 0.0]), 44_100.0)
U = np.repeat([1.5e-4, 9e-4, 0.8e-4, 8e-4, 0.6e-4], [4, 13, 6, 9, 2]), 0.17
"""Tubes like an /u/: areas [m^2] and length [m]."""
WIDE = np.full(4, 0.01), 0.02
"""So short and wide that the folds do not notice it."""
SHARED = Path(os.environ.get("EMGFACE_SHARED", "../shared"))


def nearest(found: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Entries of `found` nearest to those wanted."""
    return found[np.abs(found[:, None] - wanted).argmin(axis=0)]


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
        found, found_width = resonances(sound.mouth, sound.rate, order=32)
        sharp = width[:4] < 300.0
        # the nearest pole: a weak one may have nearly the frequency of a formant
        poles = found + 0.5j * found_width, with_losses[:4][sharp] + 0.5j * width[:4][sharp]
        here = np.abs(poles[0][:, None] - poles[1]).argmin(axis=0)
        rows.append(
            {"shape": name, "F1 to F4 Hz": " ".join(f"{f:.1f}" for f in matrix),
             "matrix, Hz": np.abs(matrix - lossless).max(),
             "time, %": 100.0 * np.abs(time / matrix - 1.0).max(),
             "Kelly-Lochbaum, %": 100.0 * np.abs(scattered / matrix - 1.0).max(),
             "matrix with losses, %": 100.0 * np.abs(with_losses[:4] / lossy - 1.0).max(),
             "time with losses, %":
                 100.0 * np.abs(found[here] / with_losses[:4][sharp] - 1.0).max(),
             "bandwidth, %": 100.0 * np.abs(found_width[here] / width[:4][sharp] - 1.0).max()}
        )  # fmt: skip
    return pd.DataFrame(rows).round(4)


Row = tuple[str, float, float | tuple[float, float]]
"""Check, figure, and its largest value or range."""


def checks() -> pd.DataFrame:
    """Closed forms, published shapes, moving tubes, geometry, folds and noise: figures and limits.

    Checks 1 to 7; check 8 is the part "stiffening".
    """
    rows = [
        *_uniform_and_two_tubes(), *_scheme(), *_published(), *_any_shapes(), *_radiation_and_walls(),
        *_moving(), *_geometry(), *_folds(), *_noise(), *_wave(),
    ]  # fmt: skip
    table = pd.DataFrame(rows, columns=["check", "figure", "limit"])
    ranges = [limit if isinstance(limit, tuple) else (0.0, limit) for limit in table["limit"]]
    met = [low <= f <= high for f, (low, high) in zip(table["figure"], ranges, strict=True)]
    table["limit"] = [f"{low:g} to {high:g}" if low else f"{high:g}" for low, high in ranges]
    return table.assign(met=np.where(met, "yes", "no"))


def _uniform_and_two_tubes() -> list[Row]:
    expected = 350.0 / (4 * 0.175) * np.array([1.0, 3.0, 5.0])
    error = np.abs(lossless_formants(np.full(35, 3e-4), 0.175)[:3] / expected - 1.0).max()
    click = simulate_tube(np.full(35, 3e-4), 0.175, CLICK, duration=0.3, medium=LOSSLESS)
    found = nearest(resonances(click.mouth, click.rate, skip=0.02, order=24)[0], expected)
    areas, L, l2 = np.repeat([5e-5, 3.5e-4], 10), 0.17, 0.085

    def equation(f: float) -> float:
        k = 2 * np.pi * f / 350.0
        back, front = k * (L - l2), k * l2
        return float(np.sin(back) * np.sin(front) - 7.0 * np.cos(back) * np.cos(front))

    grid = np.linspace(40.0, 5000.0, 5000)
    values = np.array([equation(f) for f in grid])
    ends = np.flatnonzero(np.diff(np.sign(values)))
    exact = [brentq(equation, grid[k], grid[k + 1], xtol=1e-10) for k in ends]
    two = np.abs(lossless_formants(areas, L) - exact).max()
    return [
        ("1 uniform tube, matrix [%]", 100.0 * error, 0.5),
        ("1 uniform tube, time [%]", 100.0 * np.abs(found / expected - 1.0).max(), 0.5),
        ("1 two tubes, tan tan = A2/A1, matrix [Hz]", two, 1e-6),
    ]


def _scheme() -> list[Row]:
    N, L = 40, 0.16
    areas = np.random.default_rng(1).uniform(0.2e-4, 8e-4, N)
    weak = Flow(1e-12 * CLICK.values, CLICK.rate)

    def energy(duration: float) -> tuple[float, float]:
        y = simulate_tube(areas, L, weak, duration=duration, medium=LOSSLESS, sections=N)
        p, u, h, dt = y.node_pressure, y.cell_velocity, L / N, 1.0 / y.rate
        V = 0.5 * h * (np.append(areas, 0.0) + np.append(0.0, areas))
        before = u + dt / (LOSSLESS.rho * h) * np.diff(p)
        potential = (V[:-1] * p[:-1] ** 2).sum() / (2 * LOSSLESS.rho * LOSSLESS.c**2)
        return potential + 0.5 * LOSSLESS.rho * h * (areas * u * before).sum(), y.rate

    (first, rate), (last, _) = energy(0.01), energy(0.5)
    smooth = (1.0 + 0.8 * np.sin(np.linspace(0, 4, 16))) * 3e-4
    exact = lossless_formants(smooth, 0.16)[2]
    errors: list[float] = []
    for cells in (16, 32, 64):
        sound = simulate_tube(
            smooth, 0.16, CLICK, duration=0.3, medium=LOSSLESS, sections=cells,
            rate=50_000.0 * cells / 16,
        )  # fmt: skip
        found = resonances(sound.mouth, sound.rate, skip=0.02, order=24)[0]
        errors.append(float(np.abs(found - exact).min()))
    order = np.log2(np.array(errors[:-1]) / errors[1:])
    return [
        ("1 change of energy per step [1]", abs(last / first - 1.0) / (0.49 * rate), 1e-10),
        ("1 order of the time scheme, distance from 2", float(np.abs(order - 2.0).max()), 0.3),
    ]


def _published() -> list[Row]:
    """Check 2: every formant of the published shapes, if there are their files."""
    if not (SHARED / "artisynth_models" / "airway").exists():
        return []
    table = formant_table()
    limits = {"matrix, Hz": 1.0, "time, %": 1.0, "Kelly-Lochbaum, %": 1.0, "bandwidth, %": 5.0}
    return [
        (f"2 lossless formants of {len(table)} shapes, {name}" if k < 3 else
         f"3 bandwidths of {len(table)} shapes, time against matrix [%]", table[name].max(), limit)
        for k, (name, limit) in enumerate(limits.items())
    ]  # fmt: skip


def _any_shapes() -> list[Row]:
    """Time domain against matrix method for random tubes of up to 40 sections, lossless."""
    rng = np.random.default_rng(5)
    errors: list[float] = []
    for _ in range(20):
        n = int(rng.integers(8, 41))
        smooth = np.convolve(rng.standard_normal(n + 8), np.ones(9) / 3.0, "valid")
        areas, L = 3e-4 * np.exp(0.8 * smooth), float(rng.uniform(0.14, 0.19))
        exact = lossless_formants(areas, L)[:4]
        sound = simulate_tube(areas, L, CLICK, duration=0.3, medium=LOSSLESS)
        found = nearest(resonances(sound.mouth, sound.rate, skip=0.02, order=24)[0], exact)
        errors.append(float(np.abs(found / exact - 1.0).max()))
    return [("2 lossless formants of 20 random shapes, time, %", 100.0 * max(errors), 1.0)]


def _radiation_and_walls() -> list[Row]:
    area, L = 5e-5, 0.17
    medium = Medium(friction=0.0, yielding=0.0)
    found = formants(np.full(4, area), L, medium=medium)[0][0]
    correction = (350.0 / (4.0 * found) - L) / (8.0 * np.sqrt(area / np.pi) / (3.0 * np.pi))
    # walls of mass M and area C L, air of compliance V/(rho c^2): f = sqrt(C/(M S) + K/(M rho c^2))
    S = 4e-4
    areas = np.append(np.full(34, S), 0.0)
    wall = Medium(friction=0.0, damping=1.0)
    C = wall.circumference(S)
    omega = np.sqrt((wall.rho * wall.c**2 * C / S + wall.stiffness) / wall.mass)
    low = formants(areas, 0.175, medium=wall)[0][0]
    rows: list[Row] = [
        ("3 end correction over 8 r/(3 pi), distance from 1 [%]", 100 * abs(correction - 1), 1.0),
        ("3 F1 of a closed tube by its walls [%]", 100 * abs(low * 2 * np.pi / omega - 1.0), 2.0),
    ]
    for name, tube in (("a", AH), ("i", EE)):
        expected, width = formants(*tube)
        k = width[:4] < 300.0
        sound = simulate_tube(*tube, CLICK, duration=0.3)
        frequency, other = resonances(sound.mouth, sound.rate, order=32)
        here = np.abs(frequency[:, None] - expected[:4][k]).argmin(axis=0)
        error = np.abs(other[here] / width[:4][k] - 1.0).max()
        rows.append((f"3 bandwidths of {name}, time against matrix [%]", 100.0 * error, 5.0))
    return rows


def _moving() -> list[Row]:
    times, length = np.array([0.0, 0.1, 0.15, 0.35]), np.array([0.16, 0.16, 0.19, 0.19])
    source = Flow(rosenberg(np.arange(15_435) / 44_100.0, pitch=120.0), 44_100.0)
    sound = simulate_tube(np.full((4, 20), 3e-4), length, source, times=times, duration=0.35)
    # clicks rung on top of the changing tube give its formant before and after
    spectra: list[float] = []
    for at in (0.05, 0.25):
        here = np.zeros(15_435)
        here[int(at * 44_100)] = 1e-6
        y = simulate_tube(
            np.full((4, 20), 3e-4), length, Flow(here, 44_100.0), times=times, duration=0.35
        )
        found = resonances(y.mouth[int((at + 0.001) * y.rate) :], y.rate, duration=0.03, order=16)
        spectra.append(float(found[0][found[0] > 300.0][0]))
    ratio = jump_ratio(sound.radiated(44_100.0), 44_100.0, 0.05)
    exact = [formants(np.full(20, 3e-4), L)[0][0] for L in (0.16, 0.19)]
    return [
        ("4 length 16 to 19 cm in 50 ms, largest jump over the one before [1]", ratio, 3.0),
        (
            "4 F1 before and after [%]",
            100 * float(np.abs(np.array(spectra) / exact - 1).max()),
            1.0,
        ),
    ]


def jump_ratio(p: np.ndarray, rate: float, start: float) -> float:
    """Largest difference of successive samples over the largest one before, after `start` [s]."""
    jump = np.abs(np.diff(p))
    first = int(start * rate)
    before = np.maximum.accumulate(jump)[first - 1 : -1]
    return float((jump[first:] / np.maximum(before, 1e-12)).max())


def _fricative(front: float, flow: float) -> np.ndarray:
    n, L = 32, 0.16
    areas = np.full(n, 3e-4)
    first = n - round(front / L * n)
    areas[first - 2 : first] = 1.5e-5
    steady = Flow(flow * np.minimum(1.0, np.arange(11_025) / 2205.0), 44_100.0)
    sound = simulate_tube(areas, L, steady, duration=0.25, turbulence=Turbulence(), sections=64)
    return sound.radiated(44_100.0)[5512:]


def _geometry() -> list[Row]:
    """Check 5: tubes of known areas; the published airway and its rigid motion; a closed section."""
    from emgface.anatomy.airway.sections import sections

    rows: list[Row] = []
    cases = {
        "a straight": (STRAIGHT, 1.0), "a bent": (BENT, 1.0), "an elliptic": (STRAIGHT, 0.3),
    }  # fmt: skip
    for name, (line, flat) in cases.items():
        s = np.append(0, np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1)))
        found = sections(*pipe(line, 0.008 + 0.003 * np.sin(40 * s), flat=flat), line, count=40)
        middle = (np.arange(40) + 0.5) / 40 * s[-1]
        error = found.area / (np.pi * flat * (0.008 + 0.003 * np.sin(40 * middle)) ** 2) - 1.0
        rows.append((f"5 areas of {name} tube [%]", 100.0 * np.abs(error).max(), 1.0))
    position, triangle = pipe(STRAIGHT, 0.008)
    closed = position * np.where(np.abs(position[:, :1] - 0.1) < 0.01, [1.0, 0.0, 0.0], 1.0)
    rows.append(
        ("5 area of a closed section [m2]", sections(closed, triangle, STRAIGHT).area[23], 0.0)
    )
    if (SHARED / "artisynth_models" / "airway").exists():
        position, triangle, line = published_airway(SHARED)
        found = sections(position, triangle, line, count=30)
        turn = np.linalg.qr(np.random.default_rng(0).standard_normal((3, 3)))[0]
        moved = sections(position @ turn.T + 1.0, triangle, line @ turn.T + 1.0, count=30)
        rows += [
            ("5 length of the published airway [cm]", 100.0 * found.length, (15.0, 18.0)),
            ("5 change of its areas by a rigid motion [1]",
             float(np.abs(moved.area - found.area).max() / found.area.max()), 1e-9),
        ]  # fmt: skip
    return rows


def _folds() -> list[Row]:
    """Check 6: folds sustain, stop, rise in pitch and stay bounded."""
    f0 = [pitch(AH, Folds(tension=q), 0.35) for q in (0.5, 1.0, 2.0)]
    low, high = threshold(WIDE, Folds())
    linear = onset(Folds())
    before = np.mean(threshold(AH, Folds()))
    growth: list[float] = []
    for q in (0.5, 1.0, 2.0):
        for lung in (200.0, 785.0, 2000.0):
            flow = np.abs(simulate_tube(*AH, Folds(lung=lung, tension=q), duration=2.0).mouth)
            half = len(flow) // 2
            growth.append(flow[half:].max() / flow[:half].max())
    return [
        ("6 f0 at 785 Pa before an /a/ [Hz]", f0[1], (80.0, 300.0)),
        ("6 smallest ratio of f0 when the tension doubles [1]",
         min(f0[1] / f0[0], f0[2] / f0[1]), (1.0, 4.0)),
        ("6 threshold of the folds without a tract [Pa]", 0.5 * (low + high), (200.0, 500.0)),
        ("6 the same, from linear stability [%]", 100 * abs(0.5 * (low + high) / linear - 1), 5.0),
        ("6 threshold of the folds before an /a/ [Pa]", float(before), (200.0, 500.0)),
        ("6 largest flow of the second over that of the first of 2 s, q 0.5-2, 200-2000 Pa [1]",
         max(growth), 1.2),
    ]  # fmt: skip


def _noise() -> list[Row]:
    critical = 1800.0 * 1.86e-5 * np.sqrt(np.pi * 1.5e-5) / (2.0 * 1.14)
    quiet, loud = _fricative(0.02, 0.97 * critical).std(), _fricative(0.02, 3 * critical).std()
    peaks: list[float] = []
    for front in (0.04, 0.02):
        f, power = welch(_fricative(front, 4e-4), 44_100.0, nperseg=2048)
        inside = (f > 1000.0) & (f < 8000.0)
        peaks.append(float(f[inside][np.argmax(power[inside])]))
    t = np.arange(44_100) / 44_100.0
    spectrum = np.abs(np.fft.rfft(rosenberg(t, open_quotient=0.6, slope=2.0)))
    level = 20 * np.log10(spectrum[500:6400:100])  # harmonics from the fifth
    slope = np.polyfit(np.log2(np.arange(5, 64)), level, 1)[0]
    return [
        ("7 noise below over above the critical Reynolds number [1]", float(quiet / loud), 1e-3),
        ("7 peak with 4 cm over peak with 2 cm in front [1]", peaks[0] / peaks[1], 0.77),
        ("6 slope of a Rosenberg pulse, distance from -12 dB/octave", abs(slope + 12.0), 2.0),
    ]


def _wave() -> list[Row]:
    """Check 7: values of a wave file."""
    import tempfile

    from scipy.io import wavfile

    from emgface.anatomy.airway.area_function import ideal_vowel
    from emgface.anatomy.airway.sound import synthesise, write_wave

    with tempfile.TemporaryDirectory() as folder:
        path = write_wave(synthesise(ideal_vowel("a"), duration=0.3), Path(folder) / "a.wav")
        samples = wavfile.read(path)[1] / 32768.0
    return [
        ("7 largest value of a wave file [1]", float(np.abs(samples).max()), (0.1, 1.0)),
        ("7 values of it that are not finite", float((~np.isfinite(samples)).sum()), 0.0),
    ]


def folds() -> pd.DataFrame:
    """Threshold pressure and fundamental frequency of the folds before several tubes."""
    tracts = {"none": WIDE, "a": AH, "i": EE, "u": U, "uniform": (np.full(16, 3e-4), 0.17)}
    rows: list[dict[str, object]] = []
    for name, tube in tracts.items():
        for zeta in (0.1, 0.2):
            low, high = threshold(tube, Folds(zeta1=zeta))
            row: dict[str, object] = {"tract": name, "damping ratio": zeta}
            row["threshold Pa"] = f"{low:.0f} to {high:.0f}"
            inertance = 1.14 * tube[1] * float((1.0 / tube[0]).mean()) if name != "none" else 0.0
            row["linear stability Pa"] = round(onset(Folds(zeta1=zeta), inertance))
            for q in (0.5, 1.0, 2.0):
                given = Folds(lung=785.0, tension=q, zeta1=zeta)
                row[f"f0 Hz at q = {q:g}"] = round(pitch(tube, given, 0.35))
            rows.append(row)
    return pd.DataFrame(rows)


def threshold(tube: tuple[np.ndarray, float], source: Folds) -> tuple[float, float]:
    """Lung pressures [Pa] at which the folds rest and oscillate, less than 8 Pa apart."""
    low, high = 50.0, 500.0
    while high - low > 8.0:
        middle = 0.5 * (low + high)
        sustained = pitch(tube, replace(source, lung=middle), 1.5) > 0.0
        low, high = (low, middle) if sustained else (middle, high)
    return low, high


def onset(source: Folds, inertance: float = 0.0) -> float:
    """Lowest lung pressure [Pa] at which the equilibrium of the folds is unstable.

    Eigenvalues of the linearised equations of Ishizaka and Flanagan before a mass of air of some
    inertance [kg/m^4], written independently of the time scheme.
    """
    size = np.array([1e-4, 1.0, 1e-4, 1.0, 1e-4])
    state = np.array([0.3, 0.0, 0.3, 0.0, 0.5])
    for lung in np.arange(40.0, 1000.0, 2.0):
        state = fsolve(lambda x, P=lung: _motion(source, inertance, P, size * x) / size, state)
        jacobian = np.empty((5, 5))
        for k in range(5):
            d = np.zeros(5)
            d[k] = 1e-5 * size[k]
            ahead = _motion(source, inertance, lung, size * state + d)
            jacobian[:, k] = (ahead - _motion(source, inertance, lung, size * state - d)) / (
                2 * d[k]
            )
        rates = np.linalg.eigvals(jacobian)
        if (rates[rates.imag > 10.0].real > 0.0).any():
            return float(lung)
    return float("nan")


def _motion(f: Folds, inertance: float, lung: float, state: np.ndarray) -> np.ndarray:
    """Rates of change of x1, v1, x2, v2 and the flow U, with 0 pressure behind the mass of air."""
    rho, mu, q, length = 1.14, 1.86e-5, f.tension, f.length
    x1, v1, x2, v2, U = state
    a1, a2 = float(f.rest_area) + 2 * length * x1, float(f.rest_area) + 2 * length * x2
    R1, R2 = 12 * mu * length**2 * f.d1 / a1**3, 12 * mu * length**2 * f.d2 / a2**3
    L1, L2 = rho * f.d1 / a1, rho * f.d2 / a2
    drop = 0.5 * rho * (0.37 / a1**2 + 1.0 / a2**2) * U * abs(U) + (R1 + R2) * U
    rate = (lung - drop) / (L1 + L2 + inertance)
    p1 = lung - 0.685 * rho * (U / a1) ** 2 - 0.5 * (R1 * U + L1 * rate)
    p2 = p1 - 0.5 * ((R1 + R2) * U + (L1 + L2) * rate)
    p2 -= 0.5 * rho * U * abs(U) * (1 / a2**2 - 1 / a1**2)
    found = [v1, 0.0, v2, 0.0, rate]
    for at, m, k, zeta, x, v, other, p, d in (
        (1, f.m1 / q, f.k1 * q, f.zeta1, x1, v1, x2, p1, f.d1),
        (3, f.m2 / q, f.k2 * q, f.zeta2, x2, v2, x1, p2, f.d2),
    ):
        spring = k * x * (1 + f.cubic * x**2) + f.kc * q * (x - other)
        found[at] = (length * d * p - 2 * zeta * np.sqrt(m * k) * v - spring) / m
    return np.array(found)


def pitch(tube: tuple[np.ndarray, float], source: Folds, duration: float) -> float:
    """Fundamental frequency [Hz] of the last half of a sound; 0 without oscillation."""
    sound = simulate_tube(*tube, source, duration=duration)
    area = sound.glottal_area[len(sound.glottal_area) // 2 :]
    late = area[-len(area) // 4 :]
    if np.ptp(late) < 1e-8:
        return 0.0
    above = area > 0.5 * area.max()
    rises = np.flatnonzero(above[1:] & ~above[:-1])
    return sound.rate / float(np.median(np.diff(rises))) if len(rises) > 3 else 0.0
