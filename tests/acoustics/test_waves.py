"""Waves in time: formants, bandwidths, energy, order, sampling, closure, changing shapes."""

import numpy as np
import pytest

from benchmarks.acoustic_shapes import AH, EE, TABLE, tubes
from emgface.acoustics import (
    LOSSLESS,
    NO_TURBULENCE,
    Flow,
    Folds,
    LineBranch,
    Medium,
    Turbulence,
    formants,
    kelly_lochbaum,
    lossless_formants,
    resonances,
    rosenberg,
    simulate_tube,
)
from emgface.acoustics.errors import AcousticsError, CourantError

CLICK = Flow(np.array([0.0, 1e-6, 0.0]), 44_100.0)


def response(areas, length, medium, *, skip=0.0, order=32, **how):
    sound = simulate_tube(areas, length, CLICK, duration=0.3, medium=medium, **how)
    return resonances(sound.mouth + sound.nose, sound.rate, skip=skip, order=order)


def nearest(values, wanted):
    return values[np.abs(values[:, None] - wanted).argmin(axis=0)]


def test_impulse_responses_have_the_published_formants(shared):
    given = tubes(shared)
    for name, (lossless, _) in TABLE.items():
        frequencies, _ = response(*given[name], LOSSLESS, skip=0.02, order=24)
        assert nearest(frequencies, lossless) == pytest.approx(lossless, rel=0.01), name


@pytest.mark.parametrize("tube", [AH, EE])
def test_frequencies_and_bandwidths_agree_with_the_matrix_method(tube):
    expected, width = formants(*tube)
    k = width[:4] < 300.0
    frequencies, found_width = response(*tube, Medium())
    here = np.abs(frequencies[:, None] - expected[:4][k]).argmin(axis=0)
    assert frequencies[here] == pytest.approx(expected[:4][k], rel=0.01)
    assert found_width[here] == pytest.approx(width[:4][k], rel=0.05)


def test_a_nasal_branch_agrees_with_the_matrix_method():
    branch = LineBranch(np.array([1.0, 2.0, 4.0, 2.0, 1.0]) * 1e-4, 0.11, 0.085)
    expected, width = formants(*AH, branch=branch)
    sharp = expected[(width < 250.0) & (expected < 3500.0)]
    assert len(sharp) > 3  # more formants than without the branch
    frequencies, _ = response(*AH, Medium(), branch=branch)
    assert nearest(frequencies, sharp) == pytest.approx(sharp, rel=0.012)


@pytest.mark.parametrize("sections", [15, 16, 17])
def test_rows_end_after_the_last_node(sections):
    """Rows are filled up to a multiple of 16 entries, which never resonate; a uniform tube is exact."""
    frequencies, _ = response(
        np.full(4, 3e-4), 0.175, LOSSLESS, sections=sections, rate=350.0 * sections / 0.175,
        substeps=1, skip=0.02, order=24,
    )  # fmt: skip
    assert nearest(frequencies, [500.0, 1500.0, 2500.0]) == pytest.approx(
        [500.0, 1500.0, 2500.0], rel=1e-3
    )


def test_energy_of_the_lossless_tube_is_constant():
    """Sum of V p^2/(2 rho c^2) + rho A h u(n-1/2) u(n+1/2)/2, exact for the scheme."""
    N, L = 40, 0.16
    areas = np.random.default_rng(1).uniform(0.2e-4, 8e-4, N)
    medium = LOSSLESS

    def energy(duration):
        # so weak that the loss of the jet, which increases with the amplitude, is negligible
        weak = Flow(1e-12 * CLICK.values, CLICK.rate)
        y = simulate_tube(areas, L, weak, duration=duration, medium=medium, sections=N)
        p, u, h, dt = y.node_pressure, y.cell_velocity, L / N, 1.0 / y.rate
        V = 0.5 * h * (np.append(areas, 0.0) + np.append(0.0, areas))
        before = u + dt / (medium.rho * h) * np.diff(p)
        potential = (V[:-1] * p[:-1] ** 2).sum() / (2 * medium.rho * medium.c**2)
        return potential + 0.5 * medium.rho * h * (areas * u * before).sum()

    first = energy(0.01)
    assert first > 0.0
    assert energy(0.5) == pytest.approx(first, rel=1e-10)


