"""Sources: folds, pulses, turbulence; pressure of a steady flow on walls."""

import numpy as np
import pytest
from scipy.signal import welch

from benchmarks.acoustic_shapes import AH
from emgface.acoustics import (
    Flow,
    Folds,
    Turbulence,
    rosenberg,
    simulate_tube,
    wall_pressure,
)
from emgface.acoustics.errors import AcousticsError
from tests.acoustics.folds import WIDE, onset

UNIFORM = np.full(16, 3e-4), 0.17


def pitch(sound, start=0.15):
    """Fundamental frequency [Hz] from the openings of the glottis; 0 without oscillation."""
    area = sound.glottal_area[int(start * sound.rate) :]
    if np.ptp(area) < 1e-8:
        return 0.0
    above = area > 0.5 * area.max()
    rises = np.flatnonzero(above[1:] & ~above[:-1])
    return sound.rate / np.median(np.diff(rises)) if len(rises) > 3 else 0.0


def test_folds_sustain_and_rise_in_pitch_with_tension_and_pressure():
    f = {
        (q, lung): pitch(simulate_tube(*AH, Folds(lung=lung, tension=q), duration=0.35))
        for q, lung in ((0.7, 785.0), (1.0, 785.0), (1.5, 785.0), (1.0, 400.0), (1.0, 1500.0))
    }
    assert 80.0 < f[0.7, 785.0] < f[1.0, 785.0] < f[1.5, 785.0] < 300.0
    assert 100.0 < f[1.0, 400.0] < f[1.0, 785.0] < f[1.0, 1500.0]


@pytest.mark.parametrize(("tube", "inertance"), [(WIDE, 0.0), (UNIFORM, 1.14 * 0.17 / 3e-4)])
def test_folds_begin_where_their_equilibrium_is_unstable(tube, inertance):
    """Without a tract at 216 Pa; a column of air lowers it, as of the eigenvalues of the equations."""
    linear = onset(Folds(), inertance)
    assert pitch(simulate_tube(*tube, Folds(lung=0.9 * linear), duration=1.0), 0.8) == 0.0
    assert pitch(simulate_tube(*tube, Folds(lung=1.2 * linear), duration=1.0), 0.5) > 100.0


def test_the_pitch_of_folds_does_not_depend_on_the_step():
    pitches = [
        pitch(simulate_tube(*AH, Folds(), duration=0.35, substeps=steps)) for steps in (3, 9)
    ]
    assert pitches[1] == pytest.approx(pitches[0], rel=0.01)


def test_stiff_folds_pass_the_steady_flow_of_their_resistance():
    """lung = rho/2 (0.37/A^2 + (1 - 2 N (1 - N))/A^2) U^2 + 12 mu l^2 (d1 + d2)/A^3 U."""
    area, lung = 1e-5, 500.0
    folds = Folds(lung=lung, rest_area=area, k1=1e7, k2=1e7, kc=1e6)
    sound = simulate_tube(*AH, folds, duration=0.3)
    N = area / AH[0][0]
    kinetic = 0.57 * (0.37 + 1.0 - 2.0 * N * (1.0 - N)) / area**2
    viscous = 12.0 * 1.86e-5 * 0.014**2 * 3e-3 / area**3
    expected = (-viscous + np.sqrt(viscous**2 + 4.0 * kinetic * lung)) / (2.0 * kinetic)
    assert sound.glottis[-1000:].mean() == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize("q", [0.5, 2.0])
@pytest.mark.parametrize("lung", [200.0, 3000.0])
def test_folds_stay_bounded(q, lung):
    sound = simulate_tube(*AH, Folds(lung=lung, tension=q), duration=1.0)
    half = len(sound.mouth) // 2
    assert np.abs(sound.mouth[half:]).max() <= 1.2 * np.abs(sound.mouth[:half]).max() + 1e-9
    assert sound.glottal_area.max() < 1e-4