def test_the_scheme_is_of_second_order():
    areas = (1.0 + 0.8 * np.sin(np.linspace(0, 4, 16))) * 3e-4
    exact = lossless_formants(areas, 0.16)[:3]
    errors = []
    for sections in (16, 32, 64):  # the step is proportional to the cell length
        frequencies, _ = response(
            areas,
            0.16,
            LOSSLESS,
            sections=sections,
            rate=50_000.0 * sections / 16,
            skip=0.02,
            order=24,
        )
        errors.append(np.abs(nearest(frequencies, exact) - exact)[2])
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.3)
    assert np.log2(errors[1] / errors[2]) == pytest.approx(2.0, abs=0.3)


def test_steady_flow_through_a_narrow_tube_is_that_of_poiseuille():
    """p = 8 pi mu L/S^2 U."""
    area, length, flow = 1e-6, 0.1, 1e-8
    source = Flow(np.full(20_000, flow), 44_100.0)
    sound = simulate_tube([area], length, source, duration=0.3)
    expected = 8.0 * np.pi * 1.86e-5 * length / area**2 * flow
    assert sound.pressure[-1] == pytest.approx(expected, rel=0.01)
    assert sound.mouth[-1] == pytest.approx(flow, rel=1e-3)


def test_lips_that_open_within_two_milliseconds_do_not_click():
    """The second difference of the sound stays that of the voice; velocities in a closure are small."""
    times, areas = [0.0, 0.1, 0.12, 0.2, 0.202, 0.3], np.tile(AH[0], (6, 1))
    areas[2:4, -2:] = 0.0
    sound = simulate_tube(areas, AH[1], Folds(), times=times, duration=0.3).radiated(44_100.0)
    kink = np.abs(np.diff(sound, 2))
    assert kink[8000:9400].max() < 1.5 * kink[2000:4000].max()


def test_results_do_not_depend_on_the_sampling_rate():
    peaks = []
    for rate in (16_000.0, 44_100.0, 96_000.0):
        source = Flow(rosenberg(np.arange(8820) / 44_100.0), 44_100.0)
        sound = simulate_tube(*AH, source, duration=0.2, rate=rate)
        p = sound.radiated(rate)
        assert len(p) == round(0.2 * rate)
        spectrum = np.abs(np.fft.rfft(p[int(0.1 * rate) :] / rate))
        peaks.append(spectrum[: int(2000 * 0.1)])
    for other in peaks[1:]:
        assert other == pytest.approx(peaks[0], abs=0.03 * peaks[0].max())


def test_kelly_lochbaum_is_exact_where_the_length_fits_its_grid():
    areas, length = np.repeat(AH[0], 4), AH[1]
    click = np.zeros(12_000)
    click[1] = 1e-6
    flow, rate = kelly_lochbaum(areas, length, click)
    frequencies, _ = resonances(flow, rate, skip=0.005, order=24)
    exact = lossless_formants(*AH)[:4]
    assert nearest(frequencies, exact) == pytest.approx(exact, rel=1e-3)


def test_steps_beyond_the_courant_limit_are_refused():
    with pytest.raises(CourantError, match="more steps per sample") as caught:
        simulate_tube(*AH, CLICK, duration=0.1, substeps=1)
    assert caught.value.number > 1.0


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"duration": 0.0}, "3600 s"),
        ({"sections": 1}, "at least 2"),
        ({"sections": 600}, "at most 503"),
        ({"source": Flow(np.array([np.nan]), 44_100.0)}, "finite samples"),
        ({"branch": LineBranch(np.full(2, 1e-4), 0.1, 0.5)}, "within the tube"),
        ({"source": Folds(lung=np.inf)}, "lung pressure"),
        ({"source": Folds(m1=0.0)}, "positive constants"),
        ({"source": Folds(rest_area=0.05)}, "check its unit"),
    ],
)
def test_unusable_requests_are_refused(given, words):
    how = {"areas": AH[0], "length": AH[1], "source": CLICK, "duration": 0.01} | given
    with pytest.raises(AcousticsError, match=words):
        simulate_tube(**how)


def test_a_silent_tube_stays_silent_while_its_shape_changes():
    times, areas = [0.0, 0.05, 0.1], np.stack([AH[0], np.zeros(16), EE[0][[*range(15), 14]]])
    sound = simulate_tube(
        areas,
        [0.15, 0.18, 0.16],
        Folds(lung=0.0),
        times=times,
        duration=0.1,
        turbulence=Turbulence(),
    )
    for signal in (sound.mouth, sound.glottis, sound.pressure):
        assert not signal.any()


def test_length_changes_without_clicks_and_the_formant_follows():
    times, length = np.array([0.0, 0.1, 0.15, 0.3]), np.array([0.16, 0.16, 0.19, 0.19])
    areas = np.full((4, 20), 3e-4)
    source = Flow(rosenberg(np.arange(13_230) / 44_100.0, pitch=120.0), 44_100.0)
    sound = simulate_tube(areas, length, source, times=times, duration=0.3)
    jumps = np.abs(np.diff(sound.radiated(44_100.0)))
    usual = jumps[882:4410].max()
    assert jumps[4410:].max() < 1.5 * usual
    late = sound.radiated(44_100.0)[11_025:]
    final = simulate_tube(areas[0], 0.19, source, duration=0.3).radiated(44_100.0)[11_025:]
    assert late == pytest.approx(final, abs=0.02 * np.abs(final).max())


def test_lips_close_while_the_folds_sound_and_open_again():
    times = [0.0, 0.1, 0.12, 0.2, 0.22, 0.35]
    areas = np.tile(AH[0], (6, 1))
    areas[2:4, -2:] = 0.0
    for turbulence in (NO_TURBULENCE, Turbulence()):
        sound = simulate_tube(
            areas, AH[1], Folds(), times=times, duration=0.35, turbulence=turbulence
        )
        p, rate = sound.radiated(44_100.0), sound.rate
        parts = ((0.05, 0.1), (0.14, 0.2), (0.28, 0.35))
        rms = [p[int(a * 44_100) : int(b * 44_100)].std() for a, b in parts]
        assert np.isfinite(p).all()
        assert rms[1] < 0.02 * rms[0]  # at least 34 dB less
        assert rms[2] == pytest.approx(rms[0], rel=0.1)
        closed = sound.pressure[int(0.18 * rate) : int(0.2 * rate)].mean()
        assert 0.5 * 785.0 < closed < 785.0  # pressure rises towards that of the lung


def test_random_tubes_stay_finite_and_do_not_grow():
    rng = np.random.default_rng(7)
    for k in range(25):
        areas = 10.0 ** rng.uniform(-8.5, -2.5, (2, rng.integers(3, 40)))
        lung = rng.uniform(0.0, 3000.0)
        sound = simulate_tube(
            areas, rng.uniform(0.1, 0.2, 2), Folds(lung=lung, tension=rng.uniform(0.5, 2.0)),
            times=[0.0, 0.03], duration=0.06, sections=int(rng.integers(10, 60)), seed=k,
            turbulence=Turbulence(),
        )  # fmt: skip
        p = sound.radiated(44_100.0)
        assert np.isfinite(sound.pressure).all() and np.isfinite(p).all()
        assert np.abs(p).max() < 50.0  # Pa; 30 cm before the mouth