def test_the_pulse_of_rosenberg():
    t = np.arange(44_100) / 44_100.0
    g = rosenberg(t, pitch=100.0, open_quotient=0.6, slope=2.0, peak=2e-4)
    assert g.max() == pytest.approx(2e-4, rel=1e-3) and g.min() >= 0.0
    assert np.argmax(g[:441]) == pytest.approx(0.4 * 441, abs=1)  # opening lasts 0.6 * 2/3
    assert not g[int(0.61 * 441) : 440].any()
    harmonic = 20.0 * np.log10(np.abs(np.fft.rfft(g))[100:6400:100])
    k = np.arange(1, 64)
    slope = np.polyfit(np.log2(k[4:]), harmonic[4:], 1)[0]
    assert slope == pytest.approx(-12.0, abs=2.0)
    with pytest.raises(AcousticsError, match="open quotient"):
        rosenberg(t, open_quotient=1.2)


def fricative(front, flow, area=1.5e-5, turbulence=None):
    """Radiated sound of a constriction before a front cavity [m], driven by a steady flow."""
    n, L = 32, 0.16
    areas = np.full(n, 3e-4)
    first = n - round(front / L * n)
    areas[first - 2 : first] = area
    steady = Flow(flow * np.minimum(1.0, np.arange(11_025) / 2205.0), 44_100.0)
    sound = simulate_tube(
        areas, L, steady, duration=0.25, turbulence=turbulence or Turbulence(), sections=64
    )
    return sound.radiated(44_100.0)[5512:]


def test_noise_begins_at_the_critical_reynolds_number():
    """Re = 2 rho U/(mu sqrt(pi S)) = 1800 at U = 1.01e-4 m^3/s."""
    critical = 1800.0 * 1.86e-5 * np.sqrt(np.pi * 1.5e-5) / (2.0 * 1.14)
    quiet, loud = fricative(0.02, 0.97 * critical), fricative(0.02, 3.0 * critical)
    assert loud.std() > 1e3 * quiet.std()


def test_a_shorter_front_cavity_raises_the_peak_of_a_fricative():
    peaks = []
    for front in (0.04, 0.02):
        f, power = welch(fricative(front, 4e-4), 44_100.0, nperseg=2048)
        inside = (f > 1000.0) & (f < 8000.0)
        peaks.append(f[inside][np.argmax(power[inside])])
    assert peaks[1] > 1.3 * peaks[0]


def test_noise_has_the_same_power_at_every_rate_and_repeats_its_seed():
    noise = Turbulence()
    levels = [noise.noise(200_000, rate, 3).std(axis=1) for rate in (44_100.0, 176_400.0)]
    assert levels[0] == pytest.approx(levels[1], rel=0.05)
    assert np.array_equal(noise.noise(100, 44_100.0, 5), noise.noise(100, 44_100.0, 5))
    assert not np.array_equal(noise.noise(100, 44_100.0, 5), noise.noise(100, 44_100.0, 6))


def test_pressure_on_walls_obeys_bernoulli_up_to_separation():
    areas = np.array([4.0, 2.0, 1.0, 1.1, 1.3, 4.0]) * 1e-4
    P, Q = wall_pressure(areas, 800.0)
    assert pytest.approx(1.2e-4 * np.sqrt(2 * 800.0 / 1.14)) == Q
    assert P[:4] == pytest.approx(800.0 * (1.0 - (1.2e-4 / areas[:4]) ** 2))
    assert not P[4:].any()  # the jet has the pressure outside
    back, flow = wall_pressure(areas[::-1], 0.0, outside=800.0)
    assert back[::-1] == pytest.approx(P) and flow == -Q


def test_a_closure_carries_the_lung_pressure_and_no_flow():
    areas = np.array([3.0, 3.0, 0.0, 3.0]) * 1e-4
    P, Q = wall_pressure(areas, 800.0)
    assert P[:2] == pytest.approx([800.0, 800.0], rel=1e-6) and P[3] == 0.0
    assert Q < 1e-6
    assert wall_pressure(areas, 0.0)[1] == 0.0
